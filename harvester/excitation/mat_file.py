"""Columns of a .mat file: the real arrays in it, each a column or a table of columns."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np

from harvester.excitation.table import Table

# Classes of MATLAB that hold plain numbers; cells, structures, objects and code are not read.
NUMBER_CLASSES = {
    "double",
    "single",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}
# Numbers in all: a compressed file may claim more than it has bytes.
MOST_NUMBERS = 2**26


class MatTable(Table):
    """Samples by columns; names are those of the variables, `y[1]` for a column of a table.

    Parameters
    ----------
    content : bytes
        Of the whole file, in MATLAB's formats 4 to 7.2; scipy reads its numbers and nothing else.

    Attributes
    ----------
    names : list of str
    width, rows : int
        Columns, samples in each: those of the longest variables; shorter ones are left out.
    rate : None
        The file does not tell it.

    Raises
    ------
    ValueError
        It holds no such array.
    """

    def __init__(self, content: bytes) -> None:
        sizes = self._sizes(content)
        self.rows = max((max(shape) for shape in sizes.values()), default=0)
        kept = [name for name, shape in sizes.items() if max(shape) == self.rows]
        if sum(int(np.prod(sizes[name], dtype=float)) for name in kept) > MOST_NUMBERS:
            raise ValueError(f"its variables hold more than {MOST_NUMBERS} numbers: shorten it")
        self._columns: dict[str, np.ndarray] = {}
        for name, values in self._load(content, kept).items():
            table = np.atleast_2d(values)
            table = table.T if table.shape[0] != self.rows else table
            for place in range(table.shape[1]):
                label = name if table.shape[1] == 1 else f"{name}[{place}]"
                self._columns[label] = table[:, place]
        self.names = list(self._columns)
        self.width = len(self.names)

    def take(self, places: list[int]) -> list[np.ndarray]:
        """The columns at `places`, each float64 of shape (rows,)."""
        return [np.array(self._columns[self.names[place]], dtype=float) for place in places]

    def _sizes(self, content):
        """Shapes of the variables that hold numbers in at most two dimensions."""
        found = self._read("whosmat", content)
        return {
            name: shape
            for name, shape, kind in found
            if kind in NUMBER_CLASSES and len(shape) <= 2 and min(shape) > 0
        }

    def _load(self, content, names):
        values = self._read("loadmat", content, variable_names=names)
        found = {name: values[name] for name in names if name in values}
        return {name: each for name, each in found.items() if np.isrealobj(each)}

    def _read(self, function: str, content: bytes, **options: Any) -> Any:
        from scipy import io as scipy_io

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return getattr(scipy_io, function)(io.BytesIO(content), **options)
        # A broken file makes scipy raise whatever its parser meets.
        except Exception as error:
            raise ValueError(
                f"not a whole .mat file of numbers ({type(error).__name__}: {error}); save it in "
                "version 7 or older, or as .csv"
            ) from None

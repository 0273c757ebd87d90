"""Columns of a .npy file: one array of numbers, or of records with named fields."""

from __future__ import annotations

import io
import warnings

import numpy as np

from harvester.records.arrays import NUMBER_KINDS, is_complex
from harvester.records.table import Table


class NpyTable(Table):
    """Samples by columns; the fields of a structured array are columns with names.

    `content`: bytes of the whole file; pickled objects in it are not read. Raises ValueError if it
    holds no such array.
    """

    def __init__(self, content: bytes) -> None:
        table = _array(content)
        self.names = list(table.dtype.names or ())
        if table.ndim not in ((1,) if self.names else (1, 2)):
            raise ValueError(f"an array of shape {table.shape} is no table of samples by columns")
        self._table = table[:, None] if table.ndim == 1 and not self.names else table
        self.rows = len(table)
        self.width = len(self.names) or self._table.shape[1]
        columns = [self._table[name] for name in self.names] or list(self._table.T)
        self.complexes = [index for index, column in enumerate(columns) if is_complex(column)]

    def take(self, places: list[int]) -> list[np.ndarray]:
        return [self._column(index) for index in places]

    def _column(self, index):
        column = self._table[self.names[index]] if self.names else self._table[:, index]
        if column.dtype.kind not in NUMBER_KINDS or column.ndim != 1:
            raise ValueError(
                f"column {index} holds {column.dtype.name} and not one real number per sample"
            )
        with np.errstate(over="ignore"):
            return column.astype(complex) if is_complex(column) else column.real.astype(float)


def _array(content):
    if not content.startswith(b"\x93NUMPY"):
        raise ValueError("it does not begin as a .npy file does: save the array with numpy.save")
    try:
        # Warnings about a broken header say less than the error that follows.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.load(io.BytesIO(content), allow_pickle=False)
    # The header is a Python literal: numpy passes on any exception that evaluating it raises.
    except Exception as error:
        raise ValueError(
            f"not a whole .npy file of numbers ({type(error).__name__}: {error}); save the array "
            "with numpy.save"
        ) from None

"""Named arrays of a file (variables, data sets, channels) as one table of columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import numpy as np

from harvester.records.table import Table, Unreadable

REAL_KINDS, NUMBER_KINDS = "iuf", "iufc"
# Most numbers in a file. A compressed file may claim more than it has bytes.
MOST_NUMBERS = 2**26
# A single number with one of these names is the sampling rate (Hz), or the time between samples
# (s).
RATES = ("fs", "sampling_rate", "samplingrate", "sample_rate", "samplerate", "sampling_frequency")
INTERVALS = ("dt", "tinterval", "wf_increment")


class ArraysTable(Table):
    """The longest arrays, each a column or a table of columns; shorter ones are left out.

    A table's columns are named `y[0]`, `y[1]`, … .

    `shapes`: shapes of the arrays of numbers in one or two dimensions. `load`: function of the
    names of the longest arrays; gives them by name, as ndarrays of those shapes. `units`: units of
    arrays whose units the file says. Raises Unreadable if they hold too many numbers.
    """

    def __init__(
        self,
        shapes: Mapping[str, tuple[int, ...]],
        load: Callable[[list[str]], Mapping[str, np.ndarray]],
        units: Mapping[str, str] | None = None,
    ) -> None:
        sizes = {name: max(shape, default=1) for name, shape in shapes.items()}
        longest = max(sizes.values(), default=0)
        # A single number is no series of samples.
        self.rows = longest if longest > 1 else 0
        longest_names = [name for name, size in sizes.items() if size == self.rows]
        if sum(int(np.prod(shapes[name], dtype=float)) for name in longest_names) > MOST_NUMBERS:
            raise Unreadable(f"its arrays hold more than {MOST_NUMBERS} numbers: shorten it")
        self._columns: dict[str, np.ndarray] = {}
        self.units = []
        for name, values in load(longest_names).items():
            table = values[:, None] if values.ndim == 1 else values
            table = table.T if table.shape[0] != self.rows else table
            for column in range(table.shape[1]):
                label = name if table.shape[1] == 1 else f"{name}[{column}]"
                self._columns[label] = table[:, column]
                self.units.append((units or {}).get(name, ""))
        self.names = list(self._columns)
        self.width = len(self.names)
        self.complexes = [
            index for index, array in enumerate(self._columns.values()) if is_complex(array)
        ]

    def take(self, places: list[int]) -> list[np.ndarray]:
        columns = [self._columns[self.names[index]] for index in places]
        return [np.array(e, complex) if is_complex(e) else np.array(e.real, float) for e in columns]


def is_complex(values: np.ndarray) -> bool:
    """Whether an array holds complex numbers; such as one of frequencies beside them are real."""
    return np.iscomplexobj(values) and bool(values.imag.any())


def rate_of(numbers: Mapping[str, float]) -> float | None:
    """Sampling rate (Hz) that single numbers of a file say by their names, None where none does.

    `numbers`: single numbers by their names, also behind those of groups or structures. Raises
    Unreadable if two of them say different rates.
    """
    last = {name: re.split(r"[./]", name)[-1].lower() for name in numbers}
    rates = {name: value for name, value in numbers.items() if last[name] in RATES}
    intervals = {name: value for name, value in numbers.items() if last[name] in INTERVALS}
    rates |= {name: 1.0 / value for name, value in intervals.items() if value > 0.0}
    usable = {name: float(rate) for name, rate in rates.items() if 0.0 < rate < np.inf}
    if usable and max(usable.values()) > min(usable.values()) * (1.0 + 1e-6):
        listed = ", ".join(f"{name}: {rate:g} Hz" for name, rate in usable.items())
        raise Unreadable(f"it says several sampling rates ({listed}): keep one of them")
    return next(iter(usable.values()), None)

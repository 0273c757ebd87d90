"""Table of a file's columns, as the readers of formats return it."""

from __future__ import annotations

import contextlib
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harvester.base.errors import HarvesterError

REAL_KINDS, NUMBER_KINDS = "iuf", "iufc"
# Maximum size of a file, in bytes: binary, and text, which takes seconds to read.
LARGEST_BINARY, LARGEST_TEXT = 2**29, 2**27
# Maximum number of values in a file. A compressed file may claim more than its size.
MOST_NUMBERS = 2**26
# A single number with one of these names is the sampling rate (Hz) or the sampling interval (s).
RATES = ("fs", "sampling_rate", "samplingrate", "sample_rate", "samplerate", "sampling_frequency")
INTERVALS = ("dt", "tinterval", "wf_increment")


class Unreadable(ValueError):
    """A reader finds a fault in a file; the message is for the user."""


@contextlib.contextmanager
def broken_file(
    sort: str, cure: str, others: tuple[type[Exception], ...] = (MemoryError,)
) -> Iterator[None]:
    """Convert any exception of a library's parser within the block to `Unreadable`.

    Exceptions of the classes in `others` are passed on. Raises Unreadable.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except Exception as error:
        if isinstance(error, (Unreadable, HarvesterError, *others)):
            raise
        raise Unreadable(f"not a valid {sort} ({type(error).__name__}: {error}); {cure}") from None


@dataclass
class Table:
    """Columns of samples.

    Attributes
    ----------
    names
        Name of each column; "" for a column without a name.
    rows
        Samples in each column.
    take
        Function that returns the columns at some indices, each of shape (rows,): float64 with NaN
        for missing numbers, or complex128 for columns in `complexes`.
    units
        Units of the columns if the file states them separately from names; "" for none.
    rate
        Sampling rate (Hz) if the file states it.
    texts
        Indices of columns of text.
    complexes
        Indices of columns of complex numbers.
    remarks
        Remarks on the file for a result's notes.
    line_of
        Function that returns the number, from 1, of a row's line.
    """

    names: Sequence[str]
    rows: int
    take: Callable[[Sequence[int]], list[np.ndarray]]
    units: Sequence[str] = ()
    rate: float | None = None
    texts: Collection[int] = ()
    complexes: Sequence[int] = ()
    remarks: tuple[str, ...] = ()
    line_of: Callable[[int], int] = (1).__add__


class Format(NamedTuple):
    """A file format.

    Attributes
    ----------
    read
        Function of the file's bytes; raises ValueError, with a message for the user, if it cannot
        read the file.
    starts
        First bytes that select this format whatever the file's suffix.
    largest
        Maximum file size in bytes.
    """

    read: Callable[[bytes], Table]
    starts: tuple[bytes, ...] = ()
    largest: int = LARGEST_BINARY


def table_of(
    columns: Sequence[np.ndarray], names: Sequence[str], units: Sequence[str] = ()
) -> Table:
    """A table of real or complex arrays of shape (n,)."""

    def take(indices):
        for k in indices:
            if columns[k].dtype.kind not in NUMBER_KINDS or columns[k].ndim != 1:
                raise ValueError(
                    f"column {k} contains {columns[k].dtype.name}, not one real number per sample: "
                    "name another column"
                )
        with np.errstate(over="ignore"):
            return [
                columns[k].astype(complex) if k in complexes else columns[k].real.astype(float)
                for k in indices
            ]

    # In a file with complex columns, real columns such as the frequency have zero imaginary parts.
    complexes = [k for k, c in enumerate(columns) if np.iscomplexobj(c) and c.imag.any()]
    return Table(names, len(columns[0]) if columns else 0, take, units, complexes=complexes)


def table_of_longest(
    shapes: Mapping[str, tuple[int, ...]],
    load: Callable[[list[str]], Mapping[str, np.ndarray]],
    units: Mapping[str, str] | None = None,
    numbers: Callable[[list[str]], Mapping[str, float]] = lambda longest: {},
) -> Table:
    """A table of a file's longest arrays, each a column or a table of columns.

    A table's columns are named `y[0]`, `y[1]`, … .

    `shapes`: shapes of the numeric arrays in one or two dimensions. `load`: function of the names
    of the longest arrays that returns them by name. `units`: units of arrays, if the file states
    them. `numbers`: function of the names of the longest arrays that returns single numbers by
    name, from which `rate_of` selects the sampling rate. Raises Unreadable if there are too many
    numbers, or contradictory rates.
    """
    sizes = {name: max(shape, default=1) for name, shape in shapes.items()}
    # A single number is not a series of samples.
    rows = max((size for size in sizes.values() if size > 1), default=0)
    longest = [name for name, size in sizes.items() if size == rows]
    if sum(int(np.prod(shapes[name], dtype=float)) for name in longest) > MOST_NUMBERS:
        raise Unreadable(f"its arrays hold more than {MOST_NUMBERS} numbers: shorten it")
    columns: dict[str, np.ndarray] = {}
    column_units = []
    for name, values in load(longest).items():
        array = values[:, None] if values.ndim == 1 else values
        array = array.T if len(array) != rows else array
        labels = [f"{name}[{k}]" for k in range(array.shape[1])] if array.shape[1] > 1 else [name]
        columns |= zip(labels, array.T, strict=True)
        column_units += [(units or {}).get(name, "")] * len(labels)
    table = table_of([*columns.values()], [*columns], column_units)
    table.rate = rate_of(numbers(longest))
    return table


def rate_of(numbers: Mapping[str, float]) -> float | None:
    """Sampling rate (Hz) from a file's single numbers with names such as `fs`, else None.

    `numbers`: single numbers by name, optionally preceded by groups or structures. Raises
    Unreadable if two of them contradict each other.
    """
    last = {name: re.split(r"[./]", name)[-1].lower() for name in numbers}
    rates = {name: value for name, value in numbers.items() if last[name] in RATES}
    rates |= {name: 1.0 / dt for name, dt in numbers.items() if last[name] in INTERVALS and dt > 0}
    usable = {name: float(rate) for name, rate in rates.items() if 0.0 < rate < np.inf}
    if usable and max(usable.values()) > min(usable.values()) * (1.0 + 1e-6):
        listed = ", ".join(f"{name}: {rate:g} Hz" for name, rate in usable.items())
        raise Unreadable(f"it has several sampling rates ({listed}): keep one of them")
    return next(iter(usable.values()), None)

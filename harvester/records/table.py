"""Base class of the readers of record files."""

from __future__ import annotations

import contextlib
import warnings
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from harvester.base.errors import HarvesterError


class Unreadable(ValueError):
    """A fault that a reader finds in a file; the message is for the user."""


@contextlib.contextmanager
def broken_file(sort: str, cure: str) -> Iterator[None]:
    """Within the block, turn any exception of a library's parser into `Unreadable`.

    Raises Unreadable.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (Unreadable, HarvesterError, MemoryError):
        raise
    except Exception as error:
        raise Unreadable(f"not a whole {sort} ({type(error).__name__}: {error}); {cure}") from None


class Table(ABC):
    """Columns of samples.

    Attributes
    ----------
    names
        Names of the columns; empty where the file has none.
    units
        Units of the columns where they stand apart from the names ("" where none does); may be
        empty.
    width, rows
        Columns, samples in each.
    rate : Hz, where the file itself says it.
    texts
        Places of columns that hold words.
    complexes
        Places of columns of complex numbers.
    remarks
        Remarks on the file that go into a result's notes.
    """

    names: list[str]
    width: int
    rows: int
    units: Sequence[str] = ()
    rate: float | None = None
    texts: Collection[int] = ()
    complexes: Sequence[int] = ()
    remarks: tuple[str, ...] = ()

    @abstractmethod
    def take(self, places: list[int]) -> list[np.ndarray]:
        """The columns at `places`, each of shape (rows,); NaN where there is no number.

        float64, or complex128 of the places in `complexes`.
        """

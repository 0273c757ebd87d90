"""Columns of recorded motion from CSV, .npy, .wav and .mat files."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harvester.errors import SceneError
from harvester.excitation.mat_file import MatTable
from harvester.excitation.npy_file import NpyTable
from harvester.excitation.text_file import TextTable
from harvester.excitation.wav_file import WavTable
from harvester.files.plain_text import named, nearest, shown
from harvester.files.reading import memory_limit, read_input

# Bytes: a text takes seconds to read, and .npy of the same motion is smaller.
LARGEST_RECORD, LARGEST_TEXT = 2**29, 2**27
# A file lies in memory as it is, and decoded once more.
FILE_SHARE = 0.25
# Memory that reading and conditioning take for each sample, at most (measured: 92).
BYTES_PER_SAMPLE = 100
READERS: dict[str, Any] = {".npy": NpyTable, ".wav": WavTable, ".mat": MatTable}
# How files begin that are often named .csv, .npy or .wav by mistake.
FOREIGN = {
    b"PK\x03\x04": "a zip archive (.npz, .xlsx, .zip)",
    b"PK\x05\x06": "an empty zip archive",
    b"\x1f\x8b": "compressed (gzip)",
    b"BZh": "compressed (bzip2)",
    b"\xfd7zXZ": "compressed (xz)",
    b"\x28\xb5\x2f\xfd": "compressed (zstd)",
    b"\x89HDF": "an HDF5 file (.h5, .mat)",
}
SHOWN_NAMES = 12


class Columns(NamedTuple):
    """What a file holds, before units.

    Attributes
    ----------
    values : ndarray, shape (n,)
        NaN where the file holds no number.
    times : ndarray, shape (n,), or None
        s, as in the time column.
    sampling_rate : float or None
        Hz, where the file itself tells it.
    """

    values: np.ndarray
    times: np.ndarray | None
    sampling_rate: float | None


def read_record(file: str) -> tuple[bytes, str]:
    """(content, SHA-256) of a record's file.

    Raises
    ------
    SceneError
        It is no plain file, is too large, or cannot be read.
    """
    largest = LARGEST_RECORD if Path(file).suffix.lower() in READERS else LARGEST_TEXT
    content = read_input(file, "record", int(min(largest, FILE_SHARE * memory_limit())))
    return content, hashlib.sha256(content).hexdigest()


def most_samples() -> int:
    """That a record may have, by the memory they take."""
    return memory_limit() // BYTES_PER_SAMPLE


def read_columns(
    file: str, content: bytes, column: int | None = None, time_column: str | int | None = None
) -> Columns:
    """The column of motion, and that of time where one is named.

    Parameters
    ----------
    file : str
        `.npy`, `.wav`, or text with one line per sample: separated by commas, semicolons, tabs
        or blanks, with or without a header, comments after #, % or //.
    content : bytes
        Of that file.
    column, time_column : str, int or None
        Name in the header, or number from 0. Without `column` a file of one column besides
        time is read.

    Returns
    -------
    Columns

    Raises
    ------
    SceneError
    """
    where = named(file)
    with _telling(where):
        table = read_table(file, content)
        places = _places(where, table, column, time_column)
        values, *times = table.take(places)
    return Columns(values, times[0] if times else None, table.rate)


@contextlib.contextmanager
def _telling(where):
    """What a reader finds wrong, as a refusal of the file."""
    try:
        yield
    except ValueError as error:
        undecodable = isinstance(error, UnicodeDecodeError)
        reason = "it is no text in UTF-8: save it so" if undecodable else named(_one_line(error))
        raise SceneError(f"{where}: not a readable record: {reason}") from None


def _one_line(error):
    return " ".join(str(error).split())


def read_named_columns(
    file: str, content: bytes, wanted: Callable[[list[str], int], dict[str, int]]
) -> tuple[dict[str, np.ndarray], float | None]:
    """Several columns of a file by names of the caller's, and the rate where the file tells it.

    Parameters
    ----------
    file : str
    content : bytes
        Of that file.
    wanted : callable
        Of the header's names (empty without a header) and the number of columns; gives the place
        of each column by its new name.

    Raises
    ------
    SceneError
    """
    with _telling(named(file)):
        table = read_table(file, content)
        places = wanted(table.names, table.width)
        columns = table.take(list(places.values()))
    return dict(zip(places, columns, strict=True)), table.rate


def read_table(file: str, content: bytes) -> Any:
    """A file's table by its reader: names, width, rows, rate, take.

    Raises
    ------
    ValueError
        It is none, or has more samples than fit into memory.
    """
    sort = next((sort for start, sort in FOREIGN.items() if content.startswith(start)), None)
    if sort:
        raise ValueError(f"it is {sort}: unpack it, or save the samples as .csv, .npy or .wav")
    if not content:
        raise ValueError("it is empty")
    table = READERS.get(Path(file).suffix.lower(), TextTable)(content)
    if table.width == 0 or table.rows == 0:
        raise ValueError("it holds no samples")
    if table.rows > most_samples():
        raise ValueError(
            f"it has {table.rows} samples, and this machine's memory allows {most_samples()}: "
            "shorten it or lower its sampling rate"
        )
    return table


def _places(where, table, column, time_column):
    """Numbers of the column of motion and, where one is named, that of time."""
    names, width = table.names, table.width
    times = [] if time_column is None else [_place(where, "time_column", time_column, table)]
    if column is not None:
        return [_place(where, "column", column, table), *times]
    others = [place for place in range(width) if place not in times]
    if len(others) != 1:
        listed = _listed(names) or f"0 … {width - 1}"
        raise SceneError(f"{where}: excitation.column is missing; the file has {listed}")
    return [*others, *times]


def _place(where, key, wanted, table):
    """Number of a column given by name or number."""
    if isinstance(wanted, str):
        if wanted in table.names:
            return table.names.index(wanted)
        listed = _listed(table.names) or "no header, only numbers"
        raise SceneError(
            f"{where}: excitation.{key} = {shown(wanted)}: no such column"
            f"{nearest(wanted, table.names)}; the file has {listed}"
        )
    if not 0 <= wanted < table.width:
        raise SceneError(
            f"{where}: excitation.{key} = {shown(wanted)}: the file has columns "
            f"0 … {table.width - 1}"
        )
    return wanted


def _listed(names):
    more = f", … ({len(names)} in all)" if len(names) > SHOWN_NAMES else ""
    return ", ".join(named(name) for name in names[:SHOWN_NAMES]) + more

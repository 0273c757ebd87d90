"""Files of recorded motion: their size, their kind, and the reader of each kind."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harvester.errors import SceneError
from harvester.excitation.mat_file import MatTable
from harvester.excitation.npy_file import NpyTable
from harvester.excitation.table import Table
from harvester.excitation.text_file import TextTable
from harvester.excitation.wav_file import WavTable
from harvester.files.plain_text import named
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


@contextlib.contextmanager
def refused_as_record(where: str) -> Iterator[None]:
    """What a reader finds wrong, as a refusal of the file `where`."""
    try:
        yield
    except ValueError as error:
        undecodable = isinstance(error, UnicodeDecodeError)
        reason = "it is no text in UTF-8: save it so" if undecodable else named(_one_line(error))
        raise SceneError(f"{where}: not a readable record: {reason}") from None


def _one_line(error):
    return " ".join(str(error).split())


def read_table(file: str, content: bytes) -> Table:
    """A file's table by its reader.

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

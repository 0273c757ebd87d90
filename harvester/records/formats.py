"""Files of recorded motion: their size, their kind, and the reader of each kind."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harvester.base.errors import SceneError
from harvester.base.plain_text import named
from harvester.base.reading import memory_limit, read_input
from harvester.records.hdf5 import Hdf5Table
from harvester.records.ide import IdeTable
from harvester.records.lvm import LvmTable
from harvester.records.mat import MatTable
from harvester.records.npy import NpyTable
from harvester.records.table import Table
from harvester.records.tdms import TdmsTable
from harvester.records.text import TextTable
from harvester.records.wav import WavTable

# Largest record and largest text file, in bytes. A text takes seconds to read; .npy is smaller.
LARGEST_RECORD, LARGEST_TEXT = 2**29, 2**27
# Share of the memory limit for the file itself; it is held a second time when decoded.
FILE_SHARE = 0.25
# Memory per sample that reading and conditioning take, in bytes (92 were measured).
BYTES_PER_SAMPLE = 100
READERS: dict[str, Any] = {".npy": NpyTable, ".wav": WavTable, ".mat": MatTable}
# Readers by the first bytes of a file, whatever its ending.
READERS_BY_START: dict[bytes, Any] = {
    b"\x89HDF\r\n\x1a\n": Hdf5Table,
    b"MATLAB 7.3 MAT-file": Hdf5Table,
    b"TDSm": TdmsTable,
    b"\x1aE\xdf\xa3": IdeTable,
    b"LabVIEW Measurement": LvmTable,
}
BINARY_ENDINGS = (*READERS, ".h5", ".hdf5", ".hdf", ".nc", ".tdms", ".ide")
# First bytes of files that are often taken for records, and what to do with them.
UNPACK = "unpack it"
EXPORT = "export the samples as .csv from the program that wrote it"
FOREIGN = {
    b"PK\x03\x04": ("a zip archive (.npz, .xlsx, .zip)", f"{UNPACK}, or save its table as .csv"),
    b"PK\x05\x06": ("an empty zip archive", UNPACK),
    b"\x1f\x8b": ("compressed (gzip)", UNPACK),
    b"BZh": ("compressed (bzip2)", UNPACK),
    b"\xfd7zXZ": ("compressed (xz)", UNPACK),
    b"\x28\xb5\x2f\xfd": ("compressed (zstd)", UNPACK),
    b"7z\xbc\xaf": ("compressed (7z)", UNPACK),
    b"Rar!": ("compressed (rar)", UNPACK),
    b"\xd0\xcf\x11\xe0": ("an Excel workbook (.xls)", "save its sheet as .csv"),
    b"PAR1": ("a Parquet file", "save it by pandas.read_parquet(…).to_csv(…)"),
    b"ARROW1": ("an Arrow or Feather file", "save it by pandas.read_feather(…).to_csv(…)"),
    b"SQLite format 3": ("an SQLite database", EXPORT),
    b"CDF\x01": ("a NetCDF file of version 3", "save it as NetCDF 4 or .csv"),
    b"CDF\x02": ("a NetCDF file of version 3", "save it as NetCDF 4 or .csv"),
    b"fLaC": ("a FLAC file", "save it as .wav"),
    b"OggS": ("an Ogg file", "save it as .wav"),
    b"ID3": ("an MP3 file", "record it without loss, as .wav"),
    b"FORM": ("an AIFF file", "save it as .wav"),
    b"%PDF": ("a PDF document", EXPORT),
    b"<?xml": ("an XML file (.tdm, .gpx, …)", EXPORT),
    b"{": ("a JSON file", "save its arrays as .csv or .npy"),
    b"    -1": ("a universal file (.uff, .unv)", "read it by pyuff and save the samples as .csv"),
}


def read_record(file: str) -> tuple[bytes, str]:
    """(content, SHA-256) of a record's file.

    Raises SceneError if it is no plain file, is too large, or cannot be read.
    """
    largest = LARGEST_RECORD if Path(file).suffix.lower() in BINARY_ENDINGS else LARGEST_TEXT
    content = read_input(file, "record", int(min(largest, FILE_SHARE * memory_limit())))
    return content, hashlib.sha256(content).hexdigest()


def most_samples() -> int:
    """The largest number of samples of a record, by the memory that they take."""
    return memory_limit() // BYTES_PER_SAMPLE


@contextlib.contextmanager
def refused_as_record(where: str) -> Iterator[None]:
    """Within the block, turn a reader's errors into a SceneError that names the file."""
    try:
        yield
    except ValueError as error:
        reason = named(" ".join(str(error).split()))
        if isinstance(error, UnicodeDecodeError):
            reason = "it is no text in UTF-8: save it so"
        raise SceneError(f"{where}: not a readable record: {reason}") from None


def read_table(file: str, content: bytes) -> Table:
    """A file's table by its reader.

    Raises ValueError if it is none, or has more samples than fit into memory.
    """
    for start, (sort, cure) in FOREIGN.items():
        if content.startswith(start):
            raise ValueError(f"it is {sort}: {cure}")
    if not content:
        raise ValueError("it is empty")
    by_start = (sort for start, sort in READERS_BY_START.items() if content.startswith(start))
    reader = next(by_start, None) or READERS.get(Path(file).suffix.lower(), TextTable)
    table: Table = reader(content)
    if table.width == 0 or table.rows == 0:
        raise ValueError("it holds no samples")
    if table.rows > most_samples():
        raise ValueError(
            f"it has {table.rows} samples, and this machine's memory allows {most_samples()}: "
            "shorten it or lower its sampling rate"
        )
    return table

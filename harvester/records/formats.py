"""Size limits, formats and readers of measured files."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path

from harvester.base.errors import SceneError
from harvester.base.plain_text import named
from harvester.base.reading import memory_limit, read_input
from harvester.base.registry import Registry
from harvester.records import hdf5, ide, lvm, mat, npy, tdms, text, touchstone, wav
from harvester.records.table import Format, Table

# Formats by file suffix. Any other suffix means text, unless an installed package has an entry
# point of that name. First bytes take precedence over the suffix. LabVIEW's format is selected by
# its first bytes alone, as some .lvm files have no headers.
FORMATS: Registry[Format] = Registry(
    "harvester.record_formats",
    {
        **dict.fromkeys((".csv", ".txt", ".dat", ".tsv", ".asc", ".lvm"), text.FORMAT),
        ".npy": npy.FORMAT,
        ".wav": wav.FORMAT,
        ".mat": mat.FORMAT,
        **dict.fromkeys((".h5", ".hdf5", ".hdf", ".nc"), hdf5.FORMAT),
        ".tdms": tdms.FORMAT,
        ".ide": ide.FORMAT,
        ".s1p": touchstone.FORMAT,
        "LabVIEW": lvm.FORMAT,
    },
)
# Share of the memory limit for the file; decoding holds it in memory twice.
FILE_SHARE = 0.25
# Memory for reading and conditioning, in bytes per sample (92 were measured).
BYTES_PER_SAMPLE = 100
# First bytes of files that are often confused with records, with advice.
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


def read_content(file: str) -> tuple[bytes, str]:
    """(content, SHA-256) of a measured file.

    Raises SceneError if it is not a regular file, is too large, or cannot be read.
    """
    largest = int(min(format_of(file).largest, FILE_SHARE * memory_limit()))
    content = read_input(file, "record", largest)
    return content, hashlib.sha256(content).hexdigest()


def format_of(file: str, content: bytes = b"") -> Format:
    """The format of a file, by its first bytes if known, else by its suffix."""
    starts = (kind for kind in FORMATS.values() if content.startswith(kind.starts))
    return next(starts, None) or FORMATS.get(Path(file).suffix.lower(), text.FORMAT)


def most_samples() -> int:
    """The largest number of samples of a record that fits into the allowed memory."""
    return memory_limit() // BYTES_PER_SAMPLE


@contextlib.contextmanager
def readable_record(where: str) -> Iterator[None]:
    """Convert a reader's errors within the block to SceneError with the file's name."""
    try:
        yield
    except ValueError as error:
        reason = named(" ".join(str(error).split()))
        if isinstance(error, UnicodeDecodeError):
            reason = "it is not UTF-8 text: save it in UTF-8"
        raise SceneError(f"{where}: not a readable record: {reason}") from None


def read_table(file: str, content: bytes) -> Table:
    """Read a file as a table by the reader of its format.

    Raises ValueError if it is not a table, or has more samples than fit into memory.
    """
    for start, (sort, cure) in FOREIGN.items():
        if content.startswith(start):
            raise ValueError(f"it is {sort}: {cure}")
    if not content:
        raise ValueError("it is empty: export it again")
    table = format_of(file, content).read(content)
    if not table.names or not table.rows:
        raise ValueError("it contains no samples: export it again")
    if table.rows > most_samples():
        raise ValueError(
            f"it has {table.rows} samples, and this machine's memory allows {most_samples()}: "
            "shorten it or lower its sampling rate"
        )
    return table

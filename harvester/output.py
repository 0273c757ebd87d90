"""Files that are either whole or not there: written aside, then renamed."""

import contextlib
import json
import math
import os
import sys
import tempfile
from pathlib import Path

from harvester.errors import OutputError


@contextlib.contextmanager
def whole_file(path):
    """Path of a temporary file beside `path` that takes its place when the block succeeds.

    Raises
    ------
    OutputError
        The folder cannot be made or written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix
        )
        os.close(handle)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        yield Path(name)
        # mkstemp makes private files; the umask decides for results.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        Path(name).unlink(missing_ok=True)


def write_text(path, text):
    """Write a text file, whole; `-` is standard output."""
    if str(path) == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def finite(value):
    """A number for JSON: None for None and for what is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def write_json(path, content):
    """Write JSON, whole; `-` is standard output."""
    write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def check_writable(path):
    """Refuse early what could not be written after a long run."""
    if path is None or str(path) == "-":
        return
    path = Path(path)
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; name a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise OutputError(f"{path.parent}: cannot be written: {error.strerror}") from None

"""Reads files named by a user as a whole, if they are regular files of limited size."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any

from harvester.base.errors import HarvesterError, SceneError
from harvester.base.plain_text import named

# Memory limit for one record: largest share of the machine's memory, and largest number of bytes.
MEMORY_SHARE = 0.25
LARGEST_MEMORY = 4 * 2**30
# Largest size of a result's file (bytes).
LARGEST_RESULT = 100_000_000

_SORTS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def memory_limit() -> int:
    """Memory limit for reading and conditioning one record, per process (bytes)."""
    physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return int(min(MEMORY_SHARE * physical, LARGEST_MEMORY))


def read_input(file: Path | str, noun: str, largest: int) -> bytes:
    """The bytes of a plain file.

    Raises SceneError if the file is not regular (a device or pipe may be endless), is larger than
    `largest`, or cannot be read.
    """
    where = named(str(file))
    try:
        # Checked before it is opened, since opening a device may have an effect.
        _check(os.stat(file), where, noun, largest)
        # O_NONBLOCK: if a pipe has replaced the file since then, opening does not block.
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, "rb") as stream:
            return stream.read(_check(os.fstat(descriptor), where, noun, largest))
    except OSError as error:
        reason = error.strerror
        if isinstance(error, FileNotFoundError) and os.path.islink(file):
            reason = f"it is a link to {named(os.readlink(file))}, which does not exist"
        raise SceneError(f"{where}: the {noun} cannot be read: {reason}") from None
    except ValueError:
        raise SceneError(f"{where}: the {noun} cannot be read: no file has such a name") from None
    except MemoryError:
        raise SceneError(
            f"{where}: the {noun} does not fit into the free memory: free memory, or shorten it"
        ) from None


def read_json(file: Path | str) -> Any:
    """The content of a JSON file of `harvester.save`; raises HarvesterError."""
    try:
        return json.loads(read_input(file, "result in JSON", LARGEST_RESULT))
    except (ValueError, RecursionError):
        raise HarvesterError(
            f"{named(str(file))}: not a JSON file; give one that harvester.save, --json or "
            "--output wrote"
        ) from None


def _check(status, where, noun, largest):
    """Return the size of a file in bytes; raise if it is not regular or too large."""
    for is_sort, sort in _SORTS:
        if is_sort(status.st_mode):
            raise SceneError(f"{where}: is {sort}; a {noun} must be a regular file: save it as one")
    if status.st_size > largest:
        raise SceneError(
            f"{where}: is too large for a {noun}: {status.st_size / 1e6:.4g} MB, and "
            f"{largest / 1e6:.4g} MB is the most: shorten it"
        )
    return status.st_size

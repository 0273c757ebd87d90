"""Writes files atomically, with links resolved, and streams directly."""

from __future__ import annotations

import contextlib
import io
import math
import os
import secrets
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.base.errors import OutputError
from harvester.base.plain_text import json_text

if TYPE_CHECKING:
    from _io import BytesIO

# The licence text at the head of every file that is written for other programs.
LICENCE = (
    "Made by harvester. You may use, change and pass on this file under any terms: its lines of",
    "harvester are free of the program's own licence, see LICENSE-EXCEPTION there.",
)
STANDARD_OUTPUT = 1
# Folders whose entries are this process's open files.
OPEN_FILES = ("/dev/fd", "/proc/self/fd", "/proc/thread-self/fd")
MOST_LINKS = 40
# Name of the temporary file that replaces the old file; it remains if the process is killed.
ASIDE = ".harvester-{}"
ASIDE_BYTES = 8
UNWRITABLE = {stat.S_IFDIR: "a folder", stat.S_IFSOCK: "a socket", stat.S_IFBLK: "a disk"}


@contextlib.contextmanager
def whole_file(path: Path | str) -> Iterator[BytesIO]:
    """Binary file in memory whose content is written to `path` when the block succeeds.

    A regular file, or the target of a link, is replaced atomically and keeps its permissions; a new
    file follows the umask. Character devices, FIFOs and /dev/stdout are written to directly. `-` is
    standard output.

    Raises OutputError if writing fails; an existing file is then unchanged.
    """
    content = io.BytesIO()
    yield content
    with _named(path):
        _write(path, content.getbuffer())


def write_text(path: str | Path, text: str) -> None:
    """Write text as UTF-8, see `whole_file`."""
    with whole_file(path) as file:
        # File names may contain bytes that are not UTF-8.
        file.write(text.encode("utf-8", "backslashreplace"))


def write_json(path: str | Path, content: Any) -> None:
    """Write JSON, see `whole_file`."""
    write_text(path, json_text(content, indent=2) + "\n")


def finite(value: float | None) -> float | None:
    """A number for JSON: None for None, NaN and infinities."""
    return None if value is None or not math.isfinite(value) else float(value)


def is_standard_output(path: str | Path | None) -> bool:
    """Whether this path is standard output."""
    return path is not None and _open_file(path) == STANDARD_OUTPUT


def is_stream(path: str | Path) -> bool:
    """Whether writing creates no file: standard output, a device, a FIFO."""
    path = Path(path)
    return _open_file(path) is not None or (
        path.exists() and not path.is_file() and not path.is_dir()
    )


def check_writable(path: str | Path) -> None:
    """Raise before a long run if its result could not be written."""
    if path is None:
        return
    with _named(path):
        number = _open_file(path)
        if number is not None:
            if str(path) != "-":
                os.close(os.dup(number))
            return
        status = _status(path)
        if status is None or stat.S_ISREG(status.st_mode):
            check_folder(_real_path(path, status).parent)


def check_folder(folder: str | Path) -> None:
    """Raise early if a folder cannot be created or written; it is not created."""
    with _named(folder):
        missing = [
            parent for parent in (Path(folder), *Path(folder).parents) if not parent.exists()
        ]
        Path(folder).mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        with contextlib.suppress(OSError):
            for parent in missing:
                parent.rmdir()


def in_folder(folder: str | Path, file: str) -> Path:
    """Path in a folder of a file whose name the program chooses.

    Raises OutputError if the name exists but is not a regular file of that folder.
    """
    path = Path(folder) / file
    with _named(path):
        status = _status(path)
        if status is not None and not stat.S_ISREG(status.st_mode):
            raise OutputError(f"{path}: is not a regular file, and would be overwritten; remove it")
        real = Path(os.path.realpath(path))
        if os.path.islink(path) and real.parent != Path(os.path.realpath(folder)):
            raise OutputError(f"{path}: is a link to {real}, outside the folder; remove it")
    return path


@contextlib.contextmanager
def _named(path):
    """Convert system errors within the block to an `OutputError` that names the path."""
    try:
        yield
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        where = "standard output" if str(path) == "-" else path
        raise OutputError(f"{where}: cannot be written: {reason}") from None


def _open_file(path):
    """Descriptor of this process's open file for a path such as /dev/fd/3, or None."""
    if str(path) == "-":
        return STANDARD_OUTPUT
    folders = {os.path.realpath(folder) for folder in OPEN_FILES}
    path = os.path.abspath(path)
    for _ in range(MOST_LINKS):
        folder, name = os.path.realpath(os.path.dirname(path)), os.path.basename(path)
        if folder in folders and name.isdecimal():
            return int(name)
        if not os.path.islink(path):
            break
        path = os.path.join(folder, os.readlink(path))
    return None


def _status(path):
    """`os.stat` of a path, following links; None if it does not exist."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return None
    kind = stat.S_IFMT(status.st_mode)
    if kind in UNWRITABLE:
        raise OutputError(f"{path}: is {UNWRITABLE[kind]}; name a file")
    if not os.access(path, os.W_OK):
        raise OutputError(f"{path}: cannot be written: it is write-protected; name another file")
    return status


def _real_path(path, status):
    """Path of the file to be written; raises if it is a link into a missing folder."""
    real = Path(os.path.realpath(path))
    if status is None and os.path.islink(path) and not real.parent.is_dir():
        raise OutputError(f"{path}: is a link into a missing folder, {real.parent}: create it")
    return real


def _write(path, content):
    number = _open_file(path)
    if number == STANDARD_OUTPUT:
        _write_standard_output(content)
        return
    status = None if number is not None else _status(path)
    if number is None and (status is None or stat.S_ISREG(status.st_mode)):
        _replace(_real_path(path, status), status, content)
        return
    with open(path if number is None else os.dup(number), "wb") as stream:
        stream.write(content)


def _write_standard_output(content):
    binary = getattr(sys.stdout, "buffer", None)
    if binary is None:
        sys.stdout.write(bytes(content).decode("utf-8"))
    else:
        sys.stdout.flush()
        binary.write(content)
    sys.stdout.flush()


def _replace(real, old, content):
    """Replace or create a file atomically; a failure changes nothing."""
    real.parent.mkdir(parents=True, exist_ok=True)
    aside = real.with_name(ASIDE.format(secrets.token_hex(ASIDE_BYTES)))
    try:
        # tempfile would make a private file; here the umask sets the permissions.
        with open(aside, "xb") as file:
            file.write(content)
        if old is not None:
            _keep_rights(aside, old)
        os.replace(aside, real)
    finally:
        aside.unlink(missing_ok=True)


def _keep_rights(path, old):
    """Give the new file the owner and permissions of the replaced one."""
    new = os.stat(path)
    if (new.st_uid, new.st_gid) != (old.st_uid, old.st_gid):
        with contextlib.suppress(OSError):
            os.chown(path, old.st_uid, old.st_gid)
    os.chmod(path, stat.S_IMODE(old.st_mode) & 0o777)

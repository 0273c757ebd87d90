"""A study's folder: one run at a time; temporary files of killed runs are removed."""

import contextlib
import os
import re
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

from harvester.base.errors import FolderInUse, OutputError
from harvester.base.writing import ASIDE, ASIDE_BYTES, check_writable

LOCK = ".harvester-lock"
_LEFT_ASIDE = re.compile(re.escape(ASIDE.format("")) + f"[0-9a-f]{{{2 * ASIDE_BYTES}}}")
_HOLDER = re.compile(r"process \d{1,10} on [\w.-]{1,64}")
_HANDLES: set[int] = set()


class StudyFolder(os.PathLike):
    """A folder that only one run at a time may use; `notes` are messages for the user.

    The operating system locks an open file: the lock ends with the process, even if it is killed.
    """

    def __init__(self, path: str | os.PathLike):
        self._path = Path(path)
        self._handle: int | None = None
        self._made = False
        self.notes: list[str] = []

    def __fspath__(self) -> str:
        return str(self._path)

    def hold(self) -> None:
        """Lock the folder until `close`, and remove a killed run's temporary files; repeatable.

        Raises FolderInUse, or OutputError if the folder cannot be used.
        """
        if self._handle is not None:
            return
        new = not os.path.lexists(self._path)
        _check(self._path)
        handle = _open(self._path / LOCK)
        try:
            self.notes = _lock(handle, self._path)
        except BaseException:
            os.close(handle)
            raise
        self._handle, self._made = handle, new
        _HANDLES.add(handle)
        if not self.notes:
            _clean(self._path)

    def close(self) -> None:
        """Release the lock; remove the folder if this run made it and it is empty."""
        handle, self._handle = self._handle, None
        if handle is not None:
            if self._made:
                _take_away(self._path)
            _HANDLES.discard(handle)
            os.close(handle)


@contextlib.contextmanager
def held(folder: str | os.PathLike) -> Iterator[StudyFolder]:
    """A `StudyFolder` locked within the block; a given `StudyFolder` stays locked afterwards."""
    if isinstance(folder, StudyFolder):
        folder.hold()
        yield folder
        return
    with contextlib.closing(StudyFolder(folder)) as opened:
        opened.hold()
        yield opened


def _check(folder):
    for path in (folder, folder / "points"):
        if os.path.lexists(path) and not os.path.isdir(path):
            raise OutputError(f"{path}: is not a folder; choose another --output")
        try:
            os.makedirs(path, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"{path}: cannot be created: {error.strerror}; choose another --output"
            ) from None
        check_writable(path / "file")


def _open(path):
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        handle = os.open(path, flags, 0o666)
    except OSError as error:
        raise OutputError(f"{path}: cannot be opened: {error.strerror}; remove it") from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OutputError(f"{path}: is not a file; remove it")
    return handle


def _lock(handle, folder):
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        text = os.pread(handle, 100, 0).decode(errors="replace").strip()
        holder = text if _HOLDER.fullmatch(text) else "another process"
        raise FolderInUse(
            f"{folder}: another run uses this folder ({holder}); wait until it ends, or "
            "choose another --output"
        ) from None
    except (ImportError, OSError):
        return [f"{folder}: this file system cannot lock files: let no other run write there"]
    if os.fstat(handle).st_nlink == 0:
        raise FolderInUse(f"{folder}: another run has just ended in this folder; start again")
    # A file with a second name (hard link) may belong to another user.
    if os.fstat(handle).st_nlink == 1:
        with contextlib.suppress(OSError):
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
    return []


def _take_away(folder):
    """Remove a folder that contains only the lock file and an empty folder for answers."""
    with contextlib.suppress(OSError):
        if sorted(os.listdir(folder)) == [LOCK, "points"]:
            os.rmdir(folder / "points")
            os.unlink(folder / LOCK)
            os.rmdir(folder)


def _clean(folder):
    """Remove temporary files of killed runs; keep files with other names."""
    for path in (folder, folder / "points"):
        with os.scandir(path) as entries:
            names = [
                entry.path
                for entry in entries
                if _LEFT_ASIDE.fullmatch(entry.name) and entry.is_file(follow_symlinks=False)
            ]
        for name in names:
            with contextlib.suppress(OSError):
                os.unlink(name)


def _let_go():
    """Close the lock file in a forked process: only the parent process keeps the lock."""
    for handle in _HANDLES:
        os.close(handle)
    _HANDLES.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)

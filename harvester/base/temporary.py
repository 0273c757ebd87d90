"""Temporary folders; the next run removes folders of killed runs."""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import tempfile
import weakref
from pathlib import Path
from types import TracebackType

# Prefixes of folders in use, and of folders that their process has not locked yet.
IN_USE, UNLOCKED = "harvester-run-", "harvester-new-"


class TemporaryFolder:
    """An empty folder of this process, removed by `cleanup` or at the end of the block or process.

    A killed process does not remove its folder, but the system releases the folder's lock. The next
    process that creates a folder removes unlocked ones.

    `within`: parent folder; None: the system's folder for temporary files.

    Attributes
    ----------
    name : str
        Path of the folder.
    """

    def __init__(self, within: str | Path | None = None) -> None:
        parent = str(within or tempfile.gettempdir())
        clear_abandoned(parent)
        unlocked = tempfile.mkdtemp(prefix=UNLOCKED, dir=parent)
        lock = _lock(unlocked)
        self.name = os.path.join(parent, os.path.basename(unlocked).replace(UNLOCKED, IN_USE, 1))
        os.rename(unlocked, self.name)
        self._end = weakref.finalize(self, _remove, self.name, lock)

    def __enter__(self) -> str:
        return self.name

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.cleanup()

    def cleanup(self) -> None:
        """Remove the folder with its content."""
        self._end()


@functools.cache
def clear_abandoned(place: str) -> None:
    """Remove this user's abandoned folders in `place`; once per process.

    `place`: parent folder of `TemporaryFolder`.
    """
    with contextlib.suppress(OSError), os.scandir(place) as entries:
        for entry in entries:
            if entry.name.startswith(IN_USE) and _is_own_folder(entry):
                lock = _lock(entry.path)
                if lock is not None:
                    _remove(entry.path, lock)


def _is_own_folder(entry):
    return (
        entry.is_dir(follow_symlinks=False)
        and entry.stat(follow_symlinks=False).st_uid == os.geteuid()
    )


def _lock(folder):
    """A handle that holds the folder's lock; None if the lock is taken or not available."""
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except (ImportError, OSError):
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def _remove(folder, lock):
    shutil.rmtree(folder, ignore_errors=True)
    if lock is not None:
        os.close(lock)

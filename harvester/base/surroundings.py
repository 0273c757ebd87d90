"""Protection from the working folder's settings files and from folders that others may write to."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


@contextlib.contextmanager
def away_from_working_folder() -> Iterator[None]:
    """The package's own folder as the working folder within the block.

    For the imports of libraries that read a file of their settings from wherever they are.
    """
    try:
        before = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        # A working folder that cannot be read has no settings files.
        yield
        return
    try:
        os.chdir(PACKAGE)
        yield
    finally:
        os.fchdir(before)
        os.close(before)


def foreign_writers_of(path: str | Path) -> str:
    """Which other user (not this one, not the program's owner) may change the file at a path.

    The path is of a file or a folder; missing folders are made by this user. Returns the path
    and the reason; empty where nobody may.
    """
    path = Path(os.path.realpath(path))
    for entry in (path, *path.parents):
        try:
            about = os.stat(entry)
        except FileNotFoundError:
            continue
        foreign = other_writers(about)
        if "belongs" in foreign:
            return f"{entry} {foreign}"
        # In a folder with the sticky bit everyone may add files, but only the owner may replace
        # them.
        if entry != path and about.st_mode & stat.S_ISVTX:
            continue
        if foreign:
            return f"{entry} {foreign}"
    return ""


def other_writers(about: os.stat_result) -> str:
    """Why another user may change a file with this status; empty where nobody may."""
    if about.st_uid not in {0, os.geteuid(), PACKAGE.stat().st_uid}:
        return "belongs to another user"
    # A group with the owner's number is the owner's own.
    shared = stat.S_IWGRP if about.st_gid != about.st_uid else 0
    return "can be written by others" if about.st_mode & (shared | stat.S_IWOTH) else ""

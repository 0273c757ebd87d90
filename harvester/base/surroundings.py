"""Protects from settings files in the working folder and from folders writable by others."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


@contextlib.contextmanager
def away_from_working_folder() -> Iterator[None]:
    """Use the package's folder as the working folder within the block.

    For importing libraries that read settings files from the working folder.
    """
    try:
        before = os.open(".", os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        # An unreadable working folder has no settings files.
        yield
        return
    try:
        os.chdir(PACKAGE)
        yield
    finally:
        os.fchdir(before)
        os.close(before)


def foreign_writers_of(path: str | Path) -> str:
    """Return why other users can change the file at a path, except the program's owner.

    The path is of a file or folder; this user will create missing folders. Returns the path that
    others can change and the reason; empty if nobody can.
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
    """Why another user can change a file with this status; empty if nobody can."""
    if about.st_uid not in {0, os.geteuid(), PACKAGE.stat().st_uid}:
        return "belongs to another user"
    # A group with the owner's number is private to the owner.
    shared = stat.S_IWGRP if about.st_gid != about.st_uid else 0
    return "can be written by others" if about.st_mode & (shared | stat.S_IWOTH) else ""

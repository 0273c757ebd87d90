"""Where numba keeps what it has compiled, and whether to believe it: it is pickled machine code."""

import os
from pathlib import Path

from harvester.files.surroundings import PACKAGE, who_else_writes


def is_safe():
    """Whether nobody but this user and the program's owner may write to numba's cache.

    It lies in NUMBA_CACHE_DIR, else beside the sources, else in a folder of the user's.
    """
    from numba.core import config
    from numba.misc.appdirs import AppDirs

    folder = config.CACHE_DIR
    if not folder:
        if all(_may_write_beside(source) for source in PACKAGE.rglob("*.py")):
            return True
        folder = AppDirs("numba", appauthor=False).user_cache_dir
    return not any(map(who_else_writes, [folder, *Path(folder).rglob("*")]))


def _may_write_beside(source):
    beside = source.parent / "__pycache__"
    return os.access(beside if beside.exists() else source.parent, os.W_OK)

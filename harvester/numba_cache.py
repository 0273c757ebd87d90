"""Where numba keeps what it has compiled, and whether to believe it: it is pickled machine code."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

from harvester.files.surroundings import PACKAGE, who_else_writes

# Packages whose types may stand in the cache: code for a part defined elsewhere is compiled anew in
# each process, and no other process stumbles over a class that it does not have.
OWN = ("harvester", "circuits")


def keep_to_own_types() -> None:
    """Make numba's indexes hold types of this program only, and one that cannot be read none.

    An index is read whole: with a type whose module is gone numba would stop there.
    """
    from numba.core import caching

    class OwnIndex(caching.IndexDataCacheFile):
        def save(self, key, data):
            if not _foreign(key[0]):
                super().save(key, data)

        def _load_index(self):
            try:
                return super()._load_index()
            except (ImportError, AttributeError, EOFError, pickle.UnpicklingError):
                return {}

    caching.IndexDataCacheFile = OwnIndex


def _foreign(kind):
    """Whether a numba type, or one within it, belongs to a class of another program."""
    made = getattr(kind, "instance_class", None)
    if made is not None and made.__module__.partition(".")[0] not in OWN:
        return True
    inner = kind if isinstance(kind, tuple) else getattr(kind, "types", ())
    return any(_foreign(each) for each in inner)


def is_safe() -> bool:
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

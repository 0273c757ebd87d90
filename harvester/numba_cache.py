"""Where numba keeps what it has compiled, and whether to believe it: it is pickled machine code."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
from collections.abc import Iterator
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


def wait_for_other_processes() -> None:
    """Let a process that needs code which another is just compiling wait and take that one's.

    Workers that begin together would all compile the same for seconds.
    """
    from numba.core import caching, dispatcher
    from numba.core.compiler_lock import global_compiler_lock

    compile_now = dispatcher.Dispatcher.compile

    @functools.wraps(compile_now)
    def compile_once(self, signature):
        if isinstance(self._cache, caching.NullCache):
            return compile_now(self, signature)
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}{signature}"
        # The process's own lock first: of its threads only one then waits for other processes.
        with global_compiler_lock, _alone(Path(self._cache.cache_path), name):
            return compile_now(self, signature)

    dispatcher.Dispatcher.compile = compile_once  # type: ignore[method-assign, assignment]


@contextlib.contextmanager
def _alone(folder: Path, name: str) -> Iterator[None]:
    """The only process of this machine that compiles this; with others where it cannot be had.

    A byte of one file is locked, which the system gives back when the process ends and refuses
    where two would wait for each other.
    """
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4])
    handle, fcntl = _lock_file(folder)
    held = False
    if handle is not None:
        with contextlib.suppress(OSError):
            fcntl.lockf(handle, fcntl.LOCK_EX, 1, place)
            held = True
    try:
        yield
    finally:
        if held:
            fcntl.lockf(handle, fcntl.LOCK_UN, 1, place)


@functools.cache
def _lock_file(folder):
    """Open for as long as the process lives: closing it would give up all its locks."""
    try:
        import fcntl

        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT, 0o600), fcntl
    except (ImportError, OSError):
        return None, None


def _foreign(kind):
    """Whether a numba type, or one within it, belongs to a class of another program."""
    made = getattr(kind, "instance_class", None)
    if made is not None and made.__module__.partition(".")[0] not in OWN:
        return True
    inner = kind if isinstance(kind, tuple) else getattr(kind, "types", ())
    # An array, or a pointer.
    if hasattr(kind, "dtype"):
        inner = (*inner, kind.dtype)
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

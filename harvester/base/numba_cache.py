"""Folder of numba's compiled code, and checks that it is safe: it contains pickled machine code.

`harvester.base.numba_patches` changes numba; this module does not.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import re
import stat
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from harvester.base.surroundings import PACKAGE, foreign_writers_of, other_writers

# The cache holds code for types of these packages only. Code for other packages is compiled in each
# process, since other processes may lack the package.
OWN = ("harvester", "circuits")
DIGEST_BYTES = hashlib.sha256().digest_size
IMPORT = re.compile(
    rf"^(?:from|import) ((?:{'|'.join(OWN)})\b[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE
)


def keep_environment_usable() -> None:
    """Remove environment variables with values that make numba fail.

    These are a number of threads below 1, since numba's threads are unused, and the search path of
    numba's cache, since `is_safe` checks the default folders.
    """
    os.environ.pop("NUMBA_CACHE_LOCATOR_CLASSES", None)
    with contextlib.suppress(ValueError):
        # numba ignores a value that is not a number.
        if int(os.environ.get("NUMBA_NUM_THREADS", "1")) < 1:
            del os.environ["NUMBA_NUM_THREADS"]


def plain_file(path: str) -> bytes | None:
    """The bytes of a regular file that only this user or the program's owner can change.

    None if it is missing, or if it is another kind of file, which is reported.
    """
    try:
        # O_NONBLOCK: a pipe under this name does not block.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        with open(descriptor, "rb") as file:
            about = os.fstat(descriptor)
            if stat.S_ISREG(about.st_mode) and not other_writers(about):
                return file.read()
    except FileNotFoundError:
        return None
    except OSError:
        pass
    on_damage(path)
    return None


def begins_with_text(content: bytes) -> bool:
    """Whether the data begin with a pickled string, such as an index's version."""
    try:
        return isinstance(pickle.loads(content), str)
    # Damaged bytes may raise any exception.
    except Exception:
        return False


def unpickled(content: bytes, path: str) -> Any:
    """Unpickle the content after its digest; None if the digest is wrong or a class is missing."""
    digest, content = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        on_damage(path)
        return None
    try:
        return pickle.loads(content)
    except (ImportError, AttributeError):
        return None


def _say_damage(path: str) -> None:
    """Report a damaged file: one line on standard error, once in each process."""
    if not _reported:
        _reported.append(path)
        print(
            f"harvester: {path}: the compiled code is damaged, or other users can change it; it is "
            "compiled again",
            file=sys.stderr,
        )


_reported: list[str] = []
# Called with the path of a damaged file. A worker process passes the path on to its caller.
on_damage: Callable[[str], None] = _say_damage
# Called with 1 as a compilation begins and with -1 as it ends; the default does nothing. A worker
# process passes the number on to its caller.
on_compilation: Callable[[int], object] = abs


@contextlib.contextmanager
def alone(folder: Path, name: str) -> Iterator[None]:
    """Hold a lock within the block, so that no other process compiles the same function.

    The lock is on a byte of one file; the system releases it when the process ends. If locking
    fails, several processes may compile.
    """
    offset = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4])
    handle, fcntl = _lock_file(folder)
    held = False
    if handle is not None:
        with contextlib.suppress(OSError):
            fcntl.lockf(handle, fcntl.LOCK_EX, 1, offset)
            held = True
    try:
        yield
    finally:
        if held:
            fcntl.lockf(handle, fcntl.LOCK_UN, 1, offset)


@functools.cache
def _lock_file(folder):
    """Open the lock file for the process's lifetime: closing it would release all its locks."""
    try:
        import fcntl

        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT, 0o600), fcntl
    except (ImportError, OSError):
        return None, None


def modules_of(kind: Any) -> Iterator[str]:
    """Modules of the classes of a numba type and of all types within it."""
    owner = getattr(kind, "instance_class", None)
    if owner is not None:
        yield owner.__module__
    inner = kind if isinstance(kind, tuple) else getattr(kind, "types", ())
    # The type is an array or a pointer.
    if hasattr(kind, "dtype"):
        inner = (*inner, kind.dtype)
    for part in inner:
        yield from modules_of(part)


def is_foreign(kind: Any) -> bool:
    """Whether a numba type, or a type within it, belongs to a class of another package."""
    return any(module.partition(".")[0] not in OWN for module in modules_of(kind))


def sources(modules: Iterable[str]) -> dict[str, str]:
    """Digests, by module, of all files from which code of these modules is compiled.

    These are the modules and, recursively, the modules that they import at module level. Imports
    within functions are not compiled.
    """
    reached: dict[str, str] = {}
    left = [*modules]
    while left:
        name = left.pop()
        if name not in reached:
            reached[name], imported = _source(name)
            left += imported
    return {name: digest for name, digest in reached.items() if digest}


@functools.cache
def _source(name):
    """Digest of a module's file, and all names that it imports at module level."""
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is None:
        return "", ()
    text = Path(file).read_bytes()
    names = set()
    for module, members in IMPORT.findall(text.decode()):
        names.add(module)
        names.update(f"{module}.{member}" for member in re.findall(r"\w+", members))
    return hashlib.sha256(text).hexdigest(), names


def is_safe() -> bool:
    """Whether only this user and the program's owner can write to numba's cache.

    It is in NUMBA_CACHE_DIR, else next to the sources, else in a folder of the user.
    """
    from numba.core import config
    from numba.misc.appdirs import AppDirs

    folder = config.CACHE_DIR
    if not folder:
        caches = [source.parent / "__pycache__" for source in PACKAGE.rglob("*.py")]
        if all(os.access(path if path.exists() else path.parent, os.W_OK) for path in caches):
            return True
        folder = AppDirs("numba", appauthor=False).user_cache_dir
    return not any(map(foreign_writers_of, [folder, *Path(folder).rglob("*")]))

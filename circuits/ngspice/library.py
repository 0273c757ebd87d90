"""Locates the ngspice library and its code models; hides initialisation files."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from harvester.base.errors import EngineNotFound
from harvester.base.temporary import TemporaryFolder

SYSTEM_NAMES = (
    "libngspice.so", "libngspice.so.0", "libngspice.dylib", "libngspice.0.dylib",
    "/opt/homebrew/lib/libngspice.dylib", "/usr/local/lib/libngspice.dylib", "ngspice.dll",
    "libngspice-0.dll",
)  # fmt: skip
HOW_TO_GET_IT = (
    "get it with 'apt-get install libngspice0' (Debian, Ubuntu), 'brew install libngspice' "
    "(macOS), 'conda install -c conda-forge ngspice-lib' (conda), or from ngspice's download page "
    "as the shared library (Windows), or set NGSPICE_LIBRARY_PATH to the file"
)


def candidates() -> list[str]:
    """Names to try to load, in order; only the user's choice if there is one."""
    chosen = os.environ.get("NGSPICE_LIBRARY_PATH")
    if chosen:
        return [chosen]
    prefix = Path(sys.prefix)
    patterns = (
        "ngspice-osdi/usr/lib/*/libngspice.so*", "ngspice/usr/lib/*/libngspice.so*",
        "lib/libngspice*", "Library/bin/*ngspice*.dll",
    )  # fmt: skip
    paths = (str(path) for pattern in patterns for path in sorted(prefix.glob(pattern)))
    return [*paths, *SYSTEM_NAMES]


def find_library() -> str:
    """Name or path of the first ngspice library that loads.

    Raises
    ------
    EngineNotFound
        No library loads; the message names a remedy.
    """
    import ctypes

    reason = "no ngspice library found"
    names = candidates()
    for name in names:
        try:
            library = ctypes.CDLL(name)
        except OSError as error:
            if len(names) == 1:
                reason = f"NGSPICE_LIBRARY_PATH={name}: cannot be loaded ({error})"
            continue
        if hasattr(library, "ngSpice_Init_Sync"):
            return name
        reason = f"{name}: not a shared ngspice library (no ngSpice_Init_Sync)"
    raise EngineNotFound(f"{reason}; {HOW_TO_GET_IT}")


def code_models(library: str) -> list[Path]:
    """ngspice's code models next to the library; models of another release would crash ngspice.

    Parameters
    ----------
    library : str
        Name or path from `find_library`.

    Returns
    -------
    list of pathlib.Path
        Sorted; may be empty.
    """
    home = _loaded_from(library).parent
    folders = (home / "ngspice", home.parent / "lib" / "ngspice")
    return next(filter(None, (sorted(folder.glob("*.cm")) for folder in folders)), [])


@contextlib.contextmanager
def no_initialisation_files() -> Iterator[None]:
    """Hide ngspice's initialisation files while it starts within the block.

    ngspice reads spinit below SPICE_LIB_DIR, then the first of .spiceinit and spice.rc in the
    working folder and the home folder. ngspice finds the home folder without HOME, so an empty file
    in the working folder hides the file in the home folder.
    """
    before = dict(os.environ)
    with TemporaryFolder() as empty, contextlib.chdir(empty):
        for name in before:
            if name.upper().startswith(("SPICE", "NGSPICE")):
                del os.environ[name]
        Path(".spiceinit").write_text("* nothing\n")
        os.environ.update(HOME=empty, USERPROFILE=empty, SPICE_LIB_DIR=empty)
        try:
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)


def _loaded_from(library):
    """The file of a loaded library, with links resolved."""
    import ctypes

    class Place(ctypes.Structure):
        _fields_ = (
            ("file", ctypes.c_char_p), ("base", ctypes.c_void_p),
            ("symbol", ctypes.c_char_p), ("address", ctypes.c_void_p),
        )  # fmt: skip

    symbol_info = Place()
    if os.name == "posix":
        start = ctypes.CDLL(library).ngSpice_Init
        ctypes.CDLL(None).dladdr(start, ctypes.byref(symbol_info))
    return Path(os.fsdecode(symbol_info.file) if symbol_info.file else library).resolve()

"""Where the ngspice library is found."""

import os
import sys
from pathlib import Path

from harvester.errors import EngineNotFound

SYSTEM_NAMES = (
    "libngspice.so",
    "libngspice.so.0",
    "libngspice.dylib",
    "libngspice.0.dylib",
    "/opt/homebrew/lib/libngspice.dylib",
    "/usr/local/lib/libngspice.dylib",
    "ngspice.dll",
    "libngspice-0.dll",
)
HOW_TO_GET_IT = (
    "get it with 'apt-get install libngspice0' (Debian, Ubuntu), 'brew install libngspice' "
    "(macOS), 'conda install -c conda-forge ngspice-lib' (conda), or from ngspice's download page "
    "as the shared library (Windows), or set NGSPICE_LIBRARY_PATH to the file"
)


def candidates():
    """Names to try to load, in order: the user's own choice alone where there is one."""
    chosen = os.environ.get("NGSPICE_LIBRARY_PATH")
    if chosen:
        return [chosen]
    prefix = Path(sys.prefix)
    places = [
        *sorted(prefix.glob("ngspice/usr/lib/*/libngspice.so*")),
        *sorted(prefix.glob("lib/libngspice*")),
        *sorted(prefix.glob("Library/bin/*ngspice*.dll")),
    ]
    return [*(str(place) for place in places), *SYSTEM_NAMES]


def find_library():
    """Name or path of the first ngspice library that loads.

    Raises
    ------
    EngineNotFound
        None does; the message says how to get one.
    """
    import ctypes

    _point_to_local_scripts()
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


def _point_to_local_scripts():
    """Let a copy unpacked into the environment read its own start-up file."""
    scripts = Path(sys.prefix) / "ngspice" / "usr" / "share" / "ngspice"
    if scripts.is_dir():
        os.environ.setdefault("SPICE_LIB_DIR", str(scripts))

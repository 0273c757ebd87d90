"""Command line and environment of a worker process, independent of the caller's.

The worker runs in a new empty folder, ignores the working folder and Python's environment variables
in imports, and sees only variables that name folders of this machine.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# Packages that the worker needs in addition to harvester.
REQUIRED = ("numpy", "scipy", "numba", "cffi", "PySpice")
# Variables that list folders. Relative folders are removed: they would refer to the working folder.
SEARCHED = ("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "DYLD_FALLBACK_LIBRARY_PATH")
FOLDERS = ("HOME", "TMPDIR", "TEMP", "TMP", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")
WINDOWS = ("SYSTEMROOT", "SYSTEMDRIVE", "USERPROFILE", "APPDATA", "LOCALAPPDATA", "PATHEXT")
WORDS = ("LANG", "LANGUAGE", "TZ", "USER", "LOGNAME")
PREFIXES = ("LC_", "NUMBA_")
FIXED = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

# The worker imports harvester's packages from the caller's folder, before anything else is on its
# path; the standard library modules that they need are imported first. Packages missing in its
# environment are searched on the caller's path.
_START = f"""\
import __future__, importlib.util, json, os, sys, warnings
own, folders, callers = json.loads(sys.argv[1])
path, sys.path[:] = sys.path[:], [own]
import circuits, harvester, netlists
sys.path[:] = path + folders
if any(importlib.util.find_spec(name) is None for name in {REQUIRED}):
    sys.path += callers
from harvester.base.worker_main import main
main()
"""


def command(folders: Sequence[str | Path] = ()) -> list[str]:
    """The worker's command line; `folders`: appended to its import path."""
    packages = str(Path(__file__).parents[2])
    working_folder = _working_folder()
    callers = [entry for entry in sys.path if os.path.isabs(entry) and entry != working_folder]
    settings = json.dumps([packages, [str(folder) for folder in folders], callers])
    return [sys.executable, "-E", "-P", "-c", _START, settings]


def environment() -> dict[str, str]:
    """The worker's environment variables."""
    variables = dict(FIXED)
    for name, value in os.environ.items():
        if name in SEARCHED:
            places = [folder for folder in value.split(os.pathsep) if os.path.isabs(folder)]
            value = os.pathsep.join(places)
        elif name in FOLDERS:
            value = value if os.path.isabs(value) else ""
        elif name not in WINDOWS + WORDS and not name.startswith(PREFIXES):
            continue
        if value:
            variables[name] = value
    library = os.environ.get("NGSPICE_LIBRARY_PATH")
    if library:
        # A bare library name is left to the linker: it is not a path in the working folder.
        variables["NGSPICE_LIBRARY_PATH"] = (
            os.path.abspath(library) if os.path.dirname(library) else library
        )
    return variables


def _working_folder():
    try:
        return os.getcwd()
    except OSError:  # the folder was removed
        return ""

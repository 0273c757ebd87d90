"""Compilation of functions. All have C's arithmetic: 1/0 gives inf, and nothing is checked.

============  =====================================  ==========================================
decorator     for                                    why
============  =====================================  ==========================================
compiled      called by Python or several callers    kept on disk
uncounted     a loop that makes and keeps no array   counting references costs more than its work
merged        a part of one loop, given a device     LLVM writes it into its caller, without the
                                                     branches that a known argument rules out
merged_once   the same without a device              compiled once for all devices
inlined       a small function of a callback         else a device's numbers go over at each call
summing       sums over many points                  adds in any order, several at a time
register_     an equation that Python calls too      compiled only within its callers
jitable
overload      code chosen by an argument's type      compiled only within its callers
intrinsic     LLVM's own instructions                calls by address, numbers side by side
============  =====================================  ==========================================

numba is imported here, and by other modules from here: it reads a file `.numba_config.yaml` of the
working folder when it is imported and whenever it compiles, which may name a folder of code.
The changes to numba, and the version that they were tested with, are in
`harvester.base.numba_patches`.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from harvester.base import numba_cache
from harvester.base.memory import load_libraries_early
from harvester.base.surroundings import away_from_working_folder

load_libraries_early()
numba_cache.keep_environment_usable()
with away_from_working_folder():
    import llvmlite.binding
    import numba
    from numba import carray, cfunc, extending, njit, types
    from numba.core import cgutils
    from numba.extending import intrinsic

    from harvester.base import numba_patches
    from harvester.base.numba_patches import INLINE, UNCOUNTED, WITHIN, ziggurat

__all__ = [
    "CACHED", "address_of", "carray", "cfunc", "cgutils", "compiled", "inlined", "intrinsic",
    "merged", "merged_once", "njit", "numba", "overload", "register_jitable", "summing", "types",
    "uncounted", "ziggurat",
]  # fmt: skip

numba_patches.read_no_settings_file()
# Vectors of eight numbers if the processor has them: by default LLVM uses four on some of these.
if not numba.core.config.CPU_FEATURES:
    features = llvmlite.binding.get_host_cpu_features()
    if features.get("avx512f"):
        numba.core.config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"

numba_patches.keep_own_index()
numba_patches.wait_for_other_processes()
# Without the cache everything is compiled at every start. That takes some seconds and changes no
# number.
CACHED = numba_cache.is_safe()
compiled = partial(njit, cache=CACHED, error_model="numpy")
uncounted = partial(njit, cache=CACHED, error_model="numpy", **UNCOUNTED)
inlined = partial(njit, error_model="numpy", inline="always")
merged_once = partial(uncounted, **INLINE)
overload = partial(extending.overload, jit_options=WITHIN)
register_jitable = extending.register_jitable(**WITHIN)
summing = partial(njit, cache=CACHED, error_model="numpy", fastmath={"reassoc", "nsz", "contract"})

PACKAGE = Path(__file__).parents[1]
PACKAGES = ("harvester", "circuits")
IMPORT = re.compile(
    r"^(?:from|import) ((?:harvester|circuits)\b[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE
)


def merged(function: Callable) -> Callable:
    """Let LLVM write a function into its callers: compiles faster than `inlined` for a large one.

    Uncounted as well. If a caller knows beforehand that an argument is True or None, the compiled
    code omits the branch that is never taken. Python calls the function unchanged.
    """
    options = {"error_model": "numpy", **UNCOUNTED, **INLINE, **WITHIN}

    @extending.overload(function, jit_options=options, strict=False, prefer_literal=True)
    def choose(*arguments):
        return function

    return function


def numbers_of(part: Any) -> list[float]:
    """All numbers of a nested tuple one after another, as it lies in the memory of compiled code.

    `part`: a part of a device, such as a `harvester.device.system.System`.
    """
    if isinstance(part, tuple):
        return [number for element in part for number in numbers_of(element)]
    return [float(part)]


def address_of(function: Any, *arguments: Any) -> int:
    """Address at which C can call a function for arguments of these types; compiled if need be.

    If the types are in its signature, it is cached on disk; a function made for each kind
    of device, with the kind among its free variables, is not.

    `function`: a function that `compiled` has decorated.
    """
    if arguments not in function.overloads:
        function.compile(arguments)
    code = function.overloads[arguments]
    return code.library.get_pointer_to_function(code.fndesc.llvm_cfunc_wrapper_name)


def compiled_sources() -> list[Path]:
    """The files that compiled code is made of.

    These are all files of the folders in which a module imports this one, since a class next to
    them may be an argument of compiled code, and whatever those files import at their head. What a
    function imports as it runs is not compiled.
    """
    files = {}
    for package in PACKAGES:
        for file in sorted((PACKAGE.parent / package).rglob("*.py")):
            parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    texts = {name: file.read_bytes() for name, file in files.items()}
    folders = {files[name].parent for name, text in texts.items() if __name__.encode() in text}
    reached = set()
    left = [name for name, file in files.items() if file.parent in folders - {PACKAGE}]
    left.append(__name__)
    while left:
        name = left.pop()
        if name not in reached:
            reached.add(name)
            left += _imports(texts[name].decode()) & files.keys()
    return [file for name, file in files.items() if name in reached]


def _imports(text):
    """Names of modules, and of possible modules, that a file imports at its head."""
    names = set()
    for module, members in IMPORT.findall(text):
        names.add(module)
        names.update(f"{module}.{member}" for member in re.findall(r"\w+", members))
    return names


def forget_stale_code() -> None:
    """Drop compiled code when a source that it is made of has changed since it was written.

    numba checks the file of the function alone, not the functions that it calls elsewhere: a
    changed force law would go on being compiled into an unchanged integrator.
    """
    digest = hashlib.sha256()
    for source in compiled_sources():
        digest.update(source.read_bytes())
    stamp = PACKAGE / "__pycache__" / "compiled-from.sha256"
    try:
        if stamp.is_file() and stamp.read_bytes() == digest.hexdigest().encode():
            return
        for package in PACKAGES:
            for index in (PACKAGE.parent / package).rglob("*.nbi"):
                index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest())
    except OSError:
        # The folder may not be written: numba then keeps its files elsewhere.
        return


forget_stale_code()

"""Decorators that compile functions. Arithmetic is C's: 1/0 gives inf, indices are unchecked.

============  =====================================  ==========================================
decorator     for                                    why
============  =====================================  ==========================================
compiled      called by Python or several callers    cached on disk
uncounted     a loop that creates no array           reference counting costs more than the work
merged        a part of one loop, takes a device     LLVM inlines it, without the branches that a
                                                     constant argument excludes
merged_once   a part of one loop, takes no device    compiled once for all devices
inlined       a small function of a callback         a call would copy all numbers of a device
summing       sums over many points                  additions are reordered, and so vectorized
register_     an equation that Python calls too      compiled only within its callers
jitable
overload      code chosen by an argument's type      compiled only within its callers
intrinsic     LLVM's own instructions                calls by address, vectors of numbers
============  =====================================  ==========================================

Importing numba takes a third of this program's start-up time, so it is imported when compiled code
is first called: until then a function is `Deferred`, and overloads wait in a list. Importing
numba's `types`, `intrinsic` and the like from here imports numba at once, through
`harvester.base.numba_patches`.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

from harvester.base.memory import load_libraries_early

# Registrations that wait for the import of numba; None after the import.
_waiting: list[Callable[[], object]] | None = []
_importing = threading.RLock()


def __getattr__(name: str) -> Any:
    """An object of numba by its name, see `harvester.base.numba_patches`."""
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_numba(), name)


def _numba():
    """The module that wraps numba; its first import runs the waiting registrations."""
    global _waiting
    from harvester.base import numba_patches

    with _importing:
        waiting, _waiting = _waiting, None
        for register in waiting or ():
            register()
    return numba_patches


def _with_numba(register):
    """Run `register`, which needs numba, now or when numba is imported."""
    with _importing:
        if _waiting is not None:
            _waiting.append(register)
            return
    register()


class Deferred:
    """A compiled function; the first use of an attribute imports numba."""

    def __init__(self, function: Callable, options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self._options = options

    def __call__(self, *arguments: Any) -> Any:
        return self._dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        # Also for `_numba_type_`, by which numba compiles calls of this object as calls of the
        # dispatcher.
        return getattr(self._dispatcher, name)

    @functools.cached_property
    def _dispatcher(self):
        numba = _numba()
        cache = self._options.get("cache", False) and numba.CACHED
        return numba.njit(**self._options | {"cache": cache})(self.__wrapped__)


def _compiling(**options):
    """Make a decorator that compiles functions with given options of numba."""

    def decorate(function=None, **more):
        if function is None:
            return functools.partial(decorate, **more)
        return Deferred(function, options | more)

    return decorate


# Option for functions that create no arrays: numba's reference counting would take longer than the
# functions themselves.
UNCOUNTED = {"_nrt": False}
INLINE = {"forceinline": True}
# For functions that only compiled code calls: without an entry point for C they compile a third
# faster.
WITHIN = {"no_cfunc_wrapper": True}
COMMON = {"error_model": "numpy"}

compiled = _compiling(cache=True, **COMMON)
uncounted = _compiling(cache=True, **COMMON, **UNCOUNTED)
inlined = _compiling(inline="always", **COMMON)
merged_once = _compiling(cache=True, **COMMON, **UNCOUNTED, **INLINE)
summing = _compiling(cache=True, fastmath={"reassoc", "nsz", "contract"}, **COMMON)


def overload(function: Callable, **options: Any) -> Callable:
    """numba's decorator of this name: the function selects code by the arguments' types."""

    def decorate(choose):
        options.setdefault("jit_options", WITHIN)
        _with_numba(lambda: _numba().extending.overload(function, **options)(choose))
        return choose

    return decorate


def register_jitable(function: Callable) -> Callable:
    """Let compiled code call a function; for Python it stays unchanged."""
    _with_numba(lambda: _numba().extending.register_jitable(**WITHIN)(function))
    return function


def merged(function: Callable) -> Callable:
    """Let LLVM inline a function into its callers: faster to compile than `inlined` if it is large.

    References are not counted. If an argument is known to be True or None when a caller is
    compiled, the unused branch is omitted. For Python the function stays unchanged.
    """
    options = {**COMMON, **UNCOUNTED, **INLINE, **WITHIN}
    overload(function, jit_options=options, strict=False, prefer_literal=True)(
        lambda *arguments: function
    )
    return function


def numbers_of(part: Any) -> list[float]:
    """All numbers of a nested tuple, in the order of compiled code's memory.

    `part`: a part of a device, such as a `harvester.device.system.System`.
    """
    if isinstance(part, tuple):
        return [number for element in part for number in numbers_of(element)]
    return [float(part)]


def address_of(function: Any, *arguments: Any) -> int:
    """Address at which C can call a function for arguments of these types; compiled if necessary.

    Compiled code is cached on disk if the types are in its signature, but not if the kind of device
    is a free variable of the function.

    `function`: a function decorated by `compiled`.
    """
    if arguments not in function.overloads:
        function.compile(arguments)
    code = function.overloads[arguments]
    return code.library.get_pointer_to_function(code.fndesc.llvm_cfunc_wrapper_name)


if load_libraries_early():
    _numba()

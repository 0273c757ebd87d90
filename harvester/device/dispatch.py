"""A part's equations, called by name in Python and in compiled code.

A part is a named tuple whose methods take and return floats. `equation("force")` is a function
whose first argument is any part: it calls that part's `force`. Compiled code finds the method by
the part's type, so that parts that a device lacks are not compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from harvester.base import compilation

# A float or an array of any shape; the result of an equation is of the same kind. No type checker
# can express this for compiled functions.
Values: TypeAlias = Any


def equation(name: str) -> Callable:
    """The function that calls a method of its first argument, also in code that numba compiles.

    Every part of the same sort has a method of this name. The function is one of
    (part, *arguments).
    """

    def call(part, *arguments):
        return getattr(part, name)(*arguments)

    @compilation.overload(call, strict=False)
    def choose(part, *arguments):
        if not isinstance(part, compilation.types.BaseNamedTuple):
            return None
        return getattr(part.instance_class, name)

    return call

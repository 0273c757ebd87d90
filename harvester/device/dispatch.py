"""Calls a part's equations by name, in Python and in compiled code.

A part is a named tuple whose methods take and return floats. `equation("force")` is a function
whose first argument is any part: it calls that part's `force`. Compiled code selects the method by
the part's type, so that unused parts are not compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from harvester.base import compilation

# A float or an array of any shape; an equation returns the same kind. Type checkers cannot express
# this for compiled functions.
Values: TypeAlias = Any


def equation(name: str) -> Callable:
    """The function that calls a method of its first argument, also in code that numba compiles.

    Every part of one kind has a method of this name. The function's arguments are (part,
    *arguments).
    """

    def call(part, *arguments):
        return getattr(part, name)(*arguments)

    @compilation.overload(call, strict=False)
    def choose(part, *arguments):
        if not isinstance(part, compilation.types.BaseNamedTuple):
            return None
        return getattr(part.instance_class, name)

    return call

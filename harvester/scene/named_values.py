"""A table of values that stays as it is, so that what holds it can be compared and hashed."""

from __future__ import annotations

from typing import Any


class NamedValues(dict):
    """A dictionary that cannot be changed; equal to any with the same names and values.

    >>> {NamedValues(resistance=1e5): "a load"}[NamedValues({"resistance": 1e5})]
    'a load'
    """

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedValues, (dict(self),)

    def _refuse(self, *_, **__):
        raise TypeError("these values are fixed: make a changed copy, dict(values)")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

"""Whether the command line is to show nothing but what was asked for and what went wrong."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar

_QUIET = ContextVar("quiet", default=False)


@contextlib.contextmanager
def quiet(wanted: bool = True) -> Iterator[None]:
    """No tables, progress or remarks within the block."""
    token = _QUIET.set(bool(wanted))
    try:
        yield
    finally:
        _QUIET.reset(token)


def is_quiet() -> bool:
    """Whether `quiet` is in force."""
    return _QUIET.get()

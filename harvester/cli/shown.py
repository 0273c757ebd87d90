"""Messages on standard error, and whether the command line is quiet."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from contextvars import ContextVar

from harvester.base.plain_text import one_line

_QUIET = ContextVar("quiet", default=False)


@contextlib.contextmanager
def quiet(silent: bool = True) -> Iterator[None]:
    """Suppress tables, progress and messages within the block."""
    token = _QUIET.set(bool(silent))
    try:
        yield
    finally:
        _QUIET.reset(token)


def is_quiet() -> bool:
    """Whether the program runs inside a `quiet` block."""
    return _QUIET.get()


def say(text: object) -> None:
    """Print one line on standard error unless the command line is quiet."""
    if not is_quiet():
        print(one_line(text), file=sys.stderr)


def print_error(text: object) -> None:
    """Print one line on standard error about a failure."""
    print(f"harvester: {one_line(text)}", file=sys.stderr)

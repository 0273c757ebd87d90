"""Lines on standard error, and whether only what was asked for and what went wrong is shown."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from contextvars import ContextVar

from harvester.files.plain_text import one_line

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
    """Whether the program runs inside a `quiet` block."""
    return _QUIET.get()


def say(text: object) -> None:
    """One line on standard error, unless the command line is quiet."""
    if not is_quiet():
        print(one_line(text), file=sys.stderr)


def complain(text: object) -> None:
    """One line on standard error on what went wrong."""
    print(f"harvester: {one_line(text)}", file=sys.stderr)

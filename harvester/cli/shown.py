"""What a command shows: the interfaces of results, and lines on standard error."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Protocol

from harvester.base.plain_text import one_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.scene.model import Scene

_QUIET = ContextVar("quiet", default=False)


class Tabled(Protocol):
    """Interface of results that a command shows on the terminal."""

    @property
    def scene(self) -> Scene | None:
        """The scene that it is about; None where it is about many."""

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text; the first two columns are words."""

    def sentences(self) -> list[str]:
        """Sentences on the findings and on how they were obtained, one line each."""


class Shown(Tabled, Protocol):
    """Interface of results that are also written as JSON and as a figure."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""

    def figure(self) -> Figure | None:
        """A drawing in the project's style; None where there is nothing to draw."""


@contextlib.contextmanager
def quiet(silent: bool = True) -> Iterator[None]:
    """No tables, progress or remarks within the block."""
    token = _QUIET.set(bool(silent))
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


def print_error(text: object) -> None:
    """One line on standard error on what went wrong."""
    print(f"harvester: {one_line(text)}", file=sys.stderr)

"""Interfaces by which results, comparisons and studies are shown and written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from harvester.scene.model import Scene


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

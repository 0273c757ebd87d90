"""How long a scene is run: the table [run]."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Run:
    """Length of each realization and what is discarded before it (s); seed; how many."""

    duration: float
    settle: float = 0.0
    seed: int = 0
    realizations: int = 1

"""How long a scene is run: the table [run]."""

from __future__ import annotations

from dataclasses import dataclass

from harvester.device.keys import names_replace


@names_replace
@dataclass(frozen=True)
class Run:
    """Length of each realization and what is discarded before it (s); seed; how many.

    With `starts` there are as many realizations, each from a start of its own, drawn evenly over
    the device's energy range; without it they begin in the wells in turn. `orbit` is the one that
    studies take their quantities from if starts reach different ones: "rest", "best" or "weighted"
    by the starts (None: "rest").
    """

    duration: float
    settle: float = 0.0
    seed: int = 0
    realizations: int = 1
    starts: int | None = None
    orbit: str | None = None

    def __post_init__(self) -> None:
        if self.starts is not None:
            object.__setattr__(self, "realizations", self.starts)

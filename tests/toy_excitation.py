"""An excitation of a test: white noise by its height."""

from dataclasses import dataclass
from typing import ClassVar

from harvester.device.keys import positive
from harvester.excitation.base import Excitation
from harvester.excitation.white import WhitePath


@dataclass(frozen=True)
class Steps(Excitation):
    """A toy kind: what the recipe in CONTRIBUTING asks for, and no more."""

    height: float
    kind: str = "steps"
    knot_spacing: float | None = None

    KEYS: ClassVar[dict] = {"height": positive(required=True)}

    def spacing(self, longest):
        return longest

    def equivalent_noise(self, relaxation_time, longest):
        return self.height**2 * relaxation_time, relaxation_time

    def path(self, spacing, length, seed):
        return WhitePath(0.5 * spacing * (self.height / length) ** 2, spacing, seed)

    def notes(self, spacing, angular_frequency, run):
        return ()

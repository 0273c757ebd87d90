"""A prescribed displacement: a test bench for loads, without mechanics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.device.keys import positive, table
from harvester.excitation.base import Excitation, ExcitationPath, Run, knots
from harvester.excitation.sine import DETERMINISTIC_NOTE

# Knots per cycle: enough to resolve the switching of a rectifier, not only the sine.
KNOTS_PER_CYCLE = 200


@table
class PrescribedDisplacement(Excitation):
    """X = amplitude · sin(2π frequency t), whatever the load does.

    η is the force that moves a mass without spring and damper in this way, so that the input power
    is the power that drives the piezo. Published closed forms for loads assume this motion.
    """

    amplitude: float = positive("amplitude: of the displacement", "m", "l", required=True)
    frequency: float = positive("frequency", "Hz", required=True)
    kind: str = "prescribed_displacement"
    knot_spacing: float | None = knots("a two-hundredth of the period")

    prescribes_displacement = True
    symmetric = False
    random = False

    @property
    def period(self) -> float | None:
        return 1.0 / self.frequency

    def spacing(self, longest: float) -> float:
        return self.knot_spacing or 1.0 / (KNOTS_PER_CYCLE * self.frequency)

    def equivalent_noise(self, relaxation_time: float, longest: float) -> tuple[float, float]:
        return 0.0, 1.0 / (2.0 * math.pi * self.frequency)

    def path(self, spacing: float, length: float, seed: Any) -> ExcitationPath:
        return _ZeroPath(spacing)

    def notes(self, spacing: float, angular_frequency: float, run: Run) -> tuple[str, ...]:
        return (DETERMINISTIC_NOTE,)


@dataclass(frozen=True)
class _ZeroPath(ExcitationPath):
    """A path of zeros: the prescribed motion is part of the netlist itself."""

    spacing: float

    def read(self, count):
        return np.zeros(count)

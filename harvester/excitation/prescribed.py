"""A displacement that is prescribed: a test bench for loads, without mechanics."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from harvester.excitation.base import Excitation
from harvester.scene.schema import positive

# A rectifier's switching is resolved, not only the sine.
KNOTS_PER_CYCLE = 200


@dataclass(frozen=True)
class PrescribedDisplacement(Excitation):
    """X = amplitude · sin(2π frequency t), whatever the load does; `amplitude` in m in SI.

    η is then the force that moves a mass with neither spring nor damper so: what drives the piezo
    is the power put in. Closed forms of loads are stated for this motion.
    """

    amplitude: float
    frequency: float
    kind: str = "prescribed_displacement"
    knot_spacing: float | None = None

    KEYS: ClassVar[dict] = {
        "amplitude": positive(required=True),
        "frequency": positive(required=True),
        "knot_spacing": positive(),
    }

    @property
    def prescribes_displacement(self):
        return True

    @property
    def symmetric(self):
        return False

    def spacing(self, longest):
        return self.knot_spacing or 1.0 / (KNOTS_PER_CYCLE * self.frequency)

    def equivalent_noise(self, relaxation_time, longest):
        return 0.0, 1.0 / (2.0 * math.pi * self.frequency)

    def path(self, spacing, length, seed):
        return _Nothing(spacing)

    def notes(self, spacing, angular_frequency, run):
        return (
            "the displacement is prescribed: error bars tell how the means vary from stretch to "
            "stretch of the run, nothing else",
        )


@dataclass(frozen=True)
class _Nothing:
    """No noise: the netlist itself holds the motion."""

    spacing: float

    def read(self, count):
        return np.zeros(count)

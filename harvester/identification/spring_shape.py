"""Whether the records distinguish a model's spring from one with the next power.

A few sines of nearly one amplitude show the force at that amplitude, which many springs have. With
the next power free beside the model's own values, to first order about the fit, a score test says
whether the records need it; the other values' errors say whether they could exclude it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from harvester.base.errors import HarvesterError
from harvester.identification import intervals
from harvester.identification.candidates import SURE, richer
from harvester.identification.fitting import NOTED, Fitted
from harvester.identification.intervals import HALF_INTERVAL
from harvester.identification.unknowns import unknowns

# Once the next power is free too, a spring's value counts as uncertain if half of its 95 % interval
# exceeds this share of the value. Measured shares: right models had 0.003 under noise and 0.02 to 5
# under three sines. Cubic models of softening springs under three sines, with errors of 0.02, 0.05,
# 0.05 and 0.16, had 0.06, 0.16, 1.2 and 0.38.
TOLD_APART = 0.1
NAMED = {"linear_stiffness": 1, "cubic_stiffness": 3}


@dataclass(frozen=True)
class SpringShape:
    """A model's spring beside one with the next power.

    Attributes
    ----------
    power : int
        The next odd one.
    significance : float
        Its coefficient in standard errors, by a score test.
    moves : dict of str to float
        Change of each of the spring's values by the next power, as a share of the value.
    halves : dict of str to float
        Half of the 95 % interval of each value beyond the linear one with the next power free, as
        a share of the value.
    """

    power: int
    significance: float
    moves: dict[str, float]
    halves: dict[str, float]

    @property
    def is_refuted(self) -> bool:
        """Whether the records need the next power, and it changes a value noticeably."""
        noticed = any(abs(move) > NOTED for move in self.moves.values())
        return noticed and abs(self.significance) > SURE

    @property
    def undetermined_coefficients(self) -> dict[str, float]:
        """Values whose interval would grow if the spring had the next power, with their
        `halves`."""
        return {key: half for key, half in self.halves.items() if half > TOLD_APART}


def spring_shape(base: Fitted, sizes: dict[str, float]) -> SpringShape | None:
    """Spring shape of a model fitted to records in time; None if there is no next power.

    Parameters
    ----------
    sizes : dict of str to float
        Sizes from the motion that was fitted.
    """
    try:
        variant = richer(base.scene, base.keys, sizes)
    except HarvesterError:
        return None
    if variant is None or base.settled is None:
        return None
    _, scene, keys = variant
    # The added powers begin near 0, so their sizes come from the motion, not from their starts.
    count = len(base.keys)
    added = [replace(u, size=sizes[u.key]) for u in unknowns(scene, keys[count:], sizes)]
    problem = base.with_more(added, sizes, scene, keys[:count])
    if problem is None:
        return None
    shooting, fit = problem
    normal, gradient = shooting.reduced(fit)
    step = -np.linalg.lstsq(normal, gradient, rcond=1e-14)[0] * shooting.sizes
    errors = np.sqrt(np.maximum(np.diag(intervals.covariance(shooting, fit)), 0.0))
    spring = [
        (key, _power(key), float(step[n] / value), float(HALF_INTERVAL * errors[n] / value))
        for n, (key, value) in enumerate(zip(base.keys, base.values, strict=True))
        if _power(key) and value
    ]
    return SpringShape(
        len(scene.oscillator.coefficients) - 1,
        float(step[-1] / errors[-1]),
        {key: abs(move) for key, _, move, _ in spring},
        {key: abs(half) for key, power, _, half in spring if power > 1},
    )


def _power(key):
    """Power of x that a key's spring coefficient belongs to; 0 for other keys."""
    name = key.rpartition(".")[2]
    index = name.removeprefix("restoring_force[").rstrip("]")
    return NAMED.get(name, 0) or (int(index) if index.isdigit() else 0)

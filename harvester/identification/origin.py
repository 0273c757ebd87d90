"""Where x = 0 is: a record of the voltage alone does not show which equilibrium the motion is
about.

With the constant force kept, F(x − d) is the same device for every d at which its constant force is
that; of these the one nearest to the scene's own spring is taken.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.shooting import Fit, Shooting
from harvester.identification.unknowns import ORIGIN

if TYPE_CHECKING:
    from harvester.scene.model import Scene

FORCE = "oscillator.restoring_force[{}]"
ITERATIONS = 6


def recentred(shooting: Shooting, fit: Fit, scene: Scene) -> Fit:
    """The fit with x = 0 moved to the equilibrium that the scene has there.

    Parameters
    ----------
    shooting : Shooting
    fit : Fit
    scene : Scene
        The scene before the fit.
    """
    responses = shooting.responses
    keys, original = responses.keys, scene.oscillator.restoring_force
    outputs = [experiment.measurement.outputs for experiment in responses.experiments]
    if original is None or any(FORCE.format(n) not in keys for n in range(1, len(original))):
        return fit
    if scene.stoppers or ORIGIN in keys or any("displacement" in o for o in outputs):
        return fit
    force = np.array(
        [original[0], *(fit.values[keys.index(FORCE.format(n))] for n in range(1, len(original)))]
    )
    reach = responses.length * max(float(np.abs(states[:, 0]).max()) for states in fit.starts)
    shifts = [
        float(root.real)
        for root in np.polynomial.Polynomial([0.0, *force[1:]]).roots()
        if abs(root.imag) < 1e-9 * reach
    ]
    powers = reach ** np.arange(1, len(original))
    shifted = [(shift, _shifted(force, shift)) for shift in shifts]
    shift, moved = min(
        shifted,
        key=lambda candidate: float(np.sum(((candidate[1][1:] - original[1:]) * powers) ** 2)),
    )
    if abs(shift) < 1e-6 * reach:
        return fit
    values = fit.values.copy()
    for n in range(1, len(original)):
        values[keys.index(FORCE.format(n))] = moved[n]
    starts = [states - [shift / responses.length, 0.0, 0.0] for states in fit.starts]
    trial = shooting.minimized(Fit(values, fit.edges, starts, fit.noise), ITERATIONS, 1e-9)
    return trial if trial.grams and trial.cost < 1.01 * fit.cost else fit


def _shifted(force, distance):
    """Coefficients of F(x + distance)."""
    moved = np.polynomial.Polynomial(force)(np.polynomial.Polynomial([distance, 1.0]))
    return np.append(moved.coef, np.zeros(len(force)))[: len(force)]

"""Step error of Monte Carlo for steady sinusoidal motion of the linearised device."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from harvester.device import system, timescales
from harvester.device.damper import Damper
from harvester.device.polynomial import polynomial
from harvester.device.schemes import one_step, scheme_of

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared


def steady_error(prepared_scene: Prepared, spacing: float, steps: int) -> float:
    """Largest relative error of the mean squares of X, X' and the transducer's state.

    It applies to small oscillations about the stiffest well under the excitation's lines, with a
    resistor as load. A step is linear in (X, X', state, η, η'), so that its matrix gives the
    discrete steady motion at each line.

    `spacing`: time between two samples of the excitation (s). `steps`: steps per sample.
    """
    # The device linearised in its stiffest well, without drag and stoppers.
    s = prepared_scene.system
    stiffness = max(timescales.stiffness(s, well) for well in timescales.wells(s))
    spring, damper = polynomial([0.0, stiffness]), Damper(s.damper.damping)
    s = s._replace(spring=spring, damper=damper, contacts=())
    length = spacing / steps
    scheme = scheme_of(s, "runge-kutta", length).argument
    step = np.zeros((5, 5))
    for column, unit in zip(step.T, np.eye(5), strict=True):
        after = one_step(scheme, s, False, -math.inf, math.inf, 0.0, *unit, length, 0.0)
        column[:] = *after, unit[3] + unit[4] * length, unit[4]
    between = np.linalg.matrix_power(step, steps)
    rates = np.zeros((3, 4))
    for column, unit in zip(rates.T, np.eye(4), strict=True):
        state_rate = system.state_rate(s.transducer, unit[1], unit[2])
        column[:] = unit[1], system.push(s, *unit), state_rate
    total, error = np.zeros(3), np.zeros(3)
    for frequency, amplitude in prepared_scene.scene.excitation.lines:
        rate = 2j * math.pi * frequency
        ahead = np.exp(rate * spacing)
        # Sines are amplified to compensate for linear interpolation between samples.
        sample = amplitude / np.sinc(frequency * spacing) ** 2
        slope = sample * (ahead - 1.0) / spacing
        drive = between[:3, 3] * sample + between[:3, 4] * slope
        motion = np.array(
            [*np.linalg.solve(ahead * np.eye(3) - between[:3, :3], drive), sample, slope]
        )
        discrete = np.zeros(3)
        for _ in range(steps):
            discrete += np.abs(motion[:3]) ** 2 / steps
            motion = step @ motion
        forced = amplitude * (rates[:, 3] + [0.0, 0.0, system.base_rate(s.transducer, rate)])
        exact = np.abs(np.linalg.solve(rate * np.eye(3) - rates[:, :3], forced)) ** 2
        total += exact
        error += np.abs(discrete - exact)
    return float(np.max(error / np.where(total > 0.0, total, 1.0)))

"""Checks a circuit's run by replay: the mass is integrated under the run's own terminal voltage.

Any load answers the piezo with a voltage V(t). With that of the circuit's own record put into
Eq. 4a, the motion is that of a mass under two known forces, which an integrator without a circuit
follows: a wrong spring, damper, contact or coupling in the circuit shows. Whether the load itself
is right is left to the energy balance.
"""

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from harvester.device import spring as springs
from harvester.device.record import Record
from harvester.device.system import elastic_force
from harvester.engines.realization import start_state
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.validation.paths import noise_at_knots

# The integrator takes so many steps for each of the engine's, and more with stoppers, for which it
# does not shorten its steps.
FINER, FINER_IN_CONTACT = 2, 8


def replayed(scene: Scene, waveforms: Sequence[Record]) -> np.ndarray:
    """Displacements at the knots under recorded terminal voltages, shape (realizations, knots).

    Runge–Kutta of fourth order; `waveforms` are those of the realizations 0, 1, … from their
    beginning.
    """
    model = prepared(scene)
    system = model.system
    spacing, count = knot_spacing(model), len(waveforms)
    noise = [noise_at_knots(scene, index) for index in range(count)]
    knots = noise[0].size - 1
    finer = FINER_IN_CONTACT if system.contacts else FINER
    steps = finer * steps_per_sample(model, "default")
    times = np.linspace(0.0, knots * spacing, 2 * steps * knots + 1)
    starts = np.array([start_state(model, index) for index in range(count)])
    drive = np.array([np.interp(times, times[:: 2 * steps], path) for path in noise]).T
    # A load that switches empties the piezo within a step: the mean of the voltage over the step is
    # used.
    voltage = [_means(w, start[2], times[::2]) for w, start in zip(waveforms, starts, strict=True)]
    push = system.transducer.coupling * np.array(voltage).T
    x, v = starts[:, 0], starts[:, 1]
    places = np.empty((count, knots))
    for step in range(steps * knots):
        a, b, c = drive[2 * step : 2 * step + 3] - push[step]
        x, v = _runge_kutta(system, x, v, a, b, c, spacing / steps)
        if (step + 1) % steps == 0:
            places[:, (step + 1) // steps - 1] = x
    return places


def _means(waveform, first, ends):
    """Means of a recorded voltage between these times, `first` being that at the beginning."""
    recorded_times = np.append(0.0, waveform.time)
    times = np.union1d(recorded_times, ends)
    values = np.interp(times, recorded_times, np.append(first, waveform.voltage))
    gained = cumulative_trapezoid(values, times, initial=0.0)
    return np.diff(gained[np.searchsorted(times, ends)]) / np.diff(ends)


def _runge_kutta(system, x, v, first, middle, last, h):
    """One step under a drive given at its beginning, middle and end."""
    half = 0.5 * h
    a1 = first - _resistance(system, x, v)
    v2 = v + half * a1
    a2 = middle - _resistance(system, x + half * v, v2)
    v3 = v + half * a2
    a3 = middle - _resistance(system, x + half * v2, v3)
    v4 = v + h * a3
    a4 = last - _resistance(system, x + h * v3, v4)
    x = x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
    return x, v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _resistance(system, x, v):
    """Force of spring, damper and contacts against the drive; arrays of one shape."""
    force = elastic_force(system, x) + system.damper.force(v)
    for contact in system.contacts:
        side = np.sign(x) if contact.side == 0.0 else contact.side
        depth = np.maximum(side * x - contact.gap, 0.0)
        if depth.any():
            gain = springs.energy(system.spring, x) - springs.energy(
                system.spring, side * contact.gap
            )
            force = force + np.where(depth > 0.0, contact.law.damping(depth, v, gain, 0.0), 0.0) * v
    return force

"""The solution on one noise path to eleven digits: scipy's DOP853, for strong errors.

The force has kinks at the knots of the noise and, in its derivatives, where contact begins and
ends: the integrator is started anew at each of them, so that its order holds in between.
Eqs. 4 and 5 are written out here: a fault in the functions that engines share shows as their error.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

from harvester.device.transducer import ResistiveCoil
from harvester.parameters import knot_spacing, scale, stop_time
from harvester.realization import noise_path, start_state

RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 3e-14, 1e-15


def run(scene, index, report):
    """States of one realization at the knots, in a worker process.

    Parameters
    ----------
    scene : Scene
    index : int
        Of the realization.
    report : callable
        Not used: the paths are short.

    Returns
    -------
    ndarray, shape (knots, 3)
        X, X', terminal voltage (scaled) at the knots 1, 2, …
    """
    system, _ = scale(scene)
    spacing = knot_spacing(scene)
    knots = round(stop_time(scene) / spacing)
    noise = noise_path(scene, index).read(knots + 1)
    state = np.array(start_state(scene, index))
    stops = _stops(system)
    # As if the mass had come into a contact in which it begins.
    held = math.sqrt(state[1] ** 2 + sum(2.0 * _energy(each, state[0]) for each in stops))
    states = np.empty((knots, 3))
    for knot in range(knots):
        slope = (noise[knot + 1] - noise[knot]) / spacing
        state, held = _segment(system, stops, state, held, noise[knot], slope, spacing)
        states[knot] = state[0], state[1], _terminal_voltage(system.transducer, state)
    return states


def _stops(system):
    """(side, gap, law) of every stopper; a pair is one on either side."""
    return [
        (side, each.gap, each.law)
        for each in system.contacts
        for side in ((each.side,) if each.side else (1.0, -1.0))
    ]


def _segment(system, stops, state, held, noise, slope, spacing):
    """State and held impact speed at the end of one segment of the noise."""
    time = 0.0
    touching = [side * state[0] > gap for side, gap, _ in stops]
    while time < spacing:
        solution = solve_ivp(
            _derivative,
            (time, spacing),
            state,
            method="DOP853",
            events=[_contact_change(*each) for each in zip(stops, touching, strict=True)] or None,
            rtol=RELATIVE_TOLERANCE,
            atol=ABSOLUTE_TOLERANCE,
            args=(system, stops, held, noise, slope),
        )
        time, state = solution.t[-1], solution.y[:, -1]
        for place, times in enumerate(solution.t_events or ()):
            if solution.status == 1 and times.size:
                touching[place] = not touching[place]
                held = abs(state[1]) if touching[place] else held
    return state, held


def _contact_change(stop, touching):
    """The event that ends contact or free motion at one stopper."""
    side, gap, _ = stop

    def excess(time, state, *_):
        return side * state[0] - gap

    excess.terminal = True
    excess.direction = -1.0 if touching else 1.0
    return excess


def _derivative(time, state, system, stops, held, noise, slope):
    """Right-hand side of Eq. 4 within one segment of the noise."""
    x, v, electrical = state
    force = noise + slope * time - system.damper.damping * v
    force -= getattr(system.damper, "quadratic_damping", 0.0) * abs(v) * v
    force -= sum(k * x**n for n, k in enumerate(system.spring.coefficients))
    force -= sum(_contact_force(system, each, x, v, held) for each in stops)
    transducer = system.transducer
    if isinstance(transducer, ResistiveCoil):
        return v, force - transducer.winding_damping * transducer.current_share * v, 0.0
    decay = transducer.load_rate + transducer.own_rate
    return v, force - transducer.coupling * electrical, v - decay * electrical


def _terminal_voltage(transducer, state):
    """Of a piezo its state; of a coil what its current leaves across the resistor."""
    return transducer.voltage(state[1], state[2])


def _energy(stop, x):
    """Elastic energy in one stopper, K d^(n+1)/(n+1)."""
    side, gap, law = stop
    order = law.exponent + 1.0
    return law.stiffness * max(side * x - gap, 0.0) ** order / order


def _contact_force(system, stop, x, v, held):
    """f of Eq. 5 in contact, its spring away from the stopper.

    `held` is the speed at which a contact of `event` mode began. In `energy` mode
    v0² = v² + 2 max(U(x) − U(δ), 0) + 2 K d^(n+1)/(n+1).
    """
    side, gap, law = stop
    depth = side * x - gap
    if depth <= 0.0:
        return 0.0
    spring = law.stiffness * depth**law.exponent
    if law.holds:
        speed = max(held, abs(v), 1e-300)
    else:
        rise = sum(
            k * (x ** (n + 1) - (side * gap) ** (n + 1)) / (n + 1)
            for n, k in enumerate(system.spring.coefficients)
        )
        speed = math.sqrt(v * v + 2.0 * max(rise, 0.0) + 2.0 * _energy(stop, x))
    return side * spring + law.damping_factor * spring / speed * v

"""The solution on one noise path to eleven digits: scipy's DOP853, for strong errors.

The force has kinks at the knots of the noise and, in its derivatives, where contact begins and
ends: the integrator is started anew at each of them, so that its order holds in between.
Eqs. 4 and 5 are written out here: a fault in the functions that engines share shows as their error.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

from harvester.parameters import knot_spacing, scale, stop_time
from harvester.realization import noise_path, starts_right

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
        X, X', V (scaled) at the knots 1, 2, …
    """
    p, _ = scale(scene)
    spacing = knot_spacing(scene)
    knots = round(stop_time(scene) / spacing)
    noise = noise_path(scene, index).read(knots + 1)
    state = np.array([p.rest if starts_right(index) else -p.rest, 0.0, 0.0])
    held = 0.0
    states = np.empty((knots, 3))
    for knot in range(knots):
        slope = (noise[knot + 1] - noise[knot]) / spacing
        state, held = _segment(p, state, held, noise[knot], slope, spacing)
        states[knot] = state
    return states


def _segment(p, state, held, noise, slope, spacing):
    """State and held impact speed at the end of one segment of the noise."""
    time = 0.0
    touching = abs(state[0]) > p.gap
    while time < spacing:
        solution = solve_ivp(
            _derivative,
            (time, spacing),
            state,
            method="DOP853",
            events=_contact_changes(p, touching) if p.has_stoppers else None,
            rtol=RELATIVE_TOLERANCE,
            atol=ABSOLUTE_TOLERANCE,
            args=(p, held, noise, slope),
        )
        time, state = solution.t[-1], solution.y[:, -1]
        if solution.status == 1:
            touching = not touching
            held = abs(state[1]) if touching else held
    return state, held


def _contact_changes(p, touching):
    """The event that ends contact or free motion."""

    def excess(time, state, *_):
        return abs(state[0]) - p.gap

    excess.terminal = True
    excess.direction = -1.0 if touching else 1.0
    return excess


def _derivative(time, state, p, held, noise, slope):
    """Right-hand side of Eq. 4 within one segment of the noise."""
    x, v, voltage = state
    force = noise + slope * time - p.damping * v - p.coupling * voltage
    force -= (p.linear_stiffness + p.cubic_stiffness * x * x) * x
    if abs(x) > p.gap:
        force -= _contact_force(p, x, v, held)
    return v, force, v - p.decay_rate * voltage


def _contact_force(p, x, v, held):
    """f of Eq. 5 in contact, its spring away from the stopper on either side.

    `held` is the speed at which a contact of `event` mode began. In `energy` mode
    v0² = v² + 2 max(U(x) − U(δ), ⅖ K s^2.5).
    """
    depth = abs(x) - p.gap
    spring = p.contact_stiffness * depth**1.5
    if p.held_impact_velocity:
        speed = max(held, abs(v), 1e-300)
    else:
        way = x * x - p.gap * p.gap
        rise = (0.5 * p.linear_stiffness + 0.25 * p.cubic_stiffness * (x * x + p.gap * p.gap)) * way
        speed = math.sqrt(v * v + 2.0 * max(rise, 0.0) + 0.8 * spring * depth)
    damping = 0.75 * (1.0 - p.restitution**2) * spring / speed
    return math.copysign(spring, x) + damping * v

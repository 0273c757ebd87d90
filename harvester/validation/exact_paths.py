"""The solution on one noise path to eleven digits by scipy's DOP853, for strong errors.

The force has kinks at the noise knots and, in its derivatives, where contact begins and ends. The
integrator restarts at each of them, so that it keeps its order in between. The parts' equations are
written here independently: a fault in functions shared by the engines then shows as an error.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly

from harvester.base.errors import SceneError
from harvester.device.coil import Coil, ResistiveCoil
from harvester.device.force_table import ForceTable
from harvester.device.hertz import HertzDamp
from harvester.device.piezo import PiezoLaw
from harvester.device.polynomial import Polynomial
from harvester.device.spring import Ranged
from harvester.engines.realization import start_state
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.paths import ignore, noise_at_knots

RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 3e-14, 1e-15


def run(prepared_scene: Prepared, index: int, report: Callable = ignore) -> np.ndarray:
    """States of one realization at the knots 1, 2, …, scaled (called in a worker process).

    Returns
    -------
    ndarray, shape (knots, 3)
        X, X', terminal voltage.
    """
    equations = Equations(prepared_scene.system)
    noise, spacing = noise_at_knots(prepared_scene, index), knot_spacing(prepared_scene)
    state = np.array(start_state(prepared_scene, index), dtype=float)
    equations.begin(state, noise[0])
    states = np.empty((noise.size - 1, 3))
    for knot in range(noise.size - 1):
        slope = (noise[knot + 1] - noise[knot]) / spacing
        state = equations.segment(state, noise[knot], slope, spacing)
        states[knot] = state[0], state[1], equations.voltage(state[1], state[2])
    return states


class Equations:
    """Eqs. 4 and 5 of one device, and the state of its contacts.

    Parameters
    ----------
    system : harvester.device.system.System
        The device; only its numbers are used.
    """

    def __init__(self, system):
        self._force, self._gain = _spring_equations(system.spring)
        self._damping = system.damper.damping
        self._drag = getattr(system.damper, "quadratic_damping", 0.0)
        self._electrical, self.voltage = _electrical_equations(system.transducer)
        # κ of V' = X' + κ η' − λ V.
        self._base_share = getattr(system.transducer, "base_share", 0.0)
        # For each stopper: side, gap and law; then its held v0, and whether it is in contact.
        for contact in system.contacts:
            if not isinstance(contact.law, HertzDamp):
                raise _not_written_out(contact.law)
        self._stoppers = [
            (side, contact.gap, contact.law)
            for contact in system.contacts
            for side in ((1.0, -1.0) if contact.side == 0.0 else (contact.side,))
        ]
        self._held = [0.0] * len(self._stoppers)
        self._touching = [False] * len(self._stoppers)

    def begin(self, state: np.ndarray, noise: float) -> None:
        """Initialise from a run's first state: active contacts, impact speeds, charge.

        `state` is changed.
        """
        x, v, _ = state
        state[2] += self._base_share * noise
        for k, (side, gap, law) in enumerate(self._stoppers):
            depth = side * x - gap
            self._touching[k] = depth > 0.0
            self._held[k] = math.sqrt(v * v + 2.0 * _stored(law, max(depth, 0.0)))

    def segment(self, state: np.ndarray, noise: float, slope: float, spacing: float) -> np.ndarray:
        """State at the end of a segment of the noise."""
        time = 0.0
        while time < spacing:
            solution = solve_ivp(
                self._derivative,
                (time, spacing),
                state,
                method="DOP853",
                events=self._changes(),
                rtol=RELATIVE_TOLERANCE,
                atol=ABSOLUTE_TOLERANCE,
                args=(noise, slope),
            )
            time, state = solution.t[-1], solution.y[:, -1]
            if solution.status == 1:
                self._pass(solution.t_events, abs(state[1]))
        return state

    def _pass(self, times, speed):
        """Toggle the contacts at whose gap the integration stopped."""
        passed = [
            stopper[:2]
            for stopper, events in zip(self._stoppers, times, strict=True)
            if len(events)
        ]
        for k, (side, gap, _) in enumerate(self._stoppers):
            if (side, gap) in passed:
                self._touching[k] = not self._touching[k]
                if self._touching[k]:
                    self._held[k] = speed

    def _changes(self):
        """Events of the begin or end of contact, one per stopper; None without stoppers."""
        events: list[Any] = []
        for (side, gap, _), touching in zip(self._stoppers, self._touching, strict=True):
            # `solve_ivp` expects attributes on the function of an event.
            events.append(lambda _, state, *__, side=side, gap=gap: side * state[0] - gap)
            events[-1].terminal = True
            events[-1].direction = -1.0 if touching else 1.0
        return events or None

    def _derivative(self, time, state, noise, slope):
        """Right-hand side within one segment of the noise."""
        x, v, charge = state
        pull, rate = self._electrical(v, charge)
        rate += self._base_share * slope
        force = noise + slope * time - (self._damping + self._drag * abs(v)) * v - pull
        force -= self._force(x)
        for (side, gap, law), held in zip(self._stoppers, self._held, strict=True):
            depth = side * x - gap
            if depth > 0.0:
                force -= self._contact_force(side, gap, law, depth, v, held)
        return v, force, rate

    def _contact_force(self, side, gap, law, depth, v, held):
        """f of Eq. 5: s K d^n (1 + b s v), b = ¾(1 − e²)/v0.

        `held` is v0 of `event` mode; in `energy` mode v0² = v² + 2 [max(U(x) − U(s gap), 0) + E].
        """
        push = law.stiffness * depth**law.exponent
        speed = max(held, abs(v), 1e-300)
        if not law.holds:
            position, stop = side * (gap + depth), side * gap
            gain = self._gain(position, stop)
            speed = math.sqrt(v * v + 2.0 * (max(gain, 0.0) + _stored(law, depth)))
        return push * (side + law.damping_factor / speed * v)


def _spring_equations(spring):
    """F(x), and the energy difference between two displacements, from a spring's numbers."""
    if isinstance(spring, Ranged):
        # A run ends at the range, so the spring within it is sufficient.
        return _spring_equations(spring.spring)
    if isinstance(spring, ForceTable) and not spring.straight:
        return _table_equations(spring)
    if isinstance(spring, ForceTable):
        powers = list(enumerate(spring.core))
    elif isinstance(spring, Polynomial):
        powers = list(enumerate(spring.coefficients))
    else:
        raise _not_written_out(spring)
    return (
        lambda x: sum(k * x**n for n, k in powers),
        lambda start, stop: sum(
            k * (start ** (n + 1) - stop ** (n + 1)) / (n + 1) for n, k in powers
        ),
    )


def _table_equations(table):
    breaks = table.breaks()
    rows = np.array([coefficients for _, coefficients in list(table.pieces())[1:-1]])[:, ::-1].T
    polynomial = PPoly(rows, breaks)
    slope, integral = polynomial.derivative(), polynomial.antiderivative()

    def line(x):
        """x limited to the table, and force and slope there."""
        end = min(max(x, breaks[0]), breaks[-1])
        return end, float(polynomial(end)), float(slope(end))

    def force(x):
        end, edge_force, steep = line(x)
        return edge_force + steep * (x - end)

    def energy(x):
        end, edge_force, steep = line(x)
        return float(integral(end)) + (edge_force + 0.5 * steep * (x - end)) * (x - end)

    return force, lambda start, stop: energy(start) - energy(stop)


def _stored(law, depth):
    """Elastic energy of a stopper, K d^(n + 1)/(n + 1)."""
    return law.stiffness * depth ** (law.exponent + 1.0) / (law.exponent + 1.0)


def _electrical_equations(transducer):
    """(force on the mass, rate of the state) and terminal voltage, functions of X' and the state.

    Eq. 4b; for a coil the terminal voltage is the load's share.
    """
    if isinstance(transducer, ResistiveCoil):
        share = transducer.current_share
        damping = transducer.winding_damping * share
        return lambda v, state: (damping * v, 0.0), lambda v, state: (1.0 - share) * v
    if not isinstance(transducer, PiezoLaw | Coil):
        raise _not_written_out(transducer)
    coupling, load = transducer.coupling, transducer.load_rate
    decay = load + transducer.own_rate
    voltage_factor = load if isinstance(transducer, Coil) else 1.0
    return (
        lambda v, state: (coupling * state, v - decay * state),
        lambda v, state: voltage_factor * state,
    )


def _not_written_out(part):
    return SceneError(
        f"the reference path has no equation of {type(part).__name__}: add it "
        "in harvester/validation/exact_paths.py"
    )

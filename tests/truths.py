"""Answers that this project did not compute: closed forms and scipy's integrators."""

import math
from typing import NamedTuple

import numpy as np
from kept import kept
from scipy.integrate import DOP853
from scipy.linalg import expm, solve_discrete_lyapunov

from harvester.averaging.closures import average
from harvester.device import timescales
from harvester.device.contact import Contact
from harvester.device.damper import damper
from harvester.device.hertz import hertz_damp
from harvester.device.piezo import piezo
from harvester.device.polynomial import polynomial
from harvester.device.system import Noise, System
from harvester.engines.monte_carlo.engine import integrate, record_of
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.formulas import linear_piezo_power

# One mass and its stoppers alone, v0 held: what `rebound_speed` is the law of.
NOTHING_BUT_STOPPERS = [
    "oscillator.damping=1e-12",
    "oscillator.linear_stiffness=1e-12",
    "oscillator.cubic_stiffness=0",
    "piezo.coupling=1e-12",
    "excitation.intensity=1e-30",
    "stoppers.impact_velocity=event",
]


def assert_near(result, truths, largest_error):
    """Each mean lies within 3 standard errors of its truth, and these are at most so large shares.

    False alarm of one mean in 0.3 % of seeds.
    """
    for name, truth in truths.items():
        found = result.quantity(name)
        assert found.standard_error < largest_error * truth, name
        assert abs(found.estimate - truth) < 3.0 * found.standard_error, name


class Coefficients(NamedTuple):
    """Those of Eqs. 4–6 in scaled form, by name; `gap` is infinite without stoppers."""

    damping: float
    linear_stiffness: float
    cubic_stiffness: float
    gap: float
    contact_stiffness: float
    restitution: float
    held_impact_velocity: bool
    coupling: float
    decay_rate: float
    intensity: float
    correlation_time: float

    @property
    def system(self):
        """The same as a sum of parts."""
        law = hertz_damp(self.contact_stiffness, self.restitution, event=self.held_impact_velocity)
        touches = math.isfinite(self.gap) and self.contact_stiffness > 0.0
        return System(
            spring=polynomial((0.0, self.linear_stiffness, 0.0, self.cubic_stiffness)),
            damper=damper(self.damping),
            contacts=(Contact(0.0, self.gap, law),) if touches else (),
            transducer=piezo(self.coupling, self.decay_rate),
            noise=Noise(self.intensity, self.correlation_time),
        )

    @property
    def rest(self):
        """Stable rest position X ≥ 0 with the stoppers, without charge on the piezo."""
        return timescales.rest(self.system)


def flat(scene):
    """Coefficients of a scene with the source paper's parts."""
    s = prepared(scene).system
    linear, cubic = (*s.spring.odd, 0.0, 0.0)[:2]
    law = s.contacts[0].law if s.contacts else hertz_damp(0.0, 1.0)
    return Coefficients(
        damping=s.damper.damping,
        linear_stiffness=linear,
        cubic_stiffness=cubic,
        gap=s.contacts[0].gap if s.contacts else math.inf,
        contact_stiffness=law.stiffness,
        restitution=math.sqrt(1.0 - law.damping_factor / 0.75),
        held_impact_velocity=bool(law.holds),
        coupling=s.transducer.coupling,
        decay_rate=s.transducer.load_rate,
        intensity=s.noise.intensity,
        correlation_time=s.noise.correlation_time,
    )


def averaged(p, closure="fokker_planck", tolerance=None):
    """`harvester.averaging.closures.average` of coefficients by name."""
    return average(p.system, closure, tolerance)


def well(p):
    """Distance of the bare spring's wells from X = 0, √(ω0²/κ); 0 without wells."""
    return (
        math.sqrt(max(-p.linear_stiffness, 0.0) / p.cubic_stiffness) if p.cubic_stiffness else 0.0
    )


def drop_scene(restitution, stiffness, *overrides):
    """A scene in which a mass drops on one stopper."""
    stoppers = [f"stoppers.restitution={restitution}", f"stoppers.stiffness={stiffness}"]
    return Scene.read("paper", [*NOTHING_BUT_STOPPERS, *stoppers, *overrides])


def interpolated_linear_means(p, spacing):
    """Exact means of a linear scene under the noise as engines get it, linear between knots.

    One segment is an exact affine map of (X, X', V) and the two knots; the covariance at the
    knots solves a discrete Lyapunov equation, and means over time average over the segment.
    """
    a = math.exp(-spacing / p.correlation_time)
    variance = p.intensity / p.correlation_time
    # States X, X', V, η, η' within a segment.
    drift = np.zeros((5, 5))
    drift[0, 1] = drift[2, 1] = drift[1, 3] = drift[3, 4] = 1.0
    drift[1, :3] = -p.linear_stiffness, -p.damping, -p.coupling
    drift[2, 2] = -p.decay_rate

    def to(time):
        """(X, X', V) at a time into the segment from (X, X', V, η0, η1) at its start."""
        flow = expm(drift * time)[:3]
        slope = flow[:, 4] / spacing
        return np.column_stack([flow[:, :3], flow[:, 3] - slope, slope])

    full = to(spacing)
    step = np.zeros((4, 4))
    kick = np.zeros((4, 1))
    step[:3, :3], step[:3, 3] = full[:, :3], full[:, 3] + a * full[:, 4]
    kick[:3, 0] = full[:, 4]
    step[3, 3], kick[3, 0] = a, 1.0
    at_knots = solve_discrete_lyapunov(step, kick @ kick.T * variance * (1 - a * a))
    lift = np.vstack([np.eye(4), [0.0, 0.0, 0.0, a]])
    joint = lift @ at_knots @ lift.T
    joint[4, 4] = variance
    nodes, weights = np.polynomial.legendre.leggauss(8)
    covariance = sum(
        0.5 * w * to(0.5 * spacing * (1 + u)) @ joint @ to(0.5 * spacing * (1 + u)).T
        for u, w in zip(nodes, weights, strict=True)
    )
    power = p.coupling * p.decay_rate * covariance[2, 2]
    loss = p.damping * covariance[1, 1]
    return {
        "mean_square_voltage": covariance[2, 2],
        "mean_power": power,
        "mean_square_displacement": covariance[0, 0],
        "mean_square_velocity": covariance[1, 1],
        "power_conversion_efficiency": power / (power + loss),
    }


def oscillator_power(p):
    """E[P] of a linear harvester under Ornstein–Uhlenbeck noise, in closed form."""
    return linear_piezo_power(
        p.damping,
        p.linear_stiffness,
        p.coupling,
        p.decay_rate,
        p.intensity,
        p.correlation_time,
    )


def contact_force(p, x, v, held_speed=None):
    """f of Eq. 5 with the spring opposed on either side; v0 as held, or of `energy` mode.

    v0² = X'² + 2 max(U(X) − U(δ), ⅖ K s^2.5), U with spring and stopper; b = 3(1 − e²)/(4 v0).
    """
    depth = max(abs(x) - p.gap, 0.0)
    if depth == 0.0:
        return 0.0
    stopper = 0.4 * p.contact_stiffness * depth**2.5

    def bare(x):
        return p.linear_stiffness * x**2 / 2 + p.cubic_stiffness * x**4 / 4

    v0 = held_speed
    if v0 is None:
        v0 = math.sqrt(v**2 + 2 * max(bare(x) + stopper - bare(p.gap), stopper))
    b = 3 * (1 - p.restitution**2) / (4 * v0)
    side = 1.0 if x > 0.0 else -1.0
    return p.contact_stiffness * depth**1.5 * (side + b * v)


@kept
def reference_path(scene, knots, index=0):
    """States (X, X', V) at the knots by DOP853 at 1e-12, restarted at every knot.

    For `energy` mode; shape (knots + 1, 3).
    """
    p = flat(scene)
    ready = prepared(scene)
    spacing = knot_spacing(ready)
    noise = noise_path(ready, index).read(knots + 1)
    state = np.array([p.rest if index % 2 == 0 else -p.rest, 0.0, 0.0])
    states = [state]
    for knot in range(knots):
        slope = (noise[knot + 1] - noise[knot]) / spacing

        def derivative(t, y, start=noise[knot], slope=slope):
            x, v, voltage = y
            force = start + slope * t - p.damping * v - p.coupling * voltage
            force -= (p.linear_stiffness + p.cubic_stiffness * x * x) * x
            force -= contact_force(p, x, v)
            return np.array([v, force, v - p.decay_rate * voltage])

        solver = DOP853(derivative, 0.0, state, spacing, rtol=1e-12, atol=1e-13)
        while solver.status == "running":
            solver.step()
        state = solver.y
        states.append(state)
    return np.array(states)


class Keep:
    """An observer that keeps the whole record, as one array of shape (7, n)."""

    def __init__(self):
        self._parts = []

    def add(self, record):
        self._parts.append(np.array(record))

    def record(self):
        return np.concatenate(self._parts, axis=1)

    def at_knots(self, spacing):
        """(X, X', V) at the knots 1, 2, …, shape (knots, 3)."""
        record = self.record()
        knots = np.round(record[0] / spacing)
        on_knot = np.abs(record[0] - knots * spacing) < 1e-6 * spacing
        return record[1:4, on_knot].T


def records_of(scene, stop, index=0, path=None, start=None, **options):
    """Monte Carlo's record of one realization, chunk by chunk; overwritten by the next."""
    ready = prepared(scene)
    system = ready.system
    start = start_state(ready, index) if start is None else start
    path = noise_path(ready, index) if path is None else path
    for columns, points in integrate(system, [path], [start], stop, **options):
        yield record_of(columns, points, 0)

"""Devices as sums of parts, written out from a scene's tables alone and solved by scipy."""

import itertools
import math

import numpy as np
from kept import kept
from scipy import interpolate
from scipy.integrate import DOP853, quad
from scipy.optimize import brentq

from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing


class Tabulated:
    """A table of force by scipy's own interpolation, in straight lines beyond its ends."""

    def __init__(self, x, force, smooth=False):
        made = interpolate.PchipInterpolator(x, force)
        if smooth:
            count = min(32, (x.size - 1) // 3)
            inner = np.interp(np.arange(1, count) / count, np.linspace(0, 1, x.size), x)
            knots = np.concatenate([[x[0]] * 4, inner, [x[-1]] * 4])
            made = interpolate.make_lsq_spline(x, force, knots, 3)
        self.low, self.high = float(x[0]), float(x[-1])
        self.made, self.slope, self.integral = made, made.derivative(), made.antiderivative()

    def force(self, x):
        end = min(max(x, self.low), self.high)
        return float(self.made(end) + self.slope(end) * (x - end))

    def energy(self, x):
        end = min(max(x, self.low), self.high)
        beyond = x - end
        line = float(self.made(end)) * beyond + 0.5 * float(self.slope(end)) * beyond**2
        return float(self.integral(end) - self.integral(0.0)) + line


class Written:
    """The equations of one device in its scene's units, from the tables of the scene."""

    def __init__(self, scene):
        tables = scene.to_tables()
        oscillator = tables["oscillator"]
        self.mass = oscillator.get("mass", 1.0)
        self.damping = oscillator["damping"]
        self.drag = oscillator.get("quadratic_damping", 0.0)
        short = (0.0, oscillator.get("linear_stiffness"), 0.0, oscillator.get("cubic_stiffness"))
        self.force_of = list(oscillator.get("restoring_force", short))
        self.table = None
        if "force_table" in oscillator:
            points = np.array(oscillator["force_table"])
            kind = oscillator.get("force_interpolation", "monotone")
            self.table = Tabulated(*points.T, smooth=kind == "smooth")
        stoppers = tables.get("stoppers", [])
        stoppers = [stoppers] if isinstance(stoppers, dict) else stoppers
        self.contacts = [
            (s, each)
            for each in stoppers
            for s in {"left": (-1,), "right": (1,), "both": (1, -1)}[each.get("side", "both")]
        ]
        self.edges = sorted({s * each["gap"] for s, each in self.contacts})
        self.piezo, self.coil = tables.get("piezo"), tables.get("coil")
        self.load = tables["load"]
        self.start = tables.get("start", {})

    def spring(self, x):
        if self.table:
            return self.table.force(x)
        return sum(k * x**n for n, k in enumerate(self.force_of))

    def spring_energy(self, x):
        if self.table:
            return self.table.energy(x)
        return sum(k * x ** (n + 1) / (n + 1) for n, k in enumerate(self.force_of))

    def contact(self, s, stopper, x, v, held):
        """Force of one stopper on its side s."""
        depth = s * x - stopper["gap"]
        if depth <= 0.0:
            return 0.0
        n, stiffness = stopper.get("exponent", 1.5), stopper["stiffness"]
        stored = stiffness * depth ** (n + 1.0) / (n + 1.0)
        gain = self.spring_energy(x) - self.spring_energy(s * stopper["gap"])
        v0 = math.sqrt(v * v + 2.0 / self.mass * (max(gain, 0.0) + stored))
        if stopper.get("impact_velocity") == "event":
            v0 = max(held, abs(v))
        b = 0.75 * (1.0 - stopper["restitution"] ** 2) / v0
        return s * stiffness * depth**n * (1.0 + b * s * v)

    def contact_energy(self, x):
        total = 0.0
        for s, each in self.contacts:
            n, depth = each.get("exponent", 1.5), max(s * x - each["gap"], 0.0)
            total += each["stiffness"] * depth ** (n + 1.0) / (n + 1.0)
        return total

    def electrical(self, v, state):
        """(force on the mass, rate of the state): volts of a piezo, amperes of a coil."""
        if self.piezo:
            theta, cp = self.piezo["coupling"], self.piezo.get("capacitance", 1.0)
            if "decay_rate" in self.load:
                rate = self.load["decay_rate"] + self.piezo.get("leakage_rate", 0.0)
                return theta * state, v - rate * state
            leak = self.piezo.get("leakage_resistance", math.inf)
            current = state / self.load["resistance"] + state / leak
            return theta * state, (theta * v - current) / cp
        constant, inductance = self.coil["coupling"], self.coil["inductance"]
        resistance = self.coil["resistance"] + self.load["resistance"]
        if inductance == 0.0:
            return constant * constant * v / resistance, 0.0
        return constant * state, (constant * v - resistance * state) / inductance

    def derivative(self, y, eta, held):
        x, v, state = y
        back, rate = self.electrical(v, state)
        force = self.mass * eta - self.damping * v - self.drag * abs(v) * v - self.spring(x) - back
        for s, stopper in self.contacts:
            force -= self.contact(s, stopper, x, v, held)
        return np.array([v, force / self.mass, rate])

    def touches(self, x):
        return any(s * x > each["gap"] for s, each in self.contacts)


@kept
def written_path(scene, knots, index=0, displaced=0.0):
    """(X, X', state) at the knots 0, 1, …, by DOP853 on the noise's own knots; shape (knots+1, 3).

    In the scene's units; `displaced` is added to the displacement at the start. Steps of scipy are
    cut where a contact begins, so that the speed there can be held and the solver keeps its order.
    """
    ready = prepared(scene)
    device, spacing = Written(scene), knot_spacing(ready)
    scales = ready.scales
    noise = noise_path(ready, index).read(knots + 1) * scales.displacement
    x, v, _ = start_state(ready, index)
    state = np.array(
        [
            x * scales.displacement + displaced,
            v * scales.displacement,
            device.start.get("voltage", 0.0),
        ]
    )
    held = 0.0
    states = [state]
    for knot in range(knots):
        slope = (noise[knot + 1] - noise[knot]) / spacing
        time = 0.0
        while time < spacing:

            def derivative(t, y, start=noise[knot], slope=slope, held=held):
                return device.derivative(y, start + slope * t, held)

            time, state, crossed = _to_an_edge(device, derivative, time, spacing, state)
            if crossed is not None:
                outward = math.copysign(1.0, state[1]) == math.copysign(1.0, crossed)
                if outward and not device.touches(crossed):
                    held = abs(state[1])
        states.append(state)
    return np.array(states)


def _to_an_edge(device, derivative, time, end, state):
    """(time, state, edge) where x next crosses an edge, or (end, state there, None)."""
    size = max(device.edges, key=abs, default=1.0)
    tolerances = np.array([1e-13 * abs(size), 1e-13, 1e-13])
    solver = DOP853(derivative, time, state, end, rtol=1e-12, atol=tolerances)
    while solver.status == "running":
        solver.step()
        path = solver.dense_output() if device.edges else None
        for edge in device.edges:
            before, after = solver.y_old[0] - edge, solver.y[0] - edge
            if before * after < 0.0 and abs(before) > 1e-12 * abs(edge):
                at = brentq(
                    lambda t, path=path, edge=edge: path(t)[0] - edge,
                    solver.t_old,
                    solver.t,
                    xtol=1e-15,
                )
                at_edge = path(at)
                # Beyond the edge by less than anything counts: the next step starts there.
                at_edge[0] = edge * (1.0 + 1e-13 * math.copysign(1.0, at_edge[1] * edge))
                return at, at_edge, edge
    return end, solver.y, None


def gibbs(scene):
    """exp{−(C/(M D)) U/M} of a scene in white noise without coupling, as a function of x."""
    device = Written(scene)
    temperature = scene.excitation.intensity * device.mass / device.damping

    def weight(x):
        energy = device.spring_energy(x) + device.contact_energy(x)
        return math.exp(-energy / device.mass / temperature)

    return weight


def gibbs_share(weight, low, high, reach):
    """Share of time between two displacements by quadrature over ±reach."""
    options = {"limit": 500, "epsabs": 1e-14, "epsrel": 1e-12}
    places = [-reach, *np.linspace(-reach, reach, 41)[1:-1], reach]

    def area(a, b):
        cuts = [a, *[p for p in places if a < p < b], b]
        return sum(quad(weight, c, d, **options)[0] for c, d in itertools.pairwise(cuts))

    return area(max(low, -reach), min(high, reach)) / area(-reach, reach)

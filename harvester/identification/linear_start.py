"""Initial values of a fit: coefficients by linear regression on the measured motion.

The equation of motion is multiplied by smooth functions φ that vanish outside some period and
integrated by parts, so that nothing is differentiated twice (weak form; Messenger and Bortz,
Multiscale Model. Simul. 19, 1474 (2021)):

    s ∫φ'' z = ∫φ [η − s c w − s² C2 |w| w − Σ kₙ sⁿ zⁿ − contacts − T],   x = s z, x' = s w.

The nonlinear unknowns are searched on a grid: the scale s of a motion derived from its voltage, the
electrical rate, and the gap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import timescales
from harvester.identification.sensors import VELOCITY_SCALE
from harvester.identification.unknowns import (
    BASE_FACTOR,
    BASE_SCALE,
    DRAG,
    spring_coefficients,
    spring_key,
)
from harvester.scene.numbers import numbers

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.identification.response import Trial
    from harvester.identification.shooting import Shooting

# Frequencies below this share of the median frequency count as drift and are removed.
SLOW_SHARE = 0.15


@dataclass(frozen=True)
class Motion:
    """Displacement, velocity and transducer's state at the samples, scaled, each shape (n,).

    Attributes
    ----------
    measured : bool
        Whether the displacement itself was measured.
    """

    x: np.ndarray
    v: np.ndarray
    state: np.ndarray
    measured: bool

    def states(self, samples: np.ndarray) -> np.ndarray:
        """States at some samples, shape (number of samples, 3)."""
        return np.column_stack([self.x[samples], self.v[samples], self.state[samples]])

    def centred(self, position: float) -> Motion:
        """The motion with its mean at `position`; unchanged if the displacement was measured."""
        return (
            self if self.measured else replace(self, x=self.x + (position - float(self.x.mean())))
        )

    def without_drift(self, measurement: Measurement) -> Motion:
        """The motion with its slow drift removed by a high-pass filter."""
        from scipy import signal

        if self.measured:
            return self
        slow = SLOW_SHARE * measurement.frequencies[0]
        sections = signal.butter(2, slow, "highpass", fs=measurement.sampling_rate, output="sos")
        return replace(self, x=signal.sosfiltfilt(sections, self.x))


def motion(trial: Trial) -> Motion:
    """The motion of a record, computed with the scene's transducer.

    If only the voltage was recorded, the state e of a piezo, or of a coil with inductance, obeys
    e' = x' − λ e, where λ is the decay rate through the load. Then x = e + λ ∫e dt. For a coil
    without inductance the voltage is proportional to x', and x = ∫x' dt.
    """
    (system, scales), measurement = trial.known_device, trial.shown
    rate, transducer = measurement.sampling_rate, system.transducer
    smooth = _smoother(measurement.frequencies[1], rate)
    of_velocity = float(transducer.voltage(1.0, 0.0))
    of_state = float(transducer.voltage(0.0, 1.0))
    state = np.zeros(measurement.acceleration.size)
    x: Any = None
    v: Any = None
    outputs = {
        name: values / (scales.voltage if name == "voltage" else scales.displacement)
        for name, values in measurement.outputs.items()
    }
    if "voltage" in outputs and of_state != 0.0:
        state = outputs["voltage"] / of_state
        decay = transducer.decay_rate()
        x = state + decay * _integral(state, rate)
        v = smooth(state, 1) + decay * smooth(state, 0)
    elif "voltage" in outputs:
        v = smooth(outputs["voltage"] / of_velocity, 0)
        x = _integral(outputs["voltage"] / of_velocity, rate)
    if "displacement" in outputs:
        x, v = smooth(outputs["displacement"], 0), smooth(outputs["displacement"], 1)
    if "velocity" in outputs:
        v = smooth(outputs["velocity"], 0)
        x = x if "displacement" in outputs else _integral(outputs["velocity"], rate)
    if "voltage" not in outputs and v is not None:
        state = _driven_state(v, transducer.decay_rate(), rate)
    return Motion(x, v, state, "displacement" in outputs)


def _integral(values, rate):
    from scipy.integrate import cumulative_trapezoid

    return cumulative_trapezoid(values, dx=1.0 / rate, initial=0.0)


def _smoother(frequency, rate):
    """Values or slopes of a signal by local cubics over a fraction of the fastest period."""
    from scipy import signal

    width = max(5, 2 * round(0.25 * rate / frequency) + 1)

    def smooth(values, order):
        if width > values.size:
            return np.gradient(values) * rate if order else values
        return signal.savgol_filter(values, width, 3, deriv=order, delta=1.0 / rate)

    return smooth


def _driven_state(v, decay, rate):
    """e of e' = v − λ e from rest."""
    from scipy.signal import lfilter

    share = np.exp(-decay / rate)
    gain = (1.0 - share) / decay if decay > 0.0 else 1.0 / rate
    return lfilter([0.5 * gain, 0.5 * gain], [1.0, -share], v)


# Length of a test function in periods of the motion, and number of test functions per length.
COVERED_PERIODS, PER_COVERED = 1.5, 8
# The regression replaces a force table by a polynomial of this degree.
TABLE_DEGREE = 5
# The regression tries these factors of the capacitance and of the motion's scale, and gaps of these
# shares of the largest displacement.
ELECTRICAL_FACTORS = np.geomspace(0.2, 5.0, 13)
SCALE_FACTORS = np.geomspace(0.1, 10.0, 81)
GAP_SHARES = np.linspace(0.35, 0.95, 13)
# Origins to try, in rms values of the motion: motion in one well is far from the origin.
ORIGINS = np.sinh(np.linspace(-5.0, 5.0, 1001))
MOST_ORIGINS = 2
# Smallest damping ratio of a start.
LEAST_DAMPING_RATIO = 0.003


@dataclass(frozen=True)
class StartingPoint:
    """Values of the unknowns, and the corresponding motion of each experiment.

    Attributes
    ----------
    values : ndarray, shape (unknowns,)
    """

    values: np.ndarray
    motions: list[Motion]


def start_at(problem: Shooting, values: np.ndarray, centre: float | None = None) -> StartingPoint:
    """The start at given values with the corresponding motions.

    Motions whose displacement was not measured are centred if `centre` is given. A free scale of a
    velocity sensor fits the first motion that has a velocity.
    """
    trials = [problem.at(number, values) for number in range(len(problem.experiments))]
    motions = [motion(trial) for trial in trials]
    if VELOCITY_SCALE in problem.keys:
        pairs = zip(trials, motions, strict=True)
        scales = (trial.velocity_scale(path.v * problem.length) for trial, path in pairs)
        if scale := next(filter(None, scales), None):
            values = np.where([key == VELOCITY_SCALE for key in problem.keys], abs(scale), values)
    if centre is not None:
        motions = [path.centred(centre) for path in motions]
    return StartingPoint(values, motions)


def regressed(problem: Shooting, number: int, drifts: bool) -> list[StartingPoint]:
    """Starts by regression on one experiment, one for each likely origin of its displacement.

    The other records' motions are centred at this origin too.

    Parameters
    ----------
    problem : Shooting
        Its starts are the values that the regression does not determine.
    drifts : bool
        Whether to keep the slow part of an integrated voltage: it is needed if the mass changes
        wells, and only adds noise otherwise.
    """
    capacitance = np.array([key == "piezo.capacitance" for key in problem.keys])
    trials = (
        problem.at(number, np.where(capacitance, factor, 1.0) * problem.first)
        for factor in (ELECTRICAL_FACTORS if capacitance.any() else (1.0,))
    )
    tried = [_Regression(trial, drifts) for trial in trials if trial.device]
    if not tried:
        return []
    best = min(tried, key=lambda regression: regression.misfit)
    starts = [
        (np.clip([*best.values(origin).values()], problem.low, problem.high), origin)
        for origin in best.origins()
    ]
    return [
        start_at(problem, values, origin)
        for values, origin in starts
        if problem.at(number, values).device
    ]


class _Regression:
    """Weak form of one experiment's equation of motion, solved for its best scale and gaps.

    z and w are displacement and velocity in units of the rms displacement, with x = size·z + origin
    and x' = size·w. The coefficient of a force of degree n in the motion is that of the regression
    divided by sizeⁿ, and in the scene's units times mass·length¹⁻ⁿ.
    """

    def __init__(self, trial, drifts):
        seen, (system, scales) = motion(trial), trial.known_device
        if not drifts:
            seen = seen.without_drift(trial.measurement)
        self.known, self.scene, self.length = trial.known, trial.scene, scales.displacement
        self.powers = _powers(self.scene)
        self.degree = max(n for n, k in enumerate(self.powers) if k or n == 1)
        is_si = self.scene.units == "SI"
        self.mass = self.scene.oscillator.mass if is_si else 1.0
        stops = [stop for stop in self.scene.stoppers if stop.stiffness > 0.0]
        several = len(stops) > 1 or any(stop.side != "both" for stop in stops)
        self.stops = {f"stoppers[{n}]" if several else "stoppers": s for n, s in enumerate(stops)}
        self.mean, self.is_measured = float(np.mean(seen.x)), seen.measured
        unit = float(np.std(seen.x)) or 1.0
        self.z, self.w = (seen.x - self.mean) / unit, seen.v / unit
        # Whether the coefficient of the transducer's force is fitted (β of a scaled scene).
        self.linear_force = not is_si and "piezo.coupling" in self.known
        # Whether the factor of the drive is unknown, and the scale of the motion known.
        self.free_drive = bool({BASE_SCALE, BASE_FACTOR} & {*self.known}) and seen.measured
        rate, frequency = trial.measurement.sampling_rate, trial.measurement.frequencies[0]
        width = int(np.clip(round(COVERED_PERIODS / frequency * rate), 16, self.z.size // 4))
        # φ = (1 − u²)⁴ on −1 < u < 1, and its derivatives.
        u, half = np.linspace(-1.0, 1.0, width + 2)[1:-1], 0.5 * (width + 1) / rate
        bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** 4
        self.phi = [bump.deriv(n)(u) / half**n for n in range(3)]
        self.places = np.arange(0, self.z.size - width, max(1, width // PER_COVERED))
        self.drive = self._integrated(trial.excitation[:: trial.experiment.steps])
        self.force = self._integrated(np.array(system.transducer.force(seen.v, seen.state)))
        self.inertia = unit * self._integrated(self.z, 2)
        has_gaps = any(key.startswith("stoppers") and "gap" in key for key in numbers(self.scene))
        couplings = {"piezo.coupling", "coil.coupling"} & {*self.known}
        free_scale = couplings and is_si and not seen.measured and self.drive.any()
        self.misfit, self.factor, self.share, self.terms = min(
            (
                solution
                for share in (GAP_SHARES if has_gaps else (None,))
                for solution in self._solved(share, SCALE_FACTORS if free_scale else (1.0,))
            ),
            key=lambda solution: solution[0],
        )
        self.size = unit * self.factor

    def _integrated(self, values, order=0):
        """∫φ⁽ᵒʳᵈᵉʳ⁾ values for all test functions."""
        return np.convolve(values, self.phi[order][::-1], mode="valid")[self.places]

    def _columns(self, share):
        """Degree and integral of each force with an unknown coefficient, by key or power of z."""
        z, w = self.z, self.w
        columns: dict[Any, Any] = {"oscillator.damping": (1, -self._integrated(z, 1))}
        if DRAG in self.known:
            columns[DRAG] = 2, self._integrated(np.abs(w) * w)
        columns |= {n: (n, self._integrated(z**n)) for n in range(self.degree + 1)}
        for table, stop in self.stops.items() if share is not None else ():
            right = np.maximum(z - share * z.max(), 0.0) ** stop.exponent
            left = np.maximum(share * z.min() - z, 0.0) ** stop.exponent
            push = {"right": right, "left": -left, "both": right - left}[stop.side]
            columns[f"{table}.stiffness"] = stop.exponent, self._integrated(push)
            columns[f"{table}.dashpot"] = 0, self._integrated(np.abs(push) * w)
        if self.linear_force:
            columns["piezo.coupling"] = 0, self.force
        if self.free_drive:
            columns["drive"] = 0, -self.drive
        return columns

    def _solved(self, share, factors):
        """(misfit, s, share, terms) for each factor s of the motion.

        The right-hand side is a sum of terms in s⁰, s¹ and s⁻¹, each solved once.
        """
        forces = self._columns(share)
        degrees = [degree for degree, _ in forces.values()]
        columns = np.column_stack([column for _, column in forces.values()])
        # A term with an unknown coefficient is a column, and is omitted here.
        drive, force = self.drive * (not self.free_drive), -self.force * (not self.linear_force)
        right = np.column_stack([drive, -self.inertia, force])
        norms = np.linalg.norm(columns, axis=0)
        norms[norms == 0.0] = 1.0
        solutions = np.linalg.lstsq(columns / norms, right, rcond=1e-10)[0] / norms[:, None]
        residuals = right - columns @ solutions
        size = np.linalg.norm(right[:, 0]) or np.linalg.norm(self.inertia)
        for s in factors:
            powers = np.array([1.0, s, 1.0 / s])
            terms = zip(degrees, solutions @ powers, strict=True)
            misfit = np.linalg.norm(residuals @ powers) / size
            yield misfit, s, share, dict(zip(forces, terms, strict=True))

    def _spring(self):
        """Scaled coefficients of F as a polynomial of x − origin."""
        return np.array([self.terms[n][1] / self.size**n for n in range(self.degree + 1)])

    def _in_scene(self, degree, coefficient):
        """A scaled coefficient of a force in the scene's units."""
        return coefficient * self.mass * self.length ** (1 - degree)

    def values(self, origin: float) -> dict[str, float]:
        """Values of the unknowns with x = size·z + origin."""
        spring = shifted(self._spring(), origin)
        changes = {
            key: self._in_scene(degree, coefficient / self.size**degree)
            for key, (degree, coefficient) in self.terms.items()
            if key not in ("drive", "piezo.coupling")
        }
        # A negative stiffness of a stopper or a negative drag is noise.
        changes = {k: v for k, v in changes.items() if v > 0.0 or "stiffness" not in str(k)}
        least = 2.0 * LEAST_DAMPING_RATIO * np.sqrt(abs(spring[1])) * self.mass
        changes["oscillator.damping"] = max(changes["oscillator.damping"], least)
        changes[DRAG] = max(changes.get(DRAG, 0.0), 0.0)
        oscillator = self.scene.oscillator
        changes |= {spring_key(oscillator, n): self._in_scene(n, k) for n, k in enumerate(spring)}
        for table, stop in self.stops.items() if self.share is not None else ():
            right = self.share * self.z.max() * self.size + origin
            left = -self.share * self.z.min() * self.size - origin
            gap = {"right": right, "left": left, "both": 0.5 * (right + left)}[stop.side]
            changes[f"{table}.gap"] = gap * self.length
        # In a scaled scene β is proportional to the force, otherwise the coupling to 1/s.
        _, coupling = self.terms.get("piezo.coupling", (0, 1.0 / self.factor))
        # The drive is the base factor divided by the sensor's scale; only one of them is free.
        drive = self.terms.get("drive", (0, 1.0))[1] or 1.0
        factors = {"piezo.coupling": coupling, "coil.coupling": coupling}
        factors |= {BASE_FACTOR: drive, BASE_SCALE: 1.0 / drive}
        changes |= {k: factor * self.known[k] for k, factor in factors.items() if k in self.known}
        return {
            k: changes[k] if np.isfinite(changes.get(k, np.nan)) else self.known[k]
            for k in self.known
        }

    def origins(self) -> list[float]:
        """Likely mean displacements: those at which the coefficients that are not free keep their
        values.
        """
        if self.is_measured:
            return [self.factor * self.mean]
        oscillator, powers = self.scene.oscillator, [*self.powers, *[0.0] * self.degree]
        fixed = {
            n: powers[n] * self.length ** (n - 1) / self.mass
            for n in range(self.degree + 1)
            if spring_key(oscillator, n) not in self.known
        }
        if not fixed:
            return [0.0]
        origins, spring = ORIGINS * self.size, self._spring()
        moved = np.array([shifted(spring, origin) for origin in origins])
        off = sum(((moved[:, n] - k) * self.size**n) ** 2 for n, k in fixed.items())
        around = np.concatenate([[np.inf], off, [np.inf]])
        dips = np.flatnonzero((off < around[:-2]) & (off <= around[2:]))
        best = sorted(dips, key=lambda index: off[index])[:MOST_ORIGINS]
        return [float(origins[index]) for index in best]


def _powers(scene):
    """(F0, k1, …) in the scene's units; for a table, coefficients of a fitted polynomial."""
    if scene.oscillator.force_table is None:
        return spring_coefficients(scene)
    displacement, force = np.array(scene.oscillator.force_table).T
    degree = min(TABLE_DEGREE, len(force) - 1)
    return np.polynomial.Polynomial.fit(displacement, force, degree).convert().coef.tolist()


def shifted(coefficients: np.ndarray, distance: float) -> np.ndarray:
    """Coefficients of F(x − distance) from the coefficients of F(x)."""
    moved = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([-distance, 1.0]))
    return np.append(moved.coef, np.zeros(len(coefficients)))[: len(coefficients)]


def starts_from(problem: Shooting) -> list[StartingPoint]:
    """All starts to try: the scene's values, and regressions on each record."""
    starts: list[StartingPoint] = []
    for number, experiment in enumerate(problem.experiments):
        starts += regressed(problem, number, True)
        if "displacement" not in experiment.measurement.outputs:
            # An integrated voltage has a slow drift, so the motion is also tried without it.
            starts += regressed(problem, number, False)
    system, _ = problem.at(0, problem.first).known_device
    wells, saddles = timescales.wells(system), timescales.saddles(system)
    measured = "displacement" in problem.experiments[0].measurement.outputs
    positions = [*wells[:1]] if measured else [*wells, *saddles]
    return starts + [start_at(problem, problem.first, centre) for centre in positions]

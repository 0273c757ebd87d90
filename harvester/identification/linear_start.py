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
from harvester.identification.unknowns import BASE_FACTOR, BASE_SCALE, DRAG, spring_key
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

    With a voltage alone, e' = x' − λ e gives x = e + λ ∫e for a capacitance or an inductance; x =
    ∫x' if the voltage is proportional to the velocity.
    """
    (system, scales), measurement = trial.known_device, trial.shown
    rate, transducer = measurement.sampling_rate, system.transducer
    outputs = measurement.outputs
    smooth = _smoother(measurement.frequencies[1], rate)
    of_velocity = float(transducer.voltage(1.0, 0.0))
    of_state = float(transducer.voltage(0.0, 1.0))
    state = np.zeros(measurement.acceleration.size)
    x: Any = None
    v: Any = None
    if "voltage" in outputs:
        seen = outputs["voltage"] / scales.voltage
        if of_state != 0.0:
            state = seen / of_state
            decay = transducer.decay_rate()
            x = state + decay * _integral(state, rate)
            v = smooth(state, 1) + decay * smooth(state, 0)
        else:
            v = smooth(seen / of_velocity, 0)
            x = _integral(seen / of_velocity, rate)
    if "displacement" in outputs:
        seen = outputs["displacement"] / scales.displacement
        x, v = smooth(seen, 0), smooth(seen, 1)
    if "velocity" in outputs:
        seen = outputs["velocity"] / scales.displacement
        v = smooth(seen, 0)
        x = x if "displacement" in outputs else _integral(seen, rate)
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


def unchanged_start(
    problem: Shooting, values: np.ndarray, centre: float | None = None
) -> StartingPoint:
    """The start at given values with the corresponding motions, centred if `centre` is given."""
    motions = [motion(problem.at(n, values)) for n in range(len(problem.experiments))]
    if centre is not None:
        motions = [path.centred(centre) for path in motions]
    return StartingPoint(values, motions)


def regressed(problem: Shooting, number: int, drifts: bool) -> list[StartingPoint]:
    """Starts by regression on one experiment, one for each likely origin of its displacement.

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
    best = min(tried, key=lambda regression: regression.misfit, default=None)
    starts: list[StartingPoint] = []
    if best is None:
        return starts
    for fitted_values, origin in best.results():
        changed = np.clip(list(fitted_values.values()), problem.low, problem.high)
        if problem.at(number, changed).device is None:
            continue
        start = unchanged_start(problem, changed)
        # The regression gives only this record's origin; the other records' motions are centred
        # there too.
        motions = [path.centred(origin) for path in start.motions]
        starts.append(StartingPoint(changed, motions))
    return starts


class _Regression:
    """Weak form of one experiment's equation of motion."""

    def __init__(self, trial, drifts):
        seen, (system, self.scales) = motion(trial), trial.known_device
        if not drifts:
            seen = seen.without_drift(trial.measurement)
        self.known, self.scene = trial.known, trial.scene
        experiment = trial.experiment
        self.powers = _powers(self.scene.oscillator)
        self.degree = max(n for n, k in enumerate(self.powers) if k or n == 1)
        self.mass = self.scene.oscillator.mass if self.scene.units == "SI" else 1.0
        self.stops = [stop for stop in self.scene.stoppers if stop.stiffness > 0.0]
        self.offset = float(np.mean(seen.x))
        self.z, self.w, self.state = seen.x - self.offset, seen.v, seen.state
        self.centred = "displacement" not in experiment.measurement.outputs
        self.unit = float(np.std(self.z)) or 1.0
        # Whether the coefficient of the transducer's force is fitted (β of a scaled scene).
        self.linear_force = self.scene.units != "SI" and "piezo.coupling" in self.known
        # Whether the factor of the drive is unknown, and the scale of the motion known.
        self.free_drive = bool({BASE_SCALE, BASE_FACTOR} & {*self.known}) and not self.centred
        rate = experiment.measurement.sampling_rate
        period = 1.0 / experiment.measurement.frequencies[0]
        width = int(np.clip(round(COVERED_PERIODS * period * rate), 16, self.z.size // 4))
        # φ = (1 − u²)⁴ on −1 < u < 1, and its derivatives.
        u, half = np.linspace(-1.0, 1.0, width + 2)[1:-1], 0.5 * (width + 1) / rate
        bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** 4
        self.phi = [bump.deriv(n)(u) / half**n for n in range(3)]
        self.places = np.arange(0, self.z.size - width, max(1, width // PER_COVERED))
        self.drive = self._integrated(trial.excitation[:: experiment.steps])
        self.force = self._integrated(np.array(system.transducer.force(self.w, self.state)))
        self.inertia = self._integrated(self.z, 2)
        self.damping = -self._integrated(self.z, 1)
        self.solved = self._best()
        self.misfit = self.solved[0]

    def _integrated(self, values, order=0):
        """∫φ⁽ᵒʳᵈᵉʳ⁾ values for all test functions."""
        full = np.convolve(values, self.phi[order][::-1], mode="valid")
        return full[self.places]

    def _best(self):
        """(misfit, coefficients, scale, gaps' share, names) of the best scale and gaps."""
        known_scale = not (
            {"piezo.coupling", "coil.coupling"} & set(self.known)
            and self.scene.units == "SI"
            and self.centred
        )
        known_scale |= not self.drive.any()
        factors = (1.0,) if known_scale else SCALE_FACTORS
        has_gaps = any(key.startswith("stoppers") and "gap" in key for key in numbers(self.scene))
        gap_shares = GAP_SHARES if has_gaps else (None,)
        solutions = []
        for share in gap_shares:
            columns = self._columns(share)
            solved = self._solved(np.column_stack(list(columns.values())), factors)
            solutions += [(*solution, share, list(columns)) for solution in solved]
        return min(solutions, key=lambda solution: solution[0])

    def results(self) -> list:
        """(values, mean displacement) for each likely origin."""
        _, solution, s, share, names = self.solved
        terms = dict(zip(names, solution, strict=True))
        return [self._translated(terms, s, share, shift) for shift in self._shifts(terms, s)]

    def _columns(self, share):
        """Columns of the regression (integrals of terms, divided by s) by their coefficients'
        names.
        """
        z = self.z / self.unit
        columns = {"damping": self.damping}
        if DRAG in self.known:
            columns["drag"] = self._integrated(np.abs(self.w) * self.w)
        for power in range(self.degree + 1):
            columns[f"k{power}"] = self._integrated(z**power)
        for index, stop in enumerate(self.stops if share is not None else ()):
            push = self._push(share, stop)
            columns[f"contact{index}"] = self._integrated(push)
            columns[f"dashpot{index}"] = self._integrated(np.abs(push) * self.w)
        if self.linear_force:
            columns["force"] = self.force
        if self.free_drive:
            columns["drive"] = -self.drive
        return columns

    def _push(self, share, stop):
        right = np.maximum(self.z - share * self.z.max(), 0.0) ** stop.exponent
        left = np.maximum(-self.z + share * self.z.min() * 1.0, 0.0) ** stop.exponent
        return {"right": right, "left": -left, "both": right - left}[stop.side]

    def _solved(self, columns, factors):
        """(misfit, coefficients, s) for each scale s of the motion.

        The right-hand side is a sum of terms in s⁰, s¹ and s⁻¹, each solved once.
        """
        # A term with an unknown coefficient is a column, and is omitted here.
        drive, force = self.drive * (not self.free_drive), -self.force * (not self.linear_force)
        terms = np.column_stack([drive, -self.inertia, force])
        norms = np.linalg.norm(columns, axis=0)
        norms[norms == 0.0] = 1.0
        solutions = np.linalg.lstsq(columns / norms, terms, rcond=1e-10)[0] / norms[:, None]
        residuals = terms - columns @ solutions
        size = np.linalg.norm(terms[:, 0]) or np.linalg.norm(self.inertia)
        powers = [np.array([1.0, s, 1.0 / s]) for s in factors]
        return [
            (np.linalg.norm(residuals @ scale_powers) / size, solutions @ scale_powers, s)
            for scale_powers, s in zip(powers, factors, strict=True)
        ]

    def _force(self, terms, s):
        """Coefficients of F as a polynomial of s z, scaled."""
        return np.array([terms[f"k{n}"] / (s * self.unit) ** n for n in range(self.degree + 1)])

    def _translated(self, terms, s, share, shift):
        """(values, mean displacement) with x = s z + shift."""
        mass, length = self.mass, self.scales.displacement
        moved = shifted(self._force(terms, s), shift)
        stiffness = abs(moved[1]) if moved.size > 1 else 1.0
        least = 2.0 * LEAST_DAMPING_RATIO * np.sqrt(stiffness)
        changes = {"oscillator.damping": mass * max(terms["damping"] / s, least)}
        changes |= {
            spring_key(self.scene.oscillator, n): mass * k * length ** (1 - n)
            for n, k in enumerate(moved)
        }
        if "drag" in terms:
            changes[DRAG] = mass / length * max(terms["drag"] / s**2, 0.0)
        # In a scaled scene β is proportional to the force, otherwise the coupling to 1/s.
        for key in ("piezo.coupling", "coil.coupling"):
            changes[key] = self._value(key) * terms.get("force", 1.0 / s)
        if terms.get("drive"):
            # The drive is the base factor divided by the sensor's scale; only one of them is free.
            changes[BASE_SCALE] = self._value(BASE_SCALE) / terms["drive"]
            changes[BASE_FACTOR] = self._value(BASE_FACTOR) * terms["drive"]
        if share is not None:
            changes |= self._stops(terms, s, share, shift)
        solved = {k: changes[k] for k in self.known if np.isfinite(changes.get(k, np.nan))}
        return {**self.known, **solved}, shift

    def _value(self, key):
        """Value of a scene's key, whether free or not; 0 if the scene has no such key."""
        return self.known.get(key, float(numbers(self.scene).get(key, (0.0,))[0]))

    def _stops(self, terms, s, share, shift):
        """Gaps and stiffnesses of the contacts."""
        mass, length = self.mass, self.scales.displacement
        changes = {}
        several = len(self.stops) > 1 or self.stops[0].side != "both"
        for index, stop in enumerate(self.stops):
            table = f"stoppers[{index}]" if several else "stoppers"
            right = share * self.z.max() * s + shift
            left = -share * self.z.min() * s - shift
            gap = {"right": right, "left": left, "both": 0.5 * (right + left)}[stop.side]
            push = terms[f"contact{index}"] / s**stop.exponent
            changes[f"{table}.gap"] = gap * length
            if push > 0.0:
                changes[f"{table}.stiffness"] = push * mass * length ** (1.0 - stop.exponent)
        return changes

    def _shifts(self, terms, s):
        """Likely mean displacements: those at which the coefficients that are not free keep their
        values.
        """
        if not self.centred:
            return [s * self.offset]
        fixed = self._kept_coefficients()
        if not fixed:
            return [0.0]
        force, rms = self._force(terms, s), s * self.unit
        off = np.zeros(ORIGINS.size)
        for index, origin in enumerate(ORIGINS * rms):
            moved = shifted(force, origin)
            off[index] = sum(
                ((moved[n] - k) * rms**n) ** 2 for n, k in fixed.items() if n < moved.size
            )
        around = np.concatenate([[np.inf], off, [np.inf]])
        dips = np.flatnonzero((off < around[:-2]) & (off <= around[2:]))
        best = sorted(dips, key=lambda index: off[index])[:MOST_ORIGINS]
        return [float(ORIGINS[index] * rms) for index in best]

    def _kept_coefficients(self):
        """Scaled spring coefficients that are not free, by power."""
        length, fixed = self.scales.displacement, {}
        for n in range(self.degree + 1):
            if spring_key(self.scene.oscillator, n) not in self.known:
                value = self.powers[n] if n < len(self.powers) else 0.0
                fixed[n] = value * length ** (n - 1) / self.mass
        return fixed


def _powers(oscillator):
    """(F0, k1, …) in the scene's units; for a table, coefficients of a fitted polynomial."""
    if oscillator.force_table is None:
        return [k or 0.0 for k in oscillator.coefficients]
    displacement, force = np.array(oscillator.force_table).T
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
    starts += [unchanged_start(problem, problem.first, centre) for centre in positions]
    return [_with_velocity_scale(problem, start) for start in starts]


def _with_velocity_scale(problem, start):
    """The start with the free scale of a velocity sensor that fits its motion."""
    if VELOCITY_SCALE not in problem.keys:
        return start
    for number, path in enumerate(start.motions):
        trial = problem.at(number, start.values)
        if scale := trial.velocity_scale(path.v * problem.length):
            values = {**trial.known, VELOCITY_SCALE: abs(scale)}
            return StartingPoint(np.array(list(values.values())), start.motions)
    return start

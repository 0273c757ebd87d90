"""Determine a scene's numbers from an impedance.

Y = iω Cp + 1/R_leak + iω θ²/(k − M ω² + iω C) for small motion about the rest position with clamped
base. An impedance determines one number less than the scene has: fs, Q, θ²/M and Cp are known, and
stiffness, damping and coupling² are proportional to the scene's mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import approx_fprime, least_squares

from harvester.base.errors import IdentificationError, SceneError
from harvester.device import timescales
from harvester.device.piezo import PiezoTable
from harvester.identification.intervals import HALF_INTERVAL, interval
from harvester.identification.measured_response import MeasuredImpedance
from harvester.identification.unknowns import MASS, spring_key
from harvester.scene.numbers import numbers
from harvester.scene.prepared import prepared

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.scene.model import Scene

# A further mode is first tried with these quality factors, at each of the measured frequencies.
QUALITIES = np.geomspace(5.0, 2000.0, 9)
MOST_PLACES = 400
MOST_MODES = 6
# A further mode is accepted only if it lowers n ln(sum of squares) by more than this plus 3 ln n
# (three new parameters, Schwarz criterion). Noise alone does so in fewer than one of 10,000 sets.
SURE_OF_MODE = 20.0
# A branch with a lower quality factor corrects the background and does not count as a resonance.
LOWEST_QUALITY = 3.0
# Minimum number of points in a resonance's half-power width to determine its quality factor.
FEWEST_OVER_WIDTH = 3
NUMBERS = {
    "series_resonance": "Hz",
    "parallel_resonance": "Hz",
    "capacitance": "F",
    "coupling_factor": "",
    "quality": "",
    "loss_tangent": "",
}
SYMBOLS = dict(zip(NUMBERS, ("fs", "fp", "Cp", "k²", "Q", "tan δ"), strict=True))


@dataclass(frozen=True)
class ButterworthVanDyke:
    """A fitted circuit.

    Attributes
    ----------
    parameters : ndarray, shape (2 + 3 modes,)
        ln C0 (F), tan δ; ln fs (Hz), ln Q, ln Cm (F) of each mode, by ascending fs.
    cost : float
        Sum of squares of the residuals of ln Z.
    loss_error : float
        Standard error of tan δ.
    """

    parameters: np.ndarray
    cost: float
    loss_error: float

    @property
    def loss(self) -> float:
        """Loss tangent tan δ."""
        return float(self.parameters[1])

    @cached_property
    def modes(self) -> np.ndarray:
        """Series resonance fs (Hz), Q and motional capacitance Cm (F), shape (modes, 3)."""
        return np.exp(self.parameters[2:].reshape(-1, 3))

    def numbers(self, mode: int) -> dict[str, float]:
        """The numbers of one mode, by name.

        Cp is the capacitance in parallel with the mode: C0 and the capacitances of higher modes,
        which respond quasi-statically.
        """
        clamped = math.exp(self.parameters[0]) + self.modes[mode + 1 :, 2].sum()
        resonance, quality, motional = self.modes[mode]
        return _numbers(resonance, quality, motional, clamped, self.loss)


def _numbers(resonance, quality, motional, clamped, loss):
    """fs, fp, Cp, k², Q and tan δ: fp² = fs² (1 + Cm/Cp), k² = 1 − (fs/fp)² = Cm/(Cp + Cm)."""
    parallel = resonance * math.sqrt(1.0 + motional / clamped)
    values = resonance, parallel, clamped, motional / (motional + clamped), quality, loss
    return dict(zip(NUMBERS, map(float, values), strict=True))


def _branches(frequency, parameters):
    """Admittances of the capacitance and of each mode, shape (n, 1 + modes)."""
    columns = [2j * math.pi * frequency * math.exp(parameters[0]) * (1.0 - 1j * parameters[1])]
    for resonance, quality, motional in np.exp(parameters[2:].reshape(-1, 3)):
        columns.append(motional * _unit_branch(frequency, resonance, quality))
    return np.column_stack(columns)


def _unit_branch(frequency, resonance, quality):
    """Admittance of a mode divided by its motional capacitance."""
    ratio = frequency / resonance
    return 2j * math.pi * frequency / (1.0 - ratio**2 + 1j * ratio / quality)


def fitted_circuit(frequency: np.ndarray, impedance: np.ndarray, where: str) -> ButterworthVanDyke:
    """The circuit of an impedance, with as many modes as are significant.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz, ascending.
    impedance : ndarray, shape (n,), complex
        Ω.
    where : str
        The file, for messages.

    Raises
    ------
    IdentificationError
        The impedance shows no resonance.
    """
    circuit = _polished(frequency, impedance, _linear(frequency, impedance, []))
    samples = 2 * frequency.size
    for _ in range(MOST_MODES):
        trial = _polished(frequency, impedance, _with_another(frequency, impedance, circuit))
        gained = samples * math.log(circuit.cost / max(trial.cost, 1e-300))
        resonances, qualities, _ = trial.modes.T
        inside = (resonances > frequency[0]) & (resonances < frequency[-1])
        if gained < SURE_OF_MODE + 3.0 * math.log(samples) or not inside.all():
            break
        if (qualities < LOWEST_QUALITY).any():
            break
        circuit = trial
    if not circuit.modes.size:
        raise IdentificationError(
            f"{where}: no resonance between {frequency[0]:.4g} and {frequency[-1]:.4g} Hz: the "
            f"impedance fits a capacitance of {math.exp(circuit.parameters[0]):.3g} F with tan δ = "
            f"{circuit.loss:.2g}, with a relative error of "
            f"{math.sqrt(circuit.cost / frequency.size):.2g}; measure over a range that contains "
            "the device's resonance, with its base clamped"
        )
    return circuit


def _equations(frequency, impedance, shapes):
    """Matrix and right-hand side of Y(f) Z(f) = 1, linear in the capacitances, as real numbers."""
    rate = 2j * math.pi * frequency
    columns = [rate, -1j * rate, *(_unit_branch(frequency, *shape) for shape in shapes)]
    target = np.concatenate([np.ones(frequency.size), np.zeros(frequency.size)])
    return _stacked(np.column_stack(columns) * impedance[:, None]), target


def _linear(frequency, impedance, shapes):
    """C0, tan δ and each mode's capacitance for given (fs, Q): least relative error of Y."""
    table, target = _equations(frequency, impedance, shapes)
    sizes = np.abs(table).max(axis=0)
    coefficients = np.linalg.lstsq(table / sizes, target, rcond=None)[0] / sizes
    largest = np.abs(coefficients).max()
    clamped = max(coefficients[0], 1e-3 * largest)
    parameters = [math.log(clamped), coefficients[1] / clamped]
    for shape, motional in zip(shapes, coefficients[2:], strict=True):
        parameters += [*np.log(shape), math.log(max(motional, 1e-6 * largest))]
    return np.array(parameters)


def _stacked(table):
    """A complex array as a real one: the real parts, then the imaginary parts."""
    return np.concatenate([table.real, table.imag])


def _with_another(frequency, impedance, circuit):
    """Parameters with the additional mode that reduces the relative error of Y most."""
    shapes = circuit.modes[:, :2].tolist()
    table, target = _equations(frequency, impedance, shapes)
    basis, _ = np.linalg.qr(table)
    target = target - basis @ (basis.T @ target)
    candidates = frequency[1:-1][:: max(1, math.ceil(frequency.size / MOST_PLACES))]
    best, most = (candidates[0], QUALITIES[0]), 0.0
    for quality in QUALITIES:
        trial = _unit_branch(frequency[:, None], candidates, quality) * impedance[:, None]
        table = _stacked(trial)
        sizes = np.linalg.norm(table, axis=0)
        table = table - basis @ (basis.T @ table)
        norms = np.linalg.norm(table, axis=0)
        along = target @ table
        # Only branches with a positive motional capacitance are candidates.
        gains = np.where((along > 0.0) & (norms > 1e-6 * sizes), along / norms, 0.0)
        if gains.max() > most:
            most, best = float(gains.max()), (float(candidates[gains.argmax()]), float(quality))
    return _linear(frequency, impedance, sorted([*shapes, list(best)]))


def _polished(frequency, impedance, begun):
    """The circuit that fits ln Z best, from a start."""

    def residuals(parameters):
        admittance = _branches(frequency, np.clip(parameters, -700.0, 700.0)).sum(axis=1)
        return _stacked(-np.log(admittance * impedance))

    with np.errstate(all="ignore"):
        try:
            solution = least_squares(residuals, begun, method="lm", xtol=1e-12, ftol=1e-12)
        except ValueError:
            return ButterworthVanDyke(begun, math.inf, math.inf)
    squares, free = float(2.0 * solution.cost), max(2 * frequency.size - begun.size, 1)
    variance = np.linalg.pinv(solution.jac.T @ solution.jac)[1, 1] * squares / free
    modes = sorted(solution.x[2:].reshape(-1, 3).tolist())
    parameters = np.concatenate([solution.x[:2], *modes])
    return ButterworthVanDyke(parameters, squares, math.sqrt(max(variance, 0.0)))


def _check_width(frequency, circuit, mode, where):
    """Raise IdentificationError if there are too few points within a resonance's width."""
    branch = circuit.numbers(mode)
    resonance = branch["series_resonance"]
    width = resonance / branch["quality"]
    inside = np.abs(frequency - resonance) <= 0.5 * width
    # If the distance of the series and parallel resonances exceeds the width, all points between
    # them count.
    between = (frequency >= resonance) & (frequency <= branch["parallel_resonance"])
    points = int(np.count_nonzero(inside | between))
    if points < FEWEST_OVER_WIDTH:
        raise IdentificationError(
            f"{where}: too few points in the resonance at {resonance:.5g} Hz: {points} within "
            f"its width of {width:.2g} Hz, must be at least {FEWEST_OVER_WIDTH}: measure in "
            f"steps of {0.2 * width:.2g} Hz or less"
        )


# A wrong unit is assumed if the scene's and the measured capacitance differ by this factor.
WRONG_UNIT = 100.0
# The scene gets a leakage resistance if tan δ exceeds this number of its standard errors.
SURE_OF_LOSS = 3.0


@dataclass(frozen=True)
class FromImpedance:
    """A scene with the values that an impedance determines.

    Attributes
    ----------
    mode : int
        Index of the circuit's mode that the scene describes.
    measured : MeasuredImpedance
        The impedance, with the contributions of other modes and losses as background.
    scene : Scene
        The scene with the circuit's values, from which a fit starts.
    keys : list of str
        Keys of the values that an impedance alone determines if the mass is known.
    """

    circuit: ButterworthVanDyke
    mode: int
    measured: MeasuredImpedance
    scene: Scene
    keys: list[str]

    def parameters(self, fitted: Fitted) -> dict[str, dict[str, Any]]:
        """fs, fp, Cp, k² and Q of the fitted device, tan δ of the circuit, with 95 % intervals."""
        # Impedances follow all other measurements.
        last = len(fitted.shooting.experiments) - 1

        def numbers_of(values):
            trial = fitted.shooting.at(last, values)
            system, _ = trial.known_device
            square, clamped = float(system.spring.slope(timescales.rest(system))), trial.capacitance
            rate, motional = math.sqrt(square), clamped * system.transducer.coupling / square
            quality = rate / system.damper.damping
            parts = _numbers(rate / (2.0 * math.pi), quality, motional, clamped, self.circuit.loss)
            return np.array([*parts.values()])

        slopes = approx_fprime(fitted.values, numbers_of, 1e-6 * np.abs(fitted.values))
        variances = np.einsum("ij,jk,ik->i", slopes, fitted.covariance, slopes)
        variances[-1] = self.circuit.loss_error**2
        pairs = zip(numbers_of(fitted.values), np.sqrt(variances), strict=True)
        return {
            name: {
                "value": float(value),
                "standard_error": float(error),
                "interval": interval(float(value), float(error)),
                "unit": NUMBERS[name],
            }
            for name, (value, error) in zip(NUMBERS, pairs, strict=True)
        }

    def findings(self, fitted: Fitted) -> list[str]:
        """The device's numbers, the circuit's other modes, and undetermined values."""
        lines = [f"{self.measured.name}: {_in_words(self.parameters(fitted))}"]
        others = [n for n in range(len(self.circuit.modes)) if n != self.mode]
        lines += [
            f"{self.measured.name}: another mode at {other['series_resonance']:.5g} Hz, Q "
            f"{other['quality']:.3g}, k² {other['coupling_factor']:.3g}, is not in the scene; the "
            "capacitance of higher modes is part of Cp"
            for other in map(self.circuit.numbers, others)
        ]
        if MASS not in fitted.keys:
            lines.append(
                "an impedance determines θ²/M, k/M and C/M, not the mass: for another mass, "
                "stiffness and damping are proportional to it and coupling to its square root; "
                "weigh the mass, or give a record of voltage and base acceleration (--record)"
            )
        return lines


def _in_words(table):
    return ", ".join(
        f"{SYMBOLS[name]} {entry['value']:.5g} ± {HALF_INTERVAL * entry['standard_error']:.1g}"
        f"{' ' if entry['unit'] else ''}{entry['unit']}"
        for name, entry in table.items()
    )


def from_impedance(scene: Scene, measured: MeasuredImpedance) -> FromImpedance:
    """The scene with the values that an impedance determines.

    Raises
    ------
    SceneError
        The scene is scaled, or has no piezo.
    IdentificationError
        The impedance has no resonance, or the scene has no piezo in SI units.
    """
    transducer = scene.transducer
    if scene.units != "SI" or not isinstance(transducer, PiezoTable):
        raise SceneError(
            f"{scene.name}: an impedance needs a piezo in SI units: give the scene units = "
            '"SI" and a table [piezo]'
        )
    measured.check_size()
    lines = ~measured.aside
    circuit = fitted_circuit(measured.frequency[lines], measured.response[lines], measured.name)
    system = prepared(scene).system
    resting = float(system.spring.slope(timescales.rest(system)))
    # The scene describes the circuit's mode with the nearest frequency, by ratio.
    frequency = math.sqrt(max(resting, 1e-300)) / (2.0 * math.pi)
    mode = int(np.argmin(np.abs(np.log(circuit.modes[:, 0] / frequency))))
    branch = circuit.numbers(mode)
    _check_capacitance(scene, branch["capacitance"], measured.name)
    _check_width(measured.frequency[lines], circuit, mode, measured.name)
    leaks = branch["loss_tangent"] > SURE_OF_LOSS * circuit.loss_error
    mass, linear_key = numbers(scene)[MASS][0], _linear_key(scene)
    rate, share = 2.0 * math.pi * branch["series_resonance"], branch["coupling_factor"]
    clamped, stiffness = branch["capacitance"], mass * rate**2
    begun = numbers(scene)[linear_key][0]
    values = {
        # For a spring without constant and even terms this gives the exact stiffness at rest.
        linear_key: begun * stiffness / (mass * resting) if begun and resting > 0.0 else stiffness,
        "oscillator.damping": mass * rate / branch["quality"],
        "piezo.coupling": rate * math.sqrt(mass * clamped * share / (1.0 - share)),
        "piezo.capacitance": clamped,
    }
    if leaks:
        values["piezo.leakage_resistance"] = 1.0 / (rate * clamped * branch["loss_tangent"])
    scene = scene.replace(values)
    # Effects outside the scene: other modes, and losses other than a leak.
    branches = _branches(measured.frequency, circuit.parameters)
    background = branches.sum(axis=1) - branches[:, 1 + mode]
    background -= 2j * math.pi * measured.frequency * clamped
    leakage = numbers(scene).get("piezo.leakage_resistance", (0.0,))[0]
    background -= 1.0 / (leakage or math.inf)
    measured = replace(measured, background=background)
    return FromImpedance(circuit, mode, measured, scene, list(values))


def _linear_key(scene):
    key = spring_key(scene.oscillator, 1)
    if key in numbers(scene):
        return key
    raise IdentificationError(
        f"{scene.name}: an impedance determines the stiffness at rest, but this spring has no "
        "linear term: give it as restoring_force"
    )


def _check_capacitance(scene, capacitance, where):
    """Raise if the capacitance differs so much that a unit must be wrong."""
    ratio = capacitance / scene.transducer.capacitance
    if 1.0 / WRONG_UNIT < ratio < WRONG_UNIT:
        return
    raise IdentificationError(
        f"{where}: the measured capacitance is {capacitance:.3g} F, but the scene has "
        f"{scene.transducer.capacitance:.3g} F, a factor of {ratio:.3g}: check the units (ohm or "
        "kohm, Hz or kHz), or correct the scene"
    )

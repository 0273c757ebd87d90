"""Stationary means of a linear device from the density G of its excitation: ∫ |H(f)|² G df."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.averaging.averages import Averages
from harvester.base.errors import AveragingError
from harvester.device.damper import Damper
from harvester.device.system import System
from harvester.excitation.base import Excitation
from harvester.scene.prepared import Prepared

# Gauss–Legendre nodes on each piece. The difference to the coarse nodes is the numerical error.
NODES, COARSE_NODES = 20, 12
# Integration limits relative to the lowest and highest characteristic frequency: of E[X'²] under
# white noise a part in 10^10 lies beyond.
LOWEST, HIGHEST = 2.0**-10, 2.0**34
# Two frequencies (Hz) above every corner of a density, to test whether it still decreases there.
BEYOND = np.array([1e14, 1e15])
# The stated relative error of a mean is never smaller than this.
LEAST_ERROR = 1e-8
# A Gaussian density is tabulated at this many points, up to this many standard deviations.
DEVIATIONS, PLACES = 6.0, 241


def spectral(ready: Prepared, tolerance: float) -> Averages:
    """Means of a linear device with a resistor, exact for any excitation with a known density.

    Parameters
    ----------
    tolerance : float
        Largest accepted relative numerical error.

    Raises
    ------
    AveragingError
        The device is not linear, or the excitation has no known density.

    Notes
    -----
    The state z = (X, X', e) obeys z' = A z + b η + d η'. For the density G of the excitation η its
    covariance is ∫ Re[h h*] G df, with h = d + (iω − A)⁻¹ (b + A d). Each sine of amplitude a adds
    Re[h h*] a²/2. Only if the base acceleration moves charge directly, d = (0, 0, κ) is not zero.
    Intervals of the quadrature end at corners of G and at each resonance, and double in length away
    from it.
    """
    system = ready.system
    refusal = spectral_refusal(system, ready.scene.excitation)
    if refusal:
        raise AveragingError(f"{ready.scene.name}: spectral: {refusal}")
    matrix = _matrix(system)
    decay = -np.linalg.eigvals(matrix).real.max()
    if not decay > 0.0:
        raise AveragingError(
            f"{ready.scene.name}: spectral: the motion is undamped or unconfined: add damping and "
            "stiffness"
        )
    excitation, unit = ready.scene.excitation, ready.excitation_unit
    share = system.transducer.base_rate(1.0)
    fine, coarse = (_covariance(matrix, share, excitation, unit, n) for n in (NODES, COARSE_NODES))
    means, rough = _means(system, fine), _means(system, coarse)
    error = {
        name: abs(means[name] - rough[name]) + LEAST_ERROR * abs(means[name]) for name in means
    }
    for name, mean in means.items():
        if not error[name] <= tolerance * abs(mean):
            raise AveragingError(
                f"{name.replace('_', ' ')} changes by {error[name] / abs(mean):.2g} of its value "
                f"with more nodes, more than the tolerance of {tolerance:g}: simulate"
            )
    gaussian = not excitation.lines and getattr(excitation, "kurtosis", 3.0) == 3.0
    density = GaussianDensity(system, fine, gaussian)
    return Averages(**means, numerical_error=error, density=density)


def spectral_refusal(system: System, excitation: Excitation) -> str:
    """Reason why the spectrum alone does not give the means; empty if it does."""
    averaged = not excitation.averaging_refusal()
    remedy = "simulate" + ", or take the method fokker_planck" * averaged
    if not system.spring.straight:
        return f"the spring is not linear: {remedy}"
    if system.contacts:
        return f"stoppers are not linear: {remedy}"
    if not isinstance(system.damper, Damper):
        return f"the damper has a quadratic part: {remedy}"
    if excitation.drifts or excitation.density(np.array([1.0])) is None:
        return (
            f'excitation.kind = "{excitation.kind}" has no known density: simulate, or '
            "convert it to a spectrum (harvester spectrum)"
        )
    if system.transducer.base_rate(1.0):
        densities: Any = excitation.density(BEYOND)
        high, higher = densities
        if not (higher < high or high == 0.0):
            return (
                "the charge moved by the base (piezo.base_charge) has no mean square under noise "
                "that is white at all frequencies: choose another kind of noise, or omit the key"
            )
    return ""


def _matrix(system):
    """A of z' = A z + b η about the rest position, from the device's own equations."""
    part = system.transducer
    stiffness = float(system.spring.slope(0.0))
    # If the transducer has no dynamic state, two rows remain.
    size = 3 if part.state_rate(1.0, 0.0) != 0.0 else 2
    return np.array(
        [
            [0.0, 1.0, 0.0],
            [-stiffness, -system.damper.damping - part.force(1.0, 0.0), -part.force(0.0, 1.0)],
            [0.0, part.state_rate(1.0, 0.0), part.state_rate(0.0, 1.0)],
        ]
    )[:size, :size]


def _covariance(matrix, share, excitation, unit, nodes):
    """The scaled covariance of (X, X', e), shape (3, 3); 0 for states that do not exist.

    `share`: the number κ in the vector d of `spectral`.
    """
    frequencies, weights = _quadrature(matrix, excitation.corners, nodes)
    weights = weights * excitation.density(frequencies)
    lines = [(frequency, 0.5 * a**2) for frequency, a in excitation.lines]
    frequencies = np.append(frequencies, [frequency for frequency, _ in lines])
    weights = np.append(weights, [square for _, square in lines]) / unit**2
    size = matrix.shape[0]
    left = 2j * math.pi * frequencies[:, None, None] * np.eye(size) - matrix
    drive = np.eye(size)[:, 1]
    if share:
        drive = drive + share * matrix[:, 2]
    response = np.linalg.solve(left, drive[:, None])[:, :, 0]
    if share:
        response[:, 2] += share
    covariance = np.zeros((3, 3))
    covariance[:size, :size] = np.einsum("n,ni,nj->ij", weights, response, response.conj()).real
    return covariance


def _quadrature(matrix, corners, nodes):
    """Frequencies and weights (Hz): intervals as short as their distance from each resonance."""
    poles = np.linalg.eigvals(matrix) / (2.0 * math.pi)
    scales = np.concatenate([np.abs(poles), corners])
    low, high = scales.min() * LOWEST, scales.max() * HIGHEST
    ends = [np.array([0.0, *corners]), low * 2.0 ** np.arange(math.log2(high / low) + 1.0)]
    for pole in poles:
        steps = abs(pole.real) * 2.0 ** np.arange(-1.0, 60.0)
        steps = steps[steps < high]
        ends += [abs(pole.imag) + steps, abs(pole.imag) - steps, np.array([abs(pole.imag)])]
    pieces = np.unique(np.concatenate(ends))
    pieces = pieces[(pieces >= 0.0) & (pieces <= high)]
    places, weights = np.polynomial.legendre.leggauss(nodes)
    half, middle = 0.5 * np.diff(pieces), 0.5 * (pieces[1:] + pieces[:-1])
    return (middle[:, None] + half[:, None] * places).ravel(), (half[:, None] * weights).ravel()


def _means(system, covariance):
    """The means in `Averages`, from the covariance."""
    part, velocity = system.transducer, covariance[1, 1]
    if not velocity > 0.0:
        raise AveragingError("spectral: the excitation is 0, so there is no motion: raise it")
    displaced = -float(system.spring.force(0.0)) / float(system.spring.slope(0.0))
    power = _quadratic(part.load_power, covariance)
    loss = system.damper.damping * velocity
    transducer_loss = _quadratic(lambda v, e: part.loss(v, e, part.current(v, e)), covariance)
    return {
        "mean_square_voltage": _quadratic(lambda v, e: part.voltage(v, e) ** 2, covariance),
        "mean_power": power,
        "mechanical_loss": loss,
        "power_conversion_efficiency": power / (power + loss + transducer_loss),
        "mean_square_velocity": float(velocity),
        "mean_square_displacement": float(covariance[0, 0]) + displaced**2,
        "mean_transducer_loss": transducer_loss,
    }


def _quadratic(form: Any, covariance: np.ndarray) -> float:
    """Mean of a quadratic form of X' and the transducer's state."""
    first, second = form(1.0, 0.0), form(0.0, 1.0)
    mixed = form(1.0, 1.0) - first - second
    moments = covariance[1, 1], covariance[2, 2], covariance[1, 2]
    return float(np.dot((first, second, mixed), moments))


@dataclass(frozen=True)
class GaussianDensity:
    """Densities of a linear device's motion under Gaussian noise.

    Attributes
    ----------
    covariance : ndarray, shape (3, 3)
    gaussian : False if the noise contains sines or bursts: no density is then available.
    """

    system: Any
    covariance: np.ndarray
    gaussian: bool

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the available densities."""
        return ("displacement", "velocity") if self.gaussian else ()

    def tabulated(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """A density as a table: (points, values)."""
        axis = self.names.index(name)
        deviation = math.sqrt(self.covariance[axis, axis])
        spring = self.system.spring
        mean = -float(spring.force(0.0)) / float(spring.slope(0.0)) if axis == 0 else 0.0
        relative = np.linspace(-DEVIATIONS, DEVIATIONS, PLACES)
        height = np.exp(-0.5 * relative**2) / (deviation * math.sqrt(2.0 * math.pi))
        return mean + deviation * relative, height

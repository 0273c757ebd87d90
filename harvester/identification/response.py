"""What a device with given numbers would have shown at the sensors, window by window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import system as device
from harvester.device.damper import QuadraticDamper
from harvester.device.polynomial import Polynomial
from harvester.device.ranged import Ranged
from harvester.errors import HarvesterError, IdentificationError
from harvester.identification.unknowns import BASE_FACTOR, with_values
from harvester.monte_carlo.sampled import states_at_samples
from harvester.prepared.prepared import prepared
from harvester.scene.units import Scales

if TYPE_CHECKING:
    from harvester.device.spring import Spring
    from harvester.device.system import System
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Steps in a period of the fastest motion seen, while values are looked for and in the end:
# Runge–Kutta's phase is right to 1e-4 and to 1e-6.
COARSE_STEPS, FINE_STEPS = 24, 80
# How acceleration goes on between two samples: in a straight line, or by a spline of this degree,
# which follows five samples a period to 1e-5, and to the record's ends.
INTERPOLATIONS = ("linear", "smooth")
SPLINE_DEGREE = 7


@dataclass(frozen=True)
class Experiment:
    """A measurement with the scene it belongs to, ready to be simulated.

    Attributes
    ----------
    measurement : Measurement
    scene : Scene
        With the record's own changes.
    steps : int
        Between two samples.
    acceleration : dict of str to ndarray
        At the steps, by the name of the interpolation.
    """

    measurement: Measurement
    scene: Scene
    steps: int
    acceleration: dict[str, np.ndarray]

    @property
    def samples(self) -> int:
        """Of the whole record."""
        return self.measurement.acceleration.size


def experiment(
    scene: Scene, measurement: Measurement, frequency: float, per_period: int = FINE_STEPS
) -> Experiment:
    """A measurement made ready.

    Parameters
    ----------
    scene : Scene
    measurement : Measurement
    frequency : float
        Fastest of the motion (Hz), which the steps are to resolve.
    per_period : int
        Steps in a period of it.
    """
    from scipy.interpolate import make_interp_spline

    rate = measurement.sampling_rate
    # At least two: between samples a smooth path needs points of its own.
    steps = max(2, math.ceil(per_period * frequency / rate - 1e-9))
    samples = measurement.acceleration
    known = np.arange(samples.size)
    places = np.arange(steps * (samples.size - 1) + 1) / steps
    spline = make_interp_spline(known, samples, SPLINE_DEGREE)
    # A step's straight line weakens a sine by 1 − (ω h)²/12, h = 1/steps: that is given back.
    given_back = spline.derivative(2)(places) / (12.0 * steps**2)
    paths = {
        "linear": np.interp(places, known, samples),
        "smooth": spline(places) - given_back,
    }
    changed = scene.replace(measurement.changes)
    return Experiment(measurement, changed, steps, paths)


class Responses:
    """Simulated outputs of several experiments for values of the unknowns.

    Parameters
    ----------
    experiments : sequence of Experiment
    keys : sequence of str
        Of the unknowns, in the order of their values.
    interpolation : str
        A name in `INTERPOLATIONS`.
    length : float
        Unit of the states' displacement, in the scene's units: the same for all trial values.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        keys: Sequence[str],
        interpolation: str,
        length: float,
    ) -> None:
        self.experiments, self.keys = list(experiments), list(keys)
        self.interpolation, self.length = interpolation, length

    def device(self, number: int, values: np.ndarray) -> tuple[System, Scales] | None:
        """Scaled equations of one experiment; None where the scene refuses the values."""
        scene = self.experiments[number].scene
        unit = {"length_scale": self.length} if scene.units == "SI" else {}
        made = with_values(scene, self.keys, values, unit)
        if made is None:
            return None
        try:
            ready = prepared(made)
            system, scales = ready.system, ready.scales
        except (HarvesterError, ArithmeticError, ValueError):
            return None
        return _general(system), scales

    def known_device(self, number: int, values: np.ndarray) -> tuple[System, Scales]:
        """The same of values that the scene takes.

        Raises
        ------
        IdentificationError
            It does not.
        """
        made = self.device(number, values)
        if made is None:
            raise IdentificationError("the fit has come to values that no device has")
        return made

    def states(
        self,
        number: int,
        values: np.ndarray,
        edges: np.ndarray,
        starts: np.ndarray,
    ) -> tuple[Any, Any, Any]:
        """States at samples, states behind each window, and the outputs, of one experiment.

        Parameters
        ----------
        number : int
            Of the experiment.
        values : ndarray
            Of the unknowns.
        edges : ndarray of int, shape (windows + 1,)
        starts : ndarray, shape (windows, 3)
            Scaled X, X' and transducer's state.

        Returns
        -------
        ndarray, shape (samples, 3); ndarray, shape (windows, 3); ndarray, shape (samples, outputs)
            None instead of each where the scene refuses the values.
        """
        made = self.device(number, values)
        if made is None:
            return None, None, None
        system, scales = made
        each = self.experiments[number]
        eta = self.excitation(number, values)
        spacing = 1.0 / (each.measurement.sampling_rate * each.steps)
        states, ends = states_at_samples(system, eta, spacing, each.steps, edges, starts)
        return states, ends, self._outputs(number, values, system, scales, states, edges)

    def excitation(self, number: int, values: np.ndarray) -> np.ndarray:
        """η at the steps of one experiment, scaled."""
        each = self.experiments[number]
        path = each.acceleration[self.interpolation]
        factor = (-1.0 if each.scene.units == "SI" else 1.0) / self.length
        factor *= self.base_factor(number, values)
        gain = self._sensor(values, "sensor.acceleration_scale", 1.0)
        offset = self._sensor(values, "sensor.acceleration_offset", 0.0)
        return factor * (path - offset) / gain

    def base_factor(self, number: int, values: np.ndarray) -> float:
        """By how much the base's acceleration counts in one experiment's device."""
        given = self.experiments[number].scene.oscillator.base_factor
        return self._sensor(values, BASE_FACTOR, given)

    def _sensor(self, values, key, neutral):
        return values[self.keys.index(key)] if key in self.keys else neutral

    def _outputs(self, number, values, system, scales, states, edges):
        """What the sensors show of the states."""
        measurement = self.experiments[number].measurement
        x, v, e = states.T
        columns = []
        for name in measurement.outputs:
            true = {
                "voltage": lambda: (
                    device.terminal_voltage(system.transducer, v, e) * scales.voltage
                ),
                "displacement": lambda: x * scales.displacement,
                "velocity": lambda: v * scales.displacement,
            }[name]()
            columns.append(self._sensed(name, true, values, edges, measurement.sampling_rate))
        return np.column_stack(columns)

    def _sensed(self, name, true, values, edges, rate):
        key = f"sensor.{name}_"
        time_constant = self._sensor(values, key + "filter", 0.0)
        delay = self._sensor(values, key + "delay", 0.0)
        if time_constant > 0.0 or delay != 0.0:
            pieces = np.split(true, edges[1:-1] - edges[0])
            true = np.concatenate(
                [_delayed(_filtered(piece, time_constant * rate), delay * rate) for piece in pieces]
            )
        gain = self._sensor(values, key + "scale", 1.0)
        return gain * true + self._sensor(values, key + "offset", 0.0)


def _filtered(values, samples):
    """A low-pass of first order with this time constant, at rest with the first sample."""
    if samples <= 0.0:
        return values
    from scipy.signal import lfilter

    share = math.exp(-1.0 / samples)
    # Exact for straight lines between samples.
    new = 1.0 - samples * (1.0 - share)
    old = samples * (1.0 - share) - share
    begin = np.array([values[0] - new * values[0]])
    return lfilter([new, old], [1.0, -share], values, zi=begin)[0]


def _delayed(values, samples):
    """Later by so many samples, by a cubic through four of them; in a straight line at the ends."""
    if samples == 0.0:
        return values
    from scipy.interpolate import CubicSpline

    places = np.arange(values.size)
    if values.size < 4 or not np.isfinite(values).all():
        return np.interp(places - samples, places, values)
    moved = places - samples
    inside = np.clip(moved, 0.0, values.size - 1.0)
    spline = CubicSpline(places, values)
    return spline(inside) + (moved - inside) * spline(inside, 1)


def _general(system):
    """The system with every power of the spring up to the third or seventh, and drag.

    One compiled integrator then serves all candidates.
    """
    return system._replace(
        spring=_padded(system.spring),
        damper=QuadraticDamper(
            system.damper.damping, getattr(system.damper, "quadratic_damping", 0.0)
        ),
    )


def _padded(spring: Spring) -> Spring:
    if isinstance(spring, Ranged):
        return spring._replace(spring=_padded(spring.spring))
    if not isinstance(spring, Polynomial):
        return spring
    size = 2 if max(len(spring.even), len(spring.odd)) <= 2 else 4

    def filled(values, length):
        return (*values, *([0.0] * (length - len(values))))

    return spring._replace(
        even=filled(spring.even, size),
        odd=filled(spring.odd, size),
        even_energy=filled(spring.even_energy, size),
        odd_energy=filled(spring.odd_energy, size),
        even_slope=filled(spring.even_slope, size - 1),
        odd_slope=filled(spring.odd_slope, size),
    )

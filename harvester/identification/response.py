"""Simulate a device's sensor signals for given values, window by window.

    values ─→ device ─┐
    measured base acceleration ─→ integrator ─→ x, x', v at the samples ─→ sensors ─→ signals
                      └── states at the window's start

`Trial.device` builds the device, `states` integrates it, and `_outputs` applies the delay,
filters, gain and offset of each sensor.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import HarvesterError, IdentificationError
from harvester.device import system as device
from harvester.device import timescales
from harvester.device.damper import QuadraticDamper
from harvester.device.polynomial import Polynomial
from harvester.device.spring import Ranged
from harvester.engines.monte_carlo.sampled import states_at_samples
from harvester.excitation.conditioning import smoothed
from harvester.identification.measured_response import (
    MeasuredImpedance,
    MeasuredResponse,
    impedance_outputs,
)
from harvester.identification.sensors import (
    HIGHPASSES,
    NEUTRAL,
    VELOCITY_SCALE,
    filtered,
    integrals,
    invert_high_pass,
    parallel,
    without_memory,
)
from harvester.identification.unknowns import BASE_FACTOR, BASE_SCALE, LOAD, factor_of, with_values
from harvester.scene.numbers import numbers
from harvester.scene.prepared import prepared
from harvester.scene.units import Scales

if TYPE_CHECKING:
    from harvester.device.spring import Spring
    from harvester.device.system import System
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# Steps per period of the fastest motion, in the search and in the last fit: the phase error of the
# Runge–Kutta method is 1e-4 and 1e-6.
COARSE_STEPS, FINE_STEPS = 24, 80
# Interpolations of the acceleration between samples: linear, or a spline.
INTERPOLATIONS = ("linear", "smooth")
# Number of secant steps for the displacement's amplitude.
AMPLITUDE_STEPS = 12
# One pool for all calls, since starting threads takes as long as a short simulation. The threads
# start with the first call.
_THREADS = ThreadPoolExecutor(os.cpu_count())
# Start of a response's single window, whose samples have no states.
NO_STATES = np.zeros((1, 3))


@dataclass(frozen=True)
class Experiment:
    """A measurement with its scene, prepared for simulation.

    Attributes
    ----------
    measurement : Measurement or MeasuredResponse
        The samples of a response or an impedance are its frequencies.
    scene : Scene
        The scene with the record's changes.
    steps : int
        Number of steps between two samples of a time record.
    acceleration : dict of str to ndarray
        Base acceleration at the steps of a time record, by name of the interpolation.
    """

    measurement: Any
    scene: Scene
    steps: int = 0
    acceleration: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def is_steady(self) -> bool:
        """Whether the measurement is a response or an impedance."""
        return isinstance(self.measurement, MeasuredResponse)

    def integrals(self, quantity: str, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """First and second integral of a column, at `steps` positions per sample."""
        cache: dict[Any, Any] = self.__dict__.setdefault("_integrals", {})
        if (quantity, steps) not in cache:
            samples = getattr(self.measurement, quantity)
            positions = np.arange(steps * (samples.size - 1) + 1) / steps
            cache[quantity, steps] = integrals(samples, self.measurement.sampling_rate, positions)
        return cache[quantity, steps]


def experiment(
    scene: Scene, measurement: Measurement | MeasuredResponse, per_period: int = FINE_STEPS
) -> Experiment:
    """Prepare a measurement for simulation with this number of steps in its fastest period."""
    changed = scene.replace(measurement.changes)
    if isinstance(measurement, MeasuredResponse):
        return Experiment(measurement, changed)
    rate = measurement.sampling_rate
    # At least two steps between samples, since a smooth path needs intermediate points.
    steps = max(2, math.ceil(per_period * measurement.frequencies[1] / rate - 1e-9))
    paths = {name: interpolated(measurement.acceleration, steps, name) for name in INTERPOLATIONS}
    return Experiment(measurement, changed, steps, paths)


def interpolated(samples: np.ndarray, steps: int, interpolation: str) -> np.ndarray:
    """Acceleration at the steps, for one record or several, shape (n, records)."""
    if interpolation == "smooth":
        return smoothed(samples, steps)
    indices = np.arange(len(samples))
    positions = np.arange(steps * (len(samples) - 1) + 1) / steps
    return np.apply_along_axis(lambda series: np.interp(positions, indices, series), 0, samples)


def side_by_side(function: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
    """Call a function for each item, in as many threads as there are processors.

    The integrator releases Python's global lock. The function must not call this one.
    """
    return list(_THREADS.map(function, items))


class Trial:
    """One experiment with values of the unknowns.

    Parameters
    ----------
    problem : Shooting
        The problem with the experiments, the displacement unit and the interpolation.
    number : int
        Number of the experiment.
    known : dict of str to float
        Values of the unknowns by key.
    """

    def __init__(self, problem: Any, number: int, known: dict[str, float]) -> None:
        self.experiment: Experiment = problem.experiments[number]
        self.measurement, self.scene = self.experiment.measurement, self.experiment.scene
        self.length, self.interpolation = problem.length, problem.interpolation
        self.known = known
        factors = ((factor_of(key), value) for key, value in known.items())
        # Factors of this experiment's assumed values, by key.
        self.factors = {of[0]: value for of, value in factors if of and number in of[1]}

    @cached_property
    def device(self) -> tuple[System, Scales] | None:
        """Scaled equations; None if the values are invalid in the scene."""
        further = {"length_scale": self.length} if self.scene.units == "SI" else {}
        for key, factor in self.factors.items():
            if not key.startswith("sensor."):
                further[key] = factor * numbers(self.scene)[key][0]
        changed = with_values(self.scene, self.known | further)
        if changed is None:
            return None
        probe = self.sensor("sensor.voltage_resistance")
        try:
            if math.isfinite(probe):
                load = parallel(numbers(changed)[LOAD][0], probe)
                changed = changed.replace({LOAD: load})
            prepared_scene = prepared(changed)
            system, scales = prepared_scene.system, prepared_scene.scales
        except (HarvesterError, ArithmeticError, ValueError):
            return None
        # One compiled integrator is used for all candidates: it has all powers of the spring up to
        # the third or seventh, and drag.
        drag = getattr(system.damper, "quadratic_damping", 0.0)
        damper = QuadraticDamper(system.damper.damping, drag)
        return system._replace(spring=_padded(system.spring), damper=damper), scales

    @property
    def known_device(self) -> tuple[System, Scales]:
        """Scaled equations, for values that are known to be valid.

        Raises
        ------
        IdentificationError
            The values are invalid in the scene.
        """
        if self.device is None:
            raise IdentificationError(
                "the fit reached values that are invalid in the scene: check the columns' units "
                "and signs, free fewer (--free), or start from closer values (--set)"
            )
        return self.device

    def sensor(self, key: str) -> float:
        """A sensor's parameter: free, or as given for this record."""
        if key in self.known:
            return self.known[key]
        neutral = NEUTRAL.get(key.rpartition("_")[2], 0.0)
        default = self.measurement.sensors.get(key, neutral)
        return default * self.factors.get(key, 1.0)

    def states(self, edges: np.ndarray, starts: np.ndarray) -> tuple[Any, Any, Any]:
        """States at samples, states after each window, and outputs.

        Parameters
        ----------
        edges : ndarray of int, shape (windows + 1,)
        starts : ndarray, shape (windows, 3)
            Scaled X, X' and transducer's state.

        Returns
        -------
        ndarray, shape (samples, 3); ndarray, shape (windows, 3); ndarray, shape (samples, outputs)
            Three times None if the values are invalid in the scene.
        """
        if self.device is None:
            return None, None, None
        system, scales = self.device
        if self.experiment.is_steady:
            outputs = self._steady(system, scales)
            return np.zeros((outputs.shape[0], 3)), starts, outputs
        steps = self.experiment.steps
        spacing = 1.0 / (self.measurement.sampling_rate * steps)
        states, ends = states_at_samples(system, self.excitation, spacing, steps, edges, starts)
        return states, ends, self._outputs(system, scales, states, edges)

    @property
    def excitation(self) -> np.ndarray:
        """η at the steps, scaled."""
        factor = self.base_factor * (-1.0 if self.scene.units == "SI" else 1.0) / self.length
        return factor * self._base(
            self.experiment.acceleration[self.interpolation], self.experiment.steps
        )

    @property
    def base_factor(self) -> float:
        """Base factor of the device: drive divided by base acceleration."""
        return self.known.get(BASE_FACTOR, self.scene.oscillator.base_factor)

    def _base(self, path, steps):
        """True base acceleration, from the signal of its sensor."""
        corners = self._corners("acceleration")
        if any(corners):
            integral = self.experiment.integrals("acceleration", steps)
            path = invert_high_pass(path, integral, *corners)
        offset = self.sensor("sensor.acceleration_offset")
        return (path - offset) / self.sensor(BASE_SCALE)

    def _base_velocity(self):
        """Velocity of the base at the samples, in the scene's units."""
        base = self._base(self.measurement.acceleration, 1)
        sign = 1.0 if self.scene.units == "SI" else -1.0
        return sign * integrals(base, self.measurement.sampling_rate, np.arange(base.size))[0]

    def _corners(self, quantity):
        """Corner frequencies (Hz) of a sensor's high-passes of first and second order."""
        return [self.sensor(f"sensor.{quantity}_{effect}") for effect in HIGHPASSES]

    @property
    def shown(self) -> Measurement:
        """The record with the sensors' effects removed from its outputs, except delays and
        low-passes.
        """
        true_outputs = {}
        for name, seen in self.measurement.outputs.items():
            true, corners = seen, self._corners(name)
            if any(corners):
                # An AC-coupled input removed the slow part of its signal.
                true = invert_high_pass(seen, self.experiment.integrals(name, 1), *corners)
            true = true - self.sensor(f"sensor.{name}_offset")
            true = true / self.sensor(f"sensor.{name}_scale")
            if name == "velocity" and self.measurement.velocity_is_absolute:
                true = true - self._base_velocity()
            true_outputs[name] = true
        if VELOCITY_SCALE in self.known and len(true_outputs) > 1:
            # A velocity of unknown scale is omitted if other channels show the motion.
            true_outputs["velocity"] = None
        return replace(self.measurement, **true_outputs)

    def velocity_scale(self, velocity: np.ndarray) -> float | None:
        """Scale of the velocity sensor with which its record fits a motion (least squares).

        Returns None if the record has no velocity.

        Parameters
        ----------
        velocity : ndarray, shape (n,)
            Relative to the base, in the scene's units.
        """
        if self.measurement.velocity is None:
            return None
        true = velocity
        if self.measurement.velocity_is_absolute:
            true = true + self._base_velocity()
        return float(self.measurement.velocity @ true) / float(true @ true)

    def _outputs(self, system, scales, states, edges):
        """Simulated sensor signals for the device's states, shape (samples, outputs)."""
        x, v, e = states.T
        signals = {
            "voltage": device.terminal_voltage(system.transducer, v, e) * scales.voltage,
            "displacement": x * scales.displacement,
            "velocity": v * scales.displacement,
        }
        if self.measurement.velocity is not None and self.measurement.velocity_is_absolute:
            signals["velocity"] += self._base_velocity()[edges[0] : edges[-1]]
        names = self.measurement.outputs
        return np.column_stack([self._sensed(name, signals[name], edges) for name in names])

    def _sensed(self, name, true, edges):
        """A sensor's output for true values, window by window."""
        key, rate = f"sensor.{name}_", self.measurement.sampling_rate
        delay, low = rate * self.sensor(key + "delay"), rate * self.sensor(key + "filter")
        memory = [low, *(2.0 * math.pi * corner / rate for corner in self._corners(name))]
        if delay:
            pieces = np.split(true, edges[1:-1] - edges[0])
            true = np.concatenate([_delayed(piece, delay) for piece in pieces])
        gain, offset = self.sensor(key + "scale"), self.sensor(key + "offset")
        simulated = gain * filtered(true, edges, *memory) + offset
        seen = self.measurement.outputs[name][edges[0] : edges[-1]]
        decays = [
            value if {key + effect} & {*self.known, *self.measurement.sensors} else None
            for effect, value in zip(("filter", *HIGHPASSES), memory, strict=True)
        ]
        return without_memory(simulated, seen, edges, *decays)

    def _steady(self, system, scales):
        """Outputs of a response or an impedance, shape (frequencies, outputs)."""
        if isinstance(self.measurement, MeasuredImpedance):
            return self._impedance(system)
        response = self._gain_of_sensors() * self._response(system, scales)
        if np.iscomplexobj(self.measurement.response):
            return np.column_stack([response.real, response.imag])
        return np.abs(response)[:, None]

    def _impedance(self, system):
        """ln |Z| and phase with clamped base."""
        rate = 2j * math.pi * self.measurement.frequency
        linear = float(system.spring.slope(timescales.rest(system)))
        mechanical = linear + system.damper.damping * rate + rate**2
        of_capacitance = system.transducer.own_rate + rate
        of_capacitance = of_capacitance + system.transducer.coupling * rate / mechanical
        admittance = self.capacitance * of_capacitance + self.measurement.background
        return np.column_stack(list(impedance_outputs(1.0 / admittance).values()))

    @property
    def capacitance(self) -> float:
        """Clamped capacitance of the piezo (F)."""
        piezo: Any = self.scene.transducer
        return self.known.get("piezo.capacitance", piezo.capacitance)

    def _response(self, system, scales):
        """Complex voltage per base acceleration, before the sensors' effects."""
        measured, transducer = self.measurement, system.transducer
        rate = 2j * math.pi * measured.frequency
        # State, force on the mass and voltage for one unit of displacement.
        state = rate / (rate + transducer.decay_rate())
        force = transducer.force(rate, state)
        volts = device.terminal_voltage(transducer, rate, state) * scales.voltage
        # Stiffness at rest, and its derivative with respect to the squared amplitude.
        stiffness, square, cube = system.spring.taylor(timescales.rest(system))
        slope = 0.75 * cube - (5.0 / 6.0 * square**2 / stiffness if stiffness > 0.0 else 0.0)
        drag = 8.0 / (3.0 * math.pi) * system.damper.quadratic_damping * np.abs(rate)

        def impedance(amplitude):
            damping = system.damper.damping + drag * amplitude
            return rate**2 + damping * rate + stiffness + slope * amplitude**2 + force

        amplitude = np.zeros(rate.size)
        if measured.acceleration is not None:
            base = measured.acceleration / self.sensor(BASE_SCALE)
            voltage = np.abs(measured.response) * measured.acceleration
            drive = self.base_factor * base / self.length
            amplitude = _amplitude(impedance, drive, voltage / np.abs(volts))
        sign = -1.0 if self.scene.units == "SI" else 1.0
        moved = impedance(amplitude)
        # The base drives the state as X does, in proportion to η; the corresponding part of the
        # force is subtracted.
        driven = (1.0 + transducer.base_rate(1.0) * (moved - force)) / moved
        return self.base_factor * sign * volts * driven / self.length

    def _gain_of_sensors(self):
        """The sensors' complex gain at each frequency."""
        frequency = self.measurement.frequency
        rate = 2j * math.pi * frequency
        gain = self.sensor("sensor.voltage_scale") / self.sensor(BASE_SCALE)
        gain = gain * np.exp(-rate * self.sensor("sensor.voltage_delay"))
        gain = gain / (1.0 + rate * self.sensor("sensor.voltage_filter"))
        for name, power in (("voltage", 1), ("acceleration", -1)):
            first, second = (corner / (1j * frequency) for corner in self._corners(name))
            gain = gain * ((1.0 + first) * (1.0 + math.sqrt(2.0) * second + second**2)) ** -power
        return gain


def _delayed(values, samples):
    """A series delayed by some samples, by a cubic spline; extrapolated linearly at the ends."""
    if samples == 0.0:
        return values
    from scipy.interpolate import CubicSpline

    positions = np.arange(values.size)
    if values.size < 4 or not np.isfinite(values).all():
        return np.interp(positions - samples, positions, values)
    moved = positions - samples
    inside = np.clip(moved, 0.0, values.size - 1.0)
    spline = CubicSpline(positions, values)
    return spline(inside) + (moved - inside) * spline(inside, 1)


def _padded(spring: Spring) -> Spring:
    if isinstance(spring, Ranged):
        return spring._replace(spring=_padded(spring.spring))
    if not isinstance(spring, Polynomial):
        return spring
    size = 2 if max(len(spring.even), len(spring.odd)) <= 2 else 4
    return Polynomial(
        *(
            (*values, *[0.0] * (size - (name == "even_slope") - len(values)))
            for name, values in spring._asdict().items()
        )
    )


def _amplitude(impedance, drive, begun):
    """Solve |impedance(a)| a = drive for a, on the branch nearest to the initial value."""
    amplitude = begun
    for _ in range(AMPLITUDE_STEPS):
        step = 1e-6 * amplitude
        miss = np.abs(impedance(amplitude)) * amplitude - drive
        beyond = np.abs(impedance(amplitude + step)) * (amplitude + step) - drive
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.nan_to_num(miss * step / (beyond - miss), posinf=0.0, neginf=0.0)
        amplitude = np.clip(amplitude - change, 0.5 * amplitude, 2.0 * amplitude)
    return amplitude

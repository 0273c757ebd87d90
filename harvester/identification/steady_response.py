"""Response of a device with given values to sines of its base, about its rest position.

Linear; where the base's amplitude is known, weakly nonlinear: with the displacement's amplitude a
the stiffness is k1 + (3/4 k3 − 5/6 k2²/k1) a², of the spring's Taylor coefficients at rest (Nayfeh
and Mook, Nonlinear Oscillations, 1979, ch. 2), and drag C2 adds 8/(3π) C2 ω a to the damping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import system as device
from harvester.device import timescales
from harvester.identification.measured_impedance import MeasuredImpedance, impedance_outputs
from harvester.identification.response import Experiment, Responses
from harvester.identification.sensors import HIGHPASSES

if TYPE_CHECKING:
    from harvester.identification.measured_response import MeasuredResponse
    from harvester.scene.model import Scene

# Secant steps for the displacement's amplitude.
AMPLITUDE_STEPS = 12
# Start of the one window of a response, whose samples have no states.
NO_STATES = np.zeros((1, 3))


@dataclass(frozen=True)
class SteadyExperiment:
    """A measured response or impedance with the scene of its record."""

    measurement: MeasuredResponse
    scene: Scene


class SteadyResponses(Responses):
    """Responses to sines: samples of a `SteadyExperiment` are frequencies, of others instants."""

    def states(
        self, number: int, values: np.ndarray, edges: np.ndarray, starts: np.ndarray
    ) -> tuple[Any, Any, Any]:
        """States (zeros) and outputs, with the interface of `Responses.states` for records
        in time."""
        if isinstance(self.experiments[number], Experiment):
            return super().states(number, values, edges, starts)
        equations = self.device(number, values)
        if equations is None:
            return None, None, None
        system, scales = equations
        experiment: Any = self.experiments[number]
        if isinstance(experiment.measurement, MeasuredImpedance):
            outputs = self._impedance(system, number, values)
            return np.zeros((outputs.shape[0], 3)), starts, outputs
        response = self._gain_of_sensors(number, values)
        response = response * self._response(system, scales, number, values)
        if np.iscomplexobj(experiment.measurement.response):
            outputs = np.column_stack([response.real, response.imag])
        else:
            outputs = np.abs(response)[:, None]
        return np.zeros((response.size, 3)), starts, outputs

    def _impedance(self, system, number, values):
        """ln |Z| and phase with the base clamped."""
        experiment: Any = self.experiments[number]
        rate = 2j * math.pi * experiment.measurement.frequency
        linear = float(system.spring.slope(timescales.rest(system)))
        mechanical = linear + system.damper.damping * rate + rate**2
        of_capacitance = system.transducer.own_rate + rate
        of_capacitance = of_capacitance + system.transducer.coupling * rate / mechanical
        key = "piezo.capacitance"
        capacitance = experiment.scene.transducer.capacitance
        if key in self.keys:
            capacitance = values[self.keys.index(key)]
        admittance = capacitance * of_capacitance + experiment.measurement.background
        outputs = impedance_outputs(1.0 / admittance)
        return np.column_stack(list(outputs.values()))

    def _response(self, system, scales, number, values):
        """Complex voltage per base acceleration, before the sensors' effects."""
        experiment: Any = self.experiments[number]
        measured = experiment.measurement
        rate = 2j * math.pi * measured.frequency
        transducer = system.transducer
        # These three belong to a unit of displacement: the state, the force on the mass, the
        # voltage.
        state = rate / (rate + transducer.decay_rate())
        force = transducer.force(rate, state)
        volts = device.terminal_voltage(transducer, rate, state) * scales.voltage
        # Stiffness where the device rests, and its slope over the squared amplitude.
        stiffness, square, cube = system.spring.taylor(timescales.rest(system))
        slope = 0.75 * cube - (5.0 / 6.0 * square**2 / stiffness if stiffness > 0.0 else 0.0)
        drag = 8.0 / (3.0 * math.pi) * system.damper.quadratic_damping * np.abs(rate)

        def impedance(amplitude):
            damping = system.damper.damping + drag * amplitude
            return rate**2 + damping * rate + stiffness + slope * amplitude**2 + force

        share = transducer.base_rate(1.0)
        factor = self.base_factor(number, values)
        amplitude = np.zeros(rate.size)
        if measured.acceleration is not None:
            gain = self._sensor(number, values, "sensor.acceleration_scale")
            drive = factor * measured.acceleration / gain / self.length
            voltage = np.abs(measured.response) * measured.acceleration
            amplitude = _amplitude(impedance, drive, voltage / np.abs(volts))
        sign = -1.0 if experiment.scene.units == "SI" else 1.0
        moved = impedance(amplitude)
        # The base drives the state as X does, by the share of η; the part of the force that stems
        # from it is subtracted.
        driven = (1.0 + share * (moved - force)) / moved
        return factor * sign * volts * driven / self.length

    def _gain_of_sensors(self, number, values):
        """The sensors' gain (complex) at each frequency."""
        frequency = self.experiments[number].measurement.frequency
        rate = 2j * math.pi * frequency

        def effect(name):
            return self._sensor(number, values, f"sensor.{name}")

        gain = effect("voltage_scale") / effect("acceleration_scale")
        gain = gain * np.exp(-rate * effect("voltage_delay"))
        gain = gain / (1.0 + rate * effect("voltage_filter"))
        for name, power in (("voltage", 1), ("acceleration", -1)):
            first, second = (effect(f"{name}_{kind}") / (1j * frequency) for kind in HIGHPASSES)
            gain = gain * ((1.0 + first) * (1.0 + math.sqrt(2.0) * second + second**2)) ** -power
        return gain


def _amplitude(impedance, drive, begun):
    """a with |impedance(a)| a = drive, on the branch that is nearest to where it begins."""
    amplitude = begun
    for _ in range(AMPLITUDE_STEPS):
        step = 1e-6 * amplitude
        miss = np.abs(impedance(amplitude)) * amplitude - drive
        beyond = np.abs(impedance(amplitude + step)) * (amplitude + step) - drive
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.nan_to_num(miss * step / (beyond - miss), posinf=0.0, neginf=0.0)
        amplitude = np.clip(amplitude - change, 0.5 * amplitude, 2.0 * amplitude)
    return amplitude

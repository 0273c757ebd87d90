"""What a device with given numbers answers to sines of its base, about the place where it rests.

Linear; where the base's amplitude is known, weakly nonlinear: with the displacement's amplitude a
the stiffness is k1 + (3/4 k3 − 5/6 k2²/k1) a², of the spring's Taylor coefficients at rest (Nayfeh
and Mook, Nonlinear Oscillations, 1979, ch. 2), and drag C2 adds 8/(3π) C2 ω a to the damping.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.device import system as device
from harvester.device import timescales
from harvester.identification.response import Responses

if TYPE_CHECKING:
    from harvester.identification.measured_response import MeasuredResponse
    from harvester.scene.model import Scene

# Newton's steps for the displacement's amplitude.
AMPLITUDE_STEPS = 12


@dataclass(frozen=True)
class SteadyExperiment:
    """A measured response with the scene it belongs to.

    Attributes
    ----------
    measurement : MeasuredResponse
    scene : Scene
        With the record's own changes.
    """

    measurement: MeasuredResponse
    scene: Scene


class SteadyResponses(Responses):
    """Responses of several experiments for values of the unknowns; their samples are frequencies.

    Parameters
    ----------
    experiments : sequence of SteadyExperiment
    keys : sequence of str
    length : float
    """

    def __init__(self, experiments: Sequence[Any], keys: Sequence[str], length: float) -> None:
        super().__init__(experiments, keys, "linear", length)

    def states(
        self, number: int, values: np.ndarray, edges: np.ndarray, starts: np.ndarray
    ) -> tuple[Any, Any, Any]:
        """As those of records in time; a steady response has no states."""
        made = self.device(number, values)
        if made is None:
            return None, None, None
        system, scales = made
        each: Any = self.experiments[number]
        found = self._gain_of_sensors(each.measurement.frequency, values)
        found = found * self._response(system, scales, number, values)
        if np.iscomplexobj(each.measurement.response):
            outputs = np.column_stack([found.real, found.imag])
        else:
            outputs = np.abs(found)[:, None]
        return np.zeros((found.size, 3)), starts, outputs

    def _response(self, system, scales, number, values):
        """True voltage over true acceleration."""
        each: Any = self.experiments[number]
        measured = each.measurement
        rate = 2j * math.pi * measured.frequency
        transducer = system.transducer
        # Of a unit of displacement: the state, the force on the mass, the voltage.
        state = rate / (rate + transducer.decay_rate())
        force = transducer.force(rate, state)
        volts = device.terminal_voltage(transducer, rate, state) * scales.voltage
        stiffness, slope = _taylor(system)
        drag = 8.0 / (3.0 * math.pi) * system.damper.quadratic_damping * np.abs(rate)

        def impedance(amplitude):
            damping = system.damper.damping + drag * amplitude
            return rate**2 + damping * rate + stiffness + slope * amplitude**2 + force

        factor = self.base_factor(number, values)
        amplitude = np.zeros(rate.size)
        if measured.acceleration is not None:
            gain = self._sensor(values, "sensor.acceleration_scale", 1.0)
            drive = factor * measured.acceleration / gain / self.length
            shown = np.abs(measured.response) * measured.acceleration
            amplitude = _amplitude(impedance, drive, shown / np.abs(volts))
        sign = -1.0 if each.scene.units == "SI" else 1.0
        return factor * sign * volts / impedance(amplitude) / self.length

    def _gain_of_sensors(self, frequency, values):
        """What the sensors make of it."""
        rate = 2j * math.pi * frequency
        key = "sensor.voltage_"
        gain = self._sensor(values, key + "scale", 1.0)
        gain /= self._sensor(values, "sensor.acceleration_scale", 1.0)
        delay = np.exp(-rate * self._sensor(values, key + "delay", 0.0))
        return gain * delay / (1.0 + rate * self._sensor(values, key + "filter", 0.0))


def _taylor(system):
    """Stiffness where the device rests, and its slope over the squared amplitude."""
    rest = timescales.rest(system)
    linear, square, cube = system.spring.taylor(rest)
    return linear, 0.75 * cube - (5.0 / 6.0 * square**2 / linear if linear > 0.0 else 0.0)


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

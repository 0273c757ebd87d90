"""The motion behind a measured record, up to a factor and an origin: the start of a fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.identification.measured_response import MeasuredResponse

if TYPE_CHECKING:
    from harvester.device.system import System
    from harvester.identification.measurement import Measurement
    from harvester.scene.units import Scales

# The fastest frequency of the motion is the one with this share of the signal's power below it.
FASTEST_SHARE = 0.98

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

    def centred(self, place: float) -> Motion:
        """The motion with its mean at a place; unchanged if the displacement itself was
        measured."""
        return self if self.measured else replace(self, x=self.x + (place - float(self.x.mean())))

    def without_drift(self, measurement: Measurement) -> Motion:
        """The motion with its slow drift removed by a high-pass."""
        from scipy import signal

        if self.measured:
            return self
        slow = SLOW_SHARE * frequencies(measurement)[0]
        sections = signal.butter(2, slow, "highpass", fs=measurement.sampling_rate, output="sos")
        return replace(self, x=signal.sosfiltfilt(sections, self.x))


def frequencies(measurement: Measurement | MeasuredResponse) -> tuple[float, float]:
    """Median frequency of the measured output, and its fastest (`FASTEST_SHARE`), in Hz."""
    from scipy import signal

    if isinstance(measurement, MeasuredResponse):
        return measurement.resonance, float(measurement.frequency[-1])
    rate = measurement.sampling_rate
    medians, fastest = [], []
    for values in measurement.outputs.values():
        segment = min(values.size, max(256, values.size // 8))
        f, density = signal.welch(values, rate, nperseg=segment, detrend="linear")
        # The floor of white noise is subtracted: it is not motion.
        density = np.maximum(density - 3.0 * np.median(density[3 * f.size // 4 :]), 0.0)
        total = np.cumsum(density)
        if total[-1] <= 0.0:
            medians.append(0.1 * rate)
            fastest.append(0.1 * rate)
            continue
        medians.append(float(f[np.searchsorted(total, 0.5 * total[-1])]))
        fastest.append(float(f[np.searchsorted(total, FASTEST_SHARE * total[-1])]))
    slowest = 1.0 / measurement.duration
    return max(min(medians), slowest), max(*fastest, slowest)


def motion(system: System, scales: Scales, measurement: Measurement) -> Motion:
    """The motion that belongs to a record, computed with the scene's transducer.

    With a voltage alone, e' = x' − λ e gives x = e + λ ∫e for a capacitance or an inductance, and
    x = ∫x' where the voltage follows the velocity at once.
    """
    rate, transducer = measurement.sampling_rate, system.transducer
    outputs = measurement.outputs
    smooth = _smoother(frequencies(measurement)[1], rate)
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

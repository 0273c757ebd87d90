"""Sensor effects (filters, delays, signs) tried where a model leaves more than the sensors' noise.

A high-pass, a delay and a low-pass turn a residual's phase with the frequency. The slope of the
cost at zero strength estimates what each of them would gain (a score test), so that only the most
promising are fitted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.identification.proof import blocks_of
from harvester.identification.sensors import HIGHPASSES
from harvester.identification.unknowns import unknowns

if TYPE_CHECKING:
    from harvester.identification.fitted_model import Fitted
    from harvester.identification.measurement import Measurement

# An effect is fitted if it promises to lower the cost by this share; at most so many are fitted.
PROMISING, MOST_FITTED = 0.02, 2
# A mean is an offset beyond so many standard errors and this share of the channel's deviation.
OFFSET_ERRORS, LEAST_OFFSET = 3.0, 0.01


@dataclass(frozen=True)
class Trial:
    """Records and unknowns of a candidate.

    Attributes
    ----------
    name : str
    measurements : sequence of Measurement
    keys : list of str
        Keys of the free values: the sensors' beside the device's.
    """

    name: str
    measurements: Sequence[Measurement]
    keys: list[str]


def effects_of(base: Fitted, measurements: Sequence[Measurement]) -> list[Trial]:
    """Effects that can be free: all that are not yet, by the channels that there are."""
    outputs = list(measurements[0].sensed)
    effects = {"AC-coupled accelerometer": ["sensor.acceleration_highpass"]}
    effects["delay between the channels"] = [f"sensor.{output}_delay" for output in outputs]
    effects |= {f"low-pass of the {output}": [f"sensor.{output}_filter"] for output in outputs}
    if "voltage" in outputs:
        effects["AC-coupled voltage"] = ["sensor.voltage_highpass"]
    specified = {key for record in measurements for key in record.sensors}
    return [
        Trial(name, measurements, keys)
        for name, keys in effects.items()
        if not {*keys} & {*base.keys, *specified}
    ]


def promising(
    base: Fitted, measurements: Sequence[Measurement], sizes: dict[str, float]
) -> list[Trial]:
    """The effects that would lower the cost most, to first order."""
    trials = effects_of(base, measurements)
    keys = [key for trial in trials for key in trial.keys]
    if not keys:
        return []
    count = len(base.keys)
    added = unknowns(base.scene, keys, sizes)
    fitted_values = dict(zip(base.keys, base.values, strict=True))
    free = [
        unknown.begun(fitted_values[unknown.key])
        for unknown in unknowns(base.scene, base.keys, sizes)
    ]
    responses = base.shooting.responses.with_keys([*base.keys, *keys])
    shooting = base.shooting.beside(responses, [*free, *added])
    values = np.array([*base.values, *(unknown.start for unknown in added)])
    fit = replace(base.fit, values=values)
    if not shooting.linearized(fit):
        return []
    normal, gradient = shooting.reduced(fit)
    least = _promised(normal, gradient, range(count))[0]
    gains = []
    for trial in trials:
        places = [*range(count), *(count + keys.index(key) for key in trial.keys)]
        gain, step = _promised(normal, gradient, places)
        bounded = trial.keys[0].endswith(("_filter", *HIGHPASSES))
        if not (bounded and step[count] < 0.0) and gain - least > PROMISING * fit.cost:
            gains.append((gain, trial))
    return [trial for _, trial in sorted(gains, key=lambda pair: -pair[0])[:MOST_FITTED]]


def _promised(normal, gradient, places):
    """Expected decrease of the cost by a step in some unknowns, and that step."""
    some = list(places)
    step = -np.linalg.lstsq(normal[np.ix_(some, some)], gradient[some], rcond=1e-12)[0]
    return float(-gradient[some] @ step), step


def turned(measurements: Sequence[Measurement]) -> list[Trial]:
    """Records whose columns mean something else: without an offset, another sign, another frame."""
    outputs = list(measurements[0].sensed)
    trials = [
        trial for name in ("voltage", "velocity") for trial in _without_mean(measurements, name)
    ]
    # With one channel one sign is enough: the other gives the mirrored device.
    turnable = ["acceleration"] if outputs[0] != "voltage" else ["voltage"]
    turnable += ["acceleration"] if len(outputs) > 1 and turnable == ["voltage"] else []
    for name in turnable:
        key = f"sensor.{name}_scale"
        if any(key in record.sensors for record in measurements):
            continue
        swapped = [
            replace(record, sensors={**record.sensors, key: -1.0}) for record in measurements
        ]
        trials.append(Trial(f"swapped polarity of the {name}", swapped, []))
    if "velocity" in outputs and not any(record.velocity_is_absolute for record in measurements):
        moved = [replace(record, velocity_is_absolute=True) for record in measurements]
        trials.append(Trial("velocity in the room", moved, []))
    return trials


def _without_mean(measurements, name):
    """The records without the means of a channel that has none over long times, if those show."""
    key, changed, largest = f"sensor.{name}_offset", [], 0.0
    for record in measurements:
        values = record.sensed.get(name)
        if values is None or key in record.sensors:
            return []
        means = np.array([float(np.mean(part)) for part in blocks_of(values)])
        mean, error = float(means.mean()), float(np.std(means, ddof=1)) / math.sqrt(means.size)
        if abs(mean) > max(OFFSET_ERRORS * error, LEAST_OFFSET * float(np.std(values))):
            largest = max(largest, mean, key=abs)
        changed.append(replace(record, sensors={**record.sensors, key: mean}))
    if not largest:
        return []
    return [Trial(f"offset of the {name} (its mean, {key} = {largest:.3g})", changed, [])]

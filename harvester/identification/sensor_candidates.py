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
    made = {"AC-coupled accelerometer": ["sensor.acceleration_highpass"]}
    made["delay between the channels"] = [f"sensor.{each}_delay" for each in outputs]
    made |= {f"low-pass of the {each}": [f"sensor.{each}_filter"] for each in outputs}
    if "voltage" in outputs:
        made["AC-coupled voltage"] = ["sensor.voltage_highpass"]
    given = {key for each in measurements for key in each.sensors}
    return [
        Trial(name, measurements, keys)
        for name, keys in made.items()
        if not {*keys} & {*base.keys, *given}
    ]


def promising(
    base: Fitted, measurements: Sequence[Measurement], sizes: dict[str, float]
) -> list[Trial]:
    """The effects that would lower the cost most, to first order."""
    trials = effects_of(base, measurements)
    keys = [key for trial in trials for key in trial.keys]
    if not keys:
        return []
    own = len(base.keys)
    added = unknowns(base.scene, keys, sizes)
    known = dict(zip(base.keys, base.values, strict=True))
    free = [each.begun(known[each.key]) for each in unknowns(base.scene, base.keys, sizes)]
    responses = base.shooting.responses.with_keys([*base.keys, *keys])
    shooting = base.shooting.beside(responses, [*free, *added])
    values = np.array([*base.values, *(each.start for each in added)])
    fit = replace(base.fit, values=values)
    if not shooting.linearized(fit):
        return []
    normal, gradient = shooting.reduced(fit)
    least = _promised(normal, gradient, range(own))[0]
    found = []
    for trial in trials:
        places = [*range(own), *(own + keys.index(key) for key in trial.keys)]
        gain, step = _promised(normal, gradient, places)
        bounded = trial.keys[0].endswith(("_filter", *HIGHPASSES))
        if not (bounded and step[own] < 0.0) and gain - least > PROMISING * fit.cost:
            found.append((gain, trial))
    return [trial for _, trial in sorted(found, key=lambda each: -each[0])[:MOST_FITTED]]


def _promised(normal, gradient, places):
    """Expected decrease of the cost by a step in some unknowns, and that step."""
    some = list(places)
    step = -np.linalg.lstsq(normal[np.ix_(some, some)], gradient[some], rcond=1e-12)[0]
    return float(-gradient[some] @ step), step


def turned(measurements: Sequence[Measurement]) -> list[Trial]:
    """Records whose columns mean something else: without an offset, another sign, another frame."""
    outputs = list(measurements[0].sensed)
    found = [each for name in ("voltage", "velocity") for each in _without_mean(measurements, name)]
    # With one channel one sign is enough: the other gives the mirrored device.
    turnable = ["acceleration"] if outputs[0] != "voltage" else ["voltage"]
    turnable += ["acceleration"] if len(outputs) > 1 and turnable == ["voltage"] else []
    for name in turnable:
        key = f"sensor.{name}_scale"
        if any(key in each.sensors for each in measurements):
            continue
        swapped = [replace(each, sensors={**each.sensors, key: -1.0}) for each in measurements]
        found.append(Trial(f"swapped polarity of the {name}", swapped, []))
    if "velocity" in outputs and not any(each.velocity_is_absolute for each in measurements):
        moved = [replace(each, velocity_is_absolute=True) for each in measurements]
        found.append(Trial("velocity in the room", moved, []))
    return found


def _without_mean(measurements, name):
    """The records without the means of a channel that has none over long times, if those show."""
    key, changed, largest = f"sensor.{name}_offset", [], 0.0
    for each in measurements:
        values = each.sensed.get(name)
        if values is None or key in each.sensors:
            return []
        means = np.array([float(np.mean(part)) for part in blocks_of(values)])
        mean, error = float(means.mean()), float(np.std(means, ddof=1)) / math.sqrt(means.size)
        if abs(mean) > max(OFFSET_ERRORS * error, LEAST_OFFSET * float(np.std(values))):
            largest = max(largest, mean, key=abs)
        changed.append(replace(each, sensors={**each.sensors, key: mean}))
    if not largest:
        return []
    return [Trial(f"offset of the {name} (its mean, {key} = {largest:.3g})", changed, [])]

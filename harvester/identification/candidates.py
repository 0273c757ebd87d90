"""Other models of the same device: with one part more than the scene, or with one part less.

Where a model leaves more than the sensors' noise, effects of sensors (filters, delays, signs) are
tried too. A high-pass, a delay and a low-pass turn a residual's phase with the frequency. The slope
of the cost at zero strength estimates what each of them would gain (a score test), so that only the
most promising are fitted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.errors import HarvesterError, SceneError
from harvester.identification.fitting import MISSED_SHARE, MOST_NOISE, NOTED, Fitted, fitted
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.sensors import HIGHPASSES
from harvester.identification.unknowns import unknowns
from harvester.identification.validation_record import blocks_of, sensor_noise

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# A trial pair of stoppers begins at this share of the greatest displacement, with this share of the
# stiffness that counts as one (`sizes_of`).
STOPPER_PLACE, STOPPER_STIFFNESS = 0.9, 1e-2
# Any other trial part begins with this share of its size: too little to change the motion.
LITTLE = 1e-6
FORCE = "oscillator.restoring_force[{}]"
# Variants whose names begin so are tried only where the scene's own model leaves more than noise.
RICHER = ("spring up to power", "softening spring")
HIGHEST_POWER = 7
# A spring that may soften is defined out to this multiple of the greatest displacement.
SOFT_RANGE = 1.25
# A model predicts better if its mean square error is lower by more than this many standard errors,
# and its rms error by more than the share `NOTED`.
SURE = 3.0
# An effect is fitted if it promises to lower the cost by this share; at most so many are fitted.
PROMISING, MOST_FITTED = 0.02, 2
# A mean is an offset beyond so many standard errors and this share of the channel's deviation.
OFFSET_ERRORS, LEAST_OFFSET = 3.0, 0.01


@dataclass(frozen=True)
class Candidate:
    """A model that is compared with the scene's own.

    Attributes
    ----------
    name : str
        How it differs, such as "with drag"; "as given" for the scene's own.
    better : float
        Logarithm of the mean square error on what was kept aside over that of the scene's model,
        on average over blocks; negative: better.
    error : float
        Standard error of that.
    """

    name: str
    fitted: Fitted
    better: float
    error: float

    @property
    def is_better(self) -> bool:
        """Whether this model predicts significantly better than the scene's own."""
        return self.better < -SURE * self.error and self.better < -2.0 * NOTED

    @property
    def is_as_good(self) -> bool:
        """Whether this model predicts no worse, within two standard errors or the share `NOTED`."""
        return self.better < max(2.0 * self.error, 2.0 * NOTED)


def candidates(
    base: Fitted,
    measurements: Sequence[Measurement],
    sizes: dict[str, float],
    start: Scene,
    is_noise: bool,
) -> list[Candidate]:
    """The scene's own model first, then its neighbours that could be fitted.

    Parameters
    ----------
    base : Fitted
        The scene's own.
    start : Scene
        The scene before the fit.
    is_noise : bool
        Whether the scene's own model leaves only the sensors' noise; else sensor effects are tried
        too.
    """
    models = [Candidate("as given", base, 0.0, 0.0)]
    for name, scene, free in variants(base.scene, base.keys, sizes):
        # A fit of a wrong model does not converge to one with stoppers: such a variant starts from
        # scratch.
        anew = scene.stoppers and not base.scene.stoppers and not base.adequate
        if name.startswith(RICHER):
            # Nor does it converge to one with further powers, whose share the other coefficients
            # have taken.
            if is_noise and base.adequate:
                continue
            anew = True
        models += _tried(name, base, scene, measurements, free, sizes, None if anew else base)
    if is_noise or isinstance(measurements[0], MeasuredResponse):
        return models
    # Small effects of sensors come first, then columns of another sign or frame.
    effects = []
    for trial in promising(base, measurements, sizes):
        keys = [*base.keys, *trial.keys]
        effects += _tried(trial.name, base, base.scene, measurements, keys, sizes, base)
    if not any(model.is_better and _explains_all(model.fitted) for model in effects):
        for trial in turned(measurements):
            effects += _tried(trial.name, base, start, trial.measurements, base.keys, sizes, None)
    return models + effects


def _tried(name, base, scene, measurements, keys, sizes, warm):
    """The candidate alone in a list; an empty list where it cannot be fitted."""
    try:
        other = fitted(scene, measurements, keys, sizes, warm)
    except HarvesterError:
        return []
    return [Candidate(name, other, *_compared(base, other))]


def _explains_all(fitted):
    """Whether little is left of every output beyond its noise.

    A velocity of the room that is taken for a relative one leaves half of itself, while the voltage
    may fit.
    """
    return all(
        stretch.nrmse(n) ** 2 - min(sensor_noise(stretch, n), MOST_NOISE) ** 2 <= MISSED_SHARE**2
        for stretch in fitted.records
        for n in range(len(stretch.outputs))
    )


def _compared(base, other):
    """Mean logarithm of the ratio of two models' mean square errors by blocks, and its error.

    All outputs count, each in units of the base model's rms residual.
    """
    ratios: list[float] = []
    for mine, theirs in zip(base.records, other.records, strict=True):
        units = np.sqrt(np.mean(mine.residuals**2, axis=0))
        old, new = (
            np.array([np.mean(part**2) for part in blocks_of(stretch.residuals / units)])
            for stretch in (mine, theirs)
        )
        ratios += [float(ratio) for ratio in np.log(new / old)]
    return float(np.mean(ratios)), float(np.std(ratios, ddof=1)) / math.sqrt(len(ratios))


def proposed(found: Sequence[Candidate]) -> Candidate:
    """The simplest that predicts as well as the best."""
    return min(_of_the_best(found), key=lambda model: (len(model.fitted.keys), model.better))


def rivals(found: Sequence[Candidate]) -> list[Candidate]:
    """Models as simple as the proposed one that predict as well: the records cannot decide
    between them."""
    best = proposed(found)
    return [
        model
        for model in _of_the_best(found)
        if model is not best and len(model.fitted.keys) == len(best.fitted.keys)
    ]


def _of_the_best(found):
    """Candidates that predict as well as the best, within two standard errors or `NOTED`."""
    best = min(found, key=lambda model: model.better)
    if not best.is_better:
        return [model for model in found if model.is_as_good]
    return [
        model
        for model in found
        if model.better - best.better < max(2.0 * math.hypot(model.error, best.error), 2.0 * NOTED)
    ]


def variants(scene: Scene, keys: Sequence[str], sizes: dict[str, float]) -> list:
    """(name, scene, keys) of the models that differ by one part."""
    models = []
    for make in (_symmetry, _cubic, _richer, _plainer, _softening, _drag, _stoppers):
        try:
            variant = make(scene, list(keys), sizes)
        except HarvesterError:
            continue
        if variant:
            models.append(variant)
    return models


def _force(scene):
    if scene.oscillator.force_table is not None:
        raise SceneError(f"{scene.name}: the spring is a table, which stays as it is")
    return [k or 0.0 for k in scene.oscillator.coefficients]


def _with_spring(name, scene, keys, force, added=(), left_out=(), others=None):
    """(name, scene, keys) of a variant whose spring has these coefficients.

    The powers `added` become free, and those of `left_out` are no longer free. `others` are further
    changes of the scene.
    """
    short = {"oscillator.linear_stiffness": 1, "oscillator.cubic_stiffness": 3}
    keys = [FORCE.format(short[key]) if key in short else key for key in keys]
    dropped = {FORCE.format(n) for n in left_out}
    free = [*(key for key in keys if key not in dropped), *(FORCE.format(n) for n in added)]
    return name, scene.replace({"oscillator.restoring_force": force, **(others or {})}), free


def _symmetry(scene, keys, sizes):
    """The variant without the spring's even powers, or with the second power."""
    force = _force(scene)
    even = [n for n in range(2, len(force), 2) if force[n] != 0.0]
    if even:
        odd = [0.0 if n in even else k for n, k in enumerate(force)]
        return _with_spring("symmetric spring", scene, keys, odd, left_out=even)
    if len(force) < 4 or force[3] == 0.0:
        return None
    force[2] = LITTLE * sizes[FORCE.format(2)]
    return _with_spring("asymmetric spring", scene, keys, force, added=[2])


def _cubic(scene, keys, sizes):
    """The variant without the spring's cubic term, or with it."""
    force = _force(scene)
    if len(force) > 4 or force[1] <= 0.0:
        return None
    if len(force) == 4 and force[3] != 0.0:
        return _with_spring("linear spring", scene, keys, force[:2], left_out=[2, 3])
    force = [*force[:2], 0.0, LITTLE * sizes[FORCE.format(3)]]
    return _with_spring("cubic spring", scene, keys, force, added=[3])


def _degree(force):
    return max((n for n, k in enumerate(force) if k != 0.0), default=0)


def _richer(scene, keys, sizes):
    """The variant of `richer`, if the spring has a cubic term already; else that comes first."""
    return richer(scene, keys, sizes) if _degree(_force(scene)) >= 3 else None


def richer(
    scene: Scene, keys: Sequence[str], sizes: dict[str, float]
) -> tuple[str, Scene, list[str]] | None:
    """The variant with the spring's next odd power, and the even one below if it has even ones."""
    force = _force(scene)
    degree = _degree(force)
    if not 1 <= degree <= HIGHEST_POWER - 2:
        return None
    uneven = any(k != 0.0 for k in force[2::2])
    added = [n for n in (degree + 1, degree + 2) if n % 2 or uneven]
    force = [*force[: degree + 1], 0.0, 0.0]
    for n in added:
        force[n] = LITTLE * sizes[FORCE.format(n)]
    return _with_spring(f"spring up to power {degree + 2}", scene, keys, force, added=added)


def _plainer(scene, keys, sizes):
    """The variant without the spring's powers above the third or fifth."""
    force = _force(scene)
    degree = _degree(force)
    if degree <= 3:
        return None
    power = 3 + 2 * ((degree - 4) // 2)
    left_out, name = range(power + 1, len(force)), f"spring only up to power {power}"
    return _with_spring(name, scene, keys, force[: power + 1], left_out=left_out)


def _softening(scene, keys, sizes):
    """The variant with a cubic term of either sign; a softening spring is limited to a range."""
    force = _force(scene)
    if scene.oscillator.restoring_force_range is not None or _degree(force) > 3:
        return None
    force = [*force, 0.0, 0.0][:4]
    if force[1] <= 0.0:
        return None
    force[3] = -LITTLE * sizes[FORCE.format(3)]
    reach = SOFT_RANGE * sizes["stoppers.gap"]
    limit = {"oscillator.restoring_force_range": [-reach, reach]}
    return _with_spring("softening spring", scene, keys, force, [3], [3], limit)


def _drag(scene, keys, sizes):
    """The variant without the air's drag, or with it."""
    key = "oscillator.quadratic_damping"
    if scene.oscillator.quadratic_damping > 0.0:
        return "no drag", scene.replace({key: 0.0}), [name for name in keys if name != key]
    return "drag", scene.replace({key: LITTLE * sizes[key]}), [*keys, key]


def _stoppers(scene, keys, sizes):
    """The variant without stoppers, or with a pair near the greatest displacement."""
    if scene.stoppers:
        free = [key for key in keys if not key.startswith("stoppers")]
        return "no stoppers", scene.replace(stoppers=None), free
    table = {
        "gap": STOPPER_PLACE * sizes["stoppers.gap"],
        "stiffness": STOPPER_STIFFNESS * sizes["stoppers.stiffness"],
        "restitution": 0.7,
    }
    return "stoppers", scene.replace(stoppers=table), [*keys, "stoppers.gap", "stoppers.stiffness"]


@dataclass(frozen=True)
class Trial:
    """Records and unknowns of a candidate.

    Attributes
    ----------
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
    problem = base.with_more(unknowns(base.scene, keys, sizes), sizes, base.scene, base.keys)
    if problem is None:
        return []
    shooting, fit = problem
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
    trials = _without_mean(measurements, "voltage") + _without_mean(measurements, "velocity")
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

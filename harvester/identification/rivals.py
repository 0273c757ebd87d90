"""Rival models: the scene's own with one part more, with one part less, or with another column.

Whether a further part explains something of the residuals is seen to first order about the fit, by
a regression of the residuals on the part's effect (a score test). That regression also gives the
values at which the rival's fit begins. Parts are fitted in the order of their expected gain, until
one leaves only noise and no other promises nearly as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from harvester.base.errors import HarvesterError
from harvester.identification.fitting import NOTED, Fitted, fitted
from harvester.identification.intervals import normal_equations
from harvester.identification.measured_response import MeasuredResponse
from harvester.identification.unknowns import FORCE, LOAD, unknowns
from harvester.identification.validation_record import (
    HALF_INTERVAL,
    SURE,
    block_means,
    mean_of,
    validated,
)
from harvester.scene.numbers import numbers

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# A trial pair of stoppers begins at this share of the greatest displacement, with this share of the
# stiffness that counts as one (`sizes_of`).
STOPPER_PLACE, STOPPER_STIFFNESS = 0.9, 1e-2
SHORT_NAMES = {"oscillator.linear_stiffness": 1, "oscillator.cubic_stiffness": 3}
# Share of a size that is too little to change the motion.
LITTLE = 1e-6
DRAG = "oscillator.quadratic_damping"
HIGHEST_POWER = 7
# A spring that may soften is defined out to this multiple of the greatest displacement.
SOFT_RANGE = 1.25
# A part is fitted if it promises to lower the cost by this share; at most this number of parts is,
# and none after one that leaves only noise if it promises less than this share of the most
# promising.
PROMISING, MOST_FITTED, NEARLY_AS_MUCH = 0.02, 6, 0.5
# Shares of the regression's step from which the lowest cost is taken.
STEPS = (1.0, 0.3, 0.1, 0.03)
# A fitted value has moved if it differs from its first one by this share of its size.
MOVED = 1e-4
# Change of a load's logarithm for a difference quotient; most by which a step changes it, and most
# steps to its value, which end when it changes by less than this share.
LOAD_STEP, LARGEST_LOAD_STEP, LOAD_STEPS, LOAD_SETTLED = 1e-4, 1.0, 8, 2e-3
# Once the next power is free too, a spring's value is uncertain if half of its 95 % interval
# exceeds this share of the value. Measured shares: right models had 0.003 under noise and 0.02 to 5
# under three sines. Cubic models of softening springs under three sines, with errors of 0.02, 0.05,
# 0.05 and 0.16, had 0.06, 0.16, 1.2 and 0.38.
UNCERTAIN = 0.1
# A mean is an offset if it exceeds this number of standard errors and share of the deviation.
OFFSET_ERRORS, LEAST_OFFSET = 3.0, 0.01


class Rival(NamedTuple):
    """A model that is compared with the scene's own.

    Attributes
    ----------
    name : str
        Difference from the scene's model, such as "drag"; "as given" for the scene's.
    fitted : Fitted or None
        None where it was not tried.
    better : float
        Logarithm of the mean square error on the validation data over the scene's model's,
        on average over blocks; negative: better.
    error : float
        Standard error of that.
    explains : bool
        Whether it leaves only the sensors' noise of every record.
    remark : str
        Why it was not tried.
    """

    name: str
    fitted: Any
    better: float = 0.0
    error: float = 0.0
    explains: bool = False
    remark: str = ""

    @property
    def is_better(self) -> bool:
        """Whether this model predicts significantly better than the scene's own."""
        return self.better < -SURE * self.error and self.better < -2.0 * NOTED

    @property
    def is_as_good(self) -> bool:
        """Whether this model predicts no worse, within two standard errors or the share `NOTED`."""
        return self.better < max(2.0 * self.error, 2.0 * NOTED)


class NextPower(NamedTuple):
    """The scene's model compared with one with the spring's next power, to first order.

    Attributes
    ----------
    power : int
        The next odd one.
    significance : float
        Its coefficient in standard errors, by a score test.
    moves : dict of str to float
        Change of each of the spring's values by the next power, as a share of the value.
    halves : dict of str to float
        Half of the 95 % interval of each value beyond the linear one with the next power free, as
        a share of the value.
    """

    power: int
    significance: float
    moves: dict[str, float]
    halves: dict[str, float]

    @property
    def is_needed(self) -> bool:
        """Whether the records need the next power, and it changes a value noticeably."""
        noticed = any(move > NOTED for move in self.moves.values())
        return noticed and abs(self.significance) > SURE

    @property
    def uncertain(self) -> dict[str, float]:
        """Values whose interval is wide if the spring has the next power, with their `halves`."""
        return {key: half for key, half in self.halves.items() if not half <= UNCERTAIN}


class _Part(NamedTuple):
    """A further part: keys that are free in addition, or the record whose load is another."""

    name: str
    keys: tuple[str, ...]
    record: int | None = None


def rival_models(
    own: Rival,
    measurements: Sequence[Measurement],
    sizes: dict[str, float],
    start: Scene,
    keys: Sequence[str],
    report: Callable[[str], object],
) -> list[Rival]:
    """The scene's own model first, then its rivals.

    Parameters
    ----------
    sizes : dict of str to float
        Sizes from the fitted motion.
    start : Scene
        The scene before the fit.
    keys : sequence of str
        Keys that were to be fitted: a wrong model may have left some of them open.
    report : callable
        Called with the name of each rival before it is fitted.
    """
    base = own.fitted
    models = [own]
    for name, scene, free in _plainer(base.scene, base.keys):
        report(name)
        models.append(_tried(name, base, scene, measurements, free, sizes, base))
    parts = _parts(base, measurements, sizes)
    models += _further(base, parts, measurements, sizes, report)
    if own.explains or any(model.explains and model.is_better for model in models):
        return models
    # Large differences, to which no fit leads that begins at the wrong model: the simplest first.
    further: list[tuple[str, Scene, Any, Any]] = []
    if not isinstance(measurements[0], MeasuredResponse):
        further += [(name, start, records, keys) for name, records in turned(measurements)]
    further += [
        (name, scene, measurements, free) for name, scene, free in _structures(start, keys, sizes)
    ]
    for name, scene, records, free in further:
        report(name)
        again = _tried(name, base, scene, records, free, sizes, None)
        near = next((model for model in models if model.name == name), again)
        if near.fitted is None or (again.fitted and again.better <= near.better):
            near = again
        models = [*(model for model in models if model.name != name), near]
        if near.explains and near.is_better:
            break
    return models


def _tried(name, base, scene, measurements, keys, sizes, warm):
    """The rival, or why it cannot be fitted."""
    if not keys:
        return Rival(name, None, remark="not tried: none of its values is free")
    try:
        other = fitted(scene, measurements, keys, sizes, warm)
    except HarvesterError as error:
        return Rival(name, None, remark=f"no fit: {error}")
    return _compared(name, base, other)


def _compared(name, base, other):
    """A fitted model compared with the scene's, by the ratio of their mean square errors in blocks.

    All outputs count, each in units of the own model's rms residual.
    """
    ratios: list[float] = []
    for mine, theirs in zip(base.records, other.records, strict=True):
        units = np.sqrt(np.mean(mine.residuals**2, axis=0))
        old, new = (
            block_means(np.mean((record.residuals / units) ** 2, axis=1))
            for record in (mine, theirs)
        )
        ratios += [float(ratio) for ratio in np.log(new / old)]
    mean = mean_of(np.array(ratios))
    explains = all(record.is_explained for record in validated(other))
    return Rival(name, other, mean.estimate, mean.standard_error or 0.0, explains)


def proposed(models: Sequence[Rival]) -> Rival:
    """The simplest that predicts as well as the best of those that leave only noise."""
    return min(_of_the_best(models), key=lambda model: (len(model.fitted.keys), model.better))


def undecided(models: Sequence[Rival]) -> list[Rival]:
    """Models as simple as the proposed one that predict as well: the records cannot decide
    between them."""
    best = proposed(models)
    return [
        model
        for model in _of_the_best(models)
        if model is not best and len(model.fitted.keys) == len(best.fitted.keys)
    ]


def _of_the_best(models):
    """Models that predict as well as the best, within two standard errors or `NOTED`."""
    better = [model for model in models if model.is_better and model.explains]
    if not better:
        own, *others = [model for model in models if model.fitted and not model.is_better]
        simpler = [model for model in others if len(model.fitted.keys) < len(own.fitted.keys)]
        return [own, *(model for model in simpler if model.is_as_good)]
    best = min(better, key=lambda model: model.better)
    return [
        model
        for model in better
        if model.better - best.better < max(2.0 * math.hypot(model.error, best.error), 2.0 * NOTED)
    ]


def _coefficients(scene):
    """Coefficients of the spring; none of a table."""
    return [k or 0.0 for k in scene.oscillator.coefficients]


def _degree(force):
    return max((n for n, k in enumerate(force) if k != 0.0), default=0)


def _spring_keys(keys, left_out=()):
    """Keys with a spring's values as coefficients, without some powers."""
    keys = [FORCE.format(SHORT_NAMES[key]) if key in SHORT_NAMES else key for key in keys]
    return [key for key in keys if key not in {FORCE.format(n) for n in left_out}]


def _plainer(scene: Scene, keys: Sequence[str]) -> Iterator[tuple[str, Scene, list[str]]]:
    """Name, scene and keys of each model with a part less."""
    force = _coefficients(scene)
    degree = _degree(force)
    even = [n for n in range(2, len(force), 2) if force[n] != 0.0]
    options: list[tuple[str, list[float], Sequence[int]]] = []
    if even:
        odd = [0.0 if n in even else k for n, k in enumerate(force)]
        options.append(("symmetric spring", odd, even))
    if degree == 3 and force[1] > 0.0:
        options.append(("linear spring", force[:2], (2, 3)))
    if degree > 3:
        power = 3 + 2 * ((degree - 4) // 2)
        higher = range(power + 1, len(force))
        options.append((f"spring only up to power {power}", force[: power + 1], higher))
    for name, plain, left_out in options:
        try:
            plain_scene = scene.replace({"oscillator.restoring_force": plain})
        except HarvesterError:
            continue
        yield name, plain_scene, _spring_keys(keys, left_out)
    if scene.oscillator.quadratic_damping > 0.0:
        yield "no drag", scene.replace({DRAG: 0.0}), [key for key in keys if key != DRAG]
    if scene.stoppers:
        free = [key for key in keys if not key.startswith("stoppers")]
        yield "no stoppers", scene.replace(stoppers=None), free


def _structures(
    scene: Scene, keys: Sequence[str], sizes: dict[str, float]
) -> Iterator[tuple[str, Scene, list[str]]]:
    """Name, scene and keys of each model that is fitted from scratch."""
    force = _coefficients(scene)
    springs = [
        (*_next_powers(scene), 1.0),
        ("softening spring", [3], -1.0),
        ("asymmetric spring", [2, 3], 1.0),
    ]
    for name, powers, sign in springs if force else []:
        added = [n for n in powers if n >= len(force) or force[n] == 0.0 or sign < 0.0]
        if not added or (sign < 0.0 and _degree(force) > 3):
            continue
        changed = [*force, *[0.0] * HIGHEST_POWER][: max(len(force), *(n + 1 for n in added))]
        for n in added:
            changed[n] = sign * STOPPER_STIFFNESS * sizes[FORCE.format(n)]
        reach = SOFT_RANGE * sizes["stoppers.gap"]
        limit = {"oscillator.restoring_force_range": [-reach, reach]} if sign < 0.0 else {}
        free = [*_spring_keys(keys, added), *(FORCE.format(n) for n in added)]
        try:
            yield name, scene.replace({"oscillator.restoring_force": changed, **limit}), free
        except HarvesterError:
            continue
    if not scene.stoppers:
        table = {
            "gap": STOPPER_PLACE * sizes["stoppers.gap"],
            "stiffness": STOPPER_STIFFNESS * sizes["stoppers.stiffness"],
            "restitution": 0.7,
        }
        free = [*keys, *(f"stoppers.{key}" for key in table)]
        yield "stoppers", scene.replace(stoppers=table), free


def _next_powers(scene):
    """Name and powers of the spring's next odd power, and of the even one below if it has any."""
    force = _coefficients(scene)
    degree = _degree(force)
    if not 1 <= degree <= HIGHEST_POWER - 2:
        return "", []
    uneven = any(k != 0.0 for k in force[2::2])
    added = [n for n in (degree + 1, degree + 2) if n % 2 or uneven]
    name = "cubic spring" if degree < 3 else f"spring up to power {degree + 2}"
    return name, added


def _gains(base, measurements):
    """Gains of the channels that are neither given nor free."""
    given = {key for record in measurements for key in record.sensors}
    names = ("acceleration", *measurements[0].sensed)
    keys = {name: f"sensor.{name}_scale" for name in names}
    return [
        _Part(f"gain of the {name}", (key,))
        for name, key in keys.items()
        if key not in {*given, *base.keys}
    ]


def _parts(base, measurements, sizes):
    """All further parts that the model may have."""
    springs = [_next_powers(base.scene)]
    force = _coefficients(base.scene)
    if _degree(force) >= 3 and not any(force[2::2]):
        springs.append(("asymmetric spring", [2]))
    parts = [_Part(name, tuple(map(FORCE.format, powers))) for name, powers in springs if powers]
    if DRAG in sizes and not base.scene.oscillator.quadratic_damping:
        parts.append(_Part("drag", (DRAG,)))
    outputs = list(measurements[0].sensed)
    if isinstance(measurements[0], MeasuredResponse):
        return parts
    effects = {"AC-coupled accelerometer": ["sensor.acceleration_highpass"]}
    effects["delay between the channels"] = [f"sensor.{output}_delay" for output in outputs]
    effects |= {f"low-pass of the {output}": [f"sensor.{output}_filter"] for output in outputs}
    if "voltage" in outputs:
        effects["AC-coupled voltage"] = ["sensor.voltage_highpass"]
    taken = {*base.keys, *(key for record in measurements for key in record.sensors)}
    parts += [_Part(name, tuple(keys)) for name, keys in effects.items() if not {*keys} & taken]
    parts += _gains(base, measurements)
    if LOAD in numbers(base.scene) and LOAD not in base.keys and "voltage" in outputs:
        parts += [
            _Part(f"load of {record.name}", (), number)
            for number, record in enumerate(measurements)
            if not isinstance(record, MeasuredResponse)
        ]
    return parts


def _problem(base, keys, sizes):
    """The fit's problem with further keys at their values without effect, and the scene."""
    scene, free = base.scene, base.keys
    powers = [n for n in range(HIGHEST_POWER + 1) if FORCE.format(n) in keys]
    experiments = base.shooting.responses.experiments
    if DRAG in keys:
        # A drag of 0 is no number of a scene.
        scene = scene.replace({DRAG: LITTLE * sizes[DRAG]})
    if powers:
        force = _coefficients(scene)
        spring = {"oscillator.restoring_force": [*force, *[0.0] * (max(powers) + 1 - len(force))]}
        scene, free = scene.replace(spring), _spring_keys(free)
        experiments = [replace(one, scene=one.scene.replace(spring)) for one in experiments]
    old = zip(unknowns(scene, free, sizes), base.values, strict=True)
    # The added values begin near 0, so their sizes come from the motion, not from their starts.
    added = unknowns(scene, keys, sizes)
    added = [replace(one, size=sizes.get(one.key, one.size)) for one in added]
    every = [*(unknown.begun(value) for unknown, value in old), *added]
    responses = base.shooting.responses.replaced(experiments, [one.key for one in every])
    shooting = base.shooting.beside(responses, every)
    return shooting, replace(base.fit, values=np.array([one.start for one in every])), scene


def _further(base, parts, measurements, sizes, report):
    """Rivals with a further part, in the order of their expected gain."""
    if not parts:
        return []
    keys = list(dict.fromkeys(key for part in parts for key in part.keys))
    shooting, fit, _ = _problem(base, keys, sizes)
    records = [part.record for part in parts if part.record is not None]
    equations = _equations(shooting, fit, records)
    if equations is None:
        return [Rival(part.name, None, remark="not tried: the device diverges") for part in parts]
    count = len(base.keys)
    names = [*base.keys, *keys, *records]
    least, _ = _promised(equations, range(count))
    promises = []
    for part in parts:
        further = part.keys if part.record is None else (part.record,)
        members = [names.index(key, count) for key in further]
        gain, step = _promised(equations, [*range(count), *members])
        one_sided = part.record is None and any(
            fit.values[n] - shooting.low[n] <= LITTLE * shooting.sizes[n] and step[count + k] <= 0.0
            for k, n in enumerate(members)
        )
        promises.append((0.0 if one_sided else (gain - least) / fit.cost, part, step))
    promises.sort(key=lambda promise: -promise[0])
    models, enough = [], False
    for number, (promise, part, step) in enumerate(promises):
        if promise < PROMISING:
            remark = "not tried: it explains nothing of the residuals"
        elif number >= MOST_FITTED or (enough and promise < NEARLY_AS_MUCH * promises[0][0]):
            remark = f"not tried: it promises less, {promise:.0%} of the residuals' square"
        else:
            report(part.name)
            fit_it = _with_part if part.record is None else _with_load
            models.append(fit_it(base, part, measurements, sizes, step))
            enough = enough or (models[-1].explains and models[-1].is_better)
            continue
        models.append(Rival(part.name, None, remark=remark))
    return models


def _equations(shooting, fit, records):
    """Normal equations of all unknowns and some records' loads (ln R); None where it diverges."""
    if not math.isfinite(shooting.cost(fit)):
        return None
    changed = []
    for number in records:
        experiment = shooting.responses.experiments[number]
        load = {LOAD: math.exp(LOAD_STEP) * numbers(experiment.scene)[LOAD][0]}
        changed.append({number: replace(experiment, scene=experiment.scene.replace(load))})
    return normal_equations(shooting, fit, changed, LOAD_STEP)


def _promised(equations, places):
    """Expected decrease of the cost by a step in some unknowns, and that step in sizes."""
    some = equations.of(list(places))
    step = some.step
    return float(-some.gradient @ step), step


def _with_part(base, part, measurements, sizes, step):
    """The rival with a part, fitted from where the regression leads."""
    shooting, fit, scene = _problem(base, list(part.keys), sizes)
    if not shooting.linearized(fit):
        return Rival(part.name, None, remark="not tried: the device diverges")
    trials = []
    for share in STEPS:
        target = np.clip(fit.values + share * step * shooting.sizes, shooting.low, shooting.high)
        change = (target - fit.values) / shooting.sizes
        trial = shooting.moved(fit, change, shooting.state_moves(fit, change))
        trials.append((shooting.cost(trial), trial))
    cost, begun = min(trials, key=lambda trial: trial[0])
    if not cost < fit.cost:
        return Rival(part.name, None, remark="not tried: no step towards it lowers the residuals")
    warm = replace(base, fit=begun, shooting=shooting)
    count = len(base.keys)
    values = dict(zip(part.keys, map(float, begun.values[count:]), strict=True))
    changes = {key: value for key, value in values.items() if not key.startswith("sensor.")}
    keys = [unknown.key for unknown in shooting.unknowns]
    try:
        model = _tried(part.name, base, scene.replace(changes), measurements, keys, sizes, warm)
    except HarvesterError as error:
        return Rival(part.name, None, remark=f"no fit: {error}")
    if model.fitted is not None:
        moved = np.abs(model.fitted.values[count:] - fit.values[count:])
        if (moved < MOVED * shooting.sizes[count:]).all():
            return Rival(part.name, None, remark="not tried: its values did not move")
    return model


def _with_load(base, part, measurements, sizes, step):
    """The rival in which one record's load is another: the value at which all records agree."""
    number, records, warm = part.record, list(measurements), base
    model, factor = None, 1.0
    for _ in range(LOAD_STEPS):
        change = float(np.clip(step[-1], -LARGEST_LOAD_STEP, LARGEST_LOAD_STEP))
        factor *= math.exp(change)
        record = measurements[number]
        stated = record.changes.get(LOAD) or numbers(base.scene)[LOAD][0]
        changes = {**record.changes, LOAD: factor * stated}
        records[number] = replace(record, changes=changes)
        name = f"{part.name} ({factor * stated:.4g} Ω for {stated:.4g} Ω)"
        trial = _tried(name, base, base.scene, records, base.keys, sizes, warm)
        if trial.fitted is None:
            return model or trial
        if model is None or trial.better < model.better:
            model = trial
        warm = trial.fitted
        equations = _equations(warm.shooting, warm.fit, [number])
        if equations is None or abs(change) < LOAD_SETTLED:
            break
        step = equations.step
    return model


def next_power(base: Fitted, sizes: dict[str, float]) -> NextPower | None:
    """The model compared with one with the spring's next power; None if there is none.

    A few sines of nearly one amplitude show the force at that amplitude, which many springs have:
    the values' errors with the next power free say whether the records could exclude it.
    """
    _, powers = _next_powers(base.scene)
    if base.settled is None or not powers:
        return None
    shooting, fit, _ = _problem(base, list(map(FORCE.format, powers)), sizes)
    if (equations := _equations(shooting, fit, [])) is None:
        return None
    step = equations.step * shooting.sizes
    errors = np.sqrt(np.maximum(np.diag(equations.covariance), 0.0)) * shooting.sizes
    spring = {n: key for n, key in enumerate(base.keys) if _power(key) and base.values[n]}
    halves = HALF_INTERVAL * errors[: len(base.keys)] / np.abs(base.values)
    return NextPower(
        max(powers),
        float(step[-1] / errors[-1]),
        {key: abs(float(step[n] / base.values[n])) for n, key in spring.items()},
        {key: float(halves[n]) for n, key in spring.items() if _power(key) > 1},
    )


def _power(key):
    """Power of x that a key's spring coefficient belongs to; 0 for other keys."""
    index = key.removeprefix(FORCE[:-3]).rstrip("]")
    return SHORT_NAMES.get(key, 0) or (int(index) if index.isdigit() else 0)


def turned(measurements: Sequence[Measurement]) -> Iterator[tuple[str, list[Measurement]]]:
    """Name and records, whose columns mean something else: without an offset, another sign or
    frame."""
    outputs = list(measurements[0].sensed)
    yield from _without_mean(measurements, "voltage")
    yield from _without_mean(measurements, "velocity")
    # With one channel one sign is enough: the other gives the mirrored device.
    turnable = ["acceleration"] if outputs[0] != "voltage" else ["voltage"]
    turnable += ["acceleration"] if len(outputs) > 1 and turnable == ["voltage"] else []
    for name in turnable:
        key = f"sensor.{name}_scale"
        if not any(key in record.sensors for record in measurements):
            yield (
                f"swapped polarity of the {name}",
                [replace(one, sensors={**one.sensors, key: -1.0}) for one in measurements],
            )
    if "velocity" in outputs and not any(record.velocity_is_absolute for record in measurements):
        moved = [replace(record, velocity_is_absolute=True) for record in measurements]
        yield "velocity in the room", moved


def _without_mean(measurements, name):
    """The records without the means of a channel that has none over long times, if those show."""
    key, changed, largest = f"sensor.{name}_offset", [], 0.0
    for record in measurements:
        values = record.sensed.get(name)
        if values is None or key in record.sensors:
            return
        mean = mean_of(block_means(values))
        errors = OFFSET_ERRORS * (mean.standard_error or 0.0)
        if abs(mean.estimate) > max(errors, LEAST_OFFSET * float(np.std(values))):
            largest = max(largest, mean.estimate, key=abs)
        changed.append(replace(record, sensors={**record.sensors, key: mean.estimate}))
    if largest:
        yield f"offset of the {name} (its mean, {key} = {largest:.3g})", changed

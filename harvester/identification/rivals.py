"""Rival models: the scene's model with one part added or removed, or with another column.

A regression of the residuals on a part's effect shows, to first order about the fit, whether the
part explains some of them (a score test). It also gives the initial values for the rival's fit.
Parts are fitted in the order of their expected gain, until one leaves only noise and no other
promises nearly as much.
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
from harvester.identification.unknowns import (
    DRAG,
    FORCE,
    LITTLE,
    LOAD,
    SPRING,
    as_coefficients,
    factor_key,
    factor_of,
    power_of,
    spring_coefficients,
    with_values,
)
from harvester.identification.validation_record import HALF_INTERVAL, SURE, block_means, mean_of
from harvester.scene.numbers import numbers

if TYPE_CHECKING:
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene

# A trial pair of stoppers starts at this share of the largest displacement, with this share of the
# typical stiffness (`sizes_of`).
STOPPER_PLACE, STOPPER_STIFFNESS = 0.9, 1e-2
HIGHEST_POWER = 7
# A spring that may soften is defined up to this multiple of the largest displacement.
SOFT_RANGE = 1.25
# A part is fitted if the expected decrease of the cost exceeds this share. At most MOST_FITTED
# parts are fitted. After a part that leaves only noise, a part needs at least NEARLY_AS_MUCH of the
# largest expected decrease.
PROMISING, MOST_FITTED, NEARLY_AS_MUCH = 0.02, 6, 0.5
# Shares of the regression's step that are tried; the one with the lowest cost is used.
STEPS = (1.0, 0.3, 0.1, 0.03)
# A fitted value has changed if it differs from its initial value by this share of its size.
MOVED = 1e-4
# With the next power also free, a spring's value is uncertain if half of its 95 % interval exceeds
# this share of the value. Measured shares: 0.003 for right models under noise, and 0.02 to 5 under
# three sines. Cubic models of softening springs under three sines had errors of 0.02, 0.05, 0.05
# and 0.16, and shares of 0.06, 0.16, 1.2 and 0.38.
UNCERTAIN = 0.1
# A mean is an offset if it exceeds this number of standard errors, and this share of the standard
# deviation.
OFFSET_ERRORS, LEAST_OFFSET = 3.0, 0.01


class Rival(NamedTuple):
    """A model that is compared with the scene's.

    Attributes
    ----------
    name : str
        Difference from the scene's model, such as "drag"; "as given" for the scene's.
    fitted : Fitted or None
        None if the model was not fitted.
    better : float
        Mean over blocks of ln(mean square error of this model/that of the scene's model) on the
        validation data; negative: better.
    error : float
        Standard error of `better`.
    remark : str
        Reason why it was not fitted.
    """

    name: str
    fitted: Any
    better: float = 0.0
    error: float = 0.0
    remark: str = ""

    @property
    def size(self) -> int:
        """Number of fitted values."""
        return len(self.fitted.keys)

    @property
    def explains(self) -> bool:
        """Whether its residuals are only the sensors' noise, for every record."""
        return self.fitted is not None and self.fitted.explains

    @property
    def is_better(self) -> bool:
        """Whether this model predicts significantly better than the scene's."""
        return self.better < -SURE * self.error and self.better < -2.0 * NOTED

    @property
    def is_as_good(self) -> bool:
        """Whether this model is not worse than the scene's."""
        return self.is_close(0.0, 0.0)

    def is_close(self, better: float, error: float) -> bool:
        """Whether this model is not worse than another, within two standard errors or `NOTED`."""
        return self.better - better < max(2.0 * math.hypot(self.error, error), 2.0 * NOTED)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        fitted = ("keys", "values", "nrmse") if self.fitted else ()
        return {
            "model": self.name,
            "log_ratio_of_mean_squares": self.better,
            "standard_error": self.error,
            "leaves_only_noise": self.explains,
            "remark": self.remark,
            **{name: getattr(self.fitted, name) for name in fitted},
        }


class NextPower(NamedTuple):
    """The scene's model compared with one with the spring's next power, to first order.

    Attributes
    ----------
    power : int
        The next odd power.
    significance : float
        Its coefficient in standard errors, by a score test.
    moves : dict of str to float
        Relative change of each of the spring's values due to the next power.
    halves : dict of str to float
        Relative half width of the 95 % interval of each value except the linear one, with the next
        power free.
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

    def findings(self) -> list[str]:
        """The changes of the spring's values, and the values that become uncertain."""
        term, largest = f"a term of power {self.power}", max(self.moves.values(), default=0.0)
        needed = (
            f"{term} of the spring, which the records need by {abs(self.significance):.1f} "
            f"standard errors, changes its values by up to {largest:.0%}"
        )
        return [needed] * self.is_needed + [
            f"with {term}, which the records do not exclude, they determine "
            f"{name_and_share(key, half, ' to')} (95 %)"
            for key, half in self.uncertain.items()
        ]


def name_and_share(key: str, half: float, joint: str = "") -> str:
    """A value's name with half of its relative interval, as text."""
    return f"{key.rpartition('.')[2]}{joint} {f'± {half:.0%}' if half < 1.0 else 'not at all'}"


def rival_models(
    own: Rival,
    measurements: Sequence[Measurement],
    start: Scene,
    keys: Sequence[str],
    report: Callable[[str], object],
) -> list[Rival]:
    """The scene's model, then its rivals.

    Parameters
    ----------
    start : Scene
        The scene before the fit.
    keys : sequence of str
        Requested keys: a wrong model may leave some of them undetermined.
    report : callable
        Called with the name of each rival before its fit.
    """
    base = own.fitted
    models = [own]
    for name, scene, free in _plainer(base.scene, base.keys):
        report(name)
        models.append(_tried(name, base, scene, measurements, free, base))
    models += _further(base, _parts(base, measurements), measurements, report)
    if own.explains or any(model.explains and model.is_better for model in models):
        return models
    # Large differences, which a fit from the wrong model does not reach: the simplest first.
    further: list[tuple[str, Scene, Any, Any]] = []
    if not isinstance(measurements[0], MeasuredResponse):
        further += [(name, start, records, keys) for name, records in reinterpreted(measurements)]
    structures = _structures(start, keys, base.sizes)
    further += [(name, scene, measurements, free) for name, scene, free in structures]
    for name, scene, records, free in further:
        report(name)
        again = _tried(name, base, scene, records, free, None)
        near = next((model for model in models if model.name == name), again)
        if near.fitted is None or (again.fitted and again.better <= near.better):
            near = again
        models = [*(model for model in models if model.name != name), near]
        if near.explains and near.is_better:
            break
    return models


def _tried(name, base, scene, measurements, keys, warm):
    """Fit a rival, or give the reason why it cannot be fitted."""
    if not keys:
        return Rival(name, None, remark="not tried: none of its values is free")
    try:
        other = fitted(scene, measurements, keys, base.sizes, warm)
    except HarvesterError as error:
        return Rival(name, None, remark=f"no fit: {error}")
    return _compared(name, base, other)


def _compared(name, base, other):
    """Compare a fitted model with the scene's, by the ratio of their mean square errors in blocks.

    All outputs count, in units of the rms residual of the scene's model.
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
    return Rival(name, other, mean.estimate, mean.standard_error or 0.0)


def _degree(force):
    return max((n for n, k in enumerate(force) if k != 0.0), default=0)


def _plainer(scene: Scene, keys: Sequence[str]) -> Iterator[tuple[str, Scene, list[str]]]:
    """Yield name, scene and keys of each model with one part less."""
    force = spring_coefficients(scene)
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
        free = [key for key in as_coefficients(keys) if power_of(key) not in left_out]
        if changed := with_values(scene, {SPRING: plain}):
            yield name, changed, free
    if scene.oscillator.quadratic_damping > 0.0:
        yield "no drag", scene.replace({DRAG: 0.0}), [key for key in keys if key != DRAG]
    if scene.stoppers:
        free = [key for key in keys if not key.startswith("stoppers")]
        yield "no stoppers", scene.replace(stoppers=None), free


def _structures(
    scene: Scene, keys: Sequence[str], sizes: dict[str, float]
) -> Iterator[tuple[str, Scene, list[str]]]:
    """Yield name, scene and keys of each model that is fitted from the beginning."""
    force = spring_coefficients(scene)
    springs = [
        (*_next_powers(scene), 1.0),
        ("softening spring", [3], -1.0),
        ("asymmetric spring", [2, 3], 1.0),
    ]
    for name, powers, sign in springs if force else []:
        added = [n for n in powers if n >= len(force) or force[n] == 0.0 or sign < 0.0]
        if not added or (sign < 0.0 and _degree(force) > 3):
            continue
        spring = [*force, *[0.0] * HIGHEST_POWER][: max(len(force), added[-1] + 1)]
        for n in added:
            spring[n] = sign * STOPPER_STIFFNESS * sizes[FORCE.format(n)]
        reach = SOFT_RANGE * sizes["stoppers.gap"]
        limit = {f"{SPRING}_range": [-reach, reach]} if sign < 0.0 else {}
        free = [key for key in as_coefficients(keys) if power_of(key) not in added]
        if changed := with_values(scene, {SPRING: spring, **limit}):
            yield name, changed, [*free, *map(FORCE.format, added)]
    if not scene.stoppers:
        table = {
            "gap": STOPPER_PLACE * sizes["stoppers.gap"],
            "stiffness": STOPPER_STIFFNESS * sizes["stoppers.stiffness"],
            "restitution": 0.7,
        }
        free = [*keys, *(f"stoppers.{key}" for key in table)]
        yield "stoppers", scene.replace(stoppers=table), free


def _next_powers(scene):
    """Name and powers of the spring's next odd power, and of the even power below it if present."""
    force = spring_coefficients(scene)
    degree = _degree(force)
    if not 1 <= degree <= HIGHEST_POWER - 2:
        return "", []
    uneven = any(k != 0.0 for k in force[2::2])
    added = [n for n in (degree + 1, degree + 2) if n % 2 or uneven]
    name = "cubic spring" if degree < 3 else f"spring up to power {degree + 2}"
    return name, added


def _parts(base, measurements):
    """Yield name and keys of each part that can be added to the model."""
    springs, force = [_next_powers(base.scene)], spring_coefficients(base.scene)
    if _degree(force) >= 3 and not any(force[2::2]):
        springs.append(("asymmetric spring", [2]))
    parts = [(name, [*map(FORCE.format, powers)]) for name, powers in springs if powers]
    if not base.scene.oscillator.quadratic_damping:
        parts.append(("drag", [DRAG]))
    outputs = list(measurements[0].sensed)
    if isinstance(measurements[0], MeasuredResponse):
        return parts
    effects = [
        ("AC-coupled accelerometer", ["sensor.acceleration_highpass"]),
        ("delay between the channels", [f"sensor.{output}_delay" for output in outputs]),
        *((f"low-pass of the {output}", [f"sensor.{output}_filter"]) for output in outputs),
        *[("AC-coupled voltage", ["sensor.voltage_highpass"])] * ("voltage" in outputs),
        *((f"gain of the {name}", [f"sensor.{name}_scale"]) for name in ("acceleration", *outputs)),
    ]
    used = {*base.keys, *(key for record in measurements for key in record.sensors)}
    parts += [(name, keys) for name, keys in effects if not {*keys} & used]
    if LOAD in numbers(base.scene) and LOAD not in base.keys and "voltage" in outputs:
        parts += [
            (f"load of {record.name}", [factor_key(LOAD, [number])])
            for number, record in enumerate(measurements)
            if not isinstance(record, MeasuredResponse)
        ]
    return parts


def _further(base, parts, measurements, report):
    """Rivals with an added part, in the order of their expected gain."""
    if not parts:
        return []
    keys = list(dict.fromkeys(key for _, further in parts for key in further))
    shooting, fit, _ = base.extended(keys)
    if not math.isfinite(shooting.cost(fit)):
        return [Rival(name, None, remark="not tried: the device diverges") for name, _ in parts]
    equations, count = normal_equations(shooting, fit), len(base.keys)
    least, _ = _promised(equations, range(count))
    promises = []
    for part in parts:
        members = [count + keys.index(key) for key in part[1]]
        gain, step = _promised(equations, [*range(count), *members])
        one_sided = any(
            fit.values[n] - shooting.low[n] <= LITTLE * shooting.sizes[n] and step[count + k] <= 0.0
            for k, n in enumerate(members)
        )
        promises.append((0.0 if one_sided else (gain - least) / fit.cost, part, step))
    promises.sort(key=lambda promise: -promise[0])
    models, enough = [], False
    for number, (promise, (name, further), step) in enumerate(promises):
        if promise < PROMISING:
            remark = "not tried: it explains no part of the residuals"
        elif number >= MOST_FITTED or (enough and promise < NEARLY_AS_MUCH * promises[0][0]):
            remark = (
                f"not tried: its expected gain is smaller, {promise:.0%} of the residuals' square"
            )
        else:
            report(name)
            models.append(_with_part(base, name, further, measurements, step))
            enough = enough or (models[-1].explains and models[-1].is_better)
            continue
        models.append(Rival(name, None, remark=remark))
    return models


def _promised(equations, indices):
    """Expected decrease of the cost by a step in some unknowns, and this step in sizes."""
    some = equations.of(list(indices))
    step = some.step
    return float(-some.gradient @ step), step


def _with_part(base, name, further, measurements, step):
    """The rival with an added part, fitted from the regression's values."""
    shooting, fit, scene = base.extended(further)
    if not shooting.linearized(fit):
        return Rival(name, None, remark="not tried: the device diverges")
    trials = []
    for share in STEPS:
        target = np.clip(fit.values + share * step * shooting.sizes, shooting.low, shooting.high)
        change = (target - fit.values) / shooting.sizes
        trial = shooting.moved(fit, change)
        trials.append((shooting.cost(trial), trial))
    cost, begun = min(trials, key=lambda trial: trial[0])
    if not cost < fit.cost:
        return Rival(name, None, remark="not tried: no step towards it reduces the residuals")
    warm = replace(base, fit=begun, shooting=shooting)
    keys, count = shooting.keys, len(base.keys)
    begun_scene = with_values(
        scene, dict(zip(further, map(float, begun.values[count:]), strict=True))
    )
    if begun_scene is None:
        return Rival(name, None, remark="no fit: its values are invalid in the scene")
    model = _tried(name, base, begun_scene, measurements, keys, warm)
    if model.fitted is not None:
        moved = np.abs(model.fitted.values[count:] - fit.values[count:])
        if (moved < MOVED * shooting.sizes[count:]).all():
            return Rival(name, None, remark="not tried: its values did not change")
        if of := factor_of(further[0]):
            stated = numbers(shooting.experiments[of[1][0]].scene)[LOAD][0]
            other = stated * model.fitted.values[-1]
            model = model._replace(name=f"{name} ({other:.4g} Ω for {stated:.4g} Ω)")
    return model


def next_power(base: Fitted) -> NextPower | None:
    """Compare the model with one with the spring's next power; None if there is none.

    A few sines of similar amplitude show the force at that amplitude, which many springs share. The
    values' errors with the next power free show whether the records could exclude this power.
    """
    _, powers = _next_powers(base.scene)
    if base.settled is None or not powers:
        return None
    shooting, fit, _ = base.extended(list(map(FORCE.format, powers)))
    if not math.isfinite(shooting.cost(fit)):
        return None
    equations = normal_equations(shooting, fit)
    step = equations.step * shooting.sizes
    errors = np.sqrt(np.maximum(np.diag(equations.covariance), 0.0)) * shooting.sizes
    spring = {n: key for n, key in enumerate(base.keys) if power_of(key) and base.values[n]}
    halves = {key: HALF_INTERVAL * errors[n] / abs(base.values[n]) for n, key in spring.items()}
    return NextPower(
        max(powers),
        float(step[-1] / errors[-1]),
        {key: abs(float(step[n] / base.values[n])) for n, key in spring.items()},
        {key: float(half) for key, half in halves.items() if power_of(key) > 1},
    )


def reinterpreted(measurements: Sequence[Measurement]) -> Iterator[tuple[str, list[Measurement]]]:
    """Yield name and records with reinterpreted columns: other offset, sign or reference frame."""
    outputs = list(measurements[0].sensed)
    yield from _without_mean(measurements, "voltage")
    yield from _without_mean(measurements, "velocity")
    # With a single channel one sign is enough, since the other gives the mirrored device.
    channels = [name for name in ("voltage", "acceleration") if name in (*outputs, "acceleration")]
    for name in channels[: len(outputs)]:
        key = f"sensor.{name}_scale"
        if not any(key in record.sensors for record in measurements):
            yield (
                f"swapped polarity of the {name}",
                [replace(record, sensors={**record.sensors, key: -1.0}) for record in measurements],
            )
    if "velocity" in outputs and not any(record.velocity_is_absolute for record in measurements):
        moved = [replace(record, velocity_is_absolute=True) for record in measurements]
        yield "velocity in the inertial frame", moved


def _without_mean(measurements, name):
    """The records without a channel's mean, if it must be 0 over long times but is significant."""
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

"""The stiff and extreme cases of `harvester stability`, and their computation.

Values refer to the scaled equations (Eqs. 4–6) and are converted to the scene's units, so that the
same cases apply to scaled and SI scenes.
"""

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from harvester.averaging.closures import NOISE_CLOSURES, average
from harvester.averaging.of_scene import averaged_device, estimates_of
from harvester.base.arguments import check_name
from harvester.base.errors import SceneError
from harvester.base.serialising import key
from harvester.device import timescales
from harvester.device.hertz import HERTZ_EXPONENT
from harvester.device.piezo import PiezoTable
from harvester.device.system import System
from harvester.engines.codec import register
from harvester.engines.methods import ENGINES, MonteCarlo, engine_of
from harvester.engines.realization import run
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.units import length_scale
from harvester.statistics.balance import energy_balance_residual
from harvester.statistics.run_quantities import estimate_all
from harvester.validation import entries
from harvester.validation.path_deviation import PathDeviation, path_deviation
from harvester.validation.paths import ignore, longest_step

# Realizations of Monte Carlo's run: few, so that each is long enough for the slowest time scale.
REALIZATIONS = 4
# Approximate number of steps of all realizations of a run.
STEP_BUDGET = 12_000_000
# Settling time in slowest time scales, and its largest share of the affordable time.
SETTLED_TIMES = 5.0
LARGEST_SETTLED_SHARE = 0.2
# Stoppers for scenes without any: gap in units of the wells' distance, stiffness K, restitution e.
GAP, STIFFNESS, RESTITUTION = 1.1, 10.0, 0.7

METHODS = (*ENGINES, *NOISE_CLOSURES)
# Smallest settling time, as a share of `SETTLED_TIMES` slow times, for means to be used.
LEAST_SETTLED_SHARE = 0.5
# Steps of the trial run that measures steps per second.
TRIAL_STEPS = 100_000


@dataclass(frozen=True)
class Case:
    """One variation of a scene.

    Attributes
    ----------
    family : str
        Name of the varied quantity.
    name : str
        Value or values, as text.
    values : dict of str to float, bool, str or None
        Scaled values by the names in `_scene_value` and, for all stoppers, `_OF_STOPPERS`;
        {"stoppers": None} removes the stoppers.
    """

    family: str
    name: str = field(metadata=key("case"))
    values: dict = field(metadata=key("changes"))

    @property
    def title(self) -> str:
        return f"{self.family}: {self.name}" if self.family != "corner" else self.name


def default_cases() -> list[Case]:
    """The whole matrix: the cases of stability_cases.toml."""
    families = entries("stability_cases").items()
    return [
        Case(family, name, {key: None if v == "none" else v for key, v in values.items()})
        for family, cases in families
        for name, values in cases.items()
    ]


def changed(scene: Scene, case: Case) -> Scene:
    """The scene of one case, with its run length chosen.

    Raises
    ------
    SceneError
        The case does not apply to this scene.
    """
    changes: dict[str, Any] = {"excitation.knot_spacing": None, "run.realizations": REALIZATIONS}
    stopped = {name: value for name, value in case.values.items() if name in _OF_STOPPERS}
    if "stoppers" in case.values:
        changes["stoppers"] = case.values["stoppers"]
    elif stopped:
        changes["stoppers"] = _stoppers(scene, stopped)
    for name, scaled in case.values.items():
        if name not in ("stoppers", *_OF_STOPPERS):
            dotted, value = _scene_value(scene, name, scaled)
            changes[dotted] = value
    if scene.units == "SI":
        # Length unit and scaled values of the original scene are kept.
        changes["length_scale"] = length_scale(scene)
    new = prepared(scene.replace(changes))
    settle, duration = run_length(new)
    return new.scene.replace({"run.settle": settle, "run.duration": duration})


_OF_STOPPERS = ("stiffness", "gap_in_wells", "restitution", "impact_velocity")


def _stoppers(scene, values):
    """Tables of all stoppers with these scaled values; a scene without stoppers gets a pair."""
    if not scene.stoppers:
        if values.keys() == {"impact_velocity"}:
            raise SceneError(
                f"{scene.name}: the case varies impact_velocity, but the scene has no stoppers"
            )
        values = {"stiffness": STIFFNESS, "gap_in_wells": GAP, "restitution": RESTITUTION, **values}
    length, mass = _units(scene)
    tables, new = scene.to_tables().get("stoppers", {}), dict(values)
    if "gap_in_wells" in new:
        new["gap"] = new.pop("gap_in_wells") * _reference_length(prepared(scene).system) * length
    changed_tables = []
    for table in tables if isinstance(tables, list) else [tables]:
        changed_tables.append({**table, **new})
        if "stiffness" in new:
            exponent = table.get("exponent", HERTZ_EXPONENT)
            changed_tables[-1]["stiffness"] = new["stiffness"] * mass / length ** (exponent - 1.0)
    return changed_tables


def _units(scene):
    """Scaled units of length and mass, in the scene's units."""
    return (length_scale(scene), scene.oscillator.mass) if scene.units == "SI" else (1.0, 1.0)


def _reference_length(system):
    """Distance of the farthest well in scaled units; without wells the gap, or 1."""
    bare = system.spring
    wells = [abs(x) for x in bare.roots() if bare.slope(x) > 0.0]
    if any(wells):
        return float(max(wells))
    return min((contact.gap for contact in system.contacts), default=1.0)


# Scene key of a scaled value, and powers of length and mass in its unit.
KEYS = {
    "damping": ("oscillator.damping", 0, 1),
    "intensity": ("excitation.intensity", 2, 0),
    "correlation_time": ("excitation.correlation_time", 0, 0),
}


def _scene_value(scene, name, value):
    """Key and value in the scene's units of a scaled value (Eq. 3)."""
    length, mass = _units(scene)
    if name == "monostable":
        return _monostable(scene.oscillator)
    if name in KEYS:
        dotted, lengths, masses = KEYS[name]
        return dotted, value * length**lengths * mass**masses
    check_name("scaled value", name, (*KEYS, "monostable", "decay_rate", "coupling"))
    in_si = scene.units == "SI"
    if in_si and not isinstance(scene.transducer, PiezoTable):
        raise SceneError(f"{scene.name}: cases of λ and β need a [piezo]; this device has none")
    if name == "decay_rate":
        rate = {"decay_rate": value}
        if in_si:
            rate = {"resistance": 1.0 / (value * scene.transducer.capacitance)}
        return "load", {"kind": "resistor", **rate}
    if in_si:
        value = math.sqrt(value * mass * scene.transducer.capacitance)
    return "piezo.coupling", value


def _monostable(oscillator):
    """The spring with only its odd powers, all with positive coefficients."""
    if oscillator.force_table is not None:
        raise SceneError("the case monostable needs a polynomial spring: replace force_table")
    if oscillator.restoring_force is None:
        return "oscillator.linear_stiffness", abs(oscillator.linear_stiffness)
    powers = enumerate(oscillator.restoring_force)
    return "oscillator.restoring_force", [abs(k) if n % 2 else 0.0 for n, k in powers]


def run_length(model: Prepared) -> tuple[float, float]:
    """Settling and measured time (s) of Monte Carlo's realizations within the budget of steps."""
    step = longest_step(model, "default", "monte-carlo")
    affordable = STEP_BUDGET * step / model.scene.run.realizations
    settle = min(SETTLED_TIMES * slowest_time(model.system), LARGEST_SETTLED_SHARE * affordable)
    return settle, affordable - settle


def slowest_time(system: System) -> float:
    """The longest of relaxation time, period, correlation time of the noise and 1/λ (s)."""
    period = 2.0 * math.pi / timescales.angular_frequency(system)
    relaxation, decay = timescales.relaxation_time(system), system.transducer.decay_rate()
    return max(relaxation, period, system.noise.correlation_time, 1.0 / decay if decay else 0.0)


@register
@dataclass(frozen=True)
class CaseAnswer:
    """The result of one engine or stationary method for one case, in scaled units.

    Attributes
    ----------
    estimates : dict of str to Estimate
        Means with standard (Monte Carlo) or numerical errors (stationary method); empty for the
        circuit, whose run is too short.
    residual : float or None
        Residual of the energy balance; None for a stationary method.
    seconds : float
        Processor time of one core (s), for the simulation or the stationary method.
    steps, realizations : int
        0 for a stationary method.
    duration, settle, step : float or None
        Times of each realization, and its longest step (s); None for a stationary method.
    settled : bool
        Whether the transient had decayed before the means were taken.
    path : PathDeviation or None
        None for a stationary method.
    """

    estimates: dict = field(metadata=key("scaled_quantities"))
    residual: float | None = field(metadata=key("energy_balance_residual"))
    seconds: float
    steps: int = 0
    realizations: int = 0
    duration: float | None = None
    settle: float | None = None
    step: float | None = field(default=None, metadata=key("longest_step"))
    settled: bool = True
    path: PathDeviation | None = None


def answer(
    prepared_scene: Prepared, method: str, step: str | float, report: Callable
) -> CaseAnswer:
    """Compute one case by one engine or stationary method; a warning counts as an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if method in ENGINES:
            case_answer = _simulated(prepared_scene, method, step)
        else:
            case_answer = _averaged(prepared_scene, method)
    report(1.0)
    return case_answer


def _simulated(model, engine, step):
    engine_of(engine).check(model.scene)
    path, realizations = path_deviation(model, engine, step)
    has_means, system = engine == "monte-carlo", model.system
    if has_means:
        model = _affordable(model, step)
        realizations = _run(model, step)
    moments = [realization.moments for realization in realizations]
    slowest = SETTLED_TIMES * slowest_time(system)
    return CaseAnswer(
        estimates=estimate_all(moments, system) if has_means else {},
        residual=energy_balance_residual(moments, system),
        seconds=sum(realization.seconds for realization in realizations),
        steps=sum(record.points for record in moments),
        realizations=len(moments),
        duration=moments[0].time_reached - moments[0].start,
        settle=moments[0].start,
        step=longest_step(model, step, engine),
        settled=not has_means or model.scene.run.settle > LEAST_SETTLED_SHARE * slowest,
        path=path,
    )


def _run(model, step):
    return run(model, MonteCarlo(step), range(model.scene.run.realizations), None, ignore)


def _affordable(model, step):
    """The scene with its run shortened so that the steps in contacts fit the budget."""
    scene = model.scene
    length = scene.run.settle + scene.run.duration
    brief = min(TRIAL_STEPS * longest_step(model, step, "monte-carlo"), length)
    one = {"run.settle": 0.0, "run.duration": brief, "run.realizations": 1}
    [first] = _run(model.replace(one), step)
    points = first.moments.points * length / brief * scene.run.realizations
    share = min(STEP_BUDGET / points, 1.0)
    times = {"run.duration": scene.run.duration, "run.settle": scene.run.settle}
    return model.replace({name: share * value for name, value in times.items()})


def _averaged(model, closure):
    clock = time.process_time()
    averages = average(averaged_device(model), closure)
    return CaseAnswer(estimates_of(averages), None, time.process_time() - clock)

"""The answer of one engine or closure to one case, computed in a worker process.

Errors are outcomes of the task, which the runner hands on.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

from harvester.averaging.closures import NOISE_CLOSURES, average
from harvester.averaging.of_scene import averaged_device, estimates_of
from harvester.base.serialising import fields_of, key
from harvester.engines.codec import register
from harvester.engines.methods import ENGINES, MonteCarlo, engine_of
from harvester.engines.realization import run
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, steps_per_sample
from harvester.statistics.balance import energy_balance_residual
from harvester.statistics.means import estimate_all
from harvester.validation.path_deviation import PathDeviation, path_deviation
from harvester.validation.paths import ignore
from harvester.validation.stability_cases import SETTLED_TIMES, STEP_BUDGET, slowest_time

METHODS = (*ENGINES, *NOISE_CLOSURES)
# A run's means count if it has settled for at least this share of `SETTLED_TIMES` slow times.
LEAST_SETTLED_SHARE = 0.5
# Steps of the trial run that measures the number of steps per second.
TRIAL_STEPS = 100_000


@register
@dataclass(frozen=True)
class CaseAnswer:
    """The answer of one engine or closure to one case, in scaled units.

    Attributes
    ----------
    estimates : dict of str to Estimate
        Means: Monte Carlo's with their standard errors, a closure's with its numerical ones; none
        of the circuit, whose run is too short for them.
    residual : float or None
        Residual of the energy balance; None for a closure.
    seconds : float
        Processor time of one core (s), for the simulation or the closure.
    steps, realizations : int
        0 for a closure.
    duration, settle, step : float or None
        Times of each realization as it was run, and its longest step (s); None for a closure.
    settled : bool
        The transient had passed before the means were taken.
    path : PathDeviation or None
        None for a closure.
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

    def to_dict(self) -> dict:
        content = fields_of(self)
        return {**content, "path": content["path"] or {}}


def answer(scene: Scene, method: str, step: str | float, report: Callable) -> CaseAnswer:
    """One case by one engine or closure; a warning counts as an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        case_answer = (
            _simulated(scene, method, step) if method in ENGINES else _averaged(scene, method)
        )
    report(1.0)
    return case_answer


def _simulated(scene, engine, step):
    engine_of(engine).check(scene)
    path, realizations = path_deviation(scene, engine, step)
    system = prepared(scene).system
    estimates, settled = {}, True
    if engine == "monte-carlo":
        scene = _affordable(scene, step)
        realizations = _run(scene, step)
        settled = scene.run.settle > LEAST_SETTLED_SHARE * SETTLED_TIMES * slowest_time(scene)
    moments = [realization.moments for realization in realizations]
    if engine == "monte-carlo":
        estimates = estimate_all(moments, system)
    return CaseAnswer(
        estimates=estimates,
        residual=energy_balance_residual(moments, system),
        seconds=sum(realization.seconds for realization in realizations),
        steps=sum(record.points for record in moments),
        realizations=len(moments),
        duration=moments[0].time_reached - moments[0].start,
        settle=moments[0].start,
        step=knot_spacing(prepared(scene)) / steps_per_sample(prepared(scene), step, engine),
        settled=settled,
        path=path,
    )


def _run(scene, step):
    return run(scene, MonteCarlo(step), range(scene.run.realizations), None, ignore)


def _affordable(scene, step):
    """The scene with a run so short that its contacts, too, keep to the budget of steps."""
    length = scene.run.settle + scene.run.duration
    model = prepared(scene)
    engine_step = knot_spacing(model) / steps_per_sample(model, step, "monte-carlo")
    brief = min(TRIAL_STEPS * engine_step, length)
    one = {"run.settle": 0.0, "run.duration": brief, "run.realizations": 1}
    [first] = _run(scene.replace(one), step)
    points = first.moments.points * length / brief * scene.run.realizations
    share = min(STEP_BUDGET / points, 1.0)
    times = {"run.duration": scene.run.duration, "run.settle": scene.run.settle}
    return scene.replace({name: share * value for name, value in times.items()})


def _averaged(scene, closure):
    clock = time.process_time()
    averages = average(averaged_device(scene), closure)
    return CaseAnswer(estimates_of(averages), None, time.process_time() - clock)

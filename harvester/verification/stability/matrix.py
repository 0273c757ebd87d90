"""`stability`: stiff and extreme cases of a scene, each judged by what was computed.

Every case of `cases` is run by circuit and Monte Carlo on the same noise and
by every averaging closure. A verdict is *right*, *refused* (with a reason before anything was
computed) or *wrong*: numbers that do not hold, a run that did not end, a warning.
"""

import math
import time
import warnings
from dataclasses import dataclass

from harvester.averaging import AVERAGED, average
from harvester.averaging.of_scene import averaged_device
from harvester.engines.protocol import ENGINES
from harvester.engines.realization import run
from harvester.engines.steps import STEPS_PER_PERIOD, knot_spacing, steps_per_knot
from harvester.engines.workers import WorkerPool
from harvester.errors import HarvesterError, SceneError
from harvester.estimates.balance import energy_balance_residual
from harvester.estimates.estimate import Estimate
from harvester.estimates.means import estimate_all
from harvester.files.writing import finite
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor, scale
from harvester.simulation import check_step, require_noise
from harvester.verification.stability.cases import STEP_BUDGET, changed, default_cases
from harvester.verification.stability.verdicts import (
    JUDGED,
    LARGEST_NUMERICAL_ERROR,
    LARGEST_RESIDUAL,
    LARGEST_SIGMAS,
    REFUSED,
    RIGHT,
    SAME_PATH,
    WRONG,
    Answer,
    judged,
)

# Realizations of Monte Carlo over those of the circuit, of which they are the first.
MONTE_CARLO_FACTOR = 4
# Wall-clock limit of one case by one engine or closure (s).
TIME_LIMIT = 120.0


@dataclass(frozen=True)
class StabilityMatrix:
    """All rows of one scene; `harvester stability` shows it."""

    scene: Scene
    rows: list
    wall_seconds: float

    @property
    def wrong(self):
        """(case title, what, reason) of every wrong cell."""
        return self._cells(WRONG)

    @property
    def refused(self):
        """(case title, what, reason) of every refused cell."""
        return self._cells(REFUSED)

    def table(self):
        """Header and rows of the table, as text."""
        header = ["case", "simulation", "circuit residual", "Monte Carlo residual"]
        header += ["circuit s", "Monte Carlo s", "worst difference", "error bar of E[V²]"]
        header += [f"closure {closure}" for closure in AVERAGED]
        return header, [self._cells_of(row) for row in self.rows]

    def sentences(self):
        """What the verdicts are, one line each; reasons once for all cells that share them."""
        counts = {word: len(self._cells(word)) for word in (RIGHT, REFUSED, WRONG)}
        lines = [
            f"{', '.join(f'{count} {word}' for word, count in counts.items())} "
            f"in {self.wall_seconds:.0f} s"
        ]
        lines += [f"WRONG {title}, {what}: {reason}" for title, what, reason in self.wrong]
        shared = {}
        for title, what, reason in self.refused:
            shared.setdefault((what, reason), []).append(title)
        return lines + [
            f"refused by {what} for {'; '.join(titles)}: {reason}"
            for (what, reason), titles in shared.items()
        ]

    def to_dict(self):
        """Plain values for JSON."""
        return {
            "scene": self.scene.to_dict(),
            "seed": self.scene.run.seed,
            "wall_seconds": self.wall_seconds,
            "limits": {
                "difference_in_standard_errors": LARGEST_SIGMAS,
                "same_path_share": SAME_PATH,
                "energy_balance_residual": LARGEST_RESIDUAL,
                "closure_numerical_error": LARGEST_NUMERICAL_ERROR,
            },
            "wrong": len(self.wrong),
            "cases": [_row_to_dict(row) for row in self.rows],
        }

    def _cells(self, word):
        return [
            (row.case.title, what, verdict.reason)
            for row in self.rows
            for what, verdict in {"simulation": row.simulation, **row.closures}.items()
            if verdict.word == word
        ]

    def _cells_of(self, row):
        engines = list(ENGINES)
        return [
            row.case.title,
            row.simulation.word,
            *(_text(row.residual(engine), "{:+.2%}") for engine in engines),
            *(_text(row.seconds(engine), "{:.2f}") for engine in engines),
            _text(row.worst_difference, "{:.1f} σ"),
            _text(row.resolution("mean_square_voltage"), "{:.1%}"),
            *(verdict.word for verdict in row.closures.values()),
        ]


def stability(scene, *, cases=None, step="default", workers=None, progress=None):
    """Run and judge the matrix of one scene.

    Parameters
    ----------
    scene : Scene
        Device that the cases are variations of; its seed is kept, its run length is not.
    cases : sequence of Case or None
        None: `default_cases`.
    step : str or float
        See `harvester.simulate`.
    workers : int or None
        Processes; None: one per core.
    progress : callable or None
        Given the share done, 0 … 1.

    Returns
    -------
    StabilityMatrix

    Raises
    ------
    HarvesterError
        The excitation is no noise, or the load no resistor.
    """
    step = check_step(step)
    require_noise(scene, "stability")
    require_resistor(scene, "stability")
    clock = time.perf_counter()
    cases = default_cases() if cases is None else cases
    scenes = [_changed_or_refused(scene, case) for case in cases]
    methods = [*ENGINES, *AVERAGED]
    calls = [
        {"scene": changed_scene, "method": method, "step": step}
        for changed_scene in scenes
        if isinstance(changed_scene, Scene)
        for method in methods
    ]
    with WorkerPool(len(calls), workers) as pool:
        follow = _Follower(len(calls), progress) if progress else None
        outcomes = iter(pool.map(answer, calls, TIME_LIMIT, follow, keep_going=True))
    rows = []
    for case, changed_scene in zip(cases, scenes, strict=True):
        if isinstance(changed_scene, Scene):
            answers = {method: next(outcomes) for method in methods}
            rows.append(judged(case, changed_scene, answers))
        else:
            rows.append(judged(case, None, dict.fromkeys(methods, changed_scene)))
    return StabilityMatrix(scene, rows, time.perf_counter() - clock)


def answer(scene, method, step, report):
    """One case by one engine or closure, in a worker process.

    Returns
    -------
    Answer or HarvesterError
        What went wrong is an outcome here, not the end of the matrix.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if method in ENGINES:
                return _simulated(scene, method, step, report)
            return _averaged(scene, method, report)
    except HarvesterError as error:
        return error
    except Exception as error:
        return HarvesterError(f"{type(error).__name__}: {error}")


def _changed_or_refused(scene, case):
    try:
        return changed(scene, case)
    except SceneError as error:
        return error


def _simulated(scene, engine, step, report):
    scene = _affordable(scene, step)
    if engine == "monte-carlo":
        count = MONTE_CARLO_FACTOR * scene.run.realizations
        scene = scene.replace({"run.realizations": count})
    parameters, _ = scale(scene)
    count = scene.run.realizations
    realizations = []
    for index in range(count):
        realizations += run(scene, engine, [index], step, "external", None, _ignore)
        report((index + 1) / count)
    moments = [realization.moments for realization in realizations]
    estimates = estimate_all(moments, parameters)
    return Answer(
        {name: estimates[name] for name in JUDGED},
        energy_balance_residual(moments, parameters),
        sum(realization.seconds for realization in realizations),
        sum(each.points for each in moments),
        count,
        scene.run.duration,
        scene.run.settle,
        knot_spacing(scene) / steps_per_knot(scene, step, engine),
    )


def _affordable(scene, step):
    """The scene with a run so short that its contacts, too, keep to the budget of steps.

    A Monte Carlo run counts them; the circuit takes more in proportion.
    """
    [first] = run(scene, "monte-carlo", [0], step, "external", None, _ignore)
    steps = first.moments.points * STEPS_PER_PERIOD["circuit"] / STEPS_PER_PERIOD["monte-carlo"]
    share = STEP_BUDGET / (steps * scene.run.realizations)
    if share >= 1.0:
        return scene
    times = {"run.duration": scene.run.duration, "run.settle": scene.run.settle}
    return scene.replace({key: share * time for key, time in times.items()})


def _ignore(moments):
    """A report that nobody reads."""


def _averaged(scene, closure, report):
    clock = time.perf_counter()
    averages = average(averaged_device(scene), closure)
    estimates = {
        name: Estimate(getattr(averages, name), averages.numerical_error[name], None, "")
        for name in JUDGED
    }
    report(1.0)
    return Answer(estimates, None, time.perf_counter() - clock)


class _Follower:
    """Adds up how far the calls are."""

    def __init__(self, calls, progress):
        self._shares, self._progress = [0.0] * calls, progress

    def __call__(self, index, share):
        self._shares[index] = share
        self._progress(sum(self._shares) / len(self._shares))


def _row_to_dict(row):
    return {
        "family": row.case.family,
        "case": row.case.name,
        "changes": dict(row.case.values),
        "verdict": row.simulation.word,
        "reason": row.simulation.reason,
        "difference_in_standard_errors": {
            name: finite(value) for name, value in row.differences.items()
        },
        "closures": {
            name: {"verdict": verdict.word, "reason": verdict.reason}
            for name, verdict in row.closures.items()
        },
        "answers": {
            method: _answer_to_dict(outcome)
            for method, outcome in row.answers.items()
            if isinstance(outcome, Answer)
        },
    }


def _answer_to_dict(outcome):
    return {
        "energy_balance_residual": finite(outcome.residual),
        "seconds": outcome.seconds,
        "steps": outcome.steps,
        "realizations": outcome.realizations,
        "duration": outcome.duration,
        "settle": outcome.settle,
        "longest_step": outcome.step,
        "scaled_quantities": {
            name: _estimate_to_dict(estimate) for name, estimate in outcome.estimates.items()
        },
    }


def _estimate_to_dict(estimate: Estimate):
    return {
        "estimate": finite(estimate.estimate),
        "standard_error": finite(estimate.standard_error),
    }


def _text(value, form):
    return form.format(value) if math.isfinite(value) else "—"

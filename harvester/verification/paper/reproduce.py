"""`reproduce`: the paper's Figs. 4 to 10 by closures, Monte Carlo and circuit."""

import time
from dataclasses import dataclass

import numpy as np

from harvester.averaging import AVERAGED
from harvester.engines.protocol import ENGINES
from harvester.errors import SimulationError
from harvester.files.writing import finite
from harvester.scene.model import Scene
from harvester.studies.sweep import (
    REALIZATIONS,
    Request,
    costly_first,
    failed,
    relative_error,
    resolving,
    sweep,
    with_knots,
)
from harvester.verification.paper.figures_list import FIGURES, SYMBOLS, Figure


@dataclass(frozen=True)
class Effort:
    """How much is computed: the first measured time of one realization (s), the relative
    standard error that runs are made longer for, and the longest they may become (s)."""

    duration: float
    error: float
    longest: float


QUICK = {
    "monte-carlo": Effort(5_000.0, 0.05, 10_000.0),
    "circuit": Effort(600.0, 0.10, 600.0),
}
DEFAULT = {
    "monte-carlo": Effort(12_000.0, 0.02, 500_000.0),
    "circuit": Effort(4_000.0, 0.02, 25_000.0),
}


@dataclass(frozen=True)
class Reproduction:
    """One figure with all that was computed for it.

    Attributes
    ----------
    name : str
        "fig6".
    figure : Figure
    scene : Scene
        The device; curves and axes change it.
    lines : list of list of dict
        Per panel and curve: {method: [(value, Answer or error), …]}, values increasing.
    quick : bool
    wall_seconds : float
        From the call until the figure was done; figures share points.
    """

    name: str
    figure: Figure
    scene: Scene
    lines: list
    quick: bool
    wall_seconds: float

    def points(self):
        """(panel, curve, method, value, outcome) of every point."""
        for panel, lines in zip(self.figure.panels, self.lines, strict=True):
            for curve, line in zip(panel.curves, lines, strict=True):
                for method, points in line.items():
                    for value, outcome in points:
                        yield panel, curve, method, value, outcome

    @property
    def refused(self):
        """Of every point without an answer: (method, where, reason)."""
        return [
            (method, place(panel, curve, value), str(outcome))
            for panel, curve, method, value, outcome in self.points()
            if failed(outcome)
        ]

    @property
    def failed_runs(self):
        """Number of simulations that did not come to their end."""
        return sum(isinstance(outcome, SimulationError) for *_, outcome in self.points())

    def table(self):
        """Header and rows: how far each method is from Monte Carlo, and its error bars."""
        header = ["figure", "panel", "method", "points", "refused", "largest error bar"]
        what = "∫|p − p'| dX to" if self.figure.kind == "density" else "deviation from"
        header += [f"{what} Monte Carlo: median", "largest"]
        rows = []
        for letter, panel, lines in zip("abc", self.figure.panels, self.lines, strict=False):
            for method in lines[0]:
                points = [point for line in lines for point in line.get(method, ())]
                rows.append([self.name, f"{letter}: {SYMBOLS[panel.swept]}", method])
                rows[-1] += _summary(points, self._deviations(method, lines))
        return header, rows

    def sentences(self):
        """What a reader must know beside the figure."""
        lines = [f"{self.name}: refused by {m} at {where}: {why}" for m, where, why in self.refused]
        short = {}
        for panel, curve, method, value, outcome in self.points():
            for note in () if failed(outcome) else outcome.notes:
                # The noise's interpolation is said once, in the caption's JSON.
                if not note.startswith("noise linear"):
                    short.setdefault((method, note), []).append(place(panel, curve, value))
        return lines + [
            f"{self.name}: {method} at {'; '.join(places)}: {note}"
            for (method, note), places in short.items()
        ]

    def to_dict(self):
        """Plain values for JSON."""
        return {
            "figure": self.name,
            "title": self.figure.title,
            "scene": self.scene.to_dict(),
            "quick": self.quick,
            "wall_seconds": self.wall_seconds,
            "panels": [
                {
                    "swept": panel.swept,
                    "curves": [
                        {
                            "changes": dict(curve.changes),
                            "methods": {m: _points_to_dict(p) for m, p in line.items()},
                        }
                        for curve, line in zip(panel.curves, lines, strict=True)
                    ],
                }
                for panel, lines in zip(self.figure.panels, self.lines, strict=True)
            ],
        }

    def _deviations(self, method, lines):
        """Relative to Monte Carlo, at each value that both have; of densities the L1 distance."""
        shares = []
        for line in lines:
            simulated = dict(line["monte-carlo"])
            for value, outcome in line.get(method, ()):
                reference = simulated.get(value)
                if reference is None or failed(reference) or failed(outcome):
                    continue
                if outcome.density is not None:
                    shares.append(_distance(outcome.density, reference.density))
                for name in self.figure.quantities:
                    mean = reference.quantities[name].estimate
                    shares.append(outcome.quantities[name].estimate / mean - 1.0)
        return np.array(shares)


def reproduce(scene, names, *, quick=False, pool, progress=None, on_figure=None):
    """Compute figures; scenes that several share are computed once.

    Parameters
    ----------
    scene : Scene
        The paper's device.
    names : sequence of str
        Keys of `FIGURES`.
    quick : bool
        Fewer points and shorter runs.
    pool : harvester.engines.workers.WorkerPool
    progress : callable or None
        Given the share done, 0 … 1.
    on_figure : callable or None
        Given each Reproduction as soon as its last point is there.

    Returns
    -------
    list of Reproduction
    """
    clock = time.perf_counter()
    plans = {name: _plan(scene, FIGURES[name], quick) for name in names}
    requests = {name: costly_first(_requests(plan)) for name, plan in plans.items()}
    missing = {name: set(wanted) for name, wanted in requests.items()}
    answers, contents = {}, {}

    def collect(request, outcome):
        answers[request] = outcome
        for name in [name for name, wanted in missing.items() if request in wanted]:
            missing[name].remove(request)
            if not missing[name]:
                lines, seconds = _answered(plans[name], answers), time.perf_counter() - clock
                contents[name] = Reproduction(name, FIGURES[name], scene, lines, quick, seconds)
                if on_figure:
                    on_figure(contents[name])

    sweep([r for wanted in requests.values() for r in wanted], pool, progress, collect)
    return [contents[name] for name in names]


def place(panel, curve, value):
    """ "δr = 1.1, D = 0.02": where a point lies."""
    swept = f"{SYMBOLS[panel.swept]} = {value:g}"
    return swept if dict(curve.changes).get(panel.swept) == value else f"{curve.label}, {swept}"


def _plan(scene, figure, quick):
    """Per panel and curve {method: [(value, Request), …]}."""
    scene = with_knots(scene)
    plan = []
    for panel in figure.panels:
        if figure.kind == "density":
            plan.append(_density_plan(scene, panel, quick))
        else:
            plan.append(_sweep_plan(scene, panel, quick))
    return plan


def _requests(plan):
    """All of a figure's."""
    return [
        request
        for lines in plan
        for line in lines
        for points in line.values()
        for _, request in points
    ]


def _density_plan(scene, panel, quick):
    lines = []
    for place_, curve in enumerate(panel.curves):
        changed = scene.replace(dict(curve.changes))
        value = dict(curve.changes)[panel.swept]
        # The circuit takes a hundred times as long: one curve of each panel.
        methods = [*AVERAGED, "monte-carlo"] + ["circuit"] * (place_ == 0)
        lines.append({m: [(value, _request(changed, m, quick, density=True))] for m in methods})
    return lines


def _sweep_plan(scene, panel, quick):
    fine, coarse = panel.values(quick)
    middle = coarse[len(coarse) // 2]
    lines = []
    for place_, curve in enumerate(panel.curves):
        device = scene.replace(dict(curve.changes))
        wanted = {closure: fine for closure in AVERAGED}
        wanted["monte-carlo"] = coarse
        wanted["circuit"] = [middle] if place_ == 0 or not quick else []
        lines.append(
            {
                method: [
                    (value, _request(device.replace({panel.swept: value}), method, quick))
                    for value in values
                ]
                for method, values in wanted.items()
            }
        )
    return lines


def _request(scene, method, quick, density=False):
    """With the run that the effort asks for; a closure's answer does not depend on it."""
    effort = (QUICK if quick else DEFAULT).get(method)
    if method not in ENGINES:
        return Request(scene, method, density=density)
    run = resolving(scene).replace(
        {"run.duration": effort.duration, "run.realizations": REALIZATIONS}
    )
    return Request(run, method, effort.error, effort.longest, density)


def _answered(plan, answers):
    return [
        [{m: [(v, answers[r]) for v, r in points] for m, points in line.items()} for line in lines]
        for lines in plan
    ]


def _summary(points, deviations):
    outcomes = [outcome for _, outcome in points if not failed(outcome)]
    bars = [
        relative_error(outcome.quantities["mean_square_voltage"])
        for outcome in outcomes
        if outcome.simulated_time > 0.0
    ]
    cells = [str(len(points)), str(len(points) - len(outcomes))]
    cells.append(f"{max(bars):.1%}" if bars else "—")
    if not deviations.size:
        return [*cells, "—", "—"]
    worst = deviations[np.argmax(np.abs(deviations))]
    return [*cells, f"{np.median(deviations):+.1%}", f"{worst:+.1%}"]


def _distance(density, reference):
    """∫|p − p'| dX on the bins of the reference."""
    values = np.interp(reference.centre, density.centre, density.density, 0.0, 0.0)
    width = reference.centre[1] - reference.centre[0]
    return float(np.sum(np.abs(values - reference.density)) * width)


def _points_to_dict(points):
    return [
        {"value": finite(value), "refused": str(outcome)}
        if failed(outcome)
        else {"value": finite(value), **outcome.to_dict()}
        for value, outcome in points
    ]

"""`reproduce`: the paper's Figs. 4 to 10 by closures, Monte Carlo and circuit."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.base.arguments import listed
from harvester.base.errors import SimulationError
from harvester.base.serialising import plain
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.engines.request import relative_error
from harvester.engines.simulate import check_name
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.scene.steps import with_knots
from harvester.validation.paper_figures import (
    FIGURES,
    KEY_SYMBOLS,
    Curve,
    FigurePanel,
    PaperFigure,
)
from harvester.validation.paper_runs import Outcome, answered, costly_first, reason, request

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Effort:
    """How much is computed: realizations at first, the relative standard error that more are
    added for, and how many there may be."""

    realizations: int
    precision: float
    most: int


QUICK = {"monte-carlo": Effort(16, 0.05, 32), "circuit": Effort(8, 0.10, 8)}
DEFAULT = {"monte-carlo": Effort(40, 0.02, 1600), "circuit": Effort(48, 0.02, 336)}


@dataclass(frozen=True)
class Reproduction:
    """One figure with all that was computed for it.

    Attributes
    ----------
    layout : PaperFigure
        Panels, curves and axes of the figure.
    scene : Scene
        The device; curves and axes change it.
    lines : list of list of dict
        Per panel and curve: {method: [(value, Outcome), …]}, values increasing.
    wall_seconds : float
        Wall time from the call until the figure was done (s); figures share points.
    """

    name: str
    layout: PaperFigure
    scene: Scene
    lines: list
    quick: bool
    wall_seconds: float

    def points(self) -> Iterator[tuple[FigurePanel, Curve, str, float, Outcome]]:
        """(panel, curve, method, value, outcome) of every point."""
        for panel, lines in zip(self.layout.panels, self.lines, strict=True):
            for curve, line in zip(panel.curves, lines, strict=True):
                for method, points in line.items():
                    for value, outcome in points:
                        yield panel, curve, method, value, outcome

    @property
    def refused(self) -> list[tuple[str, str, str]]:
        """(method, where, reason) of every point without an answer."""
        return [
            (method, point_name(panel, curve, value), reason(outcome))
            for panel, curve, method, value, outcome in self.points()
            if not answered(outcome)
        ]

    @property
    def failed_runs(self) -> int:
        return sum(isinstance(outcome, SimulationError) for *_, outcome in self.points())

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows: how far each method is from Monte Carlo, and its error bars."""
        header = ["figure", "panel", "method", "points", "refused", "largest error bar"]
        what = "∫|p − p'| dX to" if self.layout.kind == "density" else "deviation from"
        header += [f"{what} Monte Carlo: median", "largest"]
        rows = []
        for letter, panel, lines in zip("abc", self.layout.panels, self.lines, strict=False):
            for method in lines[0]:
                points = [point for line in lines for point in line.get(method, ())]
                rows.append([self.name, f"{letter}: {KEY_SYMBOLS[panel.swept]}", method])
                rows[-1] += _summary(points, self._deviations(method, lines))
        return header, rows

    def sentences(self) -> list[str]:
        """Notes that belong to the figure."""
        lines = [f"{self.name}: refused by {m} at {where}: {why}" for m, where, why in self.refused]
        short: dict[tuple[str, str], list[str]] = {}
        for panel, curve, method, value, outcome in self.points():
            for note in outcome.notes if answered(outcome) else ():
                # The note on the interpolation of the noise stands once, in the caption's JSON.
                if not note.startswith("noise linear"):
                    short.setdefault((method, note), []).append(point_name(panel, curve, value))
        return lines + [
            f"{self.name}: {method} at {'; '.join(places)}: {note}"
            for (method, note), places in short.items()
        ]

    def figure(self) -> "Figure":
        from harvester.results.figures import drawn
        from harvester.validation.paper_drawing import draw

        return drawn(draw, self)

    def to_dict(self) -> dict[str, Any]:
        return {
            "figure": self.name,
            "title": self.layout.title,
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
                for panel, lines in zip(self.layout.panels, self.lines, strict=True)
            ],
        }

    def data(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers, one a point and quantity."""
        header = ["panel", "curve", "method", "value", "quantity", "estimate", "standard_error"]
        rows = [
            [
                panel.swept,
                curve.label,
                method,
                value,
                name,
                estimate.estimate,
                estimate.standard_error,
            ]
            for panel, curve, method, value, outcome in self.points()
            if answered(outcome)
            for name, estimate in outcome.quantities.items()
        ]
        return header, rows

    def _deviations(self, method, lines):
        """Relative to Monte Carlo, at each value that both have; of densities the L1 distance."""
        shares = []
        for line in lines:
            simulated = dict(line["monte-carlo"])
            for value, outcome in line.get(method, ()):
                reference = simulated.get(value)
                if not (answered(reference) and answered(outcome)):
                    continue
                if outcome.density is not None:
                    shares.append(_distance(outcome.density, reference.density))
                for name in self.layout.quantities:
                    mean = reference.quantities[name].estimate
                    shares.append(outcome.quantities[name].estimate / mean - 1.0)
        return np.array(shares)


@takes_scene
def reproduce(
    scene: Scene,
    names: Sequence[str],
    *,
    quick: bool = False,
    precision: float | None = None,
    on_figure: Callable[[Reproduction], object] | None = None,
    **running: Unpack[RunnerOptions],
) -> list[Reproduction]:
    """Compute figures; scenes that several share are computed once.

    Parameters
    ----------
    scene : Scene, str or Path
        The paper's device.
    names : sequence of str
        Keys of `FIGURES`.
    quick : bool
        Fewer points and shorter runs.
    precision : float or None
        Relative standard error of E[V²] and PCE that simulations are run for, instead of that of
        `QUICK` or `DEFAULT`.
    on_figure : callable or None
        Given each Reproduction as soon as its last point is there.
    **running
        See `harvester.engines.open_runner`.

    Returns
    -------
    list of Reproduction
        Where the time budget was spent, points that are not there yet are None.
    """
    clock = time.perf_counter()
    names = listed(names, "names", f'["{next(iter(FIGURES))}"]')
    for name in names:
        check_name("figure", name, FIGURES)
    plans = {name: _plan(scene, FIGURES[name], quick, precision) for name in names}
    requests = {
        name: costly_first(
            request
            for panel in plan
            for line in panel
            for points in line.values()
            for _, request in points
        )
        for name, plan in plans.items()
    }
    missing = {name: set(needed) for name, needed in requests.items()}
    ordered = list(dict.fromkeys(itertools.chain(*requests.values())))
    answers, contents = {}, {}

    def collect(index, outcome):
        one = ordered[index]
        answers[one] = outcome
        for name in [name for name, unanswered in missing.items() if one in unanswered]:
            missing[name].remove(one)
            if not missing[name]:
                lines, seconds = _answered(plans[name], answers), time.perf_counter() - clock
                contents[name] = Reproduction(name, FIGURES[name], scene, lines, quick, seconds)
                if on_figure:
                    on_figure(contents[name])

    with open_runner(**running) as runner:
        runner.answer(ordered, collect, in_turn=True)
    return [contents[name] for name in names]


def point_name(panel: FigurePanel, curve: Curve, value: float) -> str:
    """ "δr = 1.1, D = 0.02": where a point lies."""
    swept = f"{KEY_SYMBOLS[panel.swept]} = {value:g}"
    return swept if dict(curve.changes).get(panel.swept) == value else f"{curve.label}, {swept}"


def _plan(scene, figure, quick, precision=None):
    """Per panel and curve {method: [(value, Request), …]}."""
    scene = with_knots(scene)
    is_density = figure.kind == "density"
    efforts = QUICK if quick else DEFAULT

    def planned(device, panel, value, method):
        changed = device if is_density else device.replace({panel.swept: value})
        return _request(changed, method, efforts, precision, is_density)

    def line(panel, index, curve):
        device = scene.replace(dict(curve.changes))
        values_by_method = _values(panel, index, curve, quick, is_density)
        return {
            method: [(value, planned(device, panel, value, method)) for value in values]
            for method, values in values_by_method.items()
        }

    return [
        [line(panel, index, curve) for index, curve in enumerate(panel.curves)]
        for panel in figure.panels
    ]


def _values(panel, index, curve, quick, is_density):
    """{method: values that it computes of a curve}; the circuit, a hundred times as slow, has few.

    A density has the one value of its curve.
    """
    if is_density:
        methods = [*NOISE_CLOSURES, "monte-carlo", *(["circuit"] if index == 0 else [])]
        return {method: [dict(curve.changes)[panel.swept]] for method in methods}
    fine, coarse = panel.values(quick)
    circuit = [coarse[len(coarse) // 2]] if index == 0 or not quick else []
    return {**dict.fromkeys(NOISE_CLOSURES, fine), "monte-carlo": coarse, "circuit": circuit}


def _request(scene, method, efforts, precision, density):
    """The request for a scene, with as many realizations as the effort asks for."""
    first = {engine: effort.realizations for engine, effort in efforts.items()}
    options = {}
    if method in efforts:
        effort = efforts[method]
        options = {"precision": precision or effort.precision, "most": effort.most}
    return request(scene, method, first, density, **options)


def _answered(plan, answers):
    """The plan with answers in the place of its requests."""
    return [
        [{m: [(v, answers[r]) for v, r in points] for m, points in line.items()} for line in lines]
        for lines in plan
    ]


def _summary(points, deviations):
    outcomes = [outcome for _, outcome in points if answered(outcome)]
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
        {"value": plain(value)}
        | (outcome.to_dict() if answered(outcome) else {"refused": reason(outcome)})
        for value, outcome in points
    ]

"""`reproduce`: the paper's figures and statements by every method."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Unpack

import numpy as np

from harvester.averaging.closures import NOISE_CLOSURES
from harvester.base.arguments import listed
from harvester.base.errors import HarvesterError, SimulationError
from harvester.base.formatting import NOT_KNOWN, written
from harvester.base.plain_text import shown
from harvester.base.serialising import plain
from harvester.engines.opening import RunnerOptions, open_runner
from harvester.engines.request import Request, relative_error
from harvester.engines.simulate import check_name
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.calling import takes_scene
from harvester.scene.model import Scene
from harvester.scene.steps import with_knots
from harvester.validation import claims, orbit_maps
from harvester.validation.paper_drawing import draw
from harvester.validation.paper_figures import (
    FIGURES,
    KEY_SYMBOLS,
    Changes,
    FigurePanel,
    Outcome,
    PaperFigure,
    answered,
    costly_first,
    name_of,
    reason,
    request,
    told_of,
)


class Effort(NamedTuple):
    """Amount of computation: first realizations, required relative standard error, most
    realizations.
    """

    realizations: int
    precision: float
    most: int


QUICK = {"monte-carlo": Effort(16, 0.05, 32), "circuit": Effort(8, 0.10, 8)}
DEFAULT = {"monte-carlo": Effort(40, 0.02, 1600), "circuit": Effort(48, 0.02, 336)}
WITHOUT_NOISE = {"fig2": orbit_maps.surfaces, "fig3": orbit_maps.orbit_voltages}
# All that can be reproduced, in order of computation.
NAMES = (*WITHOUT_NOISE, *FIGURES, "claims")


@dataclass(frozen=True, repr=False)
class Reproduction(ResultBase):
    """One figure with its computed points.

    Attributes
    ----------
    layout : PaperFigure
        Panels, curves and axes of the figure.
    scene : Scene
        The device, which curves and axes vary.
    lines : list of list of dict
        Per panel and curve: {method: [(value, Outcome), …]}, with ascending values. A `plan` has
        Requests instead of outcomes.
    wall_seconds : float
        Wall time from the call until the figure was complete (s); figures share points.
    """

    name: str
    layout: PaperFigure
    scene: Scene
    lines: list
    quick: bool
    wall_seconds: float

    def points(self) -> Iterator[tuple[FigurePanel, Changes, str, float, Any]]:
        """Yield (panel, curve, method, value, outcome) of every point."""
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

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(), self._findings(), pictures=[Picture(draw, self)], records=self._records
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows: each method's deviation from Monte Carlo, and its error bars."""
        header = ["figure", "panel", "method", "points", "refused", "largest error bar"]
        what = "deviation from" if self.layout.quantities else "∫|p − p'| dX to"
        header += [f"{what} Monte Carlo: median", "largest"]
        rows = []
        for letter, panel, lines in zip("abc", self.layout.panels, self.lines, strict=False):
            for method in lines[0]:
                points = [point for line in lines for point in line.get(method, ())]
                rows.append([self.name, f"{letter}: {KEY_SYMBOLS[panel.swept]}", method])
                rows[-1] += _summary(points, self._deviations(method, lines))
        return header, rows

    def _findings(self) -> list[str]:
        """Notes on the figure."""
        lines = [f"{self.name}: refused by {m} at {where}: {why}" for m, where, why in self.refused]
        short: dict[tuple[str, str], list[str]] = {}
        for panel, curve, method, value, outcome in self.points():
            for note in outcome.notes if answered(outcome) else ():
                # The note on the interpolation of the noise is given once, in the caption's JSON.
                if not note.startswith("noise linear"):
                    short.setdefault((method, note), []).append(point_name(panel, curve, value))
        return lines + [
            f"{self.name}: {method} at {'; '.join(places)}: {note}"
            for (method, note), places in short.items()
        ]

    def answered(self, answers: dict[Request, Outcome], wall_seconds: float) -> "Reproduction":
        """This plan with the outcomes of its requests."""

        def of_line(line):
            return {m: [(v, answers[r]) for v, r in points] for m, points in line.items()}

        lines = [[of_line(line) for line in panel_lines] for panel_lines in self.lines]
        return replace(self, lines=lines, wall_seconds=wall_seconds)

    def to_dict(self) -> dict[str, Any]:
        def told(points):
            return [{"value": plain(value), **told_of(outcome)} for value, outcome in points]

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
                            "changes": dict(curve),
                            "methods": {m: told(points) for m, points in line.items()},
                        }
                        for curve, line in zip(panel.curves, lines, strict=True)
                    ],
                }
                for panel, lines in zip(self.layout.panels, self.lines, strict=True)
            ],
        }

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and rows of numbers, one row per point and quantity."""
        header = ["panel", "curve", "method", "value", "quantity", "estimate", "standard_error"]
        rows = [
            [panel.swept, name_of(curve), method, value, name, e.estimate, e.standard_error]
            for panel, curve, method, value, outcome in self.points()
            if answered(outcome)
            for name, e in outcome.quantities.items()
        ]
        return header, rows

    def _deviations(self, method, lines):
        """Deviations from Monte Carlo at common values; for densities the L1 distance."""
        shares = []
        for line in lines:
            simulated = dict(line["monte-carlo"])
            for value, outcome in line.get(method, ()):
                reference = simulated.get(value)
                if not (answered(reference) and answered(outcome)):
                    continue
                if outcome.density is not None:
                    shares.append(distance(outcome.density, reference.density))
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
    thorough: bool = False,
    on_figure: Callable[[Any], object] | None = None,
    **running: Unpack[RunnerOptions],
) -> list[Any]:
    """Compute figures and test statements; common scenes are computed once.

    Parameters
    ----------
    scene : Scene, str or Path
        The paper's device.
    names : sequence of str
        fig2 … fig10, claims.
    quick : bool
        Figures with fewer points and shorter runs.
    precision : float or None
        Relative standard error of E[V²] and PCE at which simulations for figures stop; overrides
        `QUICK` or `DEFAULT`.
    thorough : bool
        Longer runs for statements, and the circuit at every condition.
    on_figure : callable or None
        Called with each result when its last point is computed.
    **running
        See `harvester.open_runner`.

    Returns
    -------
    list of Surfaces, OrbitVoltages, Reproduction or ReproducedStatements
        Points missing because the time budget was spent are None.
    """
    clock = time.perf_counter()
    names = listed(names, "names", '["fig4"]', str)
    for name in names:
        check_name("figure", name, NAMES)
    if on_figure is not None and not callable(on_figure):
        raise HarvesterError(f"on_figure = {shown(on_figure)}: must be a function of one argument")
    contents = {}

    def keep(name, content):
        contents[name] = content
        if on_figure:
            on_figure(content)

    for name in [name for name in names if name in WITHOUT_NOISE]:
        keep(name, WITHOUT_NOISE[name](scene))
    plans = {n: plan(n, scene, quick, precision) for n in names if n in FIGURES}
    requests = {n: costly_first(r for *_, r in plans[n].points()) for n in plans}
    missing = {name: set(needed) for name, needed in requests.items()}
    ordered = list(dict.fromkeys(itertools.chain(*requests.values())))
    answers: dict[Request, Outcome] = {}

    def collect(index, outcome):
        answers[ordered[index]] = outcome
        for name, unanswered in missing.items():
            if ordered[index] in unanswered:
                unanswered.remove(ordered[index])
                if not unanswered:
                    keep(name, plans[name].answered(answers, time.perf_counter() - clock))

    with open_runner(**running) as runner:
        if ordered:
            runner.answer(ordered, collect, in_turn=True)
        if "claims" in names:
            keep("claims", claims.claims(scene, thorough=thorough, runner=runner))
    return [contents[name] for name in names]


def point_name(panel: FigurePanel, curve: Changes, value: float) -> str:
    """ "δr = 1.1, D = 0.02": label of a point."""
    swept = f"{KEY_SYMBOLS[panel.swept]} = {value:g}"
    return swept if dict(curve).get(panel.swept) == value else f"{name_of(curve)}, {swept}"


def plan(name: str, scene: Scene, quick: bool, precision: float | None = None) -> Reproduction:
    """A figure of `FIGURES` with the requests for its points."""
    figure, device = FIGURES[name], with_knots(scene)
    efforts, is_density = QUICK if quick else DEFAULT, not figure.quantities
    first = {engine: effort.realizations for engine, effort in efforts.items()}

    def asked(curve, panel, value, method):
        changes = curve if is_density else {**dict(curve), panel.swept: value}
        options = {}
        if method in efforts:
            effort = efforts[method]
            options = {"precision": precision or effort.precision, "most": effort.most}
        return request(device.replace(dict(changes)), method, first, is_density, **options)

    lines = [
        [
            {
                method: [(value, asked(curve, panel, value, method)) for value in values]
                for method, values in _values(panel, index, curve, quick, is_density).items()
            }
            for index, curve in enumerate(panel.curves)
        ]
        for panel in figure.panels
    ]
    return Reproduction(name, figure, scene, lines, quick, 0.0)


def _values(panel, index, curve, quick, is_density):
    """{method: values to compute on a curve}; few for the circuit, which is a hundred times slower.

    A density has only the curve's value.
    """
    if is_density:
        methods = [*NOISE_CLOSURES, "monte-carlo", *(["circuit"] if index == 0 else [])]
        return {method: [dict(curve)[panel.swept]] for method in methods}
    fine, coarse = panel.values(quick)
    circuit = [coarse[len(coarse) // 2]] if index == 0 or not quick else []
    return {**dict.fromkeys(NOISE_CLOSURES, fine), "monte-carlo": coarse, "circuit": circuit}


def _summary(points, deviations):
    outcomes = [outcome for _, outcome in points if answered(outcome)]
    bars = [
        relative_error(outcome.quantities["mean_square_voltage"])
        for outcome in outcomes
        if outcome.simulated_time > 0.0
    ]
    cells: list[str] = [written(len(points), "d"), written(len(points) - len(outcomes), "d")]
    cells.append(written(max(bars), ".1%") if bars else NOT_KNOWN)
    if not deviations.size:
        return [*cells, NOT_KNOWN, NOT_KNOWN]
    worst = deviations[np.argmax(np.abs(deviations))]
    return [*cells, written(float(np.median(deviations)), "+.1%"), written(float(worst), "+.1%")]


def distance(density: Any, reference: Any) -> float:
    """L1 distance ∫|p − p'| dX on the bins of the reference."""
    values = np.interp(reference.centre, density.centre, density.density, 0.0, 0.0)
    width = reference.centre[1] - reference.centre[0]
    return float(np.sum(np.abs(values - reference.density)) * width)

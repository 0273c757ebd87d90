"""What a study says: each load's optimum, their ranking, a table, sentences."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.estimates.estimate import Estimate
from harvester.files.writing import finite
from harvester.results.result import with_error
from harvester.running.realizations import PERIODS
from harvester.running.request import COMPLETE
from harvester.scene.model import Scene
from harvester.studies.curves import Difference, optimum_of, rank
from harvester.studies.evaluation import Evaluation
from harvester.studies.study import Study

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from harvester.running.folder import StudyFolder


@dataclass(frozen=True)
class Report:
    """A study with what follows from it."""

    study: Study

    @property
    def scene(self) -> Scene:
        """For the table's title."""
        return self.study.grid.scene

    @property
    def unit(self) -> str:
        """Of power."""
        return "W" if self.scene.units == "SI" else "scaled power"

    @cached_property
    def evaluations(self) -> np.ndarray:
        """Array of the grid's shape: loads, then the sweeps."""
        grid = self.study.grid
        shape = (len(grid.loads), *(len(values) for values in grid.sweeps.values()))
        array = np.empty(shape, dtype=object)
        for place, evaluation in zip(np.ndindex(shape), self.study.evaluations, strict=True):
            array[place] = evaluation
        return array

    @cached_property
    def curve_keys(self) -> tuple[str | None, list[str]]:
        """Keys of the sweep that optima are sought along, and of the others."""
        keys, curve = list(self.study.grid.sweeps), self.study.grid.curve
        if curve is None:
            return None, []
        return keys[curve], keys[:curve] + keys[curve + 1 :]

    @cached_property
    def curves(self) -> np.ndarray:
        """Evaluations with the optimum's sweep last: loads, other sweeps, places."""
        if self.study.grid.curve is None:
            return self.evaluations[..., None]
        return np.moveaxis(self.evaluations, self.study.grid.curve + 1, -1)

    @cached_property
    def optima(self) -> np.ndarray:
        """(CurveOptimum, its place or None) of each curve: loads, other sweeps."""
        key, _ = self.curve_keys
        places = self.study.grid.sweeps[key] if key else (0.0,)
        order = np.argsort(places)
        found = np.empty(self.curves.shape[:-1], dtype=object)
        for where in np.ndindex(found.shape):
            row = [self.curves[where][k] for k in order]
            powers, series = [e.power for e in row], [e.series for e in row]
            optimum = optimum_of([places[k] for k in order], powers, series)
            found[where] = optimum, None if optimum.best is None else int(order[optimum.best])
        return found

    def best(self, where: tuple[int, ...]) -> Evaluation | None:
        """Evaluation at the highest point of a curve, or None."""
        place = self.optima[where][1]
        return None if place is None else self.curves[where][place]

    @cached_property
    def rankings(self) -> dict[tuple[int, ...], tuple[list[str], list[Difference]]]:
        """(order, differences) at each place of the other sweeps."""
        loads = self.study.grid.loads
        found = {}
        for other in np.ndindex(self.optima.shape[1:]):
            places = ((load, self.best((k, *other))) for k, load in enumerate(loads))
            best = {load: e for load, e in places if e}
            powers = {load: e.power for load, e in best.items()}
            found[other] = rank(powers, {load: e.series for load, e in best.items()})
        return found

    def others(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Places of the other sweeps with their values as text, "" where there are none."""
        _, keys = self.curve_keys
        values = [self.study.grid.sweeps[key] for key in keys]
        for other in itertools.product(*(range(len(each)) for each in values)):
            words = [
                f"{key} = {each[k]:g}" for key, each, k in zip(keys, values, other, strict=True)
            ]
            yield other, ", ".join(words)

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows: each load's optimum."""
        key = self.curve_keys[0]
        header = ["load", "at", f"highest at {key or 'the scene'}", "optimum", "interval"]
        header += [f"output power [{self.unit}]", "efficiency", "realizations", "note"]
        rows = []
        for other, words in self.others():
            for k, load in enumerate(self.study.grid.loads):
                rows.append([load, words, *self._row((k, *other), key)])
        return header, rows

    def _row(self, where, key):
        optimum, place = self.optima[where]
        if place is None:
            return ["—", "—", "—", "—", "—", "0", self.curves[where][0].outcome]
        best = self.best(where)
        efficiency = best.estimates.get("end_to_end_efficiency") or best.estimates.get(
            "power_conversion_efficiency_of_input"
        )
        notes = [optimum.note, "" if best.outcome == COMPLETE else best.outcome]
        if self.study.precision and best.realizations:
            notes.append(self._precision(best))
        inside = math.isfinite(optimum.low)
        return [
            f"{self.study.grid.sweeps[key][place]:.4g}" if key else "",
            f"{optimum.place:.4g}" if inside else "—",
            f"{optimum.low:.4g} … {optimum.high:.4g}" if inside else "—",
            with_error(best.estimates["output_power"]),
            with_error(efficiency) if efficiency else "—",
            str(best.realizations),
            "; ".join(note for note in notes if note),
        ]

    def _precision(self, evaluation):
        reached, asked = evaluation.relative_error, self.study.precision
        said = f"{reached:.1%}" if math.isfinite(reached) else "no error bar"
        return said if reached <= asked else f"{said}, not the {asked:.1%} asked for"

    def sentences(self) -> list[str]:
        """The ranking, what precision was reached, how it ended, what was run."""
        lines = [line for other, words in self.others() for line in self._ranking(other, words)]
        lines += self._failures()
        study, run = self.study, self.scene.run
        total = len(study.evaluations)
        if study.precision:
            done = sum(e.relative_error <= study.precision for e in study.evaluations)
            lines.append(f"{done} of {total} points within {study.precision:.1%}")
        lines += self._proofs()
        lines += study.grid.notes
        if any(e.realizations for e in study.evaluations):
            lines.append(
                f"{self._methods()}: realizations of {run.duration:g} s after {run.settle:g} s, "
                f"seed {run.seed}, the same noise for all points"
            )
        lines.append(
            f"{study.computed} tasks computed, {study.reused} taken from before; "
            f"{study.wall_seconds:.0f} s"
        )
        return lines

    def save(self, folder: str | Path | StudyFolder) -> None:
        """Write NetCDF, CSV and figures: see `harvester.save`."""
        from harvester.studies.files import save

        save(self, folder)

    def alarms(self) -> list[str]:
        """Where the circuit's power is another, one line each."""
        return [f"DISAGREE: {self._proof(each)}" for each in self.study.proofs if each.disagrees]

    def _methods(self):
        named = dict.fromkeys(self.study.methods)
        return " and ".join(named)

    def _proofs(self):
        """What the circuit says as judge."""
        proofs = self.study.proofs
        if not proofs:
            return []
        judged = [each for each in proofs if each.judges]
        apart = sum(each.disagrees for each in judged)
        verdict = f"DISAGREES at {apart} of them" if apart else "agrees at all of them"
        head = (
            f"the circuit as judge, on the same noise at {len(judged)} places (the optima, others "
            f"at random), {verdict if judged else 'says nothing'}:"
        )
        return [head, *(f"  {self._proof(each)}" for each in proofs)]

    def _proof(self, proof):
        point = self.study.grid.points[proof.place]
        place = ", ".join(f"{value:g}" for value in point.place)
        where = f"{point.load}{' at ' * bool(place)}{place}{' (optimum)' * proof.highest}"
        parts = {
            f"in the first {PERIODS:g} periods": (
                proof.early_difference,
                proof.early_standard_error,
            ),
            "settled": (proof.difference, proof.standard_error),
        }
        told = [f"{_apart(*of)} {part}" for part, of in parts.items() if not math.isnan(of[1])]
        if not told:
            return f"{where}: {proof.trouble}"
        words = [*told, proof.trouble] if proof.trouble else told
        return f"{where}: circuit over Monte Carlo, paired, {', '.join(words)}"

    def figure(self) -> Figure:
        """Output power over the swept value."""
        from harvester.show import figures
        from harvester.studies.drawing import draw_power

        return figures.drawn(draw_power, self)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, powers in `unit`; missing errors become null."""
        study, grid = self.study, self.study.grid
        return {
            "scene": self.scene.to_dict(),
            "method": study.method,
            "precision": study.precision,
            "unit_of_power": self.unit,
            "points": [
                {
                    "load": point.load,
                    "place": dict(zip(grid.sweeps, point.place, strict=True)),
                    "outcome": each.outcome,
                    "realizations": each.realizations,
                    "quantities": {n: found.to_dict() for n, found in each.estimates.items()},
                }
                for point, each in zip(grid.points, study.evaluations, strict=True)
            ],
            "optima": [
                {"load": load, "at": words, **self._optimum_to_dict((k, *other))}
                for other, words in self.others()
                for k, load in enumerate(grid.loads)
            ],
            "proofs": [
                {
                    "load": grid.points[each.place].load,
                    "place": dict(zip(grid.sweeps, grid.points[each.place].place, strict=True)),
                    "highest": each.highest,
                    "difference": finite(each.difference),
                    "standard_error": finite(each.standard_error),
                    "early_difference": finite(each.early_difference),
                    "early_standard_error": finite(each.early_standard_error),
                    "disagrees": each.disagrees,
                    "trouble": each.trouble,
                }
                for each in study.proofs
            ],
            "rankings": [
                {"at": words, "best_first": self.rankings[other][0]}
                for other, words in self.others()
            ],
            "seed": self.scene.run.seed,
            "notes": [*grid.notes, *study.warnings],
            "wall_seconds": study.wall_seconds,
        }

    def _optimum_to_dict(self, where):
        optimum, place = self.optima[where]
        key = self.curve_keys[0]
        highest = None if place is None or key is None else self.study.grid.sweeps[key][place]
        interval = [finite(optimum.low), finite(optimum.high)]
        found = {"over": key, "highest_at": highest, "place": finite(optimum.place)}
        return {**found, "interval": interval, "note": optimum.note}

    def _ranking(self, other, words):
        order, differences = self.rankings[other]
        if len(order) < 2:
            return
        yield f"ranking at the optima{f', {words}' if words else ''}: {' > '.join(order)}"
        for each in differences:
            if order.index(each.worse) == order.index(each.better) + 1:
                estimate = Estimate(100.0 * each.estimate, 100.0 * each.standard_error, None, "1")
                distance = each.estimate / each.standard_error if each.standard_error else math.nan
                sure = f", {distance:.1f} standard errors" if math.isfinite(distance) else ""
                yield f"  {each.better} over {each.worse}: {with_error(estimate)} % (paired){sure}"

    def _failures(self):
        for point, evaluation in zip(self.study.grid.points, self.study.evaluations, strict=True):
            if evaluation.outcome != COMPLETE:
                place = ", ".join(f"{value:g}" for value in point.place)
                yield f"{point.load} at {place}: {evaluation.outcome}"


def _apart(difference, standard_error):
    """A paired difference in words."""
    share = Estimate(100.0 * difference, 100.0 * standard_error, None, "1")
    distance = abs(difference) / standard_error if standard_error else 0.0
    return f"{with_error(share)} % ({distance:.1f} σ)"

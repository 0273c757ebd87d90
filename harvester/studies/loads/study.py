"""The result of a load study with its sentences, and the steps of `load_study`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.averaging.closures import notes_on_errors
from harvester.base.arguments import check_name
from harvester.base.errors import LoadError
from harvester.base.formatting import (
    NOT_KNOWN,
    quantity,
    share_with_error,
    span,
    with_error,
    written,
)
from harvester.base.method import Method
from harvester.base.plain_text import json_text
from harvester.base.serialising import fields_of, plain
from harvester.base.symbols import definitions
from harvester.base.tables import require_xarray
from harvester.device.record import Record
from harvester.engines.methods import ENGINES, Circuit, Engine, engine_of, method_of
from harvester.engines.realizations import PERIODS
from harvester.engines.request import COMPLETE
from harvester.engines.runner import Runner
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.model import Scene
from harvester.scene.tables import key_column, key_words, value_words
from harvester.scene.units import require_resistor
from harvester.statistics.agreement import NEGLIGIBLE_SHARE, NOT_SHARP, differ, is_sharp
from harvester.statistics.estimate import Estimate
from harvester.statistics.units import unit_of
from harvester.studies import JUDGED
from harvester.studies.grid import Grid
from harvester.studies.loads import drawing
from harvester.studies.loads.curves import Difference, optimum_of, rank
from harvester.studies.loads.drawing import EFFICIENCIES
from harvester.studies.loads.evaluation import WAVEFORM, Evaluation
from harvester.studies.loads.proof import Proof, points_to_check, proving
from harvester.studies.sweep import (
    Sweep,
    columns,
    orbits_of,
    placed_notes,
    variables_of,
)

if TYPE_CHECKING:
    from xarray import Dataset

# Ratio of a realization's measured time to its settling time. A fifth of the run is then settling.
DURATION_OVER_SETTLE = 4.0
COLUMNS = (
    "columns: output power (harvested), efficiency and realizations belong to the highest "
    "computed point; optimum: the maximum of a parabola through ln(power) at this point and its "
    "neighbours; interval: 95 % for this maximum, widened to maxima of other curves (five points)"
)
# Maximum number of curves that a headline names as equal to the highest.
MOST_NAMED = 3
EQUAL = "not significantly more than from"
UNKNOWN = "with a difference of unknown error to"
# Share of the time budget reserved for the cross-check with the circuit.
PROOF_SHARE = 0.2


@dataclass(frozen=True, repr=False)
class LoadStudy(ResultBase):
    """Points, outcome, optima, ranking and cross-check of a load study.

    Attributes
    ----------
    method : "judged", an engine or a stationary method.
    version
        Version of the program that computed the results.
    evaluations
        Evaluations of the points, in the order of `grid.points`.
    proofs
        Comparisons with the circuit at selected points.
    out_of_time
        Whether the time budget ended the study; repeat the call to continue.
    computed, reused
        Numbers of tasks.
    warnings : tuple of str
        Warnings: invalid stored answers, outcomes that were not stored, a folder that cannot be
        locked.
    """

    grid: Grid
    method: str
    version: str
    precision: float | None
    evaluations: list[Evaluation]
    proofs: list[Proof]
    out_of_time: bool
    computed: int
    reused: int
    wall_seconds: float
    warnings: tuple[str, ...] = ()

    @property
    def scene(self) -> Scene:
        """The scene, with the knot spacing common to all points."""
        return self.grid.scene

    @property
    def scenes(self) -> Sequence[Scene]:
        """The scene of every point."""
        return [point.scene for point in self.grid.points]

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the method that simulated each point."""
        return tuple(evaluation.method for evaluation in self.evaluations)

    @property
    def sweep(self) -> Sweep:
        """The points as a tidy table of output power."""
        return Sweep(
            scene=self.scene,
            values={"load": self.grid.loads, **self.grid.sweeps},
            methods=(self.method,),
            quantities=("output_power",),
            cells=self.cells[..., None],
            notes=self.grid.notes,
            out_of_time=self.out_of_time,
            seconds=self.wall_seconds,
            scenes=self.scenes,
        )

    @property
    def unit(self) -> str:
        """The unit of power."""
        return "W" if self.scene.units == "SI" else "scaled power"

    @cached_property
    def cells(self) -> np.ndarray:
        """The evaluations in the grid's shape: loads, then sweeps."""
        array = np.empty(len(self.evaluations), dtype=object)
        array[:] = self.evaluations
        return array.reshape(self.grid.shape)

    @cached_property
    def curve_keys(self) -> tuple[str | None, list[str]]:
        """Key of the sweep along which optima are sought, and keys of the other sweeps."""
        keys, curve = list(self.grid.sweeps), self.grid.curve
        if curve is None:
            return None, []
        return keys[curve], keys[:curve] + keys[curve + 1 :]

    @cached_property
    def curves(self) -> np.ndarray:
        """Evaluations with the optimum's sweep last: loads, other sweeps, points."""
        if self.grid.curve is None:
            return self.cells[..., None]
        return np.moveaxis(self.cells, self.grid.curve + 1, -1)

    @cached_property
    def optima(self) -> np.ndarray:
        """(CurveOptimum, its position or None) of each curve: loads, other sweeps."""
        key, _ = self.curve_keys
        positions = self.grid.sweeps[key] if key else (0.0,)
        order = np.argsort(positions)
        optima = np.empty(self.curves.shape[:-1], dtype=object)
        for where in np.ndindex(optima.shape):
            row = [self.curves[where][k] for k in order]
            powers, series = [e.ranked_power for e in row], [e.series for e in row]
            optimum = optimum_of([positions[k] for k in order], powers, series)
            optima[where] = optimum, None if optimum.best is None else int(order[optimum.best])
        return optima

    def best(self, where: tuple[int, ...]) -> Evaluation | None:
        """Evaluation at the highest point of a curve, or None."""
        index = self.optima[where][1]
        return None if index is None else self.curves[where][index]

    @cached_property
    def rankings(self) -> dict[tuple[int, ...], tuple[list[str], list[Difference]]]:
        """(order, differences) at each point of the other sweeps."""
        loads = self.grid.loads
        return {
            other: self._ranked({load: (k, *other) for k, load in enumerate(loads)})
            for other in np.ndindex(self.optima.shape[1:])
        }

    @cached_property
    def ranked_curves(self) -> tuple[list[str], list[Difference]]:
        """(order, differences) of all curves, named by their load and values of other sweeps."""
        return self._ranked(self._curve_names)

    @cached_property
    def _curve_names(self):
        """Name of each curve, and its index in `curves`."""
        return {
            f"{load} at {words}" if words else load: (k, *other)
            for other, words in self.others()
            for k, load in enumerate(self.grid.loads)
        }

    def _ranked(self, curves):
        """(order, differences) of curves, which are given by name, at their optima."""
        best = {name: e for name, where in curves.items() if (e := self.best(where))}
        powers = {name: e.power for name, e in best.items()}
        # A periodic motion's power has no statistical error, even if there are few batches.
        exact = self._periodic and any(math.isnan(e.power_error) for e in best.values())
        series = {name: None if exact else e.series for name, e in best.items()}
        return rank(powers, series)

    @property
    def _periodic(self):
        excitation = self.scene.excitation
        return bool(excitation.period) and not excitation.random

    def others(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Yield the points of the other sweeps with their values as text, "" if there are none."""
        _, keys = self.curve_keys
        values = [self.grid.sweeps[key] for key in keys]
        for other in itertools.product(*(range(len(axis)) for axis in values)):
            words = [
                self._value(key, axis[k]) for key, axis, k in zip(keys, values, other, strict=True)
            ]
            yield other, ", ".join(words)

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=self._headline(),
            alarms=self._alarms(),
            pictures=[Picture(draw, self, name) for name, draw in drawing.FIGURES.items()],
            records=self._records,
            keys=1 + bool(self.curve_keys[1]),
            dataset=self._dataset,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and one row per load's optimum."""
        key, others = self.curve_keys
        along = key_words(key, self.scene.units)[0] if key else "the scene"
        header = ["load", *["at"] * bool(others), f"highest at {along}", "optimum", "interval"]
        header += ["output power", "efficiency (output + store)", "realizations", "note"]
        rows = []
        for other, words in self.others():
            for k, load in enumerate(self.grid.loads):
                rows.append([load, *[words] * bool(others), *self._row((k, *other), key)])
        return header, rows

    def _row(self, where, key):
        optimum, index = self.optima[where]
        if index is None:
            first = self.curves[where][0]
            return [
                *[NOT_KNOWN] * 5,
                written(first.realizations, "d"),
                "; ".join(self._unranked(where, key)) or first.outcome,
            ]
        best: Any = self.best(where)
        efficiency = next((best.estimates[n] for n in EFFICIENCIES if n in best.estimates), None)
        notes = [optimum.note, "" if best.outcome == COMPLETE else best.outcome]
        notes += self._unranked(where, key)
        if self.precision and best.realizations:
            reached, asked = best.relative_error, self.precision
            precision = (
                f"relative error of the power {reached:.1%}"
                if math.isfinite(reached)
                else "no error bar"
            )
            notes.append(precision + f", not the requested {asked:.1%}" * (not reached <= asked))
        unit = key_words(key, self.scene.units)[1] if key else ""
        return [
            quantity(self.grid.sweeps[key][index], unit) if key else "",
            quantity(optimum.place, unit) if math.isfinite(optimum.place) else NOT_KNOWN,
            span(optimum.low, optimum.high, unit),
            with_error(best.estimates["output_power"], self.unit),
            share_with_error(efficiency, sign=False) if efficiency else NOT_KNOWN,
            written(best.realizations, "d"),
            "; ".join(note for note in notes if note),
        ]

    def _unranked(self, where, key):
        """Text on points of a curve that are not ranked, and the reasons."""
        values_by_reason: dict[str, list[str]] = {}
        for k, evaluation in enumerate(self.curves[where]):
            if evaluation.unranked:
                unit = key_words(key, self.scene.units)[1] if key else ""
                value = quantity(self.grid.sweeps[key][k], unit) if key else ""
                values_by_reason.setdefault(evaluation.unranked, []).append(value)
        return [
            f"at {', '.join(values)} not ranked: {reason}" if key else f"not ranked: {reason}"
            for reason, values in values_by_reason.items()
        ]

    def _value(self, key, value):
        words = key_words(key, self.scene.units)[0]
        return f"{words} = {value_words(key, value, self.scene.units)}"

    def _findings(self) -> list[str]:
        """Sentences on the ranking, the precision, the outcome and the computing time."""
        lines = [line for other, words in self.others() for line in self._ranking(other, words)]
        lines += self._failures()
        names = {name for evaluation in self.evaluations for name in evaluation.estimates}
        lines += [COLUMNS] * any(self.best(where) for where in np.ndindex(self.optima.shape))
        lines += definitions(name for name in EFFICIENCIES if name in names)
        run, total = self.scene.run, len(self.evaluations)
        if self.precision:
            done = sum(e.relative_error <= self.precision for e in self.evaluations)
            lines.append(f"{done} of {total} points within {self.precision:.1%}")
        lines += notes_on_errors(self.methods)
        lines += self._proofs()
        lines += self.grid.notes
        if any(e.realizations for e in self.evaluations):
            lines.append(
                f"{' and '.join(dict.fromkeys(self.methods))}: realizations of {run.duration:g} s "
                f"after {run.settle:g} s, seed {run.seed}, the same noise for all points"
                + f"; to reach the precision, each realization measures at most "
                f"{DURATION_OVER_SETTLE:g} times run.settle, "
                "and their number is increased" * bool(self.precision)
            )
        lines.append(
            f"{self.computed} tasks computed, {self.reused} reused; {self.wall_seconds:.0f} s"
        )
        return lines

    def _alarms(self) -> list[str]:
        """One line for each point at which the circuit's power disagrees."""
        return [f"DISAGREE: {self._proof(proof)}" for proof in self.proofs if proof.disagrees]

    def _proofs(self):
        """Sentences on whether the study agrees with the circuit as reference."""
        proofs = self.proofs
        if not proofs:
            return []
        checked = sum(proof.checks or proof.disagrees for proof in proofs)
        apart = sum(proof.disagrees for proof in proofs)
        verdicts = [f"DISAGREES at {apart}"] * (apart > 0)
        verdicts += [f"agrees at {checked - apart}"] * (checked > apart)
        verdicts += [f"not checked at {len(proofs) - checked}"] * (len(proofs) > checked)
        head = (
            f"cross-check with the circuit on the same noise at {len(proofs)} points (the optima, "
            f"others at random): {', '.join(verdicts)}"
        )
        return [head, *(f"  {self._proof(proof)}" for proof in proofs)]

    def _proof(self, proof):
        point = self.grid.points[proof.place]
        values = self._swept_values(point)
        where = f"{point.load}{' at ' * bool(values)}{values}{' (optimum)' * proof.highest}"
        early = proof.early_difference, proof.early_standard_error
        parts = {f"in the first {PERIODS:g} periods": early}
        parts["settled"] = proof.difference, proof.standard_error
        apart = [
            f"{share_with_error(Estimate(difference, error, None, '1'))} "
            f"({abs(difference) / error if error else 0.0:.1f} σ) {part}"
            for part, (difference, error) in parts.items()
            if is_sharp(error) or differ(difference, error, negligible=NEGLIGIBLE_SHARE)
        ]
        words = [f"circuit over Monte Carlo, paired, {', '.join(apart)}"] if apart else []
        if not (proof.checks or proof.disagrees):
            part = "settled part " * is_sharp(proof.early_standard_error)
            words.append(f"{part}not checked ({proof.trouble or NOT_SHARP})")
        return f"{where}: {'; '.join(words)}"

    def _swept_values(self, point):
        """The swept values of a point with units, as text."""
        values = zip(self.grid.sweeps, point.place, strict=True)
        return ", ".join(value_words(key, value, self.scene.units) for key, value in values)

    def _headline(self) -> str:
        """The best load with its power and optimum, and loads of equal power."""
        order, differences = self.ranked_curves
        if not order:
            return "no load has an output power"
        where: Any = self._curve_names[order[0]]
        top: Any = self.best(where)
        key, index = self.curve_keys[0], self.optima[where][1]
        values = [self._value(key, self.grid.sweeps[key][index])] if key else []
        values += filter(None, [dict(self.others())[where[1:]]])
        at = f" at {', '.join(values)}" if values else ""
        power = with_error(top.estimates["output_power"], self.unit)
        text = f"largest power: {power} from {self.grid.loads[where[0]]}{at}"
        leads = [d for d in differences if d.better == order[0] and not d.differs]
        for unknown, words in enumerate((EQUAL, UNKNOWN)):
            names = [d.worse for d in leads if math.isnan(d.standard_error) == unknown]
            names[MOST_NAMED:] = [f"{len(names) - MOST_NAMED} more"] * (len(names) > MOST_NAMED)
            text += f", {words} {' and '.join(names)}" if names else ""
        return text

    def _records(self) -> tuple[list[str], list[list[Any]]]:
        """Header and one row per point: load, swept values, all quantities with their errors.

        `sweep.data()` has one row per quantity.
        """
        quantities = list(columns(self.scene, self.cells))
        header = ["load", *(key_column(key, self.scene.units) for key in self.grid.sweeps)]
        header += [f"{name} [{unit}]" for name, _, unit in quantities]
        rows = [
            [
                point.load,
                *point.place,
                *(values[where] for _, values, _ in quantities),
                evaluation.realizations,
                evaluation.outcome,
                "; ".join(evaluation.notes),
            ]
            for point, evaluation, where in zip(
                self.grid.points, self.evaluations, np.ndindex(self.cells.shape), strict=True
            )
        ]
        return [*header, "realizations", "outcome", "notes"], rows

    def _dataset(self) -> Dataset:
        """The study as an xarray Dataset in the scene's units.

        Dimensions are load and one per sweep by its dotted key; `better` and `worse` for paired
        differences at the optima; `sample` for waveforms. Every quantity has a variable
        `…_standard_error`. Times and durations are omitted, so that equal studies give equal files.
        """
        grid = self.grid
        dimensions = ("load", *grid.sweeps)
        coordinates = {"load": list(grid.loads), **{k: list(v) for k, v in grid.sweeps.items()}}
        variables = variables_of(self.scene, self.cells, dimensions)
        variables |= _proof_variables(self, dimensions)
        variables |= _optima(self) | _differences(self) | _waveforms(self)
        coordinates |= {"better": list(grid.loads), "worse": list(grid.loads)}
        attributes = {
            "scene": json_text(grid.scene.to_dict()),
            "method": self.method,
            "version": self.version,
            "precision": math.nan if self.precision is None else self.precision,
            "out_of_time": int(self.out_of_time),
            "notes": "\n".join(grid.notes) or "none",
        }
        return require_xarray().Dataset(variables, coordinates, attributes)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, powers in `unit`; missing errors become null."""
        grid = self.grid
        return plain(
            {
                "scene": self.scene,
                "method": self.method,
                "precision": self.precision,
                "unit_of_power": self.unit,
                "points": [
                    {
                        **self._where(k),
                        "outcome": evaluation.outcome,
                        "notes": evaluation.notes,
                        "realizations": evaluation.realizations,
                        "quantities": evaluation.estimates,
                        **orbits_of(self.scene, evaluation.orbits),
                    }
                    for k, evaluation in enumerate(self.evaluations)
                ],
                "optima": [
                    {"load": load, "at": words, **self._optimum_to_dict((k, *other))}
                    for other, words in self.others()
                    for k, load in enumerate(grid.loads)
                ],
                "proofs": [
                    {**fields_of(proof), **self._where(proof.place), "disagrees": proof.disagrees}
                    for proof in self.proofs
                ],
                "rankings": [
                    {"at": words, "best_first": self.rankings[other][0]}
                    for other, words in self.others()
                ],
                "seed": self.scene.run.seed,
                "notes": [*grid.notes, *self.warnings],
                "wall_seconds": self.wall_seconds,
            }
        )

    def _where(self, point):
        """Load and swept values of a point."""
        node = self.grid.points[point]
        return {"load": node.load, "place": dict(zip(self.grid.sweeps, node.place, strict=True))}

    def _optimum_to_dict(self, where):
        optimum, index = self.optima[where]
        key = self.curve_keys[0]
        highest = None if index is None or key is None else self.grid.sweeps[key][index]
        return {
            "over": key,
            "highest_at": highest,
            "place": optimum.place,
            "interval": [optimum.low, optimum.high],
            "note": "; ".join(filter(None, [optimum.note, *self._unranked(where, key)])),
        }

    def _ranking(self, other, words):
        order, differences = self.rankings[other]
        if len(order) < 2:
            return
        pairs = {(lead.better, lead.worse): lead for lead in differences}
        leads = [pairs[pair] for pair in itertools.pairwise(order)]
        ranking = "".join(f" {_sign(lead)} {lead.worse}" for lead in leads)
        yield f"ranking at the optima{f', {words}' if words else ''}: {order[0]}{ranking}"
        for lead in leads:
            distance = lead.estimate / lead.standard_error if lead.standard_error else math.nan
            has_error = not self._periodic and math.isfinite(distance)
            sure = f", {distance:.1f} standard errors" if has_error else ""
            known = not math.isnan(lead.standard_error)
            sure += ", no significant difference" * (known and not lead.differs)
            share = f"{share_with_error(lead)}{' (paired)' * known}"
            yield f"  {lead.better} over {lead.worse}: {share}{sure}"

    def _failures(self):
        """Failures of points and notes on other points, without duplicates."""
        points: dict[str, list[tuple[str, Sequence[str]]]] = {}
        for point, evaluation in zip(self.grid.points, self.evaluations, strict=True):
            values = self._swept_values(point)
            complete = evaluation.outcome == COMPLETE
            lines = evaluation.notes if complete else [evaluation.outcome]
            points.setdefault(point.load, []).append((values, lines))
        for load, noted in points.items():
            for note, where in placed_notes(noted):
                yield f"{load}{' at ' * bool(where)}{where}: {note}"


def _sign(lead):
    """The sign between two loads in a ranking; "?" if their difference has no error bar."""
    return "?" if math.isnan(lead.standard_error) else ">" if lead.differs else "="


def chosen(method: str | Method, step: str | float) -> tuple[Method, Engine | None]:
    """The method that simulates the points, and the circuit that checks it or None."""
    if method == JUDGED:
        return engine_of("monte-carlo", step=step), engine_of("circuit", step=step)
    if isinstance(method, str) and method not in ENGINES:
        from harvester.averaging.closures import CLOSURES

        check_name("method", method, {JUDGED: None, **ENGINES, **CLOSURES})
    return method_of(method, step=step), None


def method_at(scene: Scene, method: Method, judge: Engine | None) -> Method:
    """The method of a point; the circuit if Monte Carlo cannot simulate its load."""
    if not isinstance(method, Engine):
        require_resistor(scene, method.name)
    elif not isinstance(method, Circuit):
        try:
            method.check(scene)
        except LoadError:
            if judge is None:
                raise
            return judge
    return method


def proofs(
    runner: Runner, grid: Grid, engines: tuple[Engine, Engine], evaluations: list[Evaluation]
) -> list[Proof]:
    """Compare the circuit with Monte Carlo on the same noise at selected points."""
    first, judge = ((engine, runner.version(engine.name)) for engine in engines)
    return runner.follow(
        [
            proving(index, highest, grid.points[index].scene, first, judge)
            for index, highest in points_to_check(grid, evaluations, grid.scene.run.seed)
            if evaluations[index].method == engines[0].name
        ]
    )


def _proof_variables(study, dimensions):
    """(circuit − Monte Carlo)/Monte Carlo of the output power; NaN at unchecked points."""
    attributes = {
        "difference": "difference",
        "difference_standard_error": "standard_error",
        "early_difference": "early_difference",
        "early_difference_standard_error": "early_standard_error",
    }
    values = np.full((len(attributes), len(study.evaluations)), math.nan)
    for proof in study.proofs:
        values[:, proof.place] = [getattr(proof, name) for name in attributes.values()]
    shape = study.cells.shape
    return {
        f"circuit_{name}": (dimensions, row.reshape(shape), {"unit": "1"})
        for name, row in zip(attributes, values, strict=True)
    }


def _optima(study):
    key, others = study.curve_keys
    if key is None:
        return {}
    positions = np.array(study.grid.sweeps[key])
    dimensions = ("load", *others)
    shape = study.optima.shape

    def array(value, kind=float):
        return np.array([value(optimum) for optimum in study.optima.ravel()], kind).reshape(shape)

    attributes = {"along": key}
    return {
        "highest_at": (dimensions, array(lambda o: math.nan if o[1] is None else positions[o[1]])),
        "optimum": (dimensions, array(lambda o: o[0].place), attributes),
        "optimum_low": (dimensions, array(lambda o: o[0].low), attributes),
        "optimum_high": (dimensions, array(lambda o: o[0].high), attributes),
        "optimum_note": (dimensions, array(lambda o: o[0].note or "inside", str)),
    }


def _differences(study):
    """P(better)/P(worse) − 1 of the loads at their optima; NaN for the reverse order."""
    _, others = study.curve_keys
    loads = study.grid.loads
    shape = (len(loads), len(loads), *study.optima.shape[1:])
    values, errors = np.full(shape, math.nan), np.full(shape, math.nan)
    for other, (_, differences) in study.rankings.items():
        for difference in differences:
            where = (loads.index(difference.better), loads.index(difference.worse), *other)
            values[where], errors[where] = difference.estimate, difference.standard_error
    dimensions = ("better", "worse", *others)
    return {
        "relative_difference": (dimensions, values, {"unit": "1"}),
        "relative_difference_standard_error": (dimensions, errors, {"unit": "1"}),
    }


def _waveforms(study):
    """A few periods at each load's highest point, if there are any."""
    _, others = study.curve_keys
    best = {where: study.best(where) for where in np.ndindex(study.optima.shape)}
    drawn = {where: e.waveform for where, e in best.items() if e and e.waveform is not None}
    if not drawn:
        return {}
    count = next(iter(drawn.values())).shape[1]
    variables = {}
    for name, dimension in WAVEFORM.items():
        values = np.full((*study.optima.shape, count), math.nan)
        row = Record._fields.index(name)
        for where, waveform in drawn.items():
            values[where] = waveform[row]
        unit = {"unit": unit_of(study.scene, dimension)}
        variables[f"waveform_{name}"] = (("load", *others, "sample"), values, unit)
    return variables

"""The result of a load study with its sentences, and the steps of `load_study`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.arguments import check_name
from harvester.errors import LoadError
from harvester.estimates.estimate import NOT_SHARP, Estimate
from harvester.files.serialising import fields_of, plain
from harvester.files.tables import Tabular, write_netcdf
from harvester.files.writing import in_folder
from harvester.method import Method
from harvester.running import Runner
from harvester.running.folder import held
from harvester.running.realizations import PERIODS
from harvester.running.request import COMPLETE
from harvester.scene.model import Scene
from harvester.scene.units import require_resistor
from harvester.show.numbers import NOT_KNOWN, number, quantity, share_with_error, with_error
from harvester.show.symbols import EFFICIENCIES, definitions, key_words
from harvester.simulation.methods import ENGINES, Circuit, Engine, engine_of, method_of
from harvester.studies.grid import Grid
from harvester.studies.loads.curves import Difference, optimum_of, rank
from harvester.studies.loads.evaluation import MOST_REALIZATIONS, Evaluation
from harvester.studies.loads.proof import Proof, places_to_prove, proving
from harvester.studies.public import JUDGED, LOAD_STUDY_FILES
from harvester.studies.sweep import (
    Sweep,
    columns,
    orbits_of,
    outcome_and_notes,
    placed_notes,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

    from harvester.running.folder import StudyFolder

# Measured time of a realization over its settling time. A fifth of the run is then spent on
# settling.
DURATION_OVER_SETTLE = 4.0
# Share of the time budget that is kept for the circuit as judge.
PROOF_SHARE = 0.2


@dataclass(frozen=True)
class Study(Tabular):
    """A load study's points, how it ended, and what follows: optima, ranking, verdict.

    Attributes
    ----------
    grid : Grid
    method : str
        "judged", an engine or a closure.
    version : str
        Version of the program that computed.
    precision : float or None
    evaluations : list of Evaluation
        Evaluations of the points, in the order of `grid.points`.
    proofs : list of Proof
        Comparisons with the circuit, at the points that were chosen for it.
    out_of_time : bool
        The time budget ended it: the same call again goes on.
    computed, reused : int
        Tasks.
    wall_seconds : float
    warnings : tuple of str
        Warnings: stored answers that are not valid, outcomes not kept, a folder that cannot be
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
        """The scene, with one spacing of knots for all points."""
        return self.grid.scene

    @property
    def methods(self) -> tuple[str, ...]:
        """Name of the method that ran each point."""
        return tuple(each.method for each in self.evaluations)

    @property
    def sweep(self) -> Sweep:
        """The points as a tidy table of their output power."""
        return Sweep(
            scene=self.scene,
            values={"load": self.grid.loads, **self.grid.sweeps},
            methods=(self.method,),
            quantities=("output_power",),
            cells=self.cells[..., None],
            notes=self.grid.notes,
            out_of_time=self.out_of_time,
            seconds=self.wall_seconds,
        )

    @property
    def unit(self) -> str:
        """The unit of power."""
        return "W" if self.scene.units == "SI" else "scaled power"

    @cached_property
    def cells(self) -> np.ndarray:
        """The evaluations in the grid's shape: loads, then the sweeps."""
        array = np.empty(len(self.evaluations), dtype=object)
        array[:] = self.evaluations
        return array.reshape(self.grid.shape)

    @cached_property
    def curve_keys(self) -> tuple[str | None, list[str]]:
        """Keys of the sweep that optima are sought along, and of the others."""
        keys, curve = list(self.grid.sweeps), self.grid.curve
        if curve is None:
            return None, []
        return keys[curve], keys[:curve] + keys[curve + 1 :]

    @cached_property
    def curves(self) -> np.ndarray:
        """Evaluations with the optimum's sweep last: loads, other sweeps, places."""
        if self.grid.curve is None:
            return self.cells[..., None]
        return np.moveaxis(self.cells, self.grid.curve + 1, -1)

    @cached_property
    def optima(self) -> np.ndarray:
        """(CurveOptimum, its place or None) of each curve: loads, other sweeps."""
        key, _ = self.curve_keys
        places = self.grid.sweeps[key] if key else (0.0,)
        order = np.argsort(places)
        found = np.empty(self.curves.shape[:-1], dtype=object)
        for where in np.ndindex(found.shape):
            row = [self.curves[where][k] for k in order]
            powers, series = [e.ranked_power for e in row], [e.series for e in row]
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
        loads = self.grid.loads
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
        values = [self.grid.sweeps[key] for key in keys]
        for other in itertools.product(*(range(len(each)) for each in values)):
            words = [
                self._value(key, each[k]) for key, each, k in zip(keys, values, other, strict=True)
            ]
            yield other, ", ".join(words)

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows: each load's optimum."""
        key, others = self.curve_keys
        along = key_words(key, self.scene.units)[0] if key else "the scene"
        header = ["load", *["at"] * bool(others), f"highest at {along}", "optimum", "interval"]
        header += ["output power", "efficiency", "realizations", "note"]
        rows = []
        for other, words in self.others():
            for k, load in enumerate(self.grid.loads):
                rows.append([load, *[words] * bool(others), *self._row((k, *other), key)])
        return header, rows

    def _row(self, where, key):
        optimum, place = self.optima[where]
        if place is None:
            first = self.curves[where][0]
            return [*["—"] * 5, str(first.realizations), first.fed_by_store or first.outcome]
        best: Any = self.best(where)
        efficiency = best.estimates.get("end_to_end_efficiency") or best.estimates.get(
            "power_conversion_efficiency_of_input"
        )
        outcome = outcome_and_notes(best)[0]
        notes = [optimum.note, "" if outcome == COMPLETE else outcome]
        fed = [
            quantity(self.grid.sweeps[key][k], key_words(key, self.scene.units)[1])
            for k, each in enumerate(self.curves[where])
            if key and each.fed_by_store
        ]
        notes += [f"at {', '.join(fed)} not ranked: stores discharge into the output"] * bool(fed)
        if self.precision and best.realizations:
            notes.append(self._precision(best))
        inside = math.isfinite(optimum.low)
        unit = key_words(key, self.scene.units)[1] if key else ""
        return [
            quantity(self.grid.sweeps[key][place], unit) if key else "",
            quantity(optimum.place, unit) if inside else NOT_KNOWN,
            f"{quantity(optimum.low, unit)} … {quantity(optimum.high, unit)}"
            if inside
            else NOT_KNOWN,
            with_error(best.estimates["output_power"], self.unit),
            share_with_error(efficiency, sign=False) if efficiency else NOT_KNOWN,
            str(best.realizations),
            "; ".join(note for note in notes if note),
        ]

    def _value(self, key, value):
        words, unit = key_words(key, self.scene.units)
        return f"{words} = {quantity(value, unit)}"

    def _has(self, name):
        return any(name in each.estimates for each in self.evaluations)

    def _precision(self, evaluation):
        reached, asked = evaluation.relative_error, self.precision
        said = f"power known to {reached:.1%}" if math.isfinite(reached) else "no error bar"
        return said if reached <= asked else f"{said}, not the {asked:.1%} asked for"

    def sentences(self) -> list[str]:
        """The ranking, what precision was reached, how it ended, what was run."""
        lines = [line for other, words in self.others() for line in self._ranking(other, words)]
        lines += self._failures()
        lines += definitions(name for name in EFFICIENCIES if self._has(name))
        run, total = self.scene.run, len(self.evaluations)
        if self.precision:
            done = sum(e.relative_error <= self.precision for e in self.evaluations)
            lines.append(f"{done} of {total} points within {self.precision:.1%}")
        lines += self._proofs()
        lines += self.grid.notes
        if any(e.realizations for e in self.evaluations):
            lines.append(
                f"{' and '.join(dict.fromkeys(self.methods))}: realizations of {run.duration:g} s "
                f"after {run.settle:g} s, seed {run.seed}, the same noise for all points"
                + f"; --precision takes at most {DURATION_OVER_SETTLE:g} times run.settle of each, "
                "and more of them" * bool(self.precision)
            )
        lines.append(
            f"{self.computed} tasks computed, {self.reused} taken from before; "
            f"{self.wall_seconds:.0f} s"
        )
        return lines

    def alarms(self) -> list[str]:
        """One line for each point at which the circuit's power disagrees."""
        return [f"DISAGREE: {self._proof(each)}" for each in self.proofs if each.disagrees]

    def _proofs(self):
        """Sentences on whether the circuit, as reference, agrees with the study."""
        proofs = self.proofs
        if not proofs:
            return []
        checked = sum(proof.checks or proof.disagrees for proof in proofs)
        apart = sum(proof.disagrees for proof in proofs)
        verdicts = [f"DISAGREES at {apart}"] * (apart > 0)
        verdicts += [f"agrees at {checked - apart}"] * (checked > apart)
        verdicts += [f"not checked at {len(proofs) - checked}"] * (len(proofs) > checked)
        head = (
            f"cross-check with the circuit on the same noise at {len(proofs)} places (the optima, "
            f"others at random): {', '.join(verdicts)}"
        )
        return [head, *(f"  {self._proof(each)}" for each in proofs)]

    def _proof(self, proof):
        point = self.grid.points[proof.place]
        place = ", ".join(number(value) for value in point.place)
        where = f"{point.load}{' at ' * bool(place)}{place}{' (optimum)' * proof.highest}"
        parts = {
            f"in the first {PERIODS:g} periods": (
                proof.early_difference,
                proof.early_standard_error,
            ),
            "settled": (proof.difference, proof.standard_error),
        }
        told = [f"{_apart(*of)} {part}" for part, of in parts.items() if not math.isnan(of[1])]
        words = [f"circuit over Monte Carlo, paired, {', '.join(told)}"] if told else []
        if not (proof.checks or proof.disagrees):
            words.append(f"not checked ({proof.trouble or NOT_SHARP})")
        return f"{where}: {'; '.join(words)}"

    def headline(self) -> str:
        """The best load with its power, and where its optimum is."""
        best = [
            (where, each) for where in np.ndindex(self.optima.shape) if (each := self.best(where))
        ]
        best = [pair for pair in best if "output_power" in pair[1].estimates]
        if not best:
            return "no load has a power"
        where, top = max(best, key=lambda pair: pair[1].power)
        key, place = self.curve_keys[0], self.optima[where][1]
        at = f" at {self._value(key, self.grid.sweeps[key][place])}" if key else ""
        power = with_error(top.estimates["output_power"], self.unit)
        return f"most power: {power} from {self.grid.loads[where[0]]}{at}"

    def figures(self) -> list[Figure]:
        """Power, efficiency and waveforms, as `save` draws them."""
        from harvester.show import figures
        from harvester.studies.loads import drawing

        return [figures.drawn(draw, self) for draw in drawing.FIGURES]

    def figure(self) -> Figure:
        """Output power over the swept value."""
        from harvester.show import figures
        from harvester.studies.loads.drawing import draw_power

        return figures.drawn(draw_power, self)

    def save(self, folder: str | Path | StudyFolder) -> None:
        """Write NetCDF, CSV and figures: see `harvester.save`."""
        save(self, folder)

    def data(self) -> tuple[list[str], list[list[Any]]]:
        """Header and a row for each point: load, swept values, all quantities with their errors.

        `sweep.data()` has a row for each quantity.
        """
        quantities = list(columns(self.scene, self.cells))
        header = ["load", *self.grid.sweeps, *(f"{name} [{unit}]" for name, _, unit in quantities)]
        rows = [
            [
                point.load,
                *point.place,
                *(values[where] for _, values, _ in quantities),
                each.realizations,
                outcome_and_notes(each)[0],
                "; ".join(outcome_and_notes(each)[1]),
            ]
            for point, each, where in zip(
                self.grid.points, self.evaluations, np.ndindex(self.cells.shape), strict=True
            )
        ]
        return [*header, "realizations", "outcome", "notes"], rows

    def to_xarray(self) -> Dataset:
        """The study as an xarray Dataset; see `harvester.studies.loads.dataset`."""
        from harvester.studies.loads.dataset import dataset_of

        return dataset_of(self)

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
                        "outcome": each.outcome,
                        "realizations": each.realizations,
                        "quantities": each.estimates,
                        **orbits_of(self.scene, each.orbits),
                    }
                    for k, each in enumerate(self.evaluations)
                ],
                "optima": [
                    {"load": load, "at": words, **self._optimum_to_dict((k, *other))}
                    for other, words in self.others()
                    for k, load in enumerate(grid.loads)
                ],
                "proofs": [
                    {**fields_of(each), **self._where(each.place), "disagrees": each.disagrees}
                    for each in self.proofs
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
        own = self.grid.points[point]
        return {"load": own.load, "place": dict(zip(self.grid.sweeps, own.place, strict=True))}

    def _optimum_to_dict(self, where):
        optimum, place = self.optima[where]
        key = self.curve_keys[0]
        highest = None if place is None or key is None else self.grid.sweeps[key][place]
        return {
            "over": key,
            "highest_at": highest,
            "place": optimum.place,
            "interval": [optimum.low, optimum.high],
            "note": optimum.note,
        }

    def _ranking(self, other, words):
        order, differences = self.rankings[other]
        if len(order) < 2:
            return
        yield f"ranking at the optima{f', {words}' if words else ''}: {' > '.join(order)}"
        for each in differences:
            if order.index(each.worse) == order.index(each.better) + 1:
                distance = each.estimate / each.standard_error if each.standard_error else math.nan
                told = self.scene.excitation.random and math.isfinite(distance)
                sure = f", {distance:.1f} standard errors" if told else ""
                apart = share_with_error(each)
                yield f"  {each.better} over {each.worse}: {apart} (paired){sure}"

    def _failures(self):
        """Failures of points, and notes on the others, each printed once."""
        points: dict[str, list[tuple[str, Sequence[str]]]] = {}
        for point, evaluation in zip(self.grid.points, self.evaluations, strict=True):
            outcome, notes = outcome_and_notes(evaluation)
            place = ", ".join(number(value) for value in point.place)
            lines = notes if outcome == COMPLETE else [outcome]
            points.setdefault(point.load, []).append((place, lines))
        for load, noted in points.items():
            for each, where in placed_notes(noted):
                yield f"{load}{' at ' * bool(where)}{where}: {each}"


def chosen(method: str | Method, step: str | float) -> tuple[Method, Engine | None]:
    """The method that runs the points, and the circuit that checks it, or None.

    Raises
    ------
    HarvesterError
    """
    if method == JUDGED:
        return engine_of("monte-carlo", step=step), engine_of("circuit", step=step)
    if isinstance(method, str) and method not in ENGINES:
        from harvester.averaging import CLOSURES

        check_name("method", method, {JUDGED: None, **ENGINES, **CLOSURES})
    return method_of(method, step=step), None


def method_at(scene: Scene, method: Method, judge: Engine | None) -> Method:
    """The method of a point; a load that Monte Carlo cannot simulate is run by the circuit."""
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
    runner: Runner,
    grid: Grid,
    engines: tuple[Engine, Engine],
    evaluations: list[Evaluation],
) -> list[Proof]:
    """The circuit beside Monte Carlo, on the same noise, at chosen points that Monte Carlo ran."""
    first, judge = ((each, runner.version(each.name)) for each in engines)
    return runner.follow(
        [
            proving(place, highest, grid.points[place].scene, first, judge)
            for place, highest in places_to_prove(grid, evaluations, grid.scene.run.seed)
            if evaluations[place].method == engines[0].name
        ]
    )


def cut(scene: Scene) -> Scene:
    """The scene with shorter realizations, at most `DURATION_OVER_SETTLE` settling times,
    for rounds."""
    run = scene.run
    duration = min(run.duration, DURATION_OVER_SETTLE * run.settle) or run.duration
    return scene.replace({"run.duration": duration, "run.realizations": MOST_REALIZATIONS})


def _apart(difference, standard_error):
    """Text: the relative difference of two loads' powers, paired on common noise."""
    share = Estimate(difference, standard_error, None, "1")
    distance = abs(difference) / standard_error if standard_error else 0.0
    return f"{share_with_error(share)} ({distance:.1f} σ)"


def save(study: Study, folder: str | Path | StudyFolder) -> list[str]:
    """Write a study's files, each whole or not at all; returns their names.

    Raises
    ------
    HarvesterError
        xarray is missing.
    OutputError
        `FolderInUse` where another run is at work there.
    """
    from harvester.show import figures
    from harvester.studies.loads import drawing

    with held(folder) as own:
        place = Path(own)
        grid, table, *pictures = (in_folder(place, name) for name in LOAD_STUDY_FILES)
        write_netcdf(grid, study.to_xarray())
        study.to_csv(table)
        for draw, picture in zip(drawing.FIGURES, pictures, strict=True):
            figures.save(draw, study, picture)
    return list(LOAD_STUDY_FILES)

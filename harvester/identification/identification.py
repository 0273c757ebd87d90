"""Result of an identification: values, intervals, verdict, tables and files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.formatting import Printed, span, value_and_error
from harvester.base.serialising import plain
from harvester.device import timescales
from harvester.identification.drawing import draw, draw_posterior
from harvester.identification.intervals import interval
from harvester.identification.response import experiment
from harvester.identification.rivals import Rival
from harvester.identification.unknowns import BASE_FACTOR, factor_of
from harvester.identification.validation_record import HALF_INTERVAL, ResponseRecord
from harvester.identification.verdict import FitEvidence
from harvester.results.report import page_of
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.numbers import numbers
from harvester.scene.text import scene_text

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.identification.impedance_fit import FromImpedance
    from harvester.identification.intervals import Undetermined
    from harvester.identification.measurement import Measurement
    from harvester.identification.posterior import Posterior
    from harvester.scene.model import Scene


# Verdicts of models whose values are claimed to be valid.
CLAIMING = ("predicts", "fits")
# Units of sensor parameters.
SENSOR_UNITS = {"delay": "s", "filter": "s", "highpass": "Hz", "highpass2": "Hz", "resistance": "Ω"}


@dataclass(frozen=True, repr=False, kw_only=True)
class Identification(FitEvidence, ResultBase):
    """A scene identified from records, with the evidence for its verdict (`FitEvidence`).

    Attributes
    ----------
    scene : Scene
        The scene with the fitted values.
    start : Scene
        The scene from which the fit started.
    fitted : Fitted
        Values, covariance, and predictions of the validation data.
    kept : list of (str, Undetermined)
        Keys that keep the scene's values, with the undetermined combinations.
    seconds : float
        Wall-clock time (s).
    posterior : Posterior, optional
        Posterior of the values, if requested.
    impedance : FromImpedance, optional
        Results from the impedance, if one was given.
    """

    scene: Scene
    start: Scene
    measurements: list[Measurement]
    fitted: Fitted
    kept: list[tuple[str, Undetermined]]
    seconds: float
    posterior: Posterior | None = None
    impedance: FromImpedance | None = None

    @property
    def keys(self) -> list[str]:
        """Keys of the identified values."""
        return self.fitted.keys

    @property
    def values(self) -> dict[str, float]:
        """Identified values by key, in the scene's units."""
        return self.fitted.shooting.known(self.fitted.values)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors by key."""
        return self.fitted.shooting.known(self.fitted.standard_errors)

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals by key."""
        errors = self.standard_errors
        return {key: interval(value, errors[key]) for key, value in self.values.items()}

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the values, in the order of `keys`: shape (keys, keys)."""
        return self.fitted.covariance

    @property
    def undetermined(self) -> set[str]:
        """Keys whose values the records do not determine."""
        return self.fitted.undetermined_keys

    def simulated(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """Simulate sensor signals under another record's acceleration, with the device initially at
        rest.

        Parameters
        ----------
        measurement : Measurement
            A record; only the names of its outputs are used.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            Signals by the output's name.
        """
        problem = replace(self.fitted.shooting, experiments=[experiment(self.scene, measurement)])
        trial = problem.at(0, self.fitted.values)
        system, _ = trial.known_device
        start = np.array([[timescales.rest(system), 0.0, 0.0]])
        edges = np.array([0, measurement.acceleration.size])
        _, _, outputs = trial.states(edges, start)
        return dict(zip(measurement.outputs, outputs.T, strict=True))

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            headline=self.verdict.sentence,
            pictures=[
                Picture(draw, self),
                *[Picture(draw_posterior, self, "posterior")] * (self.posterior is not None),
            ],
            records=self._records,
            texts=self.texts,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text: each value with its interval and unit."""
        rows = self._rows(self.fitted)
        header = ["parameter", "value ± 95 % interval", "unit", "state"]
        if self.posterior:
            header.append("posterior's 95 %")
            for row, (low, high) in zip(rows, self.posterior.intervals.values(), strict=True):
                row.append(span(low, high, "", 6))
        return header, rows

    def _rows(self, model):
        """Name, value with half its interval, unit and state of each value of a model."""
        rows = []
        for key, value, error in zip(model.keys, model.values, model.standard_errors, strict=True):
            if factor_of(key):
                continue
            printed = value_and_error(value, HALF_INTERVAL * error)
            state = self._state(key) if model is self.fitted else "identified"
            if key in model.undetermined_keys:
                printed, state = Printed("undetermined", value), "undetermined"
            rows.append([key, printed, self._unit(key), state])
        return rows

    def _unit(self, key):
        """Unit of a value; empty if it has none."""
        spec = numbers(self.scene).get(key, (0.0, None))[1]
        unit = spec.unit_in(self.scene.units) if spec else SENSOR_UNITS.get(key.rpartition("_")[2])
        return "" if unit in (None, "1") else unit

    def _records(self):
        """Header and one row per value."""
        header = ["parameter", "state", "value", "standard_error", "low", "high"]
        return header, [
            [key, self._state(key), value, self.standard_errors[key], *self.intervals[key]]
            for key, value in self.values.items()
        ]

    def _state(self, key):
        """Text on how well the records determine a value."""
        if key in self.undetermined:
            return "undetermined"
        if self.verdict.word not in CLAIMING:
            return "not claimed"
        # These are coefficients about x = 0, where no record has motion.
        if self.visited and key in self.visited.values:
            return "extrapolated"
        return "conditional" if key in self.dependent else "identified"

    def _findings(self) -> list[str]:
        """Remedies, undetermined values, and the evidence for the verdict."""
        lines = [f"to do: {self.verdict.advice}"]
        if self.impedance:
            lines += self.impedance.findings(self.fitted)
        lines += [
            f"{record.name}: {remark}" for record in self.measurements for remark in record.remarks
        ]
        lines += [str(direction) for direction in self.fitted.undetermined]
        lines += [f"{unclear}; {key} keeps the scene's value" for key, unclear in self.kept]
        lines += self.evidence()
        if self.proposed is not self.rivals[0]:
            lines += [
                f"proposed: free {' = '.join(row[:2])} (--free {row[0]})"
                for row in self._rows(self.proposed.fitted)
                if row[0].startswith("sensor.") and row[0] not in self.keys
            ]
        if self.posterior:
            lines.append(
                f"posterior: {self.posterior.independent:.0f} independent draws, "
                f"{self.posterior.accepted:.0%} of the moves accepted; residuals are assumed "
                "independent"
            )
        lines.append(
            f"fitted to {self._fitted_part()}; intervals allow for correlated residuals; "
            f"{self.seconds:.1f} s"
        )
        return lines

    def _fitted_part(self):
        """Text on the fitted part of the records."""
        steady = sum(isinstance(record, ResponseRecord) for record in self.records)
        lines = f"two of every three frequencies of {_counted(steady, 'record')}"
        count = len(self.records) - steady
        if not count:
            return lines
        windows = sum(edges.size - 1 for edges in self.fitted.fit.edges[:count])
        return (
            f"the first two thirds of {_counted(count, 'record')} in "
            f"{_counted(windows, 'window')}, acceleration {self.fitted.interpolation} between "
            f"samples{f', and {lines}' if steady else ''}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        names = ("scene", "start", "verdict", "keys", "covariance", "visited", "assumptions",
                 "posterior", "seconds")  # fmt: skip
        white = self.records[0].whiteness()
        more = {"impedance": self.impedance.parameters(self.fitted)} if self.impedance else {}
        return plain(
            {
                **{name: getattr(self, name) for name in names},
                "parameters": {
                    key: {
                        "value": value,
                        "standard_error": error,
                        "interval": interval,
                        "determined": state in ("identified", "extrapolated"),
                        "state": state,
                    }
                    for key, state, value, error, *interval in self._records()[1]
                },
                "undetermined": [str(direction) for direction in self.fitted.undetermined],
                "kept": {key: str(unclear) for key, unclear in self.kept},
                "kept_aside": [record.to_dict() for record in self.kept_aside],
                "records": [record.to_dict() for record in self.records],
                "misfits": [
                    {"record": record.name, **part._asdict()}
                    for record in self.records
                    for part in record.unexplained
                ],
                "spring_shape": self.spring and self.spring._asdict(),
                "residuals_white": white.white,
                "whiteness_probability": white.probability,
                "candidates": [rival.to_dict() for rival in self.rivals],
                "proposed": self.proposed.name,
                "interpolation": self.fitted.interpolation,
                **more,
            }
        )

    def scene_text(self, rival: Rival | None = None) -> str:
        """A model's scene as a TOML file with intervals in comments.

        The head contains the verdict, the table and the findings. `rival`: another model than the
        fitted one.
        """
        model = rival.fitted if rival else self.fitted
        errors = dict(zip(model.keys, HALF_INTERVAL * model.standard_errors, strict=True))
        comments = {key: f"identified, ± {error:.2g} (95 %)" for key, error in errors.items()}
        for key, assumed in self.dependent.items():
            if key in comments:
                comments[key] += f", if {_condition(assumed)}"
        if BASE_FACTOR in comments:
            comments[BASE_FACTOR] += "; only as accurate as the accelerometer's scale"
        comments |= dict.fromkeys(model.undetermined_keys, "not determined by the records")
        names = ", ".join(record.name for record in self.measurements)
        path = f'Between samples of a record: interpolation = "{model.interpolation}".'
        rows = ["; ".join(filter(None, row)) for row in self._rows(model)]
        heading = [self.verdict.sentence, f"Identified from {names}.", *rows, *self._findings()]
        return scene_text(model.scene, comments, [*heading, path])

    def texts(self) -> dict[str, str]:
        """Further files of the result: the scenes, including a proposed one, and the HTML page."""
        names = ", ".join(record.name for record in self.measurements)
        page = page_of(self, f"identified from {names}")
        files = {".toml": self.scene_text(), ".html": page}
        if self.proposed is not self.rivals[0]:
            files["-proposed.toml"] = self.scene_text(self.proposed)
        return files


def _condition(assumed):
    """Text on the assumed value that limits the accuracy of a value."""
    names = [key.removeprefix("sensor.").replace("_scale", "'s gain") for key in assumed]
    return f"{' and '.join(names)} {'are' if names[1:] else 'is'} exact"


def _counted(count, noun):
    return f"{count} {noun}{'' if count == 1 else 's'}"

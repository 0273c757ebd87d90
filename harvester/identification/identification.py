"""Result of an identification: values, intervals, proof, tables and files."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.formatting import NOT_KNOWN, share_with_error, span, with_error, written
from harvester.base.serialising import plain
from harvester.device import timescales
from harvester.identification.candidates import Candidate, proposed
from harvester.identification.drawing import draw, draw_posterior
from harvester.identification.fitting import responses_of
from harvester.identification.intervals import HALF_INTERVAL, interval
from harvester.identification.proof import ResponseStretch, sensor_noise
from harvester.identification.response import FINE_STEPS
from harvester.identification.unknowns import BASE_FACTOR
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.text import scene_text

if TYPE_CHECKING:
    from harvester.identification.consistency import Misfit
    from harvester.identification.fitted_model import Fitted
    from harvester.identification.impedance_fit import FromImpedance
    from harvester.identification.intervals import Undetermined
    from harvester.identification.kept_aside import Kept
    from harvester.identification.measurement import Measurement
    from harvester.identification.posterior import Posterior
    from harvester.identification.proof import Whiteness
    from harvester.identification.spring_shape import SpringShape
    from harvester.identification.verdict import FitVerdict
    from harvester.identification.visited import Visited
    from harvester.scene.model import Scene


LEGEND = (
    "95 % intervals, which allow for residuals that are correlated. The last third of each record "
    "was kept aside: nothing was fitted to it but the states at the beginnings of windows."
)
CAPTION = (
    "The part kept aside. Grey: measured; blue: predicted (waveforms in windows, spectra and "
    "densities from one start alone); orange: the difference in windows."
)
POSTERIOR_CAPTION = "Draws of each value and of each pair; grey: the 95 % intervals of the table."


@dataclass(frozen=True, repr=False)
class Identification(ResultBase):
    """A scene identified from records.

    Attributes
    ----------
    scene : Scene
        The scene with the fitted values.
    start : Scene
        The scene that the fit began with.
    fitted : Fitted
        Values, covariance, and what the model predicts of the data kept aside.
    kept : list of (str, Undetermined)
        Keys that stay as in the scene, and what the records leave open.
    candidates : list of Candidate
        The scene's own model first.
    whiteness : Whiteness
        Whiteness of the residuals of the first record's part that was kept aside.
    seconds : float
        Wall-clock.
    posterior : Posterior, optional
        Posterior of the values, where it was asked for.
    impedance : FromImpedance, optional
        Results from the impedance, if one was given.
    misfits : list of Misfit
        Residuals of each output of each record, compared with the sensors' noise.
    spring_shape : SpringShape or None
        The spring beside one with the next power, of a model that explains its records in time.
    kept_aside : list of Kept
        Whole records that were not fitted to.
    visited : Visited or None
        Ranges that the records visited; None if there are only frequency responses.
    """

    scene: Scene
    start: Scene
    measurements: list[Measurement]
    fitted: Fitted
    kept: list[tuple[str, Undetermined]]
    candidates: Sequence[Candidate]
    whiteness: Whiteness
    verdict: FitVerdict
    seconds: float
    posterior: Posterior | None = None
    impedance: FromImpedance | None = None
    misfits: Sequence[Misfit] = ()
    spring_shape: SpringShape | None = None
    kept_aside: Sequence[Kept] = ()
    visited: Visited | None = None

    @property
    def keys(self) -> list[str]:
        """Keys of the identified values."""
        return self.fitted.keys

    @property
    def values(self) -> dict[str, float]:
        """Identified values by key, in the scene's units."""
        return dict(zip(self.keys, map(float, self.fitted.values), strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors by key."""
        return dict(zip(self.keys, map(float, self.fitted.standard_errors), strict=True))

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
        return {key for direction in self.fitted.undetermined for key in direction.keys}

    @property
    def proposed(self) -> Candidate:
        """The simplest model that predicts as well as the best."""
        return proposed(self.candidates)

    def simulated(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """Simulated sensor signals under another record's acceleration, the device starting at
        rest.

        Parameters
        ----------
        measurement : Measurement
            A record; of its outputs only the names are used.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By the output's name.
        """
        reference = self.fitted.shooting.responses
        responses = responses_of(self.scene, [measurement], self.keys, reference.length, FINE_STEPS)
        responses.interpolation = self.fitted.interpolation
        system, _ = responses.known_device(0, self.fitted.values)
        start = np.array([[timescales.rest(system), 0.0, 0.0]])
        edges = np.array([0, measurement.acceleration.size])
        _, _, outputs = responses.states(0, self.fitted.values, edges, start)
        return dict(zip(measurement.outputs, outputs.T, strict=True))

    def view(self) -> View:
        """Table, findings and pictures."""
        return View(
            self._table(),
            self._findings(),
            pictures=[
                Picture(draw, self),
                *[Picture(draw_posterior, self, "posterior")] * (self.posterior is not None),
            ],
            records=self._records,
            texts=self.texts,
            page=self.page,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text: each value with its interval."""
        header = ["parameter", "state", "value", "95 % interval", "relative half-width"]
        rows = []
        for key, value in self.values.items():
            low, high = self.intervals[key]
            half = 0.5 * (high - low)
            share = written(half / abs(value), ".2%") if value else NOT_KNOWN
            state = self._state(key)
            printed = written(value, ".6g", "", self.standard_errors[key])
            rows.append([key, state, printed, span(low, high, "", 6), share])
        if self.posterior:
            header.append("posterior's 95 %")
            for row, (low, high) in zip(rows, self.posterior.intervals.values(), strict=True):
                row.append(span(low, high, "", 6))
        return header, rows

    def _records(self):
        """Header and a row for each value."""
        header = ["parameter", "state", "value", "standard_error", "low", "high"]
        return header, [
            [key, self._state(key), value, self.standard_errors[key], *self.intervals[key]]
            for key, value in self.values.items()
        ]

    def _state(self, key):
        """How far the records determine a value."""
        if key in self.undetermined:
            return "undetermined"
        # These are coefficients about x = 0, where the records have no motion.
        return "extrapolated" if self.visited and key in self.visited.values else "identified"

    def _findings(self) -> list[str]:
        """The verdict, what is not determined, the proof of each record, and the other models."""
        lines = [self.verdict.sentence]
        if self.impedance:
            lines += self.impedance.findings("oscillator.mass" in self.keys)
        lines += [
            f"{record.name}: {remark}"
            for record in self.measurements
            for remark in getattr(record, "remarks", ())
        ]
        if self.visited:
            lines.append(f"visited: {self.visited.ranges}")
            lines.append(f"extrapolated: {', '.join(self.visited.extrapolated)}")
        lines += [
            f"{misfit.record}: {misfit.output} NRMSE {misfit.left:.2%}, {misfit.noise:.2%} is "
            f"the sensors' noise, {misfit.systematic:.2%} follow from the motion"
            f"{'' if misfit.is_noise else ', which is no noise'}"
            for misfit in self.misfits
        ]
        lines += [str(direction) for direction in self.fitted.undetermined]
        lines += [f"{unclear}; {key} is kept as in the scene" for key, unclear in self.kept]
        for stretch in self.fitted.stretches:
            measured, predicted, difference = stretch.powers()
            name, unit = stretch.compared
            in_windows = f" in {_counted(stretch.windows, 'window')}" if stretch.long else ""
            lines.append(
                f"{stretch.name}, {stretch.aside}: {stretch.quantity} NRMSE {stretch.nrmse():.2%}"
                f"{in_windows}; {name} measured {with_error(measured, unit)}, predicted "
                f"{with_error(predicted, unit)}, difference {share_with_error(difference)}"
            )
            if stretch.windows > 1:
                lines.append(
                    f"{stretch.name}: from one start alone, whose path may diverge from the "
                    f"measured one, {name} {with_error(stretch.free_power(), unit)}"
                )
        lines += [str(prediction) for prediction in self.kept_aside]
        lines += [
            f"model {model.name}: {len(model.fitted.keys)} values, NRMSE {model.fitted.nrmse:.2%} "
            f"on the data kept aside{self._sensors(model.fitted)}"
            for model in self.candidates[1:]
        ]
        if self.posterior:
            lines.append(
                f"posterior: {self.posterior.independent:.0f} independent draws, "
                f"{self.posterior.accepted:.0%} of the moves accepted; its residuals are taken for "
                "independent"
            )
        lines.append(
            f"fitted to {self._fitted_part()}; intervals allow for correlated residuals; "
            f"{self.seconds:.1f} s"
        )
        return lines

    def _sensors(self, other):
        """Sensor effects of another model that this one lacks, in words."""
        effects = zip(other.keys, other.values, other.standard_errors, strict=True)
        return "".join(
            f", {key} = {value:.4g} ± {HALF_INTERVAL * error:.2g}"
            for key, value, error in effects
            if key.startswith("sensor.") and key not in self.keys
        )

    def _fitted_part(self):
        """Text: the part of the records that was fitted."""
        stretches = self.fitted.stretches
        steady = sum(isinstance(stretch, ResponseStretch) for stretch in stretches)
        lines = f"two of every three frequencies of {_counted(steady, 'record')}"
        if steady == len(stretches):
            return lines
        count = len(stretches) - steady
        windows = sum(edges.size - 1 for edges in self.fitted.fit.edges[:count])
        return (
            f"the first two thirds of {_counted(count, 'record')} in "
            f"{_counted(windows, 'window')}, acceleration {self.fitted.interpolation} between "
            f"samples{f', and {lines}' if steady else ''}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return plain(
            {
                "scene": self.scene,
                "start": self.start,
                "verdict": self.verdict,
                "parameters": {
                    key: {
                        "value": value,
                        "standard_error": self.standard_errors[key],
                        "interval": self.intervals[key],
                        "determined": key not in self.undetermined,
                        "state": self._state(key),
                    }
                    for key, value in self.values.items()
                },
                "keys": self.keys,
                "covariance": self.covariance,
                "undetermined": [str(direction) for direction in self.fitted.undetermined],
                "kept": {key: str(unclear) for key, unclear in self.kept},
                "records": [_record(stretch) for stretch in self.fitted.stretches],
                "misfits": list(self.misfits),
                "spring_shape": self.spring_shape,
                "visited": self.visited,
                "kept_aside": [
                    {**vars(prediction), "within_interval": prediction.holds}
                    for prediction in self.kept_aside
                ],
                "residuals_white": self.whiteness.white,
                "whiteness_probability": self.whiteness.probability,
                "candidates": [
                    {
                        "model": model.name,
                        "keys": model.fitted.keys,
                        "values": model.fitted.values,
                        "nrmse": model.fitted.nrmse,
                        "log_ratio_of_mean_squares": model.better,
                        "standard_error": model.error,
                    }
                    for model in self.candidates
                ],
                "proposed": self.proposed.name,
                "interpolation": self.fitted.interpolation,
                "posterior": self.posterior,
                **({"impedance": self.impedance.parameters()} if self.impedance else {}),
                "seconds": self.seconds,
            }
        )

    def scene_text(self, candidate: Candidate | None = None) -> str:
        """The scene as a TOML file with intervals in comments; that of another model on demand."""
        model = candidate.fitted if candidate else self.fitted
        errors = dict(zip(model.keys, HALF_INTERVAL * model.standard_errors, strict=True))
        comments = {key: f"identified, ± {error:.2g} (95 %)" for key, error in errors.items()}
        if BASE_FACTOR in comments:
            comments[BASE_FACTOR] += "; as much as the accelerometer's scale is right"
        for direction in model.undetermined:
            comments |= {key: "not determined by the records" for key in direction.keys}
        names = ", ".join(record.name for record in self.measurements)
        sensors = [
            f"{key} = {value:.6g} ± {errors[key]:.2g} (95 %)"
            for key, value in zip(model.keys, model.values, strict=True)
            if key.startswith("sensor.")
        ]
        path = f'Between samples of a record: interpolation = "{model.interpolation}".'
        heading = [f"Identified from {names}.", self.verdict.sentence, path, *sensors]
        return scene_text(model.scene, comments, heading)

    def page(self) -> str:
        """One self-contained page of HTML with everything."""
        from harvester.results import page

        first, *others = self._findings()
        verdicts = [page.Verdict(first, self.verdict.good), *map(page.Verdict, others)]
        models = [
            (model.name, str(len(model.fitted.keys)), f"{model.fitted.nrmse:.2%}")
            for model in self.candidates
        ]
        name, records = self.scene.name, ", ".join(record.name for record in self.measurements)
        sections = {
            "Verdict": page.verdict_list(verdicts),
            "Values": page.wide(page.table_of(*self._table())) + page.facts(LEGEND),
            "Figures": Picture(draw, self).html(f"{name}: proof", CAPTION),
        }
        if self.posterior:
            picture = Picture(draw_posterior, self)
            sections["Posterior"] = picture.html(f"{name}: posterior", POSTERIOR_CAPTION)
        sections["Models"] = page.wide(page.table_of(("model", "values", "NRMSE"), models))
        sections["Scene"] = page.wide(f"<pre>{html.escape(self.scene_text())}</pre>")
        about = f"scene {self.scene.digest()[:12]}"
        return page.page(f"{name}: identified from {records}", about, sections)

    def texts(self) -> dict[str, str]:
        """Further files of the result: the scenes, that proposed where it is another, the page."""
        files = {".toml": self.scene_text(), ".html": self.page()}
        if self.proposed is not self.candidates[0]:
            files["-proposed.toml"] = self.scene_text(self.proposed)
        return files


def _counted(count, noun):
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _record(stretch):
    names = ("measured", "predicted", "relative_difference")
    powers = dict(zip(names, stretch.powers(), strict=True))
    return {
        "name": stretch.name,
        "outputs": stretch.outputs,
        "nrmse": {name: stretch.nrmse(n) for n, name in enumerate(stretch.outputs)},
        "sensor_noise": {name: sensor_noise(stretch, n) for n, name in enumerate(stretch.outputs)},
        "windows": stretch.windows,
        "compared": stretch.compared[0],
        **{
            name: {"estimate": estimate.estimate, "standard_error": estimate.standard_error}
            for name, estimate in {"free": stretch.free_power(), **powers}.items()
        },
    }

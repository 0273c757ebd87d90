"""Result of an engine or a stationary method, with its evidence and view."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.arguments import Named
from harvester.base.errors import HarvesterError, UnknownQuantity
from harvester.base.formatting import (
    Printed,
    count,
    is_share,
    largest,
    prefixed,
    quantity,
    with_error,
)
from harvester.base.libraries import optional_library
from harvester.base.plain_text import named, shown
from harvester.base.reading import read_json
from harvester.base.serialising import LEFT_OUT, NotAValue, fields_of, values_of
from harvester.base.symbols import definitions
from harvester.base.tables import csv_text
from harvester.device.cores import is_of_jumps
from harvester.excitation.spectrum_fit import SpectrumFit
from harvester.results import joint_drawing
from harvester.results.drawing import axis_label, density_label, draw_density, draw_result
from harvester.results.headline import headline
from harvester.results.orbit import Attractor
from harvester.results.view import NOT_IN_JSON, Picture, ResultBase, Table, View
from harvester.results.waveform import Waveform
from harvester.results.waveform import draw as draw_waveform
from harvester.scene.described import device_line
from harvester.scene.model import Scene
from harvester.scene.prepared import Prepared, prepared
from harvester.scene.units import Scales, scale
from harvester.statistics.estimate import Density, Estimate, with_roots
from harvester.statistics.joint_density import JointDensity
from harvester.statistics.moments import Moments
from harvester.statistics.output_side import USED, step_sizes
from harvester.statistics.strain import without_line
from harvester.statistics.units import SI_UNITS, inverse, unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

# The step error of a difference of powers is printed if it exceeds this multiple of the powers'
# step error.
LARGER_ERROR = 1.5
# Explanation of an error of 0.
CONSTANT = "constant in the run: the load, the scene or its start determines the value"
ERROR_KINDS = ("statistical", "numerical")


@dataclass(frozen=True, repr=False)
class Result(ResultBase):
    """Quantities of one scene by one engine or stationary method, with error bars and provenance.

    `result["mean_power"]` is an estimate in the scene's units, as are all of `quantities`;
    `scaled_quantities` and `densities` are in scaled units.

    Attributes
    ----------
    scene : Scene
    engine : str
        "circuit", "monte-carlo", or "averaging" followed by the stationary method.
    scaled_quantities : dict of str to Estimate
    scales : Scales
    error_kind : str
        "statistical", or "numerical" for averaging.
    energy_balance_residual : float or None
        The energy input that is not accounted for, as a share of the input.
    wall_seconds : float
        Wall time from the first realization's start to the last one's end, without start-up (s).
    engine_seconds : float
        Processor time of all realizations, or of averaging (s); `simulated_time` over it is the
        speed of one core.
    simulated_time : float
        Simulated time of all realizations, including settling (s); 0 for averaging.
    steps : int
    step : float or None
        Longest step (s).
    step_error : float or None
        Relative error of a mean power due to the step, by `harvester.scene.steps.step_error`; None
        if unknown. Error bars of deterministic runs include it.
    realizations : int
    engine_version : str
    netlist_sha256 : str or None
        SHA-256 of the first realization's netlist; with Monte Carlo, of the load's netlist.
    notes : tuple of str
        Caveats for citing the numbers.
    densities : dict of str to Density
        Densities of displacement, velocity and voltage.
    joint_density : JointDensity or None
        Joint density of displacement and velocity, of the stationary solver or if requested.
    waveform : Waveform or None
        A time interval of the first realization, in the scene's units; None for averaging.
    failures : dict of int to str
        Realizations that failed repeatedly, with the reason; excluded from the estimates.
    moments : list of harvester.statistics.moments.Moments
        One per realization, for paired differences; empty for averaging.
    spectrum_fit : SpectrumFit or None
        The fit that averaging over a record used.
    stroboscope : ndarray or None, shape (realizations, samples, columns)
        If requested, the scaled state at the starts of the excitation's periods, with the columns
        `harvester.statistics.stroboscope.COLUMNS`; see `section`.
    attractors : tuple of Attractor
        Motions reached in a deterministic run from several starts.
    outcome : str
        "complete", "incomplete" if realizations failed, or the name of the error that ended the run
        early.
    """

    scene: Scene = field(metadata=LEFT_OUT)
    engine: str
    scaled_quantities: dict[str, Estimate]
    scales: Scales
    error_kind: str
    energy_balance_residual: float | None
    wall_seconds: float
    engine_seconds: float
    simulated_time: float
    steps: int
    step: float | None
    realizations: int
    engine_version: str
    netlist_sha256: str | None
    notes: tuple[str, ...] = ()
    densities: dict[str, Density] = field(default_factory=dict, metadata=LEFT_OUT)
    joint_density: JointDensity | None = field(default=None, metadata=LEFT_OUT)
    waveform: Waveform | None = field(default=None, metadata=LEFT_OUT)
    failures: dict[int, str] = field(default_factory=dict)
    moments: list[Moments] = field(default_factory=list, metadata=LEFT_OUT)
    spectrum_fit: SpectrumFit | None = field(default=None, metadata=LEFT_OUT)
    outcome: str = "complete"
    step_error: float | None = None
    stroboscope: np.ndarray | None = field(default=None, metadata=LEFT_OUT)
    attractors: tuple[Attractor, ...] = field(default=(), metadata=LEFT_OUT)

    def __post_init__(self) -> None:
        why = "" if self.densities else " (JSON contains none: run the scene again)"
        densities = Named(f"{self.scene.name}: no density{why} of", self.densities)
        object.__setattr__(self, "densities", densities)

    def quantity(self, name: str) -> Estimate:
        """An estimate in the scene's units, like `result[name]`; raises UnknownQuantity."""
        if name not in self.scaled_quantities:
            missing = without_line(self.scene, name) or self._without_jump_rates(name)
            if name in (*self.densities, "density", "densities"):
                missing = f'no quantity {name}; to_dataframe("densities") has the densities'
            if missing:
                raise UnknownQuantity(missing)
            return super().__getitem__(name)
        estimate = self.scaled_quantities[name]
        return estimate.times(self.scales.of(estimate.dimension), self.unit(estimate.dimension))

    __getitem__ = quantity

    def _without_jump_rates(self, name):
        """Remedy if `average` computed no jump rates of a device that jumps; else ""."""
        jumps = self.scaled_quantities.keys() & {"well_crossing_rate", "share_in_wells"}
        computed = self.error_kind != "numerical" or any(map(is_of_jumps, self.scaled_quantities))
        if computed or not jumps or not is_of_jumps(name):
            return ""
        return f"no quantity {name}: average(…, jump_rates=True) by fokker_planck computes it"

    def _numbers(self) -> Named:
        """All estimates in the table; each mean square is followed by its root."""
        return Named(f"{self.scene.name}: no quantity", self.quantities)

    @cached_property
    def prepared_scene(self) -> Prepared:
        """The scene with its scaled equations and steps; see `harvester.scene.prepared`."""
        return prepared(self.scene)

    @property
    def seed(self) -> int:
        """The seed of the noise and all other random numbers."""
        return self.scene.run.seed

    @property
    def quantities(self) -> dict[str, Estimate]:
        """All estimates in the scene's units; each mean square is followed by its root."""
        return with_roots({name: self.quantity(name) for name in self.scaled_quantities})

    def unit(self, dimension: str) -> str:
        """Unit of a dimension like "voltage^2" in this scene."""
        return unit_of(self.scene, dimension)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN and missing errors become null.

        Densities, waveform and moments are omitted: see `density_table` and `to_xarray`.
        """
        content = {
            **fields_of(self),
            "quantities": {
                name: self.quantity(name).to_dict(self.unit(estimate.dimension))
                for name, estimate in self.scaled_quantities.items()
            },
            "scaled_quantities": {
                name: {**estimate.to_dict("scaled"), "dimension": estimate.dimension}
                for name, estimate in self.scaled_quantities.items()
            },
            "seed": self.seed,
        }
        if self.attractors:
            content["attractors"] = [orbit.to_dict(self.unit) for orbit in self.attractors]
        if self.spectrum_fit:
            content["spectrum_fit"] = self.spectrum_fit.to_dict()
        return {**content, "scene": self.scene.to_dict()}

    @classmethod
    def read(cls, path: str | Path) -> Result:
        """Read a result of `simulate` or `average` from its JSON, without densities.

        `path`: a file of `harvester.save` that ends in .json. Raises HarvesterError, also for the
        JSON of a study; see `from_dict`.
        """
        content = read_json(path)
        try:
            return cls.from_dict(content, str(Path(path).parent))
        except HarvesterError as error:
            raise type(error)(f"{named(str(path))}: {error}") from None

    @classmethod
    def from_dict(cls, content: dict[str, Any], folder: str | None = None) -> Result:
        """Build a result from the return value of `to_dict`.

        The scene's files are read again, a load's netlist from `folder` or the current one.

        Raises
        ------
        HarvesterError
            `content` does not contain the values of a result.
        SceneError
            A file of the scene is missing or has changed.
        """
        if isinstance(content, Mapping) and content and "scaled_quantities" not in content:
            raise HarvesterError(
                f"not a result of simulate or average, but JSON with {', '.join(content)}: studies "
                "are not read again; take its numbers with json.load, its table from the .csv of "
                "harvester.save, or keep the study itself with pickle"
            )
        try:
            return _result_of(cls, content, folder)
        except NotAValue as error:
            reason = str(error)
        except KeyError as error:
            reason = f"{error} is missing"
        except (TypeError, AttributeError, ValueError, OverflowError) as error:
            reason = f"{type(error).__name__}: {error}"
        raise HarvesterError(f"not a result: {reason}; pass the return value of Result.to_dict")

    def _dataset(self) -> Dataset:
        """All quantities and densities in the scene's units with their standard errors (NaN if
        unknown).

        Returns
        -------
        xarray.Dataset
            Quantities have no dimension. `displacement_density` and other densities have the bins'
            centres as coordinates `displacement` etc. `joint_density`, if any, has
            `joint_displacement` and `joint_velocity`. Errors are `…_standard_error`; the attribute
            `unit` is the unit.

        Raises
        ------
        MissingLibrary
        """
        xarray = optional_library("xarray", "Result.to_xarray", "study")
        variables: dict[str, tuple] = {}
        coordinates: dict[str, tuple] = {}
        for name, estimate in self.quantities.items():
            unit = {"unit": self.unit(estimate.dimension)}
            error = math.nan if estimate.standard_error is None else estimate.standard_error
            variables[name] = ((), estimate.estimate, unit)
            variables[f"{name}_standard_error"] = ((), error, unit)
        for name, density in self.densities.items():
            scale, across = self.scales.of(density.dimension), self.unit(density.dimension)
            coordinates[name] = (name, density.centre * scale, {"unit": across})
            _add_density(variables, name, name, density, scale, across)
        if self.joint_density is not None:
            names = ["joint_displacement", "joint_velocity"]
            for name, axis in zip(("displacement", "velocity"), names, strict=True):
                values = getattr(self.joint_density, name) * self.scales.of(name)
                coordinates[axis] = (axis, values, {"unit": self.unit(name)})
            area = self.scales.of("displacement") * self.scales.of("velocity")
            across = f"{self.unit('displacement')} {self.unit('velocity')}"
            _add_density(variables, "joint", names, self.joint_density, area, across)
        attributes = {
            "scene": self.scene.name,
            "scene_sha256": self.scene.digest(),
            "engine": self.engine,
            "engine_version": self.engine_version,
            "outcome": self.outcome,
        }
        return xarray.Dataset(variables, coordinates, attributes)

    def density_table(self) -> Table:
        """The densities in the scene's units, one row per bin."""
        header = ["quantity", "centre", "density", "standard_error", "unit_of_centre"]
        header += ["unit_of_density"]
        rows = []
        for name, density in self.densities.items():
            scale, unit = self.scales.of(density.dimension), self.unit(density.dimension)
            errors = _bin_errors(density) / scale
            columns = zip(density.centre * scale, density.density / scale, errors, strict=True)
            rows += [[name, *numbers, unit, inverse(unit)] for numbers in columns]
        return Table(header, rows)

    def view(self) -> View:
        """The quantities with error bars, the evidence and the densities."""
        return View(
            self._table(),
            self._findings(),
            headline=headline(self),
            pictures=[
                Picture(draw_result, self, needs=f"densities, {NOT_IN_JSON}"),
                Picture(joint_drawing.draw, [self], "joint", joint_drawing.NEEDS),
                *([Picture(draw_waveform, self.waveform, "waveform")] if self.waveform else []),
            ],
            records=self._records,
            dataset=self._dataset,
            texts=lambda: {"-densities.csv": csv_text(*self.density_table())},
            methods={self.engine: self},
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows as text: quantity, unit, value with error bar, effective samples.

        A mean square is followed by its root, and a value without error bar by the reason.
        """
        numerical = self.error_kind == "numerical"
        header = [
            "quantity",
            "unit",
            f"estimate ± {'numerical' if numerical else 'standard'} error",
        ]
        header += ["effective samples"] * (not numerical)
        printed = self._numbers()
        # A column explains missing error bars.
        reasons = {
            name: CONSTANT if mean.standard_error == 0.0 and not mean.note else mean.note
            for name, mean in printed.items()
        }
        bare = any(reasons.values())
        header += ["no error bar because"] * bare
        rows = []
        for name, estimate in printed.items():
            factor, unit = self.in_print(name, estimate)
            harvested = " (harvested)" * (name == "mean_output_power" and USED in printed)
            rows.append(
                [
                    name.replace("_", " ") + harvested,
                    unit,
                    self.printed(estimate, factor),
                    *([] if numerical else [count(estimate.effective_sample_size)]),
                    *[reasons[name].removeprefix("no error bar: ")] * bare,
                ]
            )
        return header, rows

    def _records(self):
        """Header and one row per quantity, in the scene's units."""
        keys = ["estimate", "standard_error", "effective_sample_size", "unit", "note"]
        return ["quantity", *keys], [
            [name, *(getattr(estimate, key) for key in keys)]
            for name, estimate in self.quantities.items()
        ]

    def in_print(self, name: str, estimate: Estimate) -> tuple[float, str]:
        """Factor and unit for printing a quantity, such as 1e6 and "µW"."""
        if estimate.dimension == "1" and is_share(name):
            return 100.0, "%"
        return prefixed(largest(estimate), self.unit(estimate.dimension))

    def printed(self, estimate: Estimate, factor: float) -> Printed:
        """One of `quantities`, printed with the factor of `in_print`."""
        text, unit = with_error(estimate.times(factor)), self.unit(estimate.dimension)
        value, error = estimate.estimate, estimate.standard_error
        return Printed(text, value, error, unit, estimate=estimate)

    def _findings(self) -> list[str]:
        """Sentences on how the numbers were obtained, and caveats for citing them."""
        return [
            *self.evidence(),
            *device_line(self.scene),
            *definitions(self.scaled_quantities),
            *self.notes,
        ]

    def draw_density(self, axes: Axes, name: str, label: str | None = None, **style: Any) -> None:
        """Draw one density into axes of your figure, in the scene's units.

        Parameters
        ----------
        axes : matplotlib.axes.Axes
        name : str
            "displacement", "velocity" or "voltage"; others raise UnknownQuantity.
        label : str or None
            Label in the legend (default: the method).
        **style
            `colour`, `line`, `width`, with matplotlib's values.
        """
        draw_density(axes, self, name, label or self.engine, **style)
        axes.set(xlabel=axis_label(self, name), ylabel=density_label(self, name))

    def section(self) -> np.ndarray:
        """Displacement and velocity of all stroboscopic samples, in the scene's units.

        Shape (realizations, samples, 2). Raises HarvesterError if the samples were not kept.
        """
        if self.stroboscope is None:
            raise HarvesterError(f"{self.scene.name}: no samples: simulate with stroboscope=True")
        units = [self.scales.of("displacement"), self.scales.of("velocity")]
        return self.stroboscope[:, :, :2] * units

    def evidence(self) -> list[str]:
        """Sentences on the runs and methods that produced the numbers."""
        sentences = [self.engine_version]
        if self.simulated_time > 0.0:
            sentences.append(
                f"{self.realizations} × {self.simulated_time / self.realizations:.6g} s, measured "
                f"from {self.scene.run.settle:g} s on, {count(self.steps)} steps of at most "
                f"{quantity(self.step or 0.0, 's', 3)}, seed {self.scene.run.seed}"
            )
        if self.step_error is not None:
            sentences.append(f"step error of powers: up to {100.0 * self.step_error:.1g} %")
            loss = self.scaled_quantities.get("mean_converter_loss")
            size = step_sizes(self.scaled_quantities).get("mean_converter_loss", 0.0)
            # The larger relative error of a difference of powers is printed if it is relevant.
            if loss and size > LARGER_ERROR * abs(loss.estimate) > 0.0:
                share = self.step_error * size / abs(loss.estimate)
                sentences[-1] += (
                    f", of the converter loss up to {float(f'{100.0 * share:.1g}'):g} %"
                )
        if self.energy_balance_residual is not None:
            sentences.append(f"energy balance residual {self.energy_balance_residual:z.2%}")
        sentences.append(f"{self.wall_seconds:.2f} s")
        if self.netlist_sha256:
            sentences.append(f"netlist {self.netlist_sha256[:12]}")
        return sentences


def _add_density(variables, name, axes, density, scale, unit):
    """Add a density with its axes and error; `scale` and `unit`: of the product of its axes."""
    attributes = {"unit": inverse(unit)}
    variables[f"{name}_density"] = (axes, density.density / scale, attributes)
    if density.standard_error is not None:
        errors = _bin_errors(density) / scale
        variables[f"{name}_density_standard_error"] = (axes, errors, attributes)


def _bin_errors(density):
    """Standard errors; NaN if unknown, or in an empty bin, whose counts do not vary."""
    return np.where(density.density != 0.0, np.asarray(density.standard_error, float), math.nan)


def _result_of(kind, content, folder):
    """Implement `Result.from_dict`; raise NotAValue, KeyError, TypeError or AttributeError."""
    values = values_of(kind, content, "result")
    for name, estimate in values["scaled_quantities"].items():
        # Valid dimensions are a known quantity or an integer power of it, such as "voltage^2".
        base, power, exponent = estimate.dimension.partition("^")
        if base not in SI_UNITS or (power and not exponent.removeprefix("-").isdecimal()):
            raise NotAValue(f"{name}: {shown(estimate.dimension)} is not a dimension")
        for key in ("standard_error", "effective_sample_size"):
            _check_size(getattr(estimate, key), f"scaled_quantities.{name}.{key}")
    for name in ("simulated_time", "wall_seconds", "engine_seconds", "step", "step_error"):
        _check_size(values[name], name)
    if math.isnan(values["simulated_time"]) or values["error_kind"] not in ERROR_KINDS:
        raise NotAValue("simulated_time or error_kind is invalid")
    scene = Scene.from_dict(content["scene"], folder)
    stored, computed = vars(values["scales"]), vars(scale(scene)[1])
    if not all(math.isclose(computed[k], stored[k], rel_tol=1e-9) for k in computed):
        raise NotAValue(f"scales: the scene's are {computed}")
    fit = content.get("spectrum_fit") or None
    result = kind(**values, scene=scene, spectrum_fit=fit and SpectrumFit.from_dict(fit))
    written = result.to_dict()
    for name in written.keys() - {"attractors", "scene", "spectrum_fit"}:
        if content.get(name) != written[name]:
            raise NotAValue(f"{name} contradicts the other values, or is not finite")
    return result


def _check_size(value, where):
    """Raise NotAValue unless a size is ≥ 0; NaN and None mean unknown."""
    if value is not None and value < 0.0:
        raise NotAValue(f"{where} = {shown(value)}: must be a number ≥ 0")

"""Results with their evidence: what every engine and closure returns, and how it is shown."""

import html
import math
from dataclasses import dataclass, field

from harvester.estimates.estimate import Estimate
from harvester.excitation.spectrum_fit import SpectrumFit
from harvester.files.plain_text import one_line
from harvester.files.writing import finite
from harvester.record.record import Record
from harvester.scene.model import Scene
from harvester.scene.units import Scales

SI_UNITS = {
    "voltage": "V",
    "power": "W",
    "displacement": "m",
    "velocity": "m/s",
    "energy": "J",
    "rate": "1/s",
    "time": "s",
    "1": "1",
}


@dataclass(frozen=True)
class Result:
    """Quantities of one scene by one engine or closure, with error bars and provenance.

    Estimates and densities are in scaled units; `quantity` and `quantities` give them in the
    scene's own.

    Attributes
    ----------
    scene : Scene
    engine : str
        "circuit", "monte-carlo", or "averaging" followed by the closure.
    scaled_quantities : dict of str to Estimate
    scales : Scales
    error_kind : str
        "statistical", or "numerical" for averaging.
    energy_balance_residual : float or None
        Share of the energy put in that is not found again.
    wall_seconds : float
        From the first realization's start to the last one's end, without start-up.
    engine_seconds : float
        Summed over realizations: `simulated_time` over it is the rate of one core.
    simulated_time : float
        Summed over realizations, settling included (s); 0 for averaging.
    steps : int
    step : float or None
        Longest step (s).
    realizations : int
    engine_version : str
    netlist_sha256 : str or None
        Of the first realization's netlist.
    notes : tuple of str
        What a reader must know before citing a number.
    densities : dict of str to Density
        Of displacement, velocity and voltage.
    waveform : Record or None
        A stretch of the first realization.
    failures : dict of int to str
        Realizations that failed for good, with the reason; left out of the estimates.
    moments : list of harvester.record.moments.Moments
        One per realization, for paired differences; empty for averaging.
    spectrum_fit : SpectrumFit or None
        Of averaging over a record.
    outcome : str
        "complete", "incomplete" where realizations failed, or the name of the error that ended
        the run early.
    """

    scene: Scene
    engine: str
    scaled_quantities: dict
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
    notes: tuple = ()
    densities: dict = field(default_factory=dict, repr=False)
    waveform: Record | None = field(default=None, repr=False)
    failures: dict = field(default_factory=dict)
    moments: list = field(default_factory=list, repr=False)
    spectrum_fit: SpectrumFit | None = field(default=None, repr=False)
    outcome: str = "complete"

    def quantity(self, name):
        """One estimate in the scene's units; KeyError for an unknown name."""
        return self._in_units(self.scaled_quantities[name])

    @property
    def quantities(self):
        """All estimates in the scene's units, {name: Estimate}."""
        return {name: self.quantity(name) for name in self.scaled_quantities}

    def unit(self, dimension):
        """Unit of a dimension like "voltage^2" in this scene."""
        return unit_of(self.scene, dimension)

    def to_dict(self):
        """Plain values for JSON; NaN and missing errors become null."""
        fit = {"spectrum_fit": self.spectrum_fit.to_dict()} if self.spectrum_fit else {}
        return {
            "engine": self.engine,
            "engine_version": self.engine_version,
            "outcome": self.outcome,
            "quantities": {
                name: self._entry(estimate, self.unit(estimate.dimension))
                for name, estimate in self.quantities.items()
            },
            "scaled_quantities": {
                name: self._entry(estimate, "scaled")
                for name, estimate in self.scaled_quantities.items()
            },
            "scales": {
                "displacement": self.scales.displacement,
                "voltage": self.scales.voltage,
                "power": self.scales.power,
            },
            "error_kind": self.error_kind,
            "energy_balance_residual": finite(self.energy_balance_residual),
            "wall_seconds": finite(self.wall_seconds),
            "engine_seconds": finite(self.engine_seconds),
            "simulated_time": self.simulated_time,
            "steps": self.steps,
            "step": self.step,
            "realizations": self.realizations,
            "seed": self.scene.run.seed,
            "netlist_sha256": self.netlist_sha256,
            "notes": list(self.notes),
            "failures": {str(index): reason for index, reason in self.failures.items()},
            **fit,
            "scene": self.scene.to_dict(),
        }

    def density_table(self):
        """CSV of the densities in the scene's units: quantity, centre, density, error."""
        lines = ["quantity,centre,density,standard_error,unit_of_centre"]
        for name, density in self.densities.items():
            scale, unit = self.scales.of(density.dimension), self.unit(density.dimension)
            errors = density.standard_error
            for k, centre in enumerate(density.centre):
                error = "" if errors is None else f"{errors[k] / scale:.6g}"
                value = density.density[k] / scale
                lines.append(f"{name},{centre * scale:.9g},{value:.9g},{error},{unit}")
        return "\n".join(lines) + "\n"

    def rows(self):
        """(name, value with error bar, effective samples, unit) for a table, as text."""
        return [
            (
                name.replace("_", " "),
                with_error(estimate),
                _count(estimate.effective_sample_size),
                self.unit(estimate.dimension),
            )
            for name, estimate in self.quantities.items()
        ]

    def _repr_html_(self):
        cells = "".join(
            "<tr>" + "".join(f"<td>{html.escape(one_line(cell))}</td>" for cell in row) + "</tr>"
            for row in self.rows()
        )
        facts = html.escape(one_line("; ".join([*self.evidence(), *self.notes])))
        title = html.escape(f"{self.scene.name}: {self.engine}")
        return (
            f"<table><caption>{title}</caption><tr><th>quantity</th><th>estimate</th>"
            f"<th>effective samples</th><th>unit</th></tr>{cells}</table><p>{facts}</p>"
        )

    def evidence(self):
        """Sentences on how the numbers came about."""
        facts = [self.engine_version]
        if self.simulated_time > 0.0:
            facts.append(
                f"{self.realizations} × {self.simulated_time / self.realizations:g} s, "
                f"{self.steps} steps of at most {self.step:g} s, seed {self.scene.run.seed}"
            )
        if self.energy_balance_residual is not None:
            facts.append(f"energy balance residual {self.energy_balance_residual:.2%}")
        facts.append(f"{self.wall_seconds:.2f} s")
        if self.netlist_sha256:
            facts.append(f"netlist {self.netlist_sha256[:12]}")
        return facts

    def _in_units(self, estimate):
        factor = self.scales.of(estimate.dimension)
        error = estimate.standard_error
        return Estimate(
            estimate.estimate * factor,
            None if error is None else error * factor,
            estimate.effective_sample_size,
            estimate.dimension,
            estimate.note,
        )

    def _entry(self, estimate, unit):
        entry = {
            "estimate": finite(estimate.estimate),
            "standard_error": finite(estimate.standard_error),
            "effective_sample_size": finite(estimate.effective_sample_size),
            "unit": unit,
        }
        return {**entry, "note": estimate.note} if estimate.note else entry


def unit_of(scene, dimension):
    """Unit of a dimension like "voltage^2" in a scene's own units."""
    base, _, exponent = dimension.partition("^")
    if base == "1":
        return "1"
    if scene.units == "SI" or base in ("rate", "time"):
        unit = SI_UNITS[base]
        unit = f"({unit})" if exponent and "/" in unit else unit
    else:
        unit = f"scaled {base}"
    return f"{unit}^{exponent}" if exponent else unit


def with_error(estimate):
    """ "0.02745 ± 0.00012", or the bare value and that it has no error bar."""
    value, error = estimate.estimate, estimate.standard_error
    if value is None or not math.isfinite(value):
        return "—"
    if error is None or not math.isfinite(error):
        return f"{value:.3g} (no error bar)"
    if error == 0.0:
        return f"{value:.6g} ± 0"
    digits = max(0, math.floor(math.log10(abs(value) / error)) + 2) if value else 2
    if 1e-4 <= abs(value) < 1e5 or value == 0.0:
        places = max(0, 1 - math.floor(math.log10(error)))
        return f"{value:.{places}f} ± {error:.{places}f}"
    exponent = math.floor(math.log10(abs(value)))
    scale = 10.0**exponent
    return f"({value / scale:.{digits}f} ± {error / scale:.{digits}f})e{exponent}"


def _count(size):
    return "" if size is None else f"{size:.0f}"

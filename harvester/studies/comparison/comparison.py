"""One scene by circuit, Monte Carlo and averaging, compared: the result of `validate`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from harvester.averaging.closures import notes_on_errors
from harvester.base.formatting import NOT_KNOWN, Printed, share_with_error, signed, written
from harvester.base.serialising import plain
from harvester.base.symbols import definitions
from harvester.results import joint_drawing
from harvester.results.headline import headline
from harvester.results.page import Verdict
from harvester.results.result import Result
from harvester.results.view import Picture, ResultBase, View
from harvester.scene.described import device_line
from harvester.scene.model import Scene
from harvester.statistics.agreement import (
    NEGLIGIBLE_SHARE,
    NOT_SHARP,
    SHARP_SHARE,
    differ,
    is_sharp,
)
from harvester.statistics.estimate import Estimate, with_roots

COMPARED = (
    "mean_square_voltage",
    "rms_voltage",
    "mean_power",
    "power_conversion_efficiency",
    "mean_square_displacement",
    "mean_square_velocity",
)
# Additional quantities of a device with several wells: rates of crossings and of jumps, and shares
# of time.
BETWEEN_WELLS = ("well_crossing_rate", "share_of_time_in_well", "jump_rate")
# Additional quantities of a load with an output.
AT_THE_OUTPUT = ("mean_output_power", "end_to_end_efficiency", "output_voltage")
BESIDE = (*BETWEEN_WELLS, *AT_THE_OUTPUT)
# If neither result has an error, a relative difference below this is round-off.
SAME = 1e-9
# Part of the progress bar for each engine. Monte Carlo takes little of the time.
SHARES = {"circuit": (0.0, 0.95), "monte-carlo": (0.95, 1.0)}
# Quantity by which stationary methods are compared.
JUDGED_BY = "mean_square_voltage"
# Known limits of stationary methods, from the docstring of harvester.averaging.closures.average.
LIMITS = {
    "paper": "it omits the piezo's constant force from the potential (Eqs. 11–15)",
    "consistent": "it assumes motion in one well and neglects the slow voltage after "
    "a jump between wells",
}
# Placeholder for a quantity that a method does not compute.
_NOTHING = Estimate(math.nan, None, None, "1")
# Number of periods of small oscillations in the waveform.
SHOWN_PERIODS = 20


@dataclass(frozen=True, repr=False)
class Comparison(ResultBase):
    """Results of one scene by several methods, and their differences.

    Attributes
    ----------
    circuit, monte_carlo
        Results of both engines on the same noise paths.
    closures
        Results of the stationary methods that are valid for the scene.
    refused
        Stationary methods that are not valid for the scene, with the reasons.
    paired : dict of str to Estimate
        (Circuit − Monte Carlo)/Monte Carlo, with the error of the paired difference: the bias due
        to the circuit's step.
    """

    circuit: Result
    monte_carlo: Result
    closures: dict[str, Result]
    refused: dict[str, str]
    paired: dict[str, Estimate]

    @property
    def scene(self) -> Scene:
        """The scene of all results."""
        return self.circuit.scene

    @property
    def compared(self) -> tuple[str, ...]:
        """Names of the quantities that are compared."""
        quantities = self.monte_carlo.scaled_quantities
        names = (*COMPARED, *(name for name in quantities if name.startswith(BESIDE)))
        return tuple(with_roots({name: quantities[name] for name in names}))

    def difference(self, name: str) -> float:
        """Circuit minus Monte Carlo in combined standard errors; NaN without error bars.

        The engines are treated as independent, which is conservative for common noise.
        """
        a, b = (_scaled(result, name) for result in self._engines())
        if a.standard_error is None or b.standard_error is None:
            return math.nan
        joint = math.hypot(a.standard_error, b.standard_error)
        if joint == 0.0:
            return 0.0 if math.isclose(a.estimate, b.estimate, rel_tol=SAME) else math.inf
        return (a.estimate - b.estimate) / joint

    def share(self, name: str) -> float:
        """(Circuit − Monte Carlo)/Monte Carlo of a mean; NaN if the Monte Carlo mean is 0."""
        a, b = (_scaled(result, name).estimate for result in self._engines())
        return a / b - 1.0 if b else math.nan

    @property
    def significant(self) -> dict[str, float]:
        """Relative differences of quantities that exceed their errors, the largest first."""
        apart = {
            name: self.share(name) for name in self.compared if differ(self.difference(name), 1.0)
        }
        return dict(sorted(apart.items(), key=lambda item: -_or_infinite(item[1])))

    @property
    def paired_apart(self) -> dict[str, Estimate]:
        """Paired differences (circuit − Monte Carlo, same noise) that exceed their errors,
        largest first."""
        apart = {
            name: bias
            for name, bias in self.paired.items()
            if name in self.compared
            and bias.standard_error
            and differ(bias.estimate, bias.standard_error)
        }
        return dict(sorted(apart.items(), key=lambda item: -abs(item[1].estimate)))

    @property
    def agree(self) -> bool:
        """Whether every difference is insignificant or below `NEGLIGIBLE_SHARE`."""
        shares = [*self.significant.values(), *(p.estimate for p in self.paired_apart.values())]
        return all(_or_infinite(share) <= NEGLIGIBLE_SHARE for share in shares)

    def deviation(self, closure: str, name: str) -> tuple[float, float]:
        """A stationary method's deviation from Monte Carlo as a share, and in standard errors.

        NaN for a quantity that the stationary method does not compute.
        """
        value = _scaled(self.closures[closure], name).estimate
        reference = _scaled(self.monte_carlo, name)
        share = value / reference.estimate - 1.0 if reference.estimate else math.nan
        error = reference.standard_error
        return share, (value - reference.estimate) / error if error else math.nan

    def view(self) -> View:
        """Table, findings and pictures."""
        from harvester.studies.comparison.report import draw_comparison

        # p(X, X') of the stationary solver and Monte Carlo, on the same grid and colour scale.
        joint = [*self.closures.values(), self.monte_carlo]
        return View(
            self._table(),
            self._findings(),
            headline=self.verdict().text.partition(";")[0].removesuffix("."),
            pictures=[
                Picture(draw_comparison, self),
                Picture(joint_drawing.draw, joint, "joint", joint_drawing.NEEDS),
            ],
            records=self._records,
            methods=self.results_by_method(),
            page=self.page,
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table, as text."""
        header = [
            "quantity",
            "unit",
            "circuit",
            "Monte Carlo",
            "difference [σ]",
            "paired relative bias",
        ]
        header += [name for name in self.closures]
        rows = [self._row(name) for name in self.compared]
        timed = (self.circuit, self.monte_carlo, *self.closures.values())
        seconds = [written(result.wall_seconds, ".2f", "s") for result in timed]
        rows.append(["wall time", "s", *seconds[:2], "", "", *seconds[2:]])
        reasons = {
            name.replace("_", " "): reason
            for name in self.compared
            if math.isnan(self.difference(name))
            for reason in self._reasons_without_error_bar(name)
        }
        if reasons:
            header.append("no error bar because")
            rows = [[*row, reasons.get(row[0], "")] for row in rows]
        return header, rows

    def _records(self):
        """Header and one row per quantity and method, in the scene's units."""
        header = ["quantity", "method", "estimate", "standard_error", "unit"]
        return header, [
            [name, method, mean.estimate, mean.standard_error, mean.unit]
            for name in self.compared
            for method, result in self.results_by_method().items()
            for mean in [result.quantities.get(name)]
            if mean
        ]

    def _row(self, name):
        circuit, difference = self.circuit.quantities[name], self.difference(name)
        paired = self.paired.get(name)
        factor, unit = self.circuit.in_print(name, circuit)
        row = [
            name.replace("_", " "),
            unit,
            self.circuit.printed(circuit, factor),
            self.monte_carlo.printed(self.monte_carlo.quantities[name], factor),
            Printed(
                "no error bar" if math.isnan(difference) else signed(difference, ".2f"), difference
            ),
            share_with_error(paired) if paired else NOT_KNOWN,
        ]
        for closure, result in self.closures.items():
            share, sigma = self.deviation(closure, name)
            if name not in result.quantities:
                row.append(NOT_KNOWN)
                continue
            value = result.printed(result.quantities[name], factor)
            sigmas = "no error bar" if math.isnan(sigma) else f"{signed(sigma, '.0f')} σ"
            text = f"{value} ({signed(share, '.1%')}, {sigmas})"
            row.append(Printed(text, value.value, value.error, value.unit, None, value.estimate))
        return row

    def _findings(self) -> list[str]:
        """Sentences on the findings, one line each."""
        lines = [headline(self.circuit), self.verdict().text]
        lines += [f"{engine.engine}: {'; '.join(engine.evidence())}" for engine in self._engines()]
        judged = self._judged()
        bare = [name for name in judged if math.isnan(self.difference(name))]
        # If no quantity has an error bar, the verdict reports this.
        lines += self.without_error_bar(bare) if len(bare) < len(judged) else []
        lines += self.not_applying()
        for name, (apart, chance) in self.joint_distances().items():
            by_chance = "" if math.isnan(chance) else f", {chance:.3f} expected by chance"
            lines.append(f"∬|p(X, X') by {name} − by Monte Carlo| = {apart:.3f}{by_chance}")
        lines += [*device_line(self.scene), *definitions(self.compared)]
        if self.closures:
            lines += notes_on_errors(self.closures)
            lines.append(
                "in brackets a stationary method's deviation from Monte Carlo, as a share and in "
                "standard errors of Monte Carlo alone"
            )
        return [*lines, *dict.fromkeys((*self.circuit.notes, *self.monte_carlo.notes))]

    def verdict(self) -> Verdict:
        """One sentence on whether the engines agree."""
        apart = {name: abs(self.difference(name)) for name in self._judged()}
        sigmas = {name: sigma for name, sigma in apart.items() if not math.isnan(sigma)}
        if not sigmas:
            reasons = "; ".join(self.without_error_bar(apart))
            return Verdict(f"The engines cannot be compared without error bars: {reasons}.", False)
        short = len(apart) - len(sigmas)
        tail = f"; {short} of {len(apart)} quantities have no error bar" if short else ""
        unsharp = [name for name in sigmas if not self._is_sharp(name)]
        if unsharp:
            tail += f"; not checked, as {NOT_SHARP}: {', '.join(map(words, unsharp))}"
        if not self.agree:
            return Verdict(f"Circuit and Monte Carlo disagree: {self._greatest()}{tail}.", False)
        if len(unsharp) == len(sigmas):
            excitation = self.scene.excitation
            remedy = excitation.longer_run(self.scene.run)
            remedy += " or run.realizations" * excitation.random
            return Verdict(
                "Circuit and Monte Carlo cannot be cross-checked: every difference is "
                f"{NOT_SHARP}; {remedy}.",
                None,
            )
        checked = ", ".join(words(name) for name in sigmas if name not in unsharp)
        if self.significant or self.paired_apart:
            within = f"Circuit and Monte Carlo agree within {NEGLIGIBLE_SHARE:.0%} in {checked}"
            small = "significant, but below that limit, and may be due to the time steps"
            return Verdict(f"{within}: {self._greatest()}; {small}{tail}.", True)
        # The difference of deterministic runs may be 0; the text states at least 0.1.
        worst = max(0.1, *sigmas.values())
        agreed = f"Circuit and Monte Carlo agree within {worst:.1f} standard errors"
        biases = {n: b for n, b in self.paired.items() if n in sigmas and b.standard_error}
        if biases:
            name = max(biases, key=lambda n: abs(biases[n].estimate))
            bias = share_with_error(biases[name])
            tail = f"; on the same noise the {words(name)} differs most, by {bias}{tail}"
        return Verdict(f"{agreed} of {checked if unsharp else 'every quantity'}{tail}.", True)

    def _judged(self):
        """The compared quantities without the roots of those whose mean square is compared."""
        roots = {name.replace("mean_square", "rms") for name in self.compared if "square" in name}
        return [name for name in self.compared if name not in roots]

    def _is_sharp(self, name):
        """Whether the engines' difference, paired or not, is known to `SHARP_SHARE` or better."""
        paired = self.paired.get(name)
        if paired and paired.standard_error is not None:
            return is_sharp(paired.standard_error)
        circuit, reference = (_scaled(result, name) for result in self._engines())
        errors = circuit.standard_error or 0.0, reference.standard_error or 0.0
        return math.hypot(*errors) <= SHARP_SHARE * abs(reference.estimate)

    def _greatest(self):
        """Text on the largest significant difference, between means or on common noise."""
        shares = {name: abs(bias.estimate) for name, bias in self.paired_apart.items()}
        joint = next(iter(self.significant.items()), None)
        if joint and _or_infinite(joint[1]) >= max(shares.values(), default=0.0):
            name, share = joint
            apart = abs(self.difference(name))
            return f"the {words(name)} differs by {abs(share):.2%}, {apart:.1f} standard errors"
        name, bias = next(iter(self.paired_apart.items()))
        return f"on the same noise the {words(name)} differs by {share_with_error(bias)}"

    def not_applying(self) -> list[str]:
        """One line on stationary methods that are not valid for the scene; empty if all are."""
        names: dict[str, list[str]] = {}
        for name, message in self.refused.items():
            reason = message.removeprefix(f"{self.scene.name}: ").removeprefix(f"{name}: ")
            names.setdefault(reason, []).append(name)
        listing = "; ".join(
            f"{', '.join(closures)}: {reason}" for reason, closures in names.items()
        )
        return [f"Stationary methods that are not valid: {listing}"] if listing else []

    def without_error_bar(self, names: Iterable[str]) -> list[str]:
        """Quantities without an error bar in either engine, by reason."""
        reasons: dict[str, list[str]] = {}
        for name in names:
            (reason,) = self._reasons_without_error_bar(name) or ("no such quantity",)
            reasons.setdefault(reason, []).append(name)
        return [
            f"{', '.join(group).replace('_', ' ')}: {reason}" for reason, group in reasons.items()
        ]

    def _reasons_without_error_bar(self, name):
        """One reason for the missing error bar, from the first engine that has a note."""
        notes = [_scaled(result, name).note for result in self._engines()]
        return [note for note in notes if note][:1]

    def joint_distances(self) -> dict[str, tuple[float, float]]:
        """∬|p − p'| from each joint density to Monte Carlo's, and the value expected by chance."""
        simulated = self.monte_carlo.joint_density
        return {
            name: simulated.distance(result.joint_density)
            for name, result in self.closures.items()
            if simulated is not None and result.joint_density is not None
        }

    def _engines(self):
        return (self.circuit, self.monte_carlo)

    def results_by_method(self) -> dict[str, Result]:
        """The result of every method, by its name in the table."""
        return {"circuit": self.circuit, "Monte Carlo": self.monte_carlo, **self.closures}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        results = [*self._engines(), *self.closures.values()]
        return plain(
            {
                "scene": self.scene,
                "results": {result.engine: result for result in results},
                "refused": self.refused,
                "difference_in_standard_errors": {
                    name: self.difference(name) for name in self.compared
                },
                "paired_bias": {name: bias.to_dict("1") for name, bias in self.paired.items()},
                "closure_deviation": {
                    closure: {name: self.deviation(closure, name)[0] for name in self.compared}
                    for closure in self.closures
                },
                "joint_density_distance": {
                    closure: {"from_monte_carlo": apart, "by_chance": chance}
                    for closure, (apart, chance) in self.joint_distances().items()
                },
            }
        )

    def page(self) -> str:
        """A self-contained HTML page of the comparison."""
        from harvester.studies.comparison.report import report

        return report(self, [Verdict(headline(self.circuit)), *verdicts(self)])


def words(name: str) -> str:
    """A quantity's name as text."""
    return name.replace("_", " ").replace("mean square", "mean-square")


def _or_infinite(share):
    return math.inf if math.isnan(share) else abs(share)


def _scaled(result, name):
    """A mean in scaled units, also the root of a mean square; NaN if a method does not give it."""
    return with_roots(result.scaled_quantities).get(name, _NOTHING)


def verdicts(comparison: Comparison) -> list[Verdict]:
    """Verdicts on a comparison, one sentence each."""
    closures = [_closure(comparison, name) for name in comparison.closures]
    refused = [Verdict(f"{line}.") for line in comparison.not_applying()]
    engines = comparison.circuit, comparison.monte_carlo
    circuit, other = (engine.energy_balance_residual or 0.0 for engine in engines)
    balance = Verdict(
        "The energy balance closes to "
        f"{signed(circuit, '.2%')} of the input in the circuit and {signed(other, '.2%')} in Monte "
        "Carlo."
    )
    return [comparison.verdict(), balance, *closures, *refused]


def _closure(comparison, name):
    share, sigma = comparison.deviation(name, JUDGED_BY)
    subject = f"The method {name}"
    if math.isnan(sigma):
        return Verdict(f"{subject} cannot be judged: Monte Carlo has no error bar.")
    reasons = _reasons(comparison.closures[name], name)
    tail = f" Known limits: {'; '.join(reasons)}." if reasons else " No known limit explains this."
    if not _off(share, sigma):
        agreed = (
            f"{subject} agrees with Monte Carlo's {words(JUDGED_BY)}: {signed(share, '.1%')}, "
            f"{signed(sigma, '.1f')} standard errors"
        )
        other = _farthest(comparison, name)
        return Verdict(f"{agreed}, but {other}.{tail}" if other else f"{agreed}.", not other)
    side = "high" if share > 0.0 else "low"
    return Verdict(
        f"{subject} is {abs(share):.1%} {side} in {words(JUDGED_BY)}, {abs(sigma):.0f} standard "
        f"errors of Monte Carlo.{tail}",
        False,
    )


def _off(share, sigma):
    return differ(sigma, 1.0) and abs(share) >= NEGLIGIBLE_SHARE


def _farthest(comparison, name):
    """Text on the quantity in which a stationary method deviates most; empty if none deviates."""
    deviations = {quantity: comparison.deviation(name, quantity) for quantity in COMPARED}
    off = {quantity: d for quantity, d in deviations.items() if _off(*d)}
    if not off:
        return ""
    worst = max(off, key=lambda quantity: abs(off[quantity][1]))
    share, sigma = off[worst]
    return f"its {words(worst)} deviates by {share:+.1%}, {sigma:+.0f} standard errors"


def _reasons(result, name):
    """Texts: the result's notes, and the known limits of the stationary method that apply."""
    reasons = list(result.notes)
    in_wells = result.scaled_quantities.get("share_in_wells")
    if name == "paper" and in_wells is not None:
        reasons.append(LIMITS[name])
    if name == "consistent" and in_wells is not None and in_wells.estimate < 1.0:
        outside = 1.0 - in_wells.estimate
        reasons.append(f"{LIMITS[name]} (it puts {outside:.0%} of the time outside the wells)")
    return reasons

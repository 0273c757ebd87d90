"""Sentences on a comparison: which methods agree, which deviate, and the closures' known limits."""

from __future__ import annotations

import math

from harvester.show.page import Verdict
from harvester.studies.comparison.comparison import (
    AGREEING_STANDARD_ERRORS,
    COMPARED,
    Comparison,
    words,
)

# Closures are judged by this quantity.
JUDGED = "mean_square_voltage"
# A closure counts as off if it deviates by more than this share. Every closure is an approximation.
NEGLIGIBLE_SHARE = 0.01
# Known limits of each closure, from its documentation (harvester.averaging.average).
LIMITS = {
    "paper": "it leaves the constant force of the piezo out of the potential (Eqs. 11–15)",
    "consistent": "it is for motion inside a well and misses the slow part of the voltage after "
    "a jump between wells",
}


def verdicts(comparison: Comparison) -> list[Verdict]:
    """Verdicts of a comparison, one sentence each."""
    closures = [_closure(comparison, name) for name in comparison.closures]
    refused = [Verdict(f"{line}.") for line in comparison.not_applying()]
    return [comparison.verdict(), _energy(comparison), *closures, *refused]


def _energy(comparison):
    residuals = [r.energy_balance_residual for r in (comparison.circuit, comparison.monte_carlo)]
    circuit, monte_carlo = (f"{residual:+.2%}" for residual in residuals)
    return Verdict(
        f"The energy balance closes to {circuit} of the input in the circuit and {monte_carlo} in "
        "Monte Carlo."
    )


def _closure(comparison, name):
    share, sigma = comparison.deviation(name, JUDGED)
    subject = f"The closure {name}"
    if math.isnan(sigma):
        return Verdict(f"{subject} cannot be judged: Monte Carlo has no error bar.")
    reasons = _reasons(comparison.closures[name], name)
    tail = f" What is known: {'; '.join(reasons)}." if reasons else " It does not say why."
    if not _off(share, sigma):
        agreed = (
            f"{subject} agrees with Monte Carlo's {words(JUDGED)}: {share:+.1%}, {sigma:+.1f} "
            "standard errors"
        )
        other = _farthest(comparison, name)
        return (
            Verdict(f"{agreed}, but {other}.{tail}", False)
            if other
            else Verdict(f"{agreed}.", True)
        )
    side = "high" if share > 0.0 else "low"
    return Verdict(
        f"{subject} lies {abs(share):.1%} {side} in {words(JUDGED)}, {abs(sigma):.0f} standard "
        f"errors of Monte Carlo.{tail}",
        False,
    )


def _off(share, sigma):
    return abs(sigma) > AGREEING_STANDARD_ERRORS and abs(share) >= NEGLIGIBLE_SHARE


def _farthest(comparison, name):
    """Text: the quantity in which a closure deviates most; empty if none deviates."""
    deviations = {quantity: comparison.deviation(name, quantity) for quantity in COMPARED}
    off = {quantity: d for quantity, d in deviations.items() if _off(*d)}
    if not off:
        return ""
    worst = max(off, key=lambda quantity: abs(off[quantity][1]))
    share, sigma = off[worst]
    return f"its {words(worst)} is off by {share:+.1%}, {sigma:+.0f} standard errors"


def _reasons(result, name):
    """Text: the result's own notes, then the known limits of the closure that apply."""
    reasons = list(result.notes)
    in_wells = result.scaled_quantities.get("share_in_wells")
    if name == "paper" and in_wells is not None:
        reasons.append(LIMITS[name])
    if name == "consistent" and in_wells is not None and in_wells.estimate < 1.0:
        outside = 1.0 - in_wells.estimate
        reasons.append(f"{LIMITS[name]} (it puts {outside:.0%} of the time outside the wells)")
    return reasons

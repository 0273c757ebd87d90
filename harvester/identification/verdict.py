"""One sentence on whether a fitted model is to be believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harvester.identification.candidates import Candidate, proposed
from harvester.identification.proof import Whiteness

if TYPE_CHECKING:
    from harvester.identification.fitted_model import Fitted


@dataclass(frozen=True)
class Verdict:
    """What is to be thought of the scene's model.

    Attributes
    ----------
    word : str
        "predicts", "wrong" or "incomplete".
    sentence : str
    """

    word: str
    sentence: str

    @property
    def good(self) -> bool:
        """Whether the model may be used as it is."""
        return self.word == "predicts"


def verdict(base: Fitted, found: Sequence[Candidate], whiteness: Whiteness) -> Verdict:
    """Judge a model by what it predicts of the data kept aside.

    Parameters
    ----------
    base : Fitted
    found : sequence of Candidate
        The scene's own first.
    whiteness : Whiteness
        Of the residuals of the first record kept aside.
    """
    output = base.stretches[0].quantity
    said = (
        f"{output} to {base.nrmse:.2%} NRMSE on the data kept aside (about {base.sensor_noise:.2%} "
        f"is the sensor's noise), residuals {'white' if whiteness.white else 'correlated'}"
    )
    best = proposed(found)
    if best.is_better:
        return Verdict(
            "wrong",
            f"the model is wrong: {said}; {best.name} leaves {best.fitted.nrmse:.2%} and is "
            "proposed instead",
        )
    if not base.adequate and not (whiteness.white and base.stretches[0].long):
        return Verdict(
            "incomplete",
            f"the model is wrong or incomplete: {said}, and none of the other models that were "
            "tried does better",
        )
    simpler = "" if best is found[0] else f"; {best.name} predicts as well and is simpler"
    return Verdict("predicts", f"the model predicts {said}{_power(base)}{simpler}")


def _power(base):
    """What it predicts of the power, in words."""
    first = base.stretches[0]
    _, _, difference = first.powers()
    return (
        f", and the {first.compared[0]} to {difference.estimate:+.2%} ± "
        f"{difference.standard_error:.2%}"
    )

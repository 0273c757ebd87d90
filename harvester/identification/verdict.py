"""One sentence on whether a fitted model is to be believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harvester.identification.candidates import SURE, Candidate, proposed
from harvester.identification.proof import Whiteness, sensor_noise
from harvester.show.numbers import share_with_error

if TYPE_CHECKING:
    from harvester.identification.fitted_model import Fitted

# Of each window: displacement, velocity and the transducer's state.
FITTED_STATES = 3
# Share of an output that is the sensor's noise from which on it is no record of a motion.
MOSTLY_NOISE = 0.9


@dataclass(frozen=True)
class Verdict:
    """What is to be thought of the scene's model.

    Attributes
    ----------
    word : str
        "predicts", "wrong", "incomplete", or "nothing" where there is nothing to judge by.
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
    if all(_is_noise(each, whiteness) for each in base.stretches):
        return Verdict(
            "nothing",
            f"nothing to judge: the model explains {output} no better than chance "
            f"({base.nrmse:.2%} NRMSE on the data kept aside), and what was measured is noise "
            f"(about {base.sensor_noise:.2%} of it); measure with a stronger excitation, and check "
            "that the columns belong together",
        )
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


def _is_noise(stretch, whiteness):
    """Whether a stretch holds only noise, of which nothing is explained.

    The starts of the windows are fitted to the stretch: of white noise, each of their states
    explains as much as one sample has.
    """
    explained = stretch.explained()
    chance = FITTED_STATES * stretch.windows / len(stretch.measured)
    if explained.estimate > chance + SURE * explained.standard_error:
        return False
    return sensor_noise(stretch) >= MOSTLY_NOISE or (stretch.long and whiteness.white)


def _power(base):
    """What it predicts of the power, in words."""
    first = base.stretches[0]
    _, _, difference = first.powers()
    return f", and the {first.compared[0]} to {share_with_error(difference)}"

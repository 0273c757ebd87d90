"""One sentence on whether a fitted model can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harvester.base.formatting import share_with_error
from harvester.identification.candidates import SURE, Candidate, proposed, rivals
from harvester.identification.consistency import Misfit, worst
from harvester.identification.intervals import HALF_INTERVAL
from harvester.identification.validation_record import ResponseRecord, Whiteness, sensor_noise

if TYPE_CHECKING:
    from harvester.identification.fitting import Fitted
    from harvester.identification.kept_aside import Kept
    from harvester.identification.spring_shape import SpringShape
    from harvester.identification.visited import Visited

# Fitted states of each window: displacement, velocity and the transducer's state.
FITTED_STATES = 3
# An output is no record of a motion if its sensor's noise has more than this share of its rms.
MOSTLY_NOISE = 0.9


@dataclass(frozen=True)
class FitVerdict:
    """The judgement on the scene's model.

    Attributes
    ----------
    word : str
        "predicts"; "fits" where the records do not tell the spring from others; "wrong",
        "incomplete", or "nothing" where there is nothing to judge by.
    """

    word: str
    sentence: str

    @property
    def good(self) -> bool:
        """Whether the model may be used as it is."""
        return self.word == "predicts"


def verdict(
    base: Fitted,
    found: Sequence[Candidate],
    whiteness: Whiteness,
    misfits: Sequence[Misfit] = (),
    visited: Visited | None = None,
    kept: Sequence[Kept] = (),
    shape: SpringShape | None = None,
) -> FitVerdict:
    """Judge a model by what it predicts of the data kept aside: its worst record and channel.

    Parameters
    ----------
    found : sequence of Candidate
        The scene's own first.
    whiteness : Whiteness
        Whiteness of the residuals of the first record kept aside.
    misfits : sequence of Misfit
        Misfits of each output of each record; none of frequency responses.
    visited : Visited, optional
        Ranges that the records visited.
    kept : sequence of Kept
        Records kept aside as a whole.
    shape : SpringShape, optional
        The spring beside one with the next power.
    """
    if all(_is_noise(stretch, whiteness) for stretch in base.records):
        return FitVerdict("nothing", _nothing(base))
    claim, claims, best = _said(base, misfits, whiteness), _claims(kept), proposed(found)
    if best.is_better:
        return FitVerdict(
            "wrong",
            f"the model is wrong: {claim}; {best.name} leaves {best.fitted.nrmse:.2%} and is "
            f"proposed instead{_freed(best, base)}{_rivals(found, base)}{claims}",
        )
    fault = _fault(base, whiteness, misfits, kept, shape)
    if fault is not None:
        others = ", and none of the other models that were tried does better" if found[1:] else ""
        return FitVerdict(
            "incomplete", f"the model is wrong or incomplete: {claim}{fault}{others}{claims}"
        )
    simpler = "" if best is found[0] else f"; {best.name} predicts as well and is simpler"
    if shape and shape.undetermined_coefficients:
        return FitVerdict(
            "fits",
            f"the model fits, and the records do not tell its spring from others: {claim}"
            f"{_power(base)}{_untold(shape)}{claims}{_where(visited)}{simpler}",
        )
    return FitVerdict(
        "predicts", f"the model predicts {claim}{_power(base)}{claims}{_where(visited)}{simpler}"
    )


def impedance_verdict(base: Fitted) -> FitVerdict:
    """Verdict of a fit to an impedance alone, which covers only small motion."""
    claim = (
        f"impedance to {base.nrmse:.2%} of itself on every third frequency, kept aside (about "
        f"{base.sensor_noise:.2%} is the analyser's noise)"
    )
    if not base.adequate:
        return FitVerdict(
            "incomplete",
            f"the model is wrong or incomplete: {claim}: it has more than modes, a capacitance and "
            "its loss",
        )
    return FitVerdict(
        "predicts",
        f"the model predicts {claim}; that is small motion about the place where it rests, the "
        "base clamped: it does not cover large motion, stoppers and the response to acceleration",
    )


def _nothing(base):
    """A sentence that says that the records hold no motion to judge by."""
    stretch = base.records[0]
    cause = (
        f"and what was measured is noise (about {base.sensor_noise:.2%} of it); measure with a "
        "stronger excitation, and check"
    )
    if isinstance(stretch, ResponseRecord) and stretch.smooth:
        cause = (
            "and what was measured is smooth and no noise; check the voltage's polarity "
            "(sensor.voltage_scale=-1 behind the file), the units of the phase, and"
        )
    return (
        f"nothing to judge: the model explains {stretch.quantity} no better than chance "
        f"({base.nrmse:.2%} NRMSE on the data kept aside), {cause} that the columns belong together"
    )


def _untold(shape):
    """Text: how wide the intervals of the spring's values are if it has one more power."""
    values = " and ".join(
        f"{key.rpartition('.')[2]} to ± {half:.0%}"
        for key, half in shape.undetermined_coefficients.items()
    )
    return (
        f"; with a term of power {shape.power} too, which they do not exclude, they tell {values} "
        "(95 %), and at other levels it may move otherwise: measure larger motions too, or noise"
    )


def _fault(base, whiteness, misfits, kept, shape):
    """The objection to the best model, in words; None if there is none."""
    wrong = worst(misfits)
    if wrong:
        return (
            f": {wrong.systematic:.2%} of the {wrong.output} of {wrong.record} follow from its "
            "motion and are no noise, so that values may be off by more than their intervals"
        )
    if shape and shape.is_refuted:
        return (
            f": the records ask for a term of power {shape.power} of the spring "
            f"({abs(shape.significance):.1f} standard errors), which moves its values by up to "
            f"{max(shape.moves.values()):.0%}"
        )
    refuted = [record for record in kept if record.claimed and not record.holds]
    if refuted:
        return f": {refuted[0].name} is not as predicted"
    others = [record for record in kept if not record.follows]
    if others:
        return (
            f": {others[0].left:.0%} of the record {others[0].name}, kept aside, is left even in "
            f"windows: {_cause(others[0])}"
        )
    if base.adequate or (whiteness.white and base.records[0].long):
        return None
    return ""


def _cause(kept):
    """Why a record kept aside may not be followed, in words."""
    if kept.own:
        return f"also with {', '.join(kept.own)} found in it, something else is another"
    return (
        "another tilt, load or sensor; what is unknown of a record alone is freed behind its file, "
        "such as oscillator.restoring_force[0]=free"
    )


def _freed(best, base):
    """Text: the sensors' values that another model frees in addition."""
    values = dict(zip(best.fitted.keys, best.fitted.values, strict=True))
    sensors = [key for key in values if key.startswith("sensor.") and key not in base.keys]
    return "".join(f" ({key} = {values[key]:.4g}, to be freed by --free {key})" for key in sensors)


def _rivals(found, base):
    """Text: other models that fit the records as well as the proposed one."""
    names = [f"{rival.name}{_freed(rival, base)}" for rival in rivals(found)]
    if not names:
        return ""
    return f"; the records do not tell it from {' nor from '.join(names)}"


def _claims(kept):
    """Text: how many kept-aside records a prediction is claimed for, and how many of those
    agree."""
    if not kept:
        return ""
    claimed = [record for record in kept if record.claimed]
    if not claimed:
        return f"; of the records kept aside ({len(kept)}) it claims none"
    held = sum(record.holds for record in claimed)
    widths = [
        HALF_INTERVAL * (record.predicted_rms.standard_error or 0.0) / record.predicted_rms.estimate
        for record in claimed
    ]
    low, high = (f"{100.0 * width:.2g}" for width in (min(widths), max(widths)))
    return (
        f"; it claims {len(claimed)} of {len(kept)} records kept aside, and {held} of those lie "
        f"within their intervals, of ± {low if low == high else f'{low} to {high}'} % of the rms"
    )


def _where(visited):
    """Text: the ranges that the records visited, and what the model extrapolates."""
    if visited is None:
        return ""
    return (
        f"; that holds for what the records visited ({visited.ranges}); extrapolated are "
        f"{', '.join(visited.extrapolated)}"
    )


def _said(base, misfits, whiteness):
    """Text: residual (NRMSE) of the worst record and channel, then of the other channels'
    worst records."""
    if not misfits:
        return (
            f"{base.records[0].quantity} to {base.nrmse:.2%} NRMSE on the data kept aside (about "
            f"{base.sensor_noise:.2%} is the sensor's noise), residuals "
            f"{'white' if whiteness.white else 'correlated'}"
        )
    channels = [
        max((misfit for misfit in misfits if misfit.output == name), key=_beyond)
        for name in dict.fromkeys(misfit.output for misfit in misfits)
    ]
    first, *others = sorted(channels, key=_beyond, reverse=True)
    several = len({misfit.record for misfit in misfits}) > 1
    source = f" of {first.record}, the worst of the records" if several else ""
    also = "".join(f", {other.output} to {other.left:.2%} ({other.noise:.2%})" for other in others)
    return (
        f"{first.output} to {first.left:.2%} NRMSE on the data kept aside{source} (about "
        f"{first.noise:.2%} is the sensors' noise){also}"
    )


def _beyond(misfit):
    """Error beyond the noise, then the whole error: the order in which records are ranked."""
    return max(misfit.left**2 - misfit.noise**2, 0.0), misfit.left


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
    """Predicted against measured power, in words, of the record with the largest difference."""
    powers = [(stretch, stretch.powers()[2]) for stretch in base.records]
    stretch, difference = max(powers, key=lambda pair: abs(pair[1].estimate))
    return f", and the {stretch.compared[0]} to {share_with_error(difference)}"

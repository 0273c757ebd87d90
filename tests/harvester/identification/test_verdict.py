"""What is said of a model by its validation records and its rivals, which are made up here."""

from types import SimpleNamespace

import numpy as np
import pytest

from harvester.identification.identifiability import Assumption
from harvester.identification.rivals import NextPower, Rival
from harvester.identification.validation_record import (
    ImpedanceRecord,
    ResponseRecord,
    Unexplained,
    ValidationRecord,
    WholeRecord,
)
from harvester.identification.verdict import FitEvidence
from harvester.statistics.estimate import Estimate

RATE, SAMPLES = 100.0, 4000
TIME = np.arange(SAMPLES) / RATE
MOTION = np.sin(2.0 * np.pi * 5.0 * TIME)
NOISE = np.random.default_rng(1).standard_normal(SAMPLES)
KEY = "oscillator.restoring_force[3]"


def in_time(measured, predicted, is_noise=True, name="made.csv", kind=ValidationRecord, **more):
    """A record of a voltage, and whether what is left of it is noise."""
    columns = [values[:, None] for values in (measured, predicted)]
    left = float(np.std(measured - predicted) / np.std(measured))
    part = Unexplained("voltage", left, left if is_noise else 0.1 * left, 0.0, 1.0, is_noise)
    return kind(
        name=name, outputs=("voltage",), rate=RATE, measured=columns[0], windowed=columns[1],
        free=columns[1], windows=10, resistance=None, motion=5.0, unexplained=(part,), **more,
    )  # fmt: skip


def response(measured, predicted, kind=ResponseRecord):
    frequency = np.linspace(1.0, 40.0, len(measured))
    return kind(
        name="lines.csv", outputs=("real", "imaginary"), rate=5.0, measured=measured,
        windowed=predicted, free=predicted, windows=1, resistance=None, motion=20.0,
        frequency=frequency,
    ).judged()  # fmt: skip


def rival(name, better, explains, keys=2, nrmse=0.01):
    model = SimpleNamespace(keys=["a"] * keys, nrmse=nrmse, explains=explains)
    return Rival(name, model, better, 0.01)


GOOD = in_time(MOTION + 0.01 * NOISE, MOTION)
BAD = in_time(MOTION + 0.01 * NOISE, -0.5 * MOTION, is_noise=False)


@pytest.mark.parametrize("predicted", [0.0 * NOISE, 0.05 * NOISE[::-1], 1e-3 * MOTION])
def test_white_noise_is_nothing_to_judge_by(predicted):
    given = FitEvidence([in_time(NOISE, predicted)]).verdict
    assert given.word == "nothing"
    assert not given.good
    assert given.sentence.startswith("no evidence: the model explains no more than chance")


def test_a_response_of_noise_is_nothing_to_judge_by():
    measured = NOISE[:400].reshape(200, 2)
    assert FitEvidence([response(measured, 0.0 * measured)]).verdict.word == "nothing"


def test_a_motion_within_noise_is_still_predicted():
    """A share of 2 % of the variance, which is far beyond chance."""
    record = in_time(NOISE + 0.2 * MOTION, 0.2 * MOTION)
    assert FitEvidence([record]).verdict.word == "predicts"


def test_a_model_that_misses_a_clear_motion_is_wrong():
    assert FitEvidence([BAD]).verdict.word == "incomplete"
    assert FitEvidence([GOOD, BAD]).verdict.word == "incomplete"


def test_white_residuals_of_one_record_excuse_no_other():
    """An impedance of which 20 % are left beside a record in time that leaves white noise."""
    assert GOOD.whiteness().white
    lines = np.column_stack([np.linspace(6.0, 4.0, 90), np.linspace(-1.5, -1.0, 90)])
    missed = 0.5 * np.exp(-(((np.arange(90) - 45) / 4.0) ** 2))[:, None]
    impedance = response(lines, lines + missed, ImpedanceRecord)
    assert FitEvidence([GOOD, impedance]).verdict.word == "incomplete"
    exact = response(lines, lines + 1e-3 * NOISE[:180].reshape(90, 2), ImpedanceRecord)
    assert FitEvidence([GOOD, exact]).verdict.word == "predicts"


def test_a_rival_is_proposed_only_if_it_leaves_noise():
    own = rival("as given", 0.0, explains=False, nrmse=0.04)
    near = rival("delay", -1.0, explains=False)
    given = FitEvidence([BAD], [own, near]).verdict
    assert given.word == "incomplete"
    assert "proposed" not in given.sentence
    given = FitEvidence([BAD], [own, near, rival("drag", -2.0, explains=True)]).verdict
    assert given.word == "wrong"
    assert given.sentence.endswith("drag has a residual of 1.00% and is proposed")
    # A rival with as many values that is hardly better is not proposed in place of the scene's own.
    assert (
        FitEvidence([BAD], [own, rival("load of made.csv", -0.01, explains=False)]).proposed is own
    )
    untried = Rival("drag", None, remark="not tried: its values did not change")
    assert FitEvidence([BAD], [own, untried]).verdict.word == "incomplete"


@pytest.mark.parametrize(
    ("significance", "move", "half", "word", "words"),
    [
        (0.3, 0.1, 0.38, "fits", "do not distinguish its spring"),
        (4.2, 0.16, 0.05, "incomplete", "the records need a spring of power 5"),
        # A term that moves nothing that would be noticed is none.
        (4.2, 0.01, 0.05, "predicts", "the model predicts"),
        (0.3, 0.01, 0.05, "predicts", "the model predicts"),
    ],
)  # fmt: skip
def test_a_spring_is_believed_as_far_as_records_tell_it(significance, move, half, word, words):
    spring = NextPower(5, significance, {KEY: move}, {KEY: half})
    given = FitEvidence([GOOD], spring=spring).verdict
    assert given.word == word
    assert words in given.sentence


@pytest.mark.parametrize(
    ("change", "error", "word", "depends"),
    [
        # 5 ± 1 % more gain moves the value by ten of its standard errors.
        (0.05, 0.01, "incomplete", True),
        # The records do not tell the gain.
        (0.05, 10.0, "predicts", True),
        # They tell it, and it is right.
        (1e-4, 1e-4, "predicts", False),
    ],
)
def test_a_value_is_only_as_right_as_a_gain_that_no_record_tells(change, error, word, depends):
    gain = Assumption("sensor.voltage_scale", ("made.csv",), change, error, {KEY: 2.0})
    evidence = FitEvidence([GOOD], errors={KEY: 0.01}, assumptions=[gain])
    assert evidence.verdict.word == word
    assert evidence.dependent == ({KEY: ["sensor.voltage_scale"]} if depends else {})


def test_records_kept_aside_refute_what_they_were_claimed_for():
    def whole(rms, outside="", limit=1.0):
        power = Estimate(rms**2, 1e-3, 1.0, "1")
        return in_time(
            MOTION + 0.01 * NOISE, MOTION, kind=WholeRecord, outside=outside, left=0.0, limit=limit,
            measured_orbit="in the well", predicted_orbit="in the well", agreement=1.0,
            rms_unit="V", predicted_rms=Estimate(rms, 1e-3, 1.0, "1"), predicted_power=power,
            own={},
        )  # fmt: skip

    right = 0.5**0.5
    assert FitEvidence([GOOD], kept_aside=[whole(right)]).verdict.word == "predicts"
    assert FitEvidence([GOOD], kept_aside=[whole(0.9)]).verdict.word == "incomplete"
    outside = whole(0.9, "its load is outside the covered range")
    assert FitEvidence([GOOD], kept_aside=[outside]).verdict.good
    assert not FitEvidence([GOOD], kept_aside=[whole(right, limit=-1.0)]).verdict.good


def test_the_first_line_has_at_most_25_words():
    spring = NextPower(5, 0.3, {KEY: 0.1}, {KEY: 0.38})
    needed = NextPower(5, 4.2, {KEY: 0.16}, {KEY: 0.05})
    gain = Assumption("sensor.voltage_scale", ("made.csv",), 0.05, 10.0, {KEY: 2.0})
    own = rival("as given", 0.0, explains=False)
    models = [
        own,
        rival("drag", -2.0, explains=True),
        rival("delay between the channels", -2.0, True),
    ]
    cases = [
        FitEvidence([in_time(NOISE, 0.0 * NOISE)]),
        FitEvidence([GOOD, BAD], models),
        FitEvidence([GOOD, BAD], [own, Rival("drag", None)]),
        FitEvidence([GOOD, GOOD], spring=spring),
        FitEvidence([GOOD, GOOD], spring=needed),
        FitEvidence([GOOD, GOOD], errors={KEY: 0.01}, assumptions=[gain]),
    ]
    for evidence in cases:
        assert len(evidence.verdict.sentence.split()) <= 25, evidence.verdict.sentence

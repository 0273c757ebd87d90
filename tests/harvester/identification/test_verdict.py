"""What is said of a model by what it leaves of records that are made up here."""

from types import SimpleNamespace

import numpy as np
import pytest
from harvester.identification.spring_shape import SpringShape

from harvester.identification.validation_record import (
    ResponseRecord,
    ValidationRecord,
    sensor_noise,
    whiteness,
)
from harvester.identification.verdict import verdict

RATE, SAMPLES = 100.0, 4000
TIME = np.arange(SAMPLES) / RATE
MOTION = np.sin(2.0 * np.pi * 5.0 * TIME)
NOISE = np.random.default_rng(1).standard_normal(SAMPLES)


def judged(measured, predicted, kind=ValidationRecord, shape=None, **more):
    """The verdict on one stretch, of a scene's own model alone."""
    columns = [each[:, None] if each.ndim == 1 else each for each in (measured, predicted)]
    stretch = kind("made.csv", ("voltage",), RATE, *columns, columns[1], 10, None, **more)
    noise, left = sensor_noise(stretch), stretch.nrmse()
    base = SimpleNamespace(
        records=[stretch],
        nrmse=left,
        sensor_noise=noise,
        adequate=left**2 - min(noise, 0.5) ** 2 <= 0.05**2,
    )
    own = SimpleNamespace(
        name="as given", better=0.0, error=0.0, is_better=False, is_as_good=True,
        fitted=SimpleNamespace(keys=[]),
    )  # fmt: skip
    return verdict(base, [own], whiteness(stretch, 0, 0.2), shape=shape)


@pytest.mark.parametrize("predicted", [0.0 * NOISE, 0.05 * NOISE[::-1], 1e-3 * MOTION])
def test_white_noise_is_nothing_to_judge_by(predicted):
    found = judged(NOISE, predicted)
    assert found.word == "nothing"
    assert not found.good
    assert found.sentence.startswith("nothing to judge: the model explains voltage no better")


def test_a_response_of_noise_is_nothing_to_judge_by():
    measured = NOISE[:400].reshape(200, 2)
    frequency = np.linspace(1.0, 40.0, 200)
    found = judged(measured, 0.0 * measured, ResponseRecord, frequency=frequency)
    assert found.word == "nothing"


def test_a_motion_within_noise_is_still_predicted():
    """A share of 2 % of the variance, which is far beyond chance."""
    found = judged(NOISE + 0.2 * MOTION, 0.2 * MOTION)
    assert found.word == "predicts"


def test_a_model_that_misses_a_clear_motion_is_wrong():
    found = judged(MOTION + 0.01 * NOISE, -0.5 * MOTION)
    assert found.word == "incomplete"


@pytest.mark.parametrize(
    ("significance", "move", "half", "word", "said"),
    [
        (0.3, 0.1, 0.38, "fits", "with a term of power 5 too, which they do not exclude, they tell "
         "restoring_force[3] to ± 38%"),
        (4.2, 0.16, 0.05, "incomplete", "ask for a term of power 5 of the spring (4.2 standard"),
        # A term that moves nothing that would be noticed is none.
        (4.2, 0.01, 0.05, "predicts", "the model predicts"),
        (0.3, 0.01, 0.05, "predicts", "the model predicts"),
    ],
)  # fmt: skip
def test_a_spring_is_believed_as_far_as_records_tell_it(significance, move, half, word, said):
    key = "oscillator.restoring_force[3]"
    shape = SpringShape(5, significance, {key: move}, {key: half})
    found = judged(MOTION + 0.01 * NOISE, MOTION, shape=shape)
    assert found.word == word
    assert said in found.sentence

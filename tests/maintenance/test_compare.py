"""What `make compare` calls a difference."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from maintenance.answers import plain
from maintenance.compare import differences, report

MEAN = 0.1
NAME = "simulate circuit: paper"


def answers(mean=MEAN, last=3.0, **more):
    result = {"mean": mean, "wall_seconds": 1.0, "notes": ["short"], **more}
    return {NAME: {"result": result, "moments": np.array([1.0, math.nan, last])}}


def found(before, after):
    return [(each.kind, each.place) for each in differences(before, after)]


def test_the_same_answers_do_not_differ_and_nan_is_nan():
    assert found(answers(math.nan), answers(math.nan)) == []
    assert found(answers(), answers(wall_seconds=2.0)) == []


@pytest.mark.parametrize("mean", [math.nextafter(MEAN, 1.0), -MEAN, math.nan, None])
def test_one_bit_of_a_number_is_a_difference(mean):
    (each,) = differences(answers(), answers(mean))
    assert (each.kind, each.place) == ("moments and quantities", f"{NAME} / result / mean")


def test_zero_is_not_minus_zero():
    assert len(found(answers(0.0, 0.0), answers(-0.0, -0.0))) == 2


def test_one_bit_of_an_array_is_told_with_its_place():
    (each,) = differences(answers(), answers(last=math.nextafter(3.0, 4.0)))
    assert each.place == f"{NAME} / moments [2], 1 of 3"
    assert each.after.endswith("(1.5e-16)")


def test_missing_keys_and_cases_messages_and_exit_codes_are_kinds_of_their_own():
    assert found(answers(more=1), answers()) == [("keys", f"{NAME} / result / more")]
    assert found({}, answers()) == [("keys", NAME)]
    assert found(answers(notes=["short"]), answers(notes=["long"]))[0][0] == "messages"
    assert found({"new": {"exit code": 0}}, {"new": {"exit code": 2}})[0][0] == "exit codes"
    netlists = ({"netlist ngspice: paper": {"files": {"a.cir": [text]}}} for text in ("R", "C"))
    assert found(*netlists)[0][0] == "netlists"


def test_a_report_tells_of_each_case_the_first_difference_and_how_many():
    many = ({f"average {k}: x": {"a": n, "b": n} for k in range(50)} for n in (1.0, 2.0))
    lines = list(report(list(differences(*many))))
    assert lines[0] == "closures: 100 differ, in 50 cases"
    assert lines[1] == "  average 0: x / a: 1.0 → 2.0 (5.0e-01) (and 1 more)"
    assert len(lines) < 20


def test_answers_are_of_plain_values_without_the_place_of_their_checkout():
    @dataclass
    class Mean:
        value: np.float64
        file: str

    told = plain({"a": (Mean(np.float64(2.0), "/here/scene.toml"),)}, "/here")
    assert told == {"a": [{"value": 2.0, "file": "CHECKOUT/scene.toml"}]}
    assert type(told["a"][0]["value"]) is float

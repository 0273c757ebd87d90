"""Dataclasses as plain values: what JSON may hold, and what each field says of itself."""

import json
import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from harvester.base.serialising import LEFT_OUT, NotAValue, fields_of, key, plain, read
from harvester.statistics.estimate import Estimate


@dataclass(frozen=True)
class Length:
    value: float
    dimension: str


@dataclass(frozen=True)
class Rod:
    name: str = field(metadata=key("rod"))
    lengths: tuple
    profile: np.ndarray = field(metadata=LEFT_OUT)


ROD = Rod("thin", (Length(math.inf, "displacement"),), np.ones(3))


def test_fields_have_their_keys_and_inner_ones_their_own():
    told = fields_of(ROD)
    assert told == {"rod": "thin", "lengths": [{"value": None, "dimension": "displacement"}]}


def test_everything_is_what_strict_json_takes():
    values = {
        "array": np.array([[1.0, math.nan], [math.inf, 2.0]]),
        "numbers": (np.float64(1.5), np.int64(2), np.bool_(True), -0.0),
        1: Estimate(math.nan, None, 3.0, "1"),
    }
    told = json.loads(json.dumps(plain(values), allow_nan=False))
    assert told["array"] == [[1.0, None], [None, 2.0]]
    assert told["numbers"] == [1.5, 2, True, 0.0]
    assert told["1"] == Estimate(math.nan, None, 3.0, "1").to_dict()


def test_what_has_no_plain_value_is_refused():
    with pytest.raises(TypeError, match="complex has no plain value"):
        plain({"a": 1j})


@dataclass(frozen=True)
class Shelf:
    rods: dict[int, Estimate]
    marks: tuple[str, ...]
    height: float | None
    width: float = field(metadata=key("breadth"))


SHELF = Shelf({3: Estimate(math.nan, None, 2.0, "1", "why")}, ("a", "b"), None, 0.5)


def test_what_was_written_is_read_again():
    told = json.loads(json.dumps(plain(SHELF), allow_nan=False))
    told["rods"]["3"]["dimension"] = "1"
    found = read(Shelf, told, "shelf")
    assert (found.marks, found.height, found.width) == (("a", "b"), None, 0.5)
    assert math.isnan(found.rods[3].estimate)
    assert found.rods[3].note == "why"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"breadth": "0.5"}, r"shelf\.breadth = '0\.5': must be a number"),
        ({"breadth": True}, r"shelf\.breadth = True: must be a number"),
        ({"marks": "ab"}, r"shelf\.marks = 'ab': must be a list"),
        ({"rods": {"3": {"estimate": 1.0}}}, r"shelf\.rods\.3\.standard_error is missing"),
        ({"rods": {"third": {}}}, r"shelf\.rods = 'third': must be a whole number"),
        ({"rods": None}, r"shelf\.rods = None: must be a table"),
    ],
)
def test_a_value_of_another_type_is_named(change, words):
    with pytest.raises(NotAValue, match=words):
        read(Shelf, {**plain(SHELF), "rods": {}, **change}, "shelf")

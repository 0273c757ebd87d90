"""Whatever a netlist holds, it is a load or a named refusal of one line, and soon.

`pytest --hypothesis-profile=long tests/circuits/netlist/test_hostile_netlists.py` looks for longer.
"""

import contextlib
import json
from pathlib import Path

import pytest
from foreign_loads import DOUBLER, RECTIFIER
from hypothesis import given
from hypothesis import strategies as st

from circuits.equivalent.ltspice import to_ltspice, translate
from circuits.netlist.expression import FUNCTIONS, NAMES, ExpressionError, check
from circuits.netlist.imported import imported
from circuits.netlist.numbers import number
from circuits.netlist.subcircuits import find_netlist, load_names, read_load
from circuits.netlist.topology import read_topology
from circuits.netlist.vetting import ELEMENTS, MODELS, PART_PARAMETERS, WAVEFORMS
from harvester.base.errors import NetlistError

BODIES = json.loads((Path(__file__).parents[2] / "hostile_bodies.json").read_text())
LOAD = ".subckt load p n out ref r=1k\n{}\nR1 out ref {{r}}\n.ends\n"
LIBRARY = [find_netlist(name).read_text(encoding="utf-8") for name in load_names()]
SEEDS = [DOUBLER, *LIBRARY, *(LOAD.format(body) for body in BODIES.values())]
CARDS = [".subckt", ".ends", ".param", ".params", ".func", ".model", ".include", ".lib", ".end"]
NODES = ["p", "n", "out", "ref", "0", "gnd", "x", "x.y", "displacement", "vload#branch"]
VALUES = ["1", "-1", "0", "4k7", "1e308", "1e-999", "3mil", "3a", "1e", "{r}", "{a+1}", "{", "}"]
SIGNS = [*" =+-*/^(){}[],.;:?!<>&|%#~'\"$@\\\n\t\r\v\f\0é", "\n+ ", "==", "**", "\u2028", "\x1b"]
WORDS = [
    *CARDS, *NODES, *VALUES, *SIGNS, *(letter + "1" for letter in [*ELEMENTS, "x", "a"]),
    *sorted(FUNCTIONS), *sorted(NAMES), *sorted(MODELS),
    *sorted(set().union(*PART_PARAMETERS.values())),
    *sorted(WAVEFORMS), "params:", "poly", "value=", "i=", "v=", "f(x)", "load", "s", "d1",
]  # fmt: skip


def answer(function, *arguments, **options):
    """What a function returns, or the one line of its refusal."""
    try:
        return function(*arguments, **options)
    except NetlistError as refusal:
        line = str(refusal)
    assert "\n" not in line
    assert len(line) < 500
    return line


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """Read bytes as a load, and all that is done with the text of one that is accepted."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "diodes.lib").write_bytes(find_netlist("bridge").with_name("diodes.lib").read_bytes())
    path = folder / "load.lib"

    def read_once(content):
        path.write_bytes(content)
        load = answer(read_load, path)
        if isinstance(load, str):
            assert ".lib" in load
            return None
        read_topology(load.text)
        answer(to_ltspice, load.text)
        assert "{" not in load.run_text
        return load

    return read_once


@pytest.mark.parametrize("name", BODIES)
def test_a_hostile_body_is_a_load_or_refused(read, name):
    content = LOAD.replace("{}", "{0}").format(BODIES[name]).encode()
    load = read(content)
    assert load is None or ".control" not in load.text


damages = st.lists(
    st.tuples(
        st.integers(0, 5000),
        st.integers(0, 40),
        st.one_of(st.sampled_from(WORDS), st.text(max_size=5), st.none()),
        st.sampled_from([1, 1, 1, 2, 30, 3000]),
    ),
    min_size=1,
    max_size=6,
)


def damaged(text, hurts):
    for place, length, word, times in hurts:
        place %= len(text) + 1
        # Without a word, what stands there is repeated.
        word = text[place : place + length] if word is None else word
        text = text[:place] + word * times + text[place + length :]
    return text


@pytest.mark.slow
@given(seed=st.sampled_from(SEEDS), hurts=damages, encoding=st.sampled_from(["utf-8", "utf-16"]))
def test_a_damaged_load_is_a_load_or_refused(read, seed, hurts, encoding):
    read(damaged(seed, hurts).encode(encoding, errors="replace"))


@pytest.mark.slow
@given(cuts=damages)
def test_a_damaged_schematic_is_a_load_or_refused(read, cuts):
    made = answer(imported, damaged(RECTIFIER, cuts), "load", ["N001", "N002", "out", "0"])
    if not isinstance(made, str):
        read(made.text.encode())


@pytest.mark.slow
@given(st.lists(st.lists(st.sampled_from(WORDS), max_size=12).map(" ".join), max_size=12))
def test_cards_of_known_words_are_a_load_or_refused(read, cards):
    read(LOAD.replace("{}", "{0}").format("\n".join(cards)).encode(errors="replace"))


@given(st.binary(max_size=300))
def test_any_bytes_are_a_load_or_refused(read, content):
    read(content)


@given(st.recursive(
    st.sampled_from([*VALUES, *NODES, *sorted(NAMES), "v(p)", "i(v1)", "{a}"]),
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), st.lists(inner, max_size=4)).map(
            lambda call: f"{call[0]}({','.join(call[1])})"
        ),
        st.tuples(inner, st.sampled_from(SIGNS), inner).map("".join),
        st.tuples(inner, st.sampled_from([1, 300])).map(lambda x: "(" * x[1] + x[0] + ")" * x[1]),
    ),
    max_leaves=20,
))  # fmt: skip
def test_any_expression_is_judged_and_said_for_ltspice_or_refused(expression):
    with contextlib.suppress(ExpressionError):
        check(expression, {"a": "1"}, {})
        answer(translate, expression, behavioural=True)


@given(st.one_of(st.from_regex(r"[-+]?[0-9.]{0,400}(e[-+]?[0-9]{0,400})?[a-z]{0,5}"), st.text()))
def test_any_text_is_a_finite_number_or_none(text):
    value = number(text)
    assert value is None or abs(value) < float("inf")

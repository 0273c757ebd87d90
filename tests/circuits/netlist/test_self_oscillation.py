"""Whether a load oscillates with the device at rest, against closed forms."""

import pytest

from circuits.netlist.load_notes import check_turn, following_notes, reading_notes
from circuits.netlist.subcircuits import find_netlist as find
from circuits.netlist.subcircuits import load_names, read_load
from harvester.base.errors import LoadError


def load_of(tmp_path, body):
    path = tmp_path / "load.lib"
    path.write_text(f".subckt load p n\n{body}\nRp p n 1meg\n.ends\n")
    return read_load(path)


CIRCLE = "L1 a n 2\nC1 a n 1u\nR1 a n {}"
RELAXING = (
    "V1 d n 1\nR1 d a 1meg\nC1 a n 10n\n.model s sw(vt=0.5 vh={} ron=1k roff=1e12)\nS1 a n a n s"
)


@pytest.mark.parametrize(("ohms", "oscillates"), [("-50k", True), ("50k", False), ("-10meg", True)])
def test_a_circle_grows_with_a_resistance_below_zero(tmp_path, ohms, oscillates):
    own = load_of(tmp_path, CIRCLE.format(ohms)).self_oscillation
    assert own.oscillates == oscillates
    assert not own.unknown


def test_a_bias_into_a_falling_characteristic_oscillates(tmp_path):
    """i = 20 µ (v − 0.2) (400 (v − 0.2)² − 1) falls at 0.2 V and rises at 0.3 V."""
    body = (
        "V1 d n {}\nL1 d a 10\nR1 a b 1k\nC1 b n 1n\n"
        "B1 b n i=20u*(v(b,n)-0.2)*(400*(v(b,n)-0.2)^2-1)"
    )
    assert load_of(tmp_path, body.format(0.2)).self_oscillation.oscillates
    assert not load_of(tmp_path, body.format(0.3)).self_oscillation.oscillates


@pytest.mark.parametrize(("gain", "oscillates"), [(2.9, False), (3.1, True)])
def test_a_wien_bridge_oscillates_from_a_gain_of_three_on(tmp_path, gain, oscillates):
    body = f"E1 x n b n {gain}\nR1 x y 1meg\nC1 y b 100p\nR2 b n 1meg\nC2 b n 100p"
    assert load_of(tmp_path, body).self_oscillation.oscillates == oscillates


def test_a_switch_that_no_state_satisfies_turns_with_the_time_constant_of_its_control(tmp_path):
    own = load_of(tmp_path, RELAXING.format(0.2)).self_oscillation
    assert own.oscillates
    # 10 nF behind 1 kΩ and, beside it, 1 MΩ.
    assert own.turn == pytest.approx(10e-9 / (1e-3 + 1e-6), rel=1e-3)
    assert own.switch == "s1 (load.lib:6)"
    # Closed above 1.1 V it never is.
    assert not load_of(tmp_path, RELAXING.format(0.6)).self_oscillation.oscillates


def test_a_node_that_jumps_with_the_switch_is_not_its_control(tmp_path):
    """A drain: 58 nF discharge by 110 kΩ; 10 pF elsewhere, at 10 Ω, do not set the time."""
    body = (
        "I1 b a 2u\nC1 a b 58n\nR1 a b 860k\nRn b n 10\nCs b n 10p\nRs a x 110k\n"
        ".model s sw(vt=1 vh=0.1 ron=100 roff=100meg)\nS1 x b a b s"
    )
    own = load_of(tmp_path, body).self_oscillation
    assert own.turn == pytest.approx(58e-9 / (1.0 / 860e3 + 1.0 / 110.1e3), rel=1e-3)


def test_a_turn_that_no_run_comes_down_to_is_refused_by_name(tmp_path):
    load = load_of(tmp_path, RELAXING.format(0.2).replace("10n", "1p").replace("1k", "1m"))
    with pytest.raises(LoadError, match=r"s1 \(load\.lib:6\) toggles endlessly"):
        check_turn(load, 1e-3)
    check_turn(load_of(tmp_path, RELAXING.format(0.2)), 1e-3)


def test_of_transistors_it_is_not_known_and_noted(tmp_path):
    load = load_of(tmp_path, "V1 d n 3\nQ1 d a n part\nR1 d a 1meg\n.model part npn")
    assert load.self_oscillation.unknown == "q1: a transistor"
    assert any("whether the load is self-oscillating" in note for note in reading_notes(load))


@pytest.mark.parametrize("name", load_names())
def test_the_librarys_loads_rest(name):
    """Their steps and numbers are as they were."""
    assert read_load(find(name)).self_oscillation == (False, float("inf"), "", "")


def test_what_a_fast_clock_costs_is_said_where_it_is_long(tmp_path):
    body = "Vclock c n pulse(0 5 0 50n 50n 6u 20u)\nRc c n 1k\nRload p n 1meg\n"
    load = load_of(tmp_path, body)
    (note,) = following_notes(load, 10.0)
    # 500 000 periods of 20 µs, by the measured 2.6 ms and 8.6 µs.
    for word in ("vclock", "20 µs", "22 min by the circuit", "4.3 s by Monte Carlo", "nano_buck"):
        assert word in note
    assert following_notes(load, 0.1) == ()
    assert following_notes(load_of(tmp_path, "Rload p n 1meg\n"), 1e6) == ()


MIRRORED = "Ra p en 1meg\nE1 x n p n -1\nRb x en 1meg\n"
BATTERIES = "V1 b n 3.3\nV2 en b -3.3\nRb en n 10k\n"


@pytest.mark.parametrize(
    ("body", "refused"),
    [
        (f"{MIRRORED}B1 p n i=v(en)>0 ? 1u : 0", True),
        (f"{MIRRORED}C1 p q 1n\nRq q en 1meg\nB1 p n i=v(en)>0 ? 1u : 0", False),
        (f"{MIRRORED}B1 p n i=v(en)>1m ? 1u : 0", False),
        (f"{BATTERIES}B1 p n i=1u*sgn(v(en,n))", True),
        (f"{BATTERIES}B1 p n i=1u*(v(b)<v(en)+3.3)", True),
        (f"{BATTERIES}B1 p n i=1u*(v(p)<v(b))", False),
        ("Ra en n 1k\nB1 p n i=v(en)>0 ? 1u : 0", False),
    ],
)
def test_a_comparison_that_rounding_decides_is_refused(tmp_path, body, refused):
    load = load_of(tmp_path, body)
    assert load.cancelled == ("b1 (load.lib:5)" if refused else "")
    if refused:
        with pytest.raises(LoadError, match="equal up to rounding"):
            check_turn(load, 1e-4)

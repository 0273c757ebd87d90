"""Numbers as SPICE and LTspice write them."""

import pytest

from circuits.netlist.numbers import number


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1.0), (".5", 0.5), ("2.", 2.0), ("-3e-2", -0.03), ("1e3k", 1e6),
        ("2t", 2e12), ("2g", 2e9), ("2meg", 2e6), ("2k", 2e3), ("2m", 2e-3), ("2u", 2e-6),
        ("2n", 2e-9), ("2p", 2e-12), ("2f", 2e-15), ("2mil", 50.8e-6),
        ("2MEG", 2e6), ("2M", 2e-3), ("10kohm", 1e4), ("3megohm", 3e6), ("5volts", 5.0),
        ("4k7", 4700.0), ("2meg2", 2.2e6), ("1u5", 1.5e-6),
    ],
)  # fmt: skip
def test_a_suffix_is_a_power_of_ten(text, value):
    assert number(text) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["", "k", "1 2", "1e999", "{x}", "1..2", "--1"])
def test_what_is_none_is_none(text):
    assert number(text) is None

"""Numbers are written as people print them."""

import decimal
import math
import re

import pytest

from harvester.base.formatting import (
    count,
    prefixed,
    quantity,
    share_with_error,
    value_and_error,
    with_error,
)
from harvester.statistics.estimate import Estimate


def estimate(value, error):
    return Estimate(value, error, None, "power")


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (6.82e-4, 1.2e-5, "W", "682 ± 12 µW"),
        (0.0274512, 0.000123, "", "0.02745 ± 0.00012"),
        (0.0001177601503556, 1.1e-18, "W", "117.760 ± <1e-3 µW"),
        (3.06e-6, 4e-8, "V^2", "3.060 ± 0.040 mV²"),
        (4.56e-7, 1e-8, "(m/s)^2", "0.456 ± 0.010 (mm/s)²"),
        (204100.0, 950.0, "Ω", "204.10 ± 0.95 kΩ"),
        (1500.0, 30.0, "s", "1500 ± 30 s"),
        (2.7e-7, 1e-9, "scaled power", "(2.700 ± 0.010)e-7 scaled power"),
        (1.0, 0.0, "V", "1 V"),
        (0.0, 0.0, "W", "0 W"),
        (32.4e-6, 0.0, "W", "32.4 µW"),
        (1e-14, 6e-7, "W", "0 ± 600 nW"),
        (7e-16, 3e-3, "", "0.0000 ± 0.0030"),
        (4.0, None, "1/s", "4 1/s (no error bar)"),
        (math.nan, None, "W", "—"),
    ],
)
def test_a_value_with_its_error_has_a_prefix_and_two_digits_of_the_error(value, error, unit, text):
    assert with_error(estimate(value, error), unit) == text


def test_written_digits_hold_value_and_error_for_any_sizes():
    """What is read back is within half of the last digit that is written."""
    for power in range(-15, 9):
        for share in (3e-5, 0.004, 0.0996, 0.5, 7.0):
            value, error = 1.2345678 * 10.0**power, share * 1.2345678 * 10.0**power
            text = value_and_error(value, error)
            found = re.fullmatch(r"\(?([-\d.]+) ± ([\d.]+)\)?(?:e(-?\d+))?", text)
            unit = 10.0 ** int(found[3] or 0)
            read, last = float(found[1]) * unit, float(found[2]) * unit
            digit = unit * 10.0 ** decimal.Decimal(found[2]).as_tuple().exponent
            assert abs(read - value) <= 0.51 * digit
            assert abs(last - error) <= 0.51 * digit
            assert len(found[2].replace(".", "").lstrip("0")) in (
                2,
                int(math.log10(max(last / unit, 10.0))) + 1,
            )


def test_shares_and_counts_are_short():
    assert share_with_error(estimate(-0.003, 0.65)) == "0 ± 65 %"
    assert share_with_error(estimate(0.0015, 0.0002)) == "+0.150 ± 0.020 %"
    assert share_with_error(estimate(7e-16, 0.3)) == "0 ± 30 %"
    assert share_with_error(estimate(7e-16, 0.003)) == "0.00 ± 0.30 %"
    assert share_with_error(estimate(0.434564, math.nan)) == "+43.5 % (no error bar)"
    assert count(0.3) == "below 1"
    assert count(9137607) == "9,100,000"
    assert (count(96.4), count(None)) == ("96", "")


def test_prefixes_keep_the_value():
    for unit, power in (("W", 1), ("V^2", 2), ("m/s", 1)):
        for exponent in range(-13, 9):
            value = 2.5 * 10.0**exponent
            factor, shown = prefixed(value, unit)
            letter = shown[0] if shown[1:2].isalpha() else ""
            sizes = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
            assert factor * sizes.get(letter, 1.0) ** power == pytest.approx(1.0)
    assert quantity(27300.0, "Ω") == "27.3 kΩ"
    assert quantity(-0.0) == "0"

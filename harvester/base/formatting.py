"""Formats numbers for reading: two digits of the error, a prefix before the unit.

All numbers for reading are formatted here; JSON and CSV contain full precision.
"""

from __future__ import annotations

import math
from typing import Protocol

NO_ERROR_BAR = " (no error bar)"
# Follows a number that the data do not confirm; the table's legend gives the reason.
UNCERTAIN = " (?)"
# Largest number of digits of a value: further digits are rounding errors.
MOST_DIGITS = 6
PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
# Units that take a prefix. Seconds take only prefixes below 1.
PREFIXED = ("V", "W", "m", "m/s", "s", "J", "A", "Ω", "F", "H", "Hz", "Pa")
SHARES = ("efficiency", "share")
# Numbers from this one on are printed with a power of ten.
LONGEST = 1e7
# Counts above this are rounded to two digits.
ROUNDED_COUNT = 1000.0


class Printed(str):
    """A printed number that keeps its value, its standard error, its unit and its estimate.

    Tables of results contain them: a terminal prints the text, a data frame uses the value.

    >>> power = quantity(2.5e-3, "W")
    >>> power, power.value, power.unit
    ('2.5 mW', 0.0025, 'W')
    """

    value: float
    error: float | None
    unit: str
    ends: tuple[float, float] | None
    estimate: Estimated | None

    def __new__(
        cls,
        text: str,
        value: float = math.nan,
        error: float | None = None,
        unit: str = "",
        ends: tuple[float, float] | None = None,
        estimate: Estimated | None = None,
    ) -> Printed:
        printed = super().__new__(cls, text)
        printed.value, printed.error, printed.unit, printed.ends = value, error, unit, ends
        printed.estimate = estimate
        return printed


NOT_KNOWN = Printed("—")


class Estimated(Protocol):
    """A value with its standard error."""

    @property
    def estimate(self) -> float: ...
    @property
    def standard_error(self) -> float | None: ...


def with_error(estimate: Estimated, unit: str = "") -> Printed:
    """ "682 ± 12 µW", or the value with "(no error bar)"."""
    value, error = estimate.estimate, estimate.standard_error
    if not math.isfinite(value):
        return Printed(NOT_KNOWN, math.nan, None, unit, estimate=estimate)
    factor, symbol = prefixed(largest(estimate), unit)
    text = _value_and_error(factor * value, None if error is None else factor * error)
    bare = text.removesuffix(NO_ERROR_BAR)
    printed = f"{bare} {symbol}".rstrip() + text[len(bare) :]
    return Printed(printed, value, error, unit, estimate=estimate)


def largest(estimate: Estimated) -> float:
    """The larger of a value and its error; it determines the printed format of value and error."""
    sizes = (abs(estimate.estimate), estimate.standard_error or 0.0)
    return max((size for size in sizes if math.isfinite(size)), default=math.nan)


def value_and_error(value: float, error: float | None) -> Printed:
    """ "0.02745 ± 0.00012"; an error of 0 is omitted, one below the value's last digit is shown as
    a bound.

    Examples
    --------
    >>> value_and_error(0.0274512, 0.000123)
    '0.02745 ± 0.00012'
    >>> value_and_error(-0.3, 65.0)
    '0 ± 65'
    >>> value_and_error(0.0001177601503556, 1.1e-18)
    '0.000117760 ± <1e-9'
    >>> value_and_error(32.4, 0.0), value_and_error(7e-14, 0.3)
    ('32.4', '0.00 ± 0.30')
    """
    return Printed(_value_and_error(value, error), value, error)


def _value_and_error(value, error):
    if value is None or not math.isfinite(value):
        return NOT_KNOWN
    if error is None or not math.isfinite(error):
        return f"{_number(value, 3)}{NO_ERROR_BAR}"
    if not error:
        return _number(value, MOST_DIGITS)
    size = max(abs(value), error)
    exponent = math.floor(math.log10(size))
    if not -4 <= exponent < 5:
        scale = 10.0**exponent
        return f"({_value_and_error(value / scale, error / scale)})e{exponent}"
    most = max(0, MOST_DIGITS - 1 - exponent)
    if error < 0.5 * 10.0**-most:
        return f"{value:.{most}f} ± {f'<1e-{most}' if most else '<1'}"
    # The error is rounded first, so that 0.0996 is shown as 0.10.
    places = max(0, 1 - math.floor(math.log10(float(f"{error:.1e}"))))
    text = f"{value:.{places}f}"
    # No sign before a zero.
    return f"{text.lstrip('-') if float(text) == 0.0 else text} ± {error:.{places}f}"


def share_with_error(estimate: Estimated, sign: bool = True) -> Printed:
    """A share in percent: "+0.15 ± 0.02 %"."""
    share, error = estimate.estimate, estimate.standard_error
    if not math.isfinite(share):
        return Printed(NOT_KNOWN)
    value = 100.0 * share
    unknown = bool(getattr(estimate, "note", "")) or (
        error is not None and not math.isfinite(error)
    )
    text = _number(value, 3) if unknown else f"{value:.2f}"
    if error is not None and not unknown:
        text = _value_and_error(value, 100.0 * error)
    plus = "+" if sign and text[0] != "(" and float(text.split()[0]) > 0.0 else ""
    return Printed(f"{plus}{text} %{NO_ERROR_BAR * unknown}", share, error, "1", estimate=estimate)


def prefixed(value: float, unit: str) -> tuple[float, str]:
    """Factor for printing a value, and the unit with its prefix.

    Examples
    --------
    >>> prefixed(6.82e-4, "W"), prefixed(3.06e-6, "V^2"), prefixed(0.5, "scaled power")
    ((1000000.0, 'µW'), (1000000.0, 'mV²'), (1.0, 'scaled power'))
    """
    base, _, raised = unit.partition("^")
    power, symbol = int(raised or 1), base.strip("()")
    if symbol not in PREFIXED or power not in (1, 2) or not value or not math.isfinite(value):
        return 1.0, in_print(unit)
    decades = math.floor(math.log10(abs(value)) + 1e-9)
    if power == 2 and decades < 0:
        # A prefix of a squared unit counts twice: squares between 0.001 and 1e6 have none.
        decades += 3
    exponent = min(max(3 * (decades // (3 * power)), min(PREFIXES)), max(PREFIXES))
    if symbol == "s":
        exponent = min(exponent, 0)
    letter = PREFIXES[exponent]
    return 10.0 ** (-exponent * power), in_print(unit.replace(symbol, letter + symbol, 1))


def in_print(unit: str) -> str:
    """Printed form of a unit: "(m/s)^2" as "(m/s)²"; empty for a dimensionless number."""
    return "" if unit == "1" else unit.replace("^2", "²").replace("^-1", "⁻¹")


def quantity(value: float, unit: str = "", digits: int = 4) -> Printed:
    """ "27.3 kΩ": a value without an error, rounded to `digits` digits."""
    factor, symbol = prefixed(value, unit)
    return Printed(f"{_number(factor * value, digits)} {symbol}".rstrip(), value, None, unit)


def span(low: float, high: float, unit: str = "", digits: int = 4) -> Printed:
    """ "0.5 kΩ … 2 kΩ": both ends of an interval; a dash for an unknown end."""
    if not math.isfinite(low + high):
        return Printed(NOT_KNOWN, unit=unit, ends=(math.nan, math.nan))
    text = f"{quantity(low, unit, digits)} … {quantity(high, unit, digits)}"
    return Printed(text, unit=unit, ends=(low, high))


def engineering(value: float, digits: int = 6) -> Printed:
    """A number in SPICE's notation, without unit; a plain number if that is short enough.

    >>> engineering(1e-5), engineering(16e3), engineering(2.2e6), engineering(0.05)
    ('10u', '16k', '2.2meg', '0.05')
    """
    if 1e-3 <= abs(value) < 1e4 or not value or not math.isfinite(value):
        return number(value, digits)
    factor, volts = prefixed(value, "V")
    letter = {"µV": "u", "MV": "meg"}.get(volts, volts[:-1].lower())
    return Printed(f"{_number(factor * value, digits)}{letter}", value)


def number(value: float, digits: int = 4) -> Printed:
    """A plain number; a dash for NaN and infinity.

    Examples
    --------
    >>> number(139247.7), number(1.392e-5), number(2.5e9)
    ('139200', '1.392e-05', '2.5e+09')
    """
    return Printed(_number(value, digits), value)


def _number(value, digits):
    if not math.isfinite(value):
        return NOT_KNOWN
    text = f"{value + 0.0:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LONGEST else text


def written(value: float, how: str, unit: str = "") -> Printed:
    """A number by a Python format specification; a dash for NaN and infinity.

    >>> written(0.01234, "+.1%"), written(float("nan"), ".3g")
    ('+1.2%', '—')
    """
    return Printed(f"{value:{how}}" if math.isfinite(value) else NOT_KNOWN, value, None, unit)


def signed(value: float, how: str) -> str:
    """A number with its sign by a format specification; a zero has none.

    >>> signed(-0.31, ".1f"), signed(0.04, ".1f"), signed(-0.0001, ".1%")
    ('-0.3', '0.0', '0.0%')
    """
    text = f"{value:+{how}}"
    return text if any(digit in text for digit in "123456789n") else text[1:]


def count(size: float | None) -> Printed:
    """Text of a number of items: "below 1", 96, 9,100,000."""
    if size is None or not math.isfinite(size):
        return Printed("")
    if size < 1.0:
        return Printed("below 1", size)
    exact = size < ROUNDED_COUNT
    return Printed(f"{size:.0f}" if exact else f"{float(f'{size:.1e}'):,.0f}", size)


def is_share(name: str) -> bool:
    """Whether the quantity of this name is printed in percent."""
    return any(word in name for word in SHARES)

"""Reads numbers with SPICE's suffixes: 200k, 4.7meg, 43n."""

from __future__ import annotations

import contextlib
import numbers
import re

POWERS = {"": 0, "k": 3, "meg": 6, "m": -3, "u": -6, "µ": -6, "μ": -6, "n": -9, "p": -12}
# Units that people write after a prefix.
UNITS = ("m", "s", "V", "A", "W", "F", "H", "Hz", "N", "Ω", "ohm", "Ohm", "kg")
_LISTED = "k, meg, m, u, n, p"
_NUMBER = re.compile(
    r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eE]([+-]?\d{1,3}))?(?: ?([a-zA-ZµμΩ]*))", re.ASCII
)


class NotANumber(ValueError):
    """A text is not a number, or is ambiguous; the message gives the correct form."""


def is_real(value: object) -> bool:
    """Whether a value is one real number, Python's or numpy's, and not True or False."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def is_whole(value: object, least: int) -> bool:
    """Whether a value is a whole number ≥ `least`, not True or False."""
    return is_real(value) and isinstance(value, numbers.Integral) and int(value) >= least


def on_quotes(value: object) -> str:
    """A remark on quotes around a number that was given as text.

    >>> on_quotes("0.1"), on_quotes("high")
    ('; write 0.1 without quotes', '')
    """
    with contextlib.suppress(NotANumber):
        return f"; write {number(value):g} without quotes" if isinstance(value, str) else ""
    return ""


def number(text: str, unit: str | None = None) -> float:
    """The number of a text such as "306e3", "200k" or "4.7meg".

    `unit`: required unit of the number; None if any unit is possible. Raises NotANumber.

    Examples
    --------
    >>> number("200k"), number("4.7meg"), number("43n")
    (200000.0, 4700000.0, 4.3e-08)
    """
    match = _NUMBER.fullmatch(text.strip())
    percent = None if match else _NUMBER.fullmatch(text.strip().removesuffix("%"))
    if percent and not percent[3]:
        raise NotANumber(f"write {float(percent[0]) / 100.0:g} for {percent[0].strip()} %")
    if not match:
        raise NotANumber(f"write a number, perhaps followed by one of {_LISTED}")
    digits, exponent, suffix = match.groups()
    if suffix == "M":
        raise NotANumber(f"M is 1e6 in SI and 1e-3 in SPICE: write {digits}meg or {digits}m")
    power = POWERS.get(suffix if suffix in POWERS else suffix.lower())
    if suffix == "g":
        from scipy.constants import g

        value = float(f"{digits}e{exponent or 0}")
        readings = {
            "kg": f"{value / 1e3:g} (kg) for {value:g} grams",
            "m/s²": f"{value * g:g} (m/s²) for {value:g} g of acceleration",
            **dict.fromkeys(("", "1"), f"{value:g}, without the unit g"),
        }
        both = f"{readings['m/s²']}, {readings['kg']}"
        raise NotANumber(f"write {both if unit is None else readings.get(unit, both)}")
    for symbol in UNITS if power is None else ():
        prefix = suffix.removesuffix(symbol)
        if prefix != suffix and prefix in POWERS:
            raise NotANumber(
                f"write {match[0].removesuffix(suffix).rstrip()}{prefix}, without the unit {symbol}"
            )
    if power is None:
        raise NotANumber(f"unknown suffix {suffix}: there are {_LISTED}")
    # Converted as text, so that 200k equals 200e3 to the last digit.
    return float(f"{digits}e{int(exponent or 0) + power}")

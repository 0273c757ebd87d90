"""Numbers in SPICE's notation: suffixes, units after them, LTspice's 4k7."""

from __future__ import annotations

import math
import re

# Suffixes and their powers of ten; `mil`, a thousandth of an inch, is 25.4e-6.
POWERS = {
    "t": 12, "g": 9, "meg": 6, "k": 3, "mil": -6, "m": -3, "u": -6, "n": -9, "p": -12, "f": -15,
}  # fmt: skip
_DIGITS = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?"
NUMBER = re.compile(
    r"([+-]?(?:\d+(?:\.\d*)?|\.\d+))(?:e([+-]?\d+))?(meg|mil|[tgkmunpf])?([a-z_]*)", re.ASCII
)
# Matches LTspice's 4k7, which means 4.7k.
INFIX = re.compile(r"(?<![\w.])(\d+)(meg|[tgkmunp])(\d+)(?![\w.])")
# kT/q at 27 °C (V).
THERMAL_VOLTAGE = 1.380649e-23 * 300.15 / 1.602176634e-19
# ngspice 46 reads a suffix A as atto, version 39 as a unit without a factor.
AMPERE = re.compile(rf"{_DIGITS}a[a-z_]*", re.ASCII)
THOUSANDTH_OF_AN_INCH = re.compile(rf"{_DIGITS}mil[a-z_]*", re.ASCII)


def number(text: str) -> float | None:
    """Convert a SPICE number like "100k" or "4k7" to a float; None if it is not a number."""
    match = NUMBER.fullmatch(INFIX.sub(r"\1.\3\2", text.strip().lower()))
    if not match or AMPERE.fullmatch(text.strip().lower()):
        return None
    digits, exponent, suffix, _ = match.groups()
    power = int(exponent or 0) + POWERS.get(suffix, 0)
    value = float(f"{digits}e{power}") * (25.4 if suffix == "mil" else 1.0)
    return value if math.isfinite(value) else None

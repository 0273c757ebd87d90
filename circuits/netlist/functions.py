"""Functions and operators of SPICE expressions: a table of values, slopes and spellings.

Definitions follow ngspice 46 in a behavioural source. `circuits.netlist.expression_graph`
compiles values and slopes; Python uses the same functions for constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

# In ngspice's sources exp() is LARGEST_EXPONENTIAL above this exponent.
LARGEST_EXPONENT, LARGEST_EXPONENTIAL = 227.9559242, 1e99
# ngspice adds this to a divisor, so that x/0 is 1e32 x and 0/0 is 0.
LEAST_DIVISOR = 1e-32
# Tolerance below 0 of a root's argument, since Newton's iterations approach 0 from both sides.
ROUNDING = 1e-12


class Operation(NamedTuple):
    """One function or operator.

    Attributes
    ----------
    ngspice, ltspice : notation in each program.
    value : Python expression of the arguments a and b; nan outside the domain.
    slopes : derivatives by a and b, which may use the value `result`; 0 at a jump.
    """

    ngspice: str
    ltspice: str
    value: str
    slopes: tuple[str, str]

    @property
    def arguments(self) -> int:
        """Number of arguments."""
        return self.ngspice.count("{")


def _operation(
    form: str, value: str, first: str = "0.0", second: str = "0.0", ltspice: str = ""
) -> Operation:
    return Operation(form, ltspice or form, value, (first, second))


def _condition(form: str, holds: str, ltspice: str = "") -> Operation:
    """1 if a condition of a and b is true, else 0; NaN gives NaN."""
    value = f"np.nan if np.isnan(a) or np.isnan(b) else 1.0 if {holds} else 0.0"
    return _operation(form, value, ltspice=ltspice)


# Functions of one argument with the same name in all programs: value and slope.
_OF_ONE = {
    "abs": ("abs(a)", "np.sign(a)"),
    "exp": (f"np.exp(a) if a <= {LARGEST_EXPONENT} else {LARGEST_EXPONENTIAL}", "result"),
    "ln": ("np.log(max(a, 1e-99)) if a >= 0.0 else np.nan", "1.0 / max(a, 1e-99)"),
    "sqrt": (f"np.sqrt(max(a, 0.0)) if a >= -{ROUNDING} else np.nan", "0.5 / max(result, 1e-15)"),
    "sin": ("np.sin(a)", "np.cos(a)"), "cos": ("np.cos(a)", "-np.sin(a)"),
    "tan": ("np.tan(a)", "1.0 + result * result"), "atan": ("np.arctan(a)", "1.0 / (1.0 + a * a)"),
    "sinh": ("np.sinh(a)", "np.cosh(a)"), "cosh": ("np.cosh(a)", "np.sinh(a)"),
    "tanh": ("np.tanh(a)", "1.0 - result * result"),
    "sgn": ("np.sign(a)", "0.0"), "floor": ("np.floor(a)", "0.0"), "ceil": ("np.ceil(a)", "0.0"),
    "u": ("np.nan if np.isnan(a) else 0.5 if a == 0.0 else 1.0 if a > 0.0 else 0.0", "0.0"),
    "uramp": ("np.nan if np.isnan(a) else max(a, 0.0)", "1.0 if a > 0.0 else 0.0"),
    "asinh": ("np.arcsinh(a)", "1.0 / np.sqrt(1.0 + a * a)"),
    "asin": ("np.arcsin(a) if abs(a) <= 1.0 else np.nan",
             "1.0 / np.sqrt(max(1.0 - a * a, 1e-15))"),
    "acos": ("np.arccos(a) if abs(a) <= 1.0 else np.nan",
             "-1.0 / np.sqrt(max(1.0 - a * a, 1e-15))"),
    "acosh": ("np.arccosh(a) if a >= 1.0 else np.nan",
              "1.0 / np.sqrt(max(a * a - 1.0, 1e-15))"),
    "atanh": ("np.arctanh(a) if abs(a) < 1.0 else np.nan", "1.0 / max(1.0 - a * a, 1e-15)"),
}  # fmt: skip
_ALONG, _ACROSS = "b * max(abs(a), 1e-30) ** (b - 1.0)", "result * np.log(max(abs(a), 1e-30))"
OPERATIONS: dict[str, Operation] = {
    "+": _operation("{0}+{1}", "a + b", "1.0", "1.0"),
    "-": _operation("{0}-{1}", "a - b", "1.0", "-1.0"),
    "*": _operation("{0}*{1}", "a * b", "b", "a"),
    "/": _operation("{0}/{1}", "a / divisor(b)", "1.0 / divisor(b)", "-result / divisor(b)"),
    "^": _operation("pow({0},{1})", "abs(a) ** b", f"{_ALONG} * np.sign(a)", _ACROSS,
                    "pwr({0},{1})"),
    "pwr": _operation("pwr({0},{1})", "np.sign(a) * abs(a) ** b", _ALONG, _ACROSS,
                      "pwrs({0},{1})"),
    "negative": _operation("-{0}", "-a", "-1.0"),
    "max": _operation("max({0},{1})", "max(a, b)", "1.0 if a >= b else 0.0",
                      "0.0 if a >= b else 1.0"),
    "min": _operation("min({0},{1})", "min(a, b)", "1.0 if a <= b else 0.0",
                      "0.0 if a <= b else 1.0"),
    # Has a third argument: see `folded` and `expression_graph.evaluate`.
    "if": _operation("ternary_fcn({0},{1},{2})", "b", ltspice="if({0},{1},{2})"),
    "<": _condition("{0}<{1}", "a < b"), "<=": _condition("{0}<={1}", "a <= b"),
    "==": _condition("{0}=={1}", "a == b", "((({0})>=({1}))*(({0})<=({1})))"),
    "and": _condition("{0}&&{1}", "a != 0.0 and b != 0.0", "(({0})&({1}))"),
    "or": _condition("{0}||{1}", "a != 0.0 or b != 0.0", "(({0})|({1}))"),
    "not": _operation("!{0}", "np.nan if np.isnan(a) else 1.0 if a == 0.0 else 0.0",
                      ltspice="(1-{0})"),
    "nint": _operation("nint({0})", "np.rint(a)", ltspice="round({0})"),
    **{name: _operation(f"{name}({{0}})", *rules) for name, rules in _OF_ONE.items()},
}  # fmt: skip
# Operations with a limited domain.
LIMITED = {"ln", "sqrt", "asin", "acos", "acosh", "atanh", "^", "pwr"}
CODES = {name: code for code, name in enumerate(OPERATIONS)}


def folded(name: str, arguments: list[float]) -> float:
    """The value of an operation on constants; nan if it is undefined."""
    with np.errstate(all="ignore"):
        a, b, c = (np.float64(argument) for argument in (*arguments, 0.0, 0.0)[:3])
        if name == "if":
            return float(b if a != 0.0 else c)
        return float(value(CODES[name], a, b))


def divisor(b: float) -> float:
    """The divisor that ngspice uses instead of b: moved away from 0."""
    return b + LEAST_DIVISOR if b >= 0.0 else b - LEAST_DIVISOR


def _function(name: str, arguments: str, results: list[str]) -> Callable[..., Any]:
    """A function that evaluates the expression with the number `code`."""
    *first, last = results
    lines = [f"    if code == {code}:\n        return {text}" for code, text in enumerate(first)]
    lines.append(f"    return {last}")
    names = {"np": np, "divisor": divisor, "__name__": __name__}
    exec("\n".join([f"def {name}(code, {arguments}):", *lines]), names)
    return names[name]  # type: ignore[return-value]


_OPERATIONS = OPERATIONS.values()
# value(code, a, b), and slope(code, a, b, result): the slopes in a and b.
value = _function("value", "a, b", [operation.value for operation in _OPERATIONS])
slope = _function("slope", "a, b, result", [", ".join(o.slopes) for o in _OPERATIONS])

# Functions of this module that compiled code calls.
COMPILED = (divisor, value, slope)
# Names of constants, without quantities that change with time.
CONSTANTS = {
    "pi": math.pi, "e": math.e, "boltz": 1.38064852e-23, "echarge": 1.6021766208e-19,
    "planck": 6.62607004e-34, "c": 2.99792458e8, "kelvin": -273.15, "temper": 27.0,
}  # fmt: skip
# Names of quantities that change during a run; parameters cannot have these names.
VARYING = {"time", "temper", "hertz"}
# Functions of the circuit's solution.
SOLUTION = {"v", "i"}

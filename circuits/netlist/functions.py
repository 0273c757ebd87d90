"""Functions and operators of SPICE expressions: one table gives value, slope and spelling.

Their meaning is ngspice 46's in a behavioural source. `circuits.netlist.expression_graph` compiles
values and slopes; Python calls the same functions for constants.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

# ngspice's exp() of a source is LARGEST_EXPONENTIAL beyond this exponent.
LARGEST_EXPONENT, LARGEST_EXPONENTIAL = 227.9559242, 1e99
# ngspice adds this to a divisor, so that x/0 is 1e32 x and 0/0 is 0.
LEAST_DIVISOR = 1e-32
# The argument of a root may be so far below 0, since Newton's iterations approach 0 from both
# sides.
ROUNDING = 1e-12


class Operation(NamedTuple):
    """One function or operator: how many arguments it takes, how ngspice and LTspice write it."""

    arguments: int
    ngspice: str
    ltspice: str


def _named(name, arguments=1, ltspice=None):
    def call(word):
        return f"{word}({','.join(f'{{{k}}}' for k in range(arguments))})"

    return Operation(arguments, call(name), call(ltspice or name))


def _infix(sign, ltspice=None):
    return Operation(2, f"{{0}}{sign}{{1}}", ltspice or f"{{0}}{sign}{{1}}")


_SAME = "((({0})>=({1}))*(({0})<=({1})))"
# Operations in the order of the codes below.
OPERATIONS: dict[str, Operation] = {
    "+": _infix("+"), "-": _infix("-"), "*": _infix("*"), "/": _infix("/"),
    "^": _named("pow", 2, "pwr"), "pwr": _named("pwr", 2, "pwrs"),
    "negative": Operation(1, "-{0}", "-{0}"), "abs": _named("abs"), "exp": _named("exp"),
    "ln": _named("ln"), "sqrt": _named("sqrt"), "sin": _named("sin"), "cos": _named("cos"),
    "tan": _named("tan"), "atan": _named("atan"), "sinh": _named("sinh"), "cosh": _named("cosh"),
    "tanh": _named("tanh"), "max": _named("max", 2), "min": _named("min", 2),
    "if": _named("ternary_fcn", 3, "if"), "<": _infix("<"), "<=": _infix("<="),
    "==": _infix("==", _SAME), "and": _infix("&&", "(({0})&({1}))"),
    "or": _infix("||", "(({0})|({1}))"), "not": Operation(1, "!{0}", "(1-{0})"),
    "sgn": _named("sgn"), "floor": _named("floor"), "ceil": _named("ceil"), "u": _named("u"),
    "uramp": _named("uramp"),
    "asinh": _named("asinh"), "asin": _named("asin"), "acos": _named("acos"),
    "acosh": _named("acosh"), "atanh": _named("atanh"), "nint": _named("nint", 1, "round"),
}  # fmt: skip
# Operations that are not defined everywhere.
LIMITED = {"ln", "sqrt", "asin", "acos", "acosh", "atanh", "^", "pwr"}
CODES = {name: code for code, name in enumerate(OPERATIONS)}
(
    ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, SIGNED_POWER, NEGATIVE, ABSOLUTE, EXPONENTIAL,
    LOGARITHM, ROOT, SINE, COSINE, TANGENT, ARC_TANGENT, HYPERBOLIC_SINE, HYPERBOLIC_COSINE,
    HYPERBOLIC_TANGENT, GREATER, LESSER, CHOICE, BELOW, NOT_ABOVE, EQUAL, AND, OR, NOT, SIGN,
    FLOOR, CEILING, STEP, RAMP, AREA_SINE, ARC_SINE, ARC_COSINE, AREA_COSINE, AREA_TANGENT, NEAREST,
) = range(len(OPERATIONS))  # fmt: skip


def folded(name: str, arguments: list[float]) -> float:
    """The value of an operation on constants; nan where it has none."""
    with np.errstate(all="ignore"):
        a, b, c = (np.float64(argument) for argument in (*arguments, 0.0, 0.0)[:3])
        if name == "if":
            return float(b if a != 0.0 else c)
        return float(value(CODES[name], a, b))


def value(code: int, a: float, b: float) -> float:
    """Value of an operation; nan outside its range."""
    if code <= NEGATIVE:
        return _arithmetic(code, a, b)
    if GREATER <= code <= RAMP:
        return _piecewise(code, a, b)
    return _elementary(code, a)


def _arithmetic(code, a, b):
    if code == ADD:
        return a + b
    if code == SUBTRACT:
        return a - b
    if code == MULTIPLY:
        return a * b
    if code == DIVIDE:
        return a / divisor(b)
    if code == POWER:
        return abs(a) ** b
    if code == SIGNED_POWER:
        return np.sign(a) * abs(a) ** b
    return -a


def divisor(b: float) -> float:
    """The divisor that ngspice uses instead of b: moved away from 0."""
    return b + LEAST_DIVISOR if b >= 0.0 else b - LEAST_DIVISOR


def _piecewise(code, a, b):
    """Value of a function that compares, or is straight between corners."""
    if code == GREATER:
        return max(a, b)
    if code == LESSER:
        return min(a, b)
    if code == SIGN:
        return np.sign(a)
    if code == FLOOR:
        return np.floor(a)
    if code == CEILING:
        return np.ceil(a)
    # NaN is neither true nor false.
    if np.isnan(a) or (code != NOT and code != STEP and code != RAMP and np.isnan(b)):
        return np.nan
    if code == STEP:
        return 0.5 if a == 0.0 else (1.0 if a > 0.0 else 0.0)
    if code == RAMP:
        return max(a, 0.0)
    holds = (
        (code == BELOW and a < b)
        or (code == NOT_ABOVE and a <= b)
        or (code == EQUAL and a == b)
        or (code == AND and a != 0.0 and b != 0.0)
        or (code == OR and (a != 0.0 or b != 0.0))
        or (code == NOT and a == 0.0)
    )
    return 1.0 if holds else 0.0


def _elementary(code, a):
    if code == ABSOLUTE:
        return abs(a)
    if code == EXPONENTIAL:
        return np.exp(a) if a <= LARGEST_EXPONENT else LARGEST_EXPONENTIAL
    if code == SINE:
        return np.sin(a)
    if code == COSINE:
        return np.cos(a)
    if code == TANGENT:
        return np.tan(a)
    if code == ARC_TANGENT:
        return np.arctan(a)
    if code == HYPERBOLIC_SINE:
        return np.sinh(a)
    if code == HYPERBOLIC_COSINE:
        return np.cosh(a)
    if code == HYPERBOLIC_TANGENT:
        return np.tanh(a)
    if code == AREA_SINE:
        return np.arcsinh(a)
    if code == NEAREST:
        return np.rint(a)
    return _of_a_range(code, a)


def _of_a_range(code, a):
    """Value of a function with a limited domain."""
    if code == LOGARITHM and a >= 0.0:
        return np.log(max(a, 1e-99))
    if code == ROOT and a >= -ROUNDING:
        return np.sqrt(max(a, 0.0))
    if code == ARC_SINE and abs(a) <= 1.0:
        return np.arcsin(a)
    if code == ARC_COSINE and abs(a) <= 1.0:
        return np.arccos(a)
    if code == AREA_COSINE and a >= 1.0:
        return np.arccosh(a)
    if code == AREA_TANGENT and abs(a) < 1.0:
        return np.arctanh(a)
    return np.nan


def slope(code: int, a: float, b: float, result: float) -> Any:
    """Slopes of an operation in its first and second argument, its value being known."""
    if code <= SIGNED_POWER:
        return _slopes_of_two(code, a, b, result)
    if code == GREATER:
        return (1.0, 0.0) if a >= b else (0.0, 1.0)
    if code == LESSER:
        return (1.0, 0.0) if a <= b else (0.0, 1.0)
    if code == NEGATIVE:
        return -1.0, 0.0
    if code == ABSOLUTE:
        return np.sign(a), 0.0
    if code == RAMP:
        return (1.0 if a > 0.0 else 0.0), 0.0
    if BELOW <= code <= STEP or code == NEAREST:
        # A jump counts as slope 0.
        return 0.0, 0.0
    return _slope_of_one(code, a, result), 0.0


def _slopes_of_two(code, a, b, result):
    if code == ADD:
        return 1.0, 1.0
    if code == SUBTRACT:
        return 1.0, -1.0
    if code == MULTIPLY:
        return b, a
    if code == DIVIDE:
        return 1.0 / divisor(b), -result / divisor(b)
    size = max(abs(a), 1e-30)
    along = b * size ** (b - 1.0)
    across = result * np.log(size)
    return (along * np.sign(a), across) if code == POWER else (along, across)


def _slope_of_one(code, a, result):
    if code == EXPONENTIAL:
        return result
    if code == LOGARITHM:
        return 1.0 / max(a, 1e-99)
    if code == ROOT:
        return 0.5 / max(result, 1e-15)
    if code == SINE:
        return np.cos(a)
    if code == COSINE:
        return -np.sin(a)
    if code == TANGENT:
        return 1.0 + result * result
    if code == ARC_TANGENT:
        return 1.0 / (1.0 + a * a)
    if code == HYPERBOLIC_SINE:
        return np.cosh(a)
    if code == HYPERBOLIC_COSINE:
        return np.sinh(a)
    if code == HYPERBOLIC_TANGENT:
        return 1.0 - result * result
    if code == AREA_SINE:
        return 1.0 / np.sqrt(1.0 + a * a)
    if code == AREA_COSINE:
        return 1.0 / np.sqrt(max(a * a - 1.0, 1e-15))
    if code == AREA_TANGENT:
        return 1.0 / max(1.0 - a * a, 1e-15)
    size = 1.0 / np.sqrt(max(1.0 - a * a, 1e-15))
    return size if code == ARC_SINE else -size


# Functions of this module that compiled code calls.
COMPILED = (
    value, _arithmetic, divisor, _piecewise, _elementary, _of_a_range, slope, _slopes_of_two,
    _slope_of_one,
)  # fmt: skip
# Names of constants. Quantities that change with time are not among them.
CONSTANTS = {
    "pi": math.pi, "e": math.e, "boltz": 1.38064852e-23, "echarge": 1.6021766208e-19,
    "planck": 6.62607004e-34, "c": 2.99792458e8, "kelvin": -273.15, "temper": 27.0,
}  # fmt: skip
# Names of quantities that change during a run. A parameter cannot take these names.
VARYING = {"time", "temper", "hertz"}
# Functions of the circuit's solution.
SOLUTION = {"v", "i"}

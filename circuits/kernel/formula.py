"""Expressions of netlists as trees, with ngspice's meaning: parsed and put into numbers.

A tree is a tuple: ("number", x), ("name", n), ("v", node, node), ("i", source), or
(operation, *trees) with a name of `OPERATIONS`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from circuits.loads.vetting import number

# Names that stand for a number of the circuit; what changes with time is no constant.
CONSTANTS = {
    "pi": math.pi, "e": math.e, "boltz": 1.38064852e-23, "echarge": 1.6021766208e-19,
    "planck": 6.62607004e-34, "c": 2.99792458e8, "kelvin": -273.15, "temper": 27.0,
}  # fmt: skip


def _power(x, y):
    """ngspice's ^, ** and, of a circuit's quantities, pow(): the size of x to the y."""
    return math.pow(abs(x), y)


def _signed_power(x, y):
    return math.copysign(math.pow(abs(x), y), x) if x else 0.0


def _ramp(x):
    return max(x, 0.0)


# In the order of the compiled code, `circuits.kernel.tape`.
OPERATIONS: dict[str, Callable] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b if b else math.inf,
    "^": _power,
    "pwr": _signed_power,
    "negative": lambda a: -a,
    "abs": abs,
    "exp": lambda a: math.exp(min(a, 700.0)),
    "ln": lambda a: math.log(a),
    "sqrt": lambda a: math.sqrt(a),
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "atan": math.atan,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "max": max,
    "min": min,
    "if": lambda c, a, b: a if c else b,
    "<": lambda a, b: float(a < b),
    "<=": lambda a, b: float(a <= b),
    "==": lambda a, b: float(a == b),
    "and": lambda a, b: float(bool(a) and bool(b)),
    "or": lambda a, b: float(bool(a) or bool(b)),
    "not": lambda a: float(not a),
    "sgn": lambda a: float((a > 0) - (a < 0)),
    "floor": lambda a: float(math.floor(a)),
    "ceil": lambda a: float(math.ceil(a)),
    "u": lambda a: float(a > 0),
    "uramp": _ramp,
    "asinh": math.asinh,
    "asin": math.asin,
    "acos": math.acos,
}
# Functions of the same value under another name, or made of others.
_SAME = {"log": "ln", "pow": "^", "ternary_fcn": "if"}
_MADE = {
    "log10": lambda x: ("/", ("ln", x), ("number", math.log(10.0))),
    "u2": lambda x: ("min", ("max", x, ("number", 0.0)), ("number", 1.0)),
}
_TOKEN = re.compile(
    r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?[a-z]*)|(?P<name>[a-z_][\w.#]*)"
    r"|(?P<operator>\*\*|&&|\|\||[<>=!]=|<>|[-+*/^<>?:,()!~%])"
)
_BINARY = (
    {"||": "or"},
    {"&&": "and"},
    {"==": "==", "!=": "!=", "<>": "!=", "<": "<", ">": ">", "<=": "<=", ">=": ">="},
    {"+": "+", "-": "-"},
    {"*": "*", "/": "/", "%": "%"},
)


class NotTaken(Exception):
    """What the compiled engine does not take, in a few words."""


class _Parser:
    """One expression, from the loosest operator to the tightest."""

    def __init__(self, text):
        self.tokens = []
        place = 0
        text = text.strip().lower().replace(" ", "")
        while place < len(text):
            match = _TOKEN.match(text, place)
            if not match:
                raise NotTaken(f"the character {text[place]!r} in an expression")
            self.tokens.append((match.lastgroup, match.group()))
            place = match.end()
        self.tokens.append(("end", ""))
        self.place = 0

    def peek(self):
        return self.tokens[self.place][1] if self.tokens[self.place][0] != "end" else ""

    def take(self, text=None):
        kind, found = self.tokens[self.place]
        if text is not None and found != text:
            raise NotTaken(f"an expression with {found or 'its end'!r} where {text!r} is expected")
        self.place += 1
        return kind, found

    def whole(self):
        tree = self.choice()
        if self.tokens[self.place][0] != "end":
            raise NotTaken(f"an expression with {self.peek()!r} at an odd place")
        return tree

    def choice(self):
        condition = self.binary(0)
        if self.peek() != "?":
            return condition
        self.take()
        yes = self.choice()
        self.take(":")
        return ("if", condition, yes, self.choice())

    def binary(self, level):
        if level == len(_BINARY):
            return self.signed()
        tree = self.binary(level + 1)
        while self.tokens[self.place][0] == "operator" and self.peek() in _BINARY[level]:
            operator = _BINARY[level][self.take()[1]]
            tree = _compared(operator, tree, self.binary(level + 1))
        return tree

    def signed(self):
        sign = self.peek()
        if sign in ("-", "+", "!", "~") and self.tokens[self.place][0] == "operator":
            self.take()
            inner = self.signed()
            return inner if sign == "+" else ("negative" if sign == "-" else "not", inner)
        tree = self.atom()
        while self.peek() in ("^", "**"):
            self.take()
            exponent = self.signed_atom()
            tree = ("^", tree, exponent)
        return tree

    def signed_atom(self):
        if self.peek() in ("-", "+"):
            sign = self.take()[1]
            inner = self.signed_atom()
            return inner if sign == "+" else ("negative", inner)
        return self.atom()

    def atom(self):
        kind, text = self.take()
        if kind == "number":
            value = number(text)
            if value is None:
                raise NotTaken(f"the number {text}")
            return ("number", value)
        if text == "(":
            tree = self.choice()
            self.take(")")
            return tree
        if kind != "name":
            raise NotTaken(f"an expression with {text or 'its end'!r} where a value is expected")
        if self.peek() != "(":
            return ("name", text)
        self.take("(")
        if text in ("v", "i"):
            return self.solution(text)
        arguments = [self.choice()]
        while self.peek() == ",":
            self.take()
            arguments.append(self.choice())
        self.take(")")
        return ("call", text, *arguments)

    def solution(self, which):
        """v(a), v(a,b) or i(source): names of nodes may begin with a digit."""
        names = []
        while True:
            name = ""
            while self.peek() not in (",", ")", ""):
                name += self.take()[1]
            names.append(name)
            if self.take()[1] != ",":
                break
        if which == "i":
            return ("i", names[0])
        return ("v", names[0], names[1] if len(names) > 1 else "0")


def _compared(operator, left, right):
    if operator in (">", ">="):
        return (operator.replace(">", "<"), right, left)
    if operator == "!=":
        return ("not", ("==", left, right))
    return (operator, left, right)


def parse(text: str) -> tuple[Any, ...]:
    """The tree of an expression, its functions not yet looked up.

    Raises
    ------
    NotTaken
    """
    return _Parser(text).whole()


def resolved(
    tree: tuple[Any, ...], name_of: Callable, function_of: Callable, signed_power: bool = False
) -> tuple[Any, ...]:
    """The tree with its names and functions looked up, constants put into numbers.

    Parameters
    ----------
    tree : tuple
        Of `parse`.
    name_of : callable
        A name's tree.
    function_of : callable
        A function's (arguments, expression, name_of), or None where the file has none of this name.
    signed_power : bool
        Of a parameter's value, where pow() keeps the sign and pwr() does not.

    Raises
    ------
    NotTaken
    """
    kind = tree[0]
    if kind in ("number", "v", "i"):
        return tree
    if kind == "name":
        return name_of(tree[1])
    if kind != "call":
        parts = [resolved(part, name_of, function_of, signed_power) for part in tree[1:]]
        return _folded(kind, parts)
    name = tree[1]
    arguments = [resolved(part, name_of, function_of, signed_power) for part in tree[2:]]
    own = function_of(name)
    if own is not None:
        names, expression, outer = own
        given: Mapping = dict(zip(names, arguments, strict=True))
        return resolved(
            parse(expression),
            lambda each: given[each] if each in given else outer(each),
            function_of,
            signed_power,
        )
    if signed_power and name in ("pow", "pwr"):
        name = {"pow": "c_pow", "pwr": "^"}[name]
        if name == "c_pow":
            return ("number", math.pow(*(_number(each) for each in arguments)))
    name = _SAME.get(name, name)
    if name in _MADE:
        return _fold_all(_MADE[name](*arguments))
    if name == "nint" and all(each[0] == "number" for each in arguments):
        return ("number", float(round(arguments[0][1])))
    return _folded(name, arguments)


def _fold_all(tree):
    if tree[0] in ("number", "v", "i"):
        return tree
    return _folded(tree[0], [_fold_all(part) for part in tree[1:]])


def _number(tree):
    if tree[0] != "number":
        raise NotTaken("a value that changes while the circuit runs")
    return tree[1]


def _folded(name, parts):
    if name == "%":
        # Of numbers alone: it has no place in the compiled code.
        parts = [("number", _number(each)) for each in parts]
    elif name not in OPERATIONS:
        raise NotTaken(f"the function {name}()")
    if all(part[0] == "number" for part in parts):
        try:
            function = math.fmod if name == "%" else OPERATIONS[name]
            return ("number", float(function(*(part[1] for part in parts))))
        except (ValueError, OverflowError):
            raise NotTaken(f"{name} of a number that has none") from None
    if name == "if" and parts[0][0] == "number":
        return parts[1] if parts[0][1] else parts[2]
    return (name, *parts)

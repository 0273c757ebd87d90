"""Checks of a netlist's text before ngspice sees it: some mistakes abort its whole process."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import TYPE_CHECKING

from harvester.errors import NetlistError
from harvester.files.plain_text import nearest

if TYPE_CHECKING:
    pass

FUNCTIONS = {
    "abs", "acos", "acosh", "asin", "asinh", "atan", "atanh", "ceil", "cos", "cosh", "ddt",
    "exp", "floor", "i", "ln", "log", "log10", "max", "min", "nint", "pow", "pwl", "pwr",
    "sgn", "sin", "sinh", "sqrt", "tan", "tanh", "ternary_fcn", "u", "u2", "uramp", "v",
}  # fmt: skip
# How many arguments they take where it is not one; of another number ngspice crashes.
ARGUMENTS = {
    "max": (2,), "min": (2,), "pow": (2,), "pwr": (2,), "ternary_fcn": (3,), "v": (1, 2),
    "pwl": range(5, 10_000, 2),
}  # fmt: skip
# Functions of other SPICEs, and what says the same here.
ELSEWHERE = {
    "if": "condition ? then : otherwise", "int": "sgn(x)*floor(abs(x))",
    "limit": "max(low, min(x, high))", "sign": "sgn(x)", "table": "pwl(x, …)",
}  # fmt: skip
NAMES = {"time", "temper", "hertz", "pi", "e", "boltz", "echarge", "planck", "c", "kelvin"}
# What changes while ngspice runs, whatever a parameter of that name says.
VARYING = {"time", "temper", "hertz"}
# Functions of the circuit's solution.
SOLUTION = {"v", "i"}
# Parentheses within parentheses: ngspice's parser and ours have an end.
DEEPEST_PARENTHESES = 100
# A card that would let a netlist run programs or write files.
REFUSED_CARDS = (".control", ".endc", ".csparam", ".measure", ".meas", ".write", ".print", ".plot")

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:e[+-]?\d+)?[a-z]*|\.\d+(?:e[+-]?\d+)?[a-z]*)"
    r"|(?P<name>[a-z_][\w.#]*)|(?P<operator>\*\*|&&|\|\||[<>=!]=|[-+*/^<>?:,()!~%]))"
)


def check_netlist(text: str) -> None:
    """Refuse what would crash ngspice or let the netlist act outside it.

    Raises
    ------
    NetlistError
        One line with the card, the fault and the nearest valid name.
    """
    for card in _cards(text):
        first = card.split(maxsplit=1)[0].lower()
        if first in REFUSED_CARDS:
            raise NetlistError(f"netlist: {first} is not accepted: a netlist is data, no program")
        if first.startswith("b"):
            check_behavioural(card)


def check_behavioural(card: str) -> None:
    """Check the expression of one `B` card."""
    match = re.match(r"(\S+)\s+\S+\s+\S+\s+[iv]\s*=\s*(.*)$", card, re.IGNORECASE | re.DOTALL)
    if not match:
        raise NetlistError(f"netlist: {card[:40]!r}: write it as 'Bname n+ n- i=expression'")
    name, expression = match.group(1), match.group(2).strip()
    fault = expression_fault(expression)
    if fault:
        raise NetlistError(f"netlist: {name}: {fault} in {expression[:60]!r}")


def expression_fault(
    expression: str, parameters: Collection[str] = (), functions: Collection[str] = ()
) -> str:
    """What is wrong with an expression, or an empty string.

    Parameters
    ----------
    expression : str
    parameters, functions : collections of str
        Names that mean something beside ngspice's own, in lower case.
    """
    tokens = []
    position = 0
    lowered = expression.strip().lower().strip("{}'\"").rstrip()
    while position < len(lowered):
        match = _TOKEN.match(lowered, position)
        if not match:
            return f"unexpected character {lowered[position]!r}"
        kind = str(match.lastgroup)
        tokens.append((kind, match.group(kind)))
        position = match.end()
    return (
        _parentheses(tokens)
        or _names(tokens, parameters, functions)
        or _order(tokens)
        or _arguments(tokens, functions)
    )


def _parentheses(tokens):
    depth = questions = 0
    for _, text in tokens:
        depth += (text == "(") - (text == ")")
        if depth > DEEPEST_PARENTHESES:
            return f"parentheses nest deeper than {DEEPEST_PARENTHESES}"
        questions += (text == "?") - (text == ":")
        if depth < 0:
            return "a closing parenthesis too many"
        if questions < 0:
            return "a ':' without its '?'"
    if depth:
        return f"{depth} closing parenthes{'is' if depth == 1 else 'es'} missing"
    return "a '?' without its ':'" if questions else ""


def _names(tokens, parameters, functions):
    """Unknown functions; node names inside v(…) and i(…) are free."""
    inside = False
    for index, (kind, text) in enumerate(tokens):
        following = tokens[index + 1][1] if index + 1 < len(tokens) else ""
        if text == ")":
            inside = False
        if kind != "name" or inside:
            continue
        if following == "(":
            if text not in FUNCTIONS and text not in functions:
                known = {*FUNCTIONS, *functions}
                hint = f"; write {ELSEWHERE[text]}" if text in ELSEWHERE else nearest(text, known)
                return f"unknown function {text[:60]}{hint}"
            inside = text in ("v", "i")
        elif text not in NAMES and text not in parameters:
            return f"unknown name {text[:60]}"
    return ""


def _arguments(tokens, functions):
    """Numbers of arguments that ngspice's own functions do not take."""
    opened = []
    for index, (_, text) in enumerate(tokens):
        if text == "(":
            opened.append([tokens[index - 1][1] if index else "", 1])
        elif text == "," and opened:
            opened[-1][1] += 1
        elif text == ")":
            name, count = opened.pop()
            if name in FUNCTIONS and name not in functions:
                expected = ARGUMENTS.get(name, (1,))
                if count not in expected:
                    return f"{name} takes {expected[0]} arguments, not {count}"
    return ""


def _order(tokens):
    """Operators and operands must alternate."""
    operand_expected = True
    for index, (kind, text) in enumerate(tokens):
        if kind in ("number", "name"):
            if not operand_expected:
                return f"missing operator before {text[:60]!r}"
            following = tokens[index + 1][1] if index + 1 < len(tokens) else ""
            operand_expected = kind == "name" and following == "("
        elif text == "(":
            operand_expected = True
        elif text == ")":
            if operand_expected:
                return "missing operand before ')'"
        elif not (operand_expected and text in "+-!~"):
            if operand_expected:
                return f"missing operand before {text!r}"
            operand_expected = True
    return "missing operand at the end" if operand_expected else ""


def _cards(text):
    """Cards with continuation lines joined, without comments and the title."""
    cards = []
    for line in text.splitlines()[1:]:
        stripped = line.strip()
        if not stripped or stripped.startswith("*"):
            continue
        if stripped.startswith("+") and cards:
            cards[-1] += " " + stripped[1:]
        else:
            cards.append(stripped)
    return cards

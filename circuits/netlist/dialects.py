"""Expressions of LTspice and PSpice in ngspice's syntax, and detection of their files."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Mapping

from circuits.netlist.expression import (
    TIGHTNESS,
    ZERO,
    ExpressionError,
    Parser,
    Tree,
    parse,
    truth,
    written,
)
from circuits.netlist.reader import Card

NGSPICE, LTSPICE, PSPICE = DIALECTS = ("ngspice", "ltspice", "pspice")
_LOGIC = {"&": "and", "&&": "and", "|": "or", "||": "or"}
# Words that occur in only one of the programs.
_MARKS = {
    LTSPICE: re.compile(
        r"\b(if|buf|inv|int|hypot|pwrs|round|limit)\(|\b(rser|rpar|cpar|mfg|iave|vpk)=|\b[vi]h=-"
    ),
    PSPICE: re.compile(r"^\.model \S+ [vi]switch|\bstp\(|\bvalue ?\{"),
}
# Matches the expressions of a card: in braces, or after `i=` or `v=` of a B source.
_EXPRESSION = re.compile(r"\{([^{}]*)\}|^b\S* \S+ \S+ [iv]=([^{}]+)$")


class _Foreign(Parser):
    """Parser for LTspice and PSpice: values above 0.5 are true, ^ is exclusive or."""

    tightness: Mapping[str, int] = {**TIGHTNESS, "&&": 0, "&": 0, "|": 0, "^": 0}
    negations = ("!", "~")
    powers = ("**",)

    def truth(self, condition: Tree) -> Tree:
        return truth(condition)

    def check_order(self, sign, level, loosest, before):
        mixed = {
            _LOGIC.get(operator, "^")
            for operator in (sign, before)
            if self.tightness.get(operator) == 0
        }
        if len(mixed) > 1:
            raise ExpressionError(f"the order of {before} and {sign} is unclear: write parentheses")
        super().check_order(sign, level, loosest, before)

    def compared(self, sign: str, left: Tree, right: Tree) -> Tree:
        if sign == "^":
            return ("not", ("==", truth(left), truth(right)))
        if sign in _LOGIC:
            return (_LOGIC[sign], truth(left), truth(right))
        return super().compared(sign, left, right)

    def raised(self, base: Tree, exponent: Tree) -> Tree:
        """Build the tree of a power; for a negative base its real part, as in LTspice."""
        if exponent[0] == "number" and exponent[1] % 2.0 == 0.0:
            return super().raised(base, exponent)
        size = _size(base, exponent)
        if exponent[0] == "number" and exponent[1].is_integer():
            return ("*", ("call", "sgn", base), size)
        turned = ("*", ("*", ("number", math.pi), exponent), ("<", base, ZERO))
        return ("*", size, ("call", "cos", turned))

    def called(self, name: str, arguments: list[Tree]) -> Tree:
        if name == "u" and len(arguments) == 1:
            return ("<", ZERO, arguments[0])
        if name in ("pow", "pwr", "pwrs") and len(arguments) == 2:
            if name == "pow":
                return self.raised(*arguments)
            size = _size(*arguments)
            return size if name == "pwr" else ("*", ("call", "sgn", arguments[0]), size)
        return super().called(name, arguments)


def _size(base, exponent):
    """The power of the absolute value, in parameters and sources."""
    return ("call", "pow", ("call", "abs", base), exponent)


def in_ngspices_words(text: str, dialect: str) -> str:
    """An expression of a file of this dialect in ngspice's syntax.

    Raises
    ------
    ExpressionError
    """
    if dialect in ("", NGSPICE):
        return text
    theirs = _theirs(text)
    return text if theirs == _ours(text) else theirs


@functools.lru_cache(maxsize=4096)
def _theirs(text):
    return written(_Foreign(text).whole())


def _ours(text):
    """The tree in ngspice's syntax, as text: trees of a thousand terms are too deep to compare."""
    try:
        return written(parse(text))
    except ExpressionError:
        return None


def ambiguity(cards: Iterable[Card]) -> str:
    """A note if a file without a dialect line may be from LTspice or PSpice; else empty."""
    cards = list(cards)
    expressions = [
        (card.where, "".join(pair)) for card in cards for pair in _EXPRESSION.findall(card.text)
    ]
    for dialect, marks in _MARKS.items():
        words = [match.group() for card in cards if (match := marks.search(card.text))]
        unlike = (expression for expression in expressions if _differs(expression[1]))
        for where, text in unlike if words else ():
            return (
                f"{where}: {text[:60]} is read in ngspice's syntax, but has another meaning in "
                f"{dialect}, whose {words[0][:20]!r} is in this file: add a line * dialect: "
                f"{dialect} or * dialect: ngspice"
            )
    return ""


def _differs(text):
    try:
        return _theirs(text) != written(parse(text))
    except ExpressionError:
        return False

"""Converts ngspice's netlists to LTspice's syntax."""

from __future__ import annotations

import re

from circuits.netlist.expression import (
    BOOLEAN,
    ZERO,
    ExpressionError,
    Names,
    Tree,
    parse,
    rebuilt,
    resolved,
    written,
)
from circuits.netlist.reader import statements
from harvester.base.errors import NetlistError

# Variables of a B source; the last one is `temper` in ngspice.
VARIABLES = {"time", "pi", "temp"}
DIFFERENCES = (
    "the noise is in a separate file in the same folder (PWL file=)",
    "conditions are if(a,b,c) instead of a ? b : c; a==b is (a>=b)*(a<=b)",
    "pwr(x,y) = |x|^y replaces ngspice's pow(x,y), pwrs its pwr",
    "the noise current is I(Inoise) instead of @inoise[current]",
    "plotwinsize=0 disables waveform compression, numdgt=7 selects double precision",
    "trtol scales each simulator's own error estimate: the steps differ",
)


def to_ltspice(text: str) -> str:
    """Elements, sub-circuits, models and analysis as LTspice reads them.

    Parameters
    ----------
    text : str
        A netlist of `circuits.equivalent.assembly`, with LTspice's waveform for the noise source.

    Raises
    ------
    NetlistError
        An expression that does not exist in LTspice.
    """
    return "\n".join(filter(None, map(_card, statements(text, "netlist")))) + "\n"


def _card(card):
    first = card.text.split()[0].lower()
    if first == ".title":
        return ""
    if first == ".save":
        return re.sub(r"@(\w+)\[current\]", r"I(\1)", card.text)
    if first.startswith(".options"):
        return f"{card.text} plotwinsize=0 numdgt=7"
    if first.startswith("b"):
        head, equals, expression = card.text.partition("=")
        return f"{head}{equals}{translate(expression, behavioural=True)}"
    if re.fullmatch(r"\.param pi=3\.14\d*", card.text.lower()):
        return ""  # LTspice defines pi itself.
    return re.sub(r"\{([^{}]*)\}", lambda match: f"{{{translate(match.group(1))}}}", card.text)


def translate(expression: str, behavioural: bool = False) -> str:
    """An expression of ngspice in LTspice's syntax.

    Parameters
    ----------
    expression : str
    behavioural : bool
        Whether it is in a B source, where parameters are in braces.

    Raises
    ------
    NetlistError
        The expression does not exist in LTspice.

    Examples
    --------
    >>> translate("(v(x) > 1) ? pow(v(x)-1, 1.5) : 0", behavioural=True)
    'if(1.0<v(x),pwr(v(x)-1.0,1.5),0.0)'
    """
    try:
        names = Names(lambda name: ("name", _translated_name(name, behavioural)))
        tree = resolved(parse(expression.replace("{", "(").replace("}", ")")), names)
        return written(rebuilt(tree, _with_truths), dialect="ltspice")
    except ExpressionError as fault:
        raise NetlistError(
            f"{expression.strip()[:60]!r}: {fault}; cannot be written for LTspice: rewrite it"
        ) from None


def _translated_name(name, behavioural):
    """A name; a parameter in a B source gets braces."""
    name = "temp" if name == "temper" else name
    return f"{{{name}}}" if behavioural and name not in VARIABLES else name


def _with_truths(tree: Tree, parts: list[Tree]) -> Tree:
    """Translate conditions: nonzero numbers are true in ngspice, numbers above 0.5 in LTspice."""
    if not parts:
        return tree
    count = {"if": 1, "not": 1, "and": 2, "or": 2}.get(tree[0], 0)
    parts[:count] = [
        part if part[0] in BOOLEAN else ("not", ("==", part, ZERO)) for part in parts[:count]
    ]
    return (*tree[: len(tree) - len(parts)], *parts)

"""Translation of a sub-circuit or deck from ngspice to LTspice, PSpice and Xyce.

| here | LTspice | PSpice, Xyce |
| --- | --- | --- |
| `B… i=…` | the same, parameters in braces | `G… VALUE={…}` |
| `a ? b : c` | `if(a,b,c)` | `IF(a,b,c)` |
| `pow(x,y)` of x > 0 | `pwr(x,y)` | `PWR(x,y)` |
| `.subckt … key=value` | the same | `… PARAMS: key=value` |
"""

from __future__ import annotations

import re

from circuits.equivalent.ltspice import to_ltspice, translate
from circuits.netlist.reader import statements

DIALECTS = ("ngspice", "ltspice", "pspice", "xyce")
# Longest line in characters; PSpice allows 132.
WIDTH = 120


def in_dialect(text: str, dialect: str) -> str:
    """Statements of ngspice, without analysis and options, in another simulator's syntax.

    Parameters
    ----------
    text : str
    dialect : str
        One of `DIALECTS`.

    Raises
    ------
    NetlistError
        An expression that does not exist in the dialect.
    """
    if dialect == "ngspice":
        cards = text.splitlines()
    elif dialect == "ltspice":
        cards = to_ltspice(text).splitlines()
    else:
        cards = [_pspice(card.text) for card in statements(text, "block")]
    return "".join(f"{line}\n" for card in cards for line in _lines(card))


def _lines(card):
    """Split a card into lines of at most `WIDTH` characters; continuation lines begin with "+"."""
    if len(card) <= WIDTH:
        return [card]
    # A break within an expression must not cut a name, number or call.
    pieces = re.split(r"(?<=[*,])|(?<= )", card)
    lines, line = [], ""
    for piece in pieces:
        if line and len(line + piece) > WIDTH:
            lines.append(line.rstrip())
            line = "+ "
        line += piece
    return [*lines, line]


def _pspice(card):
    first = card.split()[0].lower()
    if first == ".subckt":
        head, *values = re.split(r"\s+(?=\w+\s*=)", card)
        return f"{head} PARAMS: {' '.join(values)}" if values else head
    if first.startswith("b"):
        head, _, expression = card.partition("=")
        name, plus, minus, _ = head.split()
        value = translate(expression, behavioural=True).replace("{", "").replace("}", "")
        return f"G{name} {plus} {minus} VALUE={{{value}}}"
    return card

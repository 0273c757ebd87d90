"""Measures that a load's file defines by lines `* measure: kind name = expression`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from circuits.netlist.kinds import LOSS, OUTPUT, STATE, STORE, TAKEN
from circuits.netlist.vetting import LONGEST_SHOWN, check_expression, refuse
from harvester.base.plain_text import nearest

if TYPE_CHECKING:
    from circuits.netlist.reader import Card
    from circuits.netlist.vetting import Visible

KINDS = (OUTPUT, LOSS, STORE, STATE)
# Longest name of a measure, which is part of names of quantities and table columns.
LONGEST_NAME = 40
# Names that are not allowed, since the program has quantities such as `mean_power` and
# `stored_energy`.
KEPT_NAMES = re.compile(r"mean(_.*)?|stored|final_stored")
MOST_MEASURES = 50
_FORM = re.compile(r"(\S+) (\S+?)=(.*)")
_TAKING = re.compile(r"\btaking\b")


class Measure(NamedTuple):
    """One measure of a load.

    Attributes
    ----------
    kind : useful power ("output"), lost power ("loss"), stored energy ("store") or condition
        ("state").
    name : part of the names of its quantities.
    expression : power (W), energy (J), or a condition that is true above 0.
    taking : power (W) dissipated while a condition is true; "" if not given.
    where : "file:line".
    trees : both expressions as trees, resolved in the load's sub-circuit.
    """

    kind: str
    name: str
    expression: str
    taking: str
    where: str
    trees: Any = (None, None)

    @property
    def text(self) -> str:
        """The measure as text, without its location."""
        return f"{self.kind} {self.name}={self.expression} taking {self.taking}\n"

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Kind and name of its value, and of its state's power."""
        key = (self.kind, self.name)
        return (key, (TAKEN, self.name)) if self.taking else (key,)


def vet_measures(cards: Iterable[Card], scope: Visible) -> tuple[Measure, ...]:
    """The measures of cards "kind name=expression", or "state name=condition taking watts".

    Raises
    ------
    NetlistError
        One line with file, line and fault.
    """
    accepted: dict[tuple[str, str], Measure] = {}
    for card in cards:
        measure = _vetted(card, scope)
        # Kind and name of its quantity: a store also has a power.
        stored = measure.kind == STORE
        quantity = (OUTPUT, f"{measure.name}_storage") if stored else (measure.kind, measure.name)
        if quantity in accepted:
            refuse(card, f"measure: {measure.kind} {measure.name} is defined twice")
        accepted[quantity] = measure
        if len(accepted) > MOST_MEASURES:
            refuse(card, f"more than {MOST_MEASURES} measures")
    return tuple(accepted.values())


def _vetted(card, scope):
    match = _FORM.fullmatch(card.text)
    if not match:
        refuse(card, "write it as * measure: kind name = expression")
    kind, name, text = match.groups()
    if kind not in KINDS:
        hint = f"{nearest(kind, KINDS)}; there are {', '.join(KINDS)}"
        refuse(card, f"measure: unknown kind {kind[:LONGEST_SHOWN]}{hint}")
    if not re.fullmatch(rf"[a-z]\w{{,{LONGEST_NAME - 1}}}", name, re.ASCII):
        excerpt = name[:LONGEST_SHOWN]
        refuse(card, f"measure: {excerpt!r} is not a name of at most {LONGEST_NAME} letters")
    if KEPT_NAMES.fullmatch(name):
        refuse(card, f"measure: {name} is the name of a built-in quantity: rename it")
    plain = text.replace("{", "(").replace("}", ")")
    parts = _TAKING.split(plain)
    if len(parts) > (2 if kind == STATE else 1):
        refuse(card, "measure: only a state can have 'taking', once")
    expressions = [check_expression(card, part.strip(), scope) for part in parts]
    taking = expressions[1] if expressions[1:] else ""
    return Measure(kind, name, expressions[0], taking, card.where)

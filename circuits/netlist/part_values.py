"""Values of a load's parts: sources of energy, and elements across the output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from circuits.netlist.expression import leaves

if TYPE_CHECKING:
    from collections.abc import Iterable

    from circuits.netlist.elements import Element

# Advice for a source that toggles endlessly.
SOURCE_CURE = (
    "its value toggles at one threshold, since its own effect reverses each jump immediately; "
    "use a switch with a hysteresis (S, vt= and vh=), or let it change smoothly over some "
    "millivolts, as 0.5*(1+tanh((v-vt)/5m)) does"
)
# Operations whose value jumps.
_JUMPS = {"if", "<", "<=", "==", "and", "or", "not", "sgn", "floor", "ceil", "u", "nint"}


def conductance(parts: Iterable[Element]) -> float:
    """The conductance (S) of resistors in parallel."""
    return sum(1.0 / part.size for part in parts if part.letter == "r" and part.size)


def capacitance(parts: Iterable[Element]) -> float:
    """The capacitance (F) of capacitors in parallel."""
    return sum(part.size or 0.0 for part in parts if part.letter == "c")


def jumping_sources(elements: Iterable[Element]) -> tuple[Element, ...]:
    """Behavioural sources whose value may jump."""
    return tuple(
        element
        for element in elements
        if any(leaf[0] in _JUMPS for leaf in leaves(element.expression))
    )

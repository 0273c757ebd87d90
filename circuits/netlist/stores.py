"""A load's capacitors and coils, and the voltages and currents that are recorded for them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harvester.device.terminals import GROUND

if TYPE_CHECKING:
    from circuits.netlist.elements import Element

# Letters of nonlinear elements.
_CURVED = "dqjm"

# A store belongs to a mode if its voltage is at least this share of the mode's largest. This
# excludes the common voltage of a DC side against ground on stray capacitances.
TAKES_PART = 0.1


class Store(NamedTuple):
    """A capacitor or a coil of a load.

    Attributes
    ----------
    name, where : as in `circuits.netlist.elements.Element`.
    first, second : levels (or ground) whose difference is its voltage or current.
    """

    name: str
    where: str
    first: str
    second: str


def stores_of(elements: Sequence[Element]) -> tuple[Store, ...]:
    """The capacitors and coils of a load with a nonzero value."""
    return tuple(
        Store(
            element.name,
            element.where,
            *((f"i({element.name})", GROUND) if element.letter == "l" else element.nodes[:2]),
        )
        for element in elements
        if element.letter in "cl"
        and (element.expression is not None or (element.size or 0.0) > 0.0)
    )


def levels_of(elements: Sequence[Element], stores: Sequence[Store]) -> tuple[str, ...]:
    """Nodes and currents "i(name)" that determine the stores' energies and what drives them.

    Empty for a load without a store.
    """
    if not stores:
        return ()
    nodes = [end for store in stores for end in (store.first, store.second)]
    for element in elements:
        nodes += element.nodes if element.letter in _CURVED else ()
        nodes += element.controlling
    return tuple(name for name in dict.fromkeys(nodes) if name != GROUND)


def weights(store: Store, levels: Iterable[str]) -> np.ndarray:
    """The sign of each level in the voltage or current of a store: 1, −1 or 0."""
    return np.array([float(name == store.first) - float(name == store.second) for name in levels])


def times_of(matrix: np.ndarray, held: np.ndarray) -> list[np.ndarray]:
    """Relaxation times (s) of the modes that contribute to each store's charge.

    Parameters
    ----------
    matrix : ndarray, shape (levels, levels)
        See `circuits.kernel.slow_modes.relaxation`.
    held : ndarray, shape (stores, levels)
        Each store's `weights`.
    """
    times, modes = np.linalg.eig(matrix)
    parts = np.abs(held @ modes) >= TAKES_PART * np.abs(modes).max(axis=0)
    return [np.abs(times[group]) for group in parts]

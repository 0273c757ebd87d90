"""Which orbits count: the edges of a closure, and from which to which level each of them reaches.

Near the separatrix ω → 0 takes N2 away and shifts the barrier, so that neighbouring orbits would
cross each other there. An edge is therefore followed from its regular end (the well's bottom, high
energy) only as far as its orbits lie inside one another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harvester.averaging.orbits import Edge, settled_orbits, stiffnesses
from harvester.device import timescales
from harvester.errors import AveragingError

if TYPE_CHECKING:
    from harvester.averaging.orbits import Orbits
    from harvester.device.system import System

SCAN_STEP, SCAN_NODES = 0.25, 24  # of the level; of an orbit on either side of the stopper
WELL_LEVELS = -15.0, 11.5
NEGLIGIBLE = 1e-8  # fall of ln g within the innermost orbit of a well
SMALL_ORBIT = -5.0  # level of a well's orbits from which on down ω is that of its bottom
OUTER_LEVELS = -20.0, 32.0  # from that of D over the rate of loss
OUTER_EXPONENT = 45.0  # ln g falls by this much up to the outer end


def edges(system: System, closure: str) -> list[tuple[Edge, float, float]]:
    """The edges of `paper` or `consistent`, the wells first, with their first and last levels.

    Raises
    ------
    AveragingError
        Nothing holds the energy back.
    """
    outer = Edge(system)
    first, last = _outer_range(outer)
    if stiffnesses(system)[0] >= 0.0:
        return [(outer, first, last)]
    if closure == "consistent" and system.transducer.coupling > 0.0:
        wells, reach = Edge(system, inside=True, anchor=timescales.rest(system)), np.inf
    else:
        # One potential for all: no well reaches out of the first outer orbit.
        wells = Edge(system, inside=True)
        reach = settled_orbits(outer, np.array([first]), SCAN_NODES).right[0]
    return [(wells, *_well_range(wells, reach)), (outer, first, last)]


def _well_range(edge, reach):
    """First and last level of the wells, which end at the latest where they come to `reach`."""
    scan = _scan(edge, *WELL_LEVELS)
    first = min([SMALL_ORBIT, *_zeros(scan.level, scan.exponent() - NEGLIGIBLE)])
    # Of smaller orbits rounding alone may tell that they cross.
    crossings = [fold for fold in _folds(scan) if fold > first]
    return first, min([scan.level[-1], *crossings, *_zeros(scan.level, scan.right - reach)])


def _outer_range(edge):
    """First and last level of the outer edge."""
    s = edge.system
    coupling, decay_rate = s.transducer.coupling, s.transducer.decay_rate()
    rate = s.damper.damping + coupling / decay_rate or 1.0 / s.noise.correlation_time
    middle = np.log(s.noise.intensity / rate)
    scan = _scan(edge, *(middle + end for end in OUTER_LEVELS))
    exponent = scan.exponent()
    fold = max([scan.level[0], *_folds(scan)])
    followed = scan.level > fold
    level = np.append(fold, scan.level[followed])
    fall = np.append(0.0, exponent[followed] - np.interp(fold, scan.level, exponent))
    last = _zeros(level, fall - OUTER_EXPONENT)
    if last.size == 0:
        raise AveragingError(
            f"damping={s.damper.damping:g} with coupling={coupling:g} does not bound the energy; "
            "raise one of them or let the stoppers dissipate (restitution < 1)"
        )
    return fold, last[0]


def _scan(edge: Edge, low: float, high: float) -> Orbits:
    return settled_orbits(edge, np.arange(low, high + SCAN_STEP, SCAN_STEP), SCAN_NODES)


def _folds(scan):
    """Levels at which orbits begin or cease to cross the next one.

    They cross where ½X'² at one X grows nowhere less than 0 from one to the next. That growth is
    dE − dN2 · ½(X − X*)², monotone in |X − X*|, so three points tell.
    """
    anchor = scan.edge.anchor
    left, right = _middle(scan.left), _middle(scan.right)
    places = np.array([left, right, np.clip(anchor, left, right)])
    gain = np.diff(scan.energy)
    least = np.min(gain - np.diff(scan.added) * 0.5 * (places - anchor) ** 2, axis=0)
    return _zeros(_middle(scan.level), least / gain.clip(min=1e-300))


def _middle(values):
    return 0.5 * (values[1:] + values[:-1])


def _zeros(level, values):
    """Levels at which the values change sign, ascending."""
    before, after = values[:-1], values[1:]
    k = np.flatnonzero((before < 0.0) != (after < 0.0))
    return level[k] + np.diff(level)[k] * before[k] / (before[k] - after[k])

"""The energy balance of a run (Eq. 33)."""

from __future__ import annotations

import math

from harvester.device import system
from harvester.device.record import Record
from harvester.device.system import System
from harvester.statistics.moments import QUANTITIES, Moments

STATE = Record._fields.index("transducer_state")


def energy_balance_residual(moments: list[Moments], parameters: System) -> float:
    """Energy input that is neither stored, lost nor delivered, as a share of the energy that flows.

    ∫ηX'dt − Δ(½X'² + U + ½βV²) − ∫loss dt − ∫load dt, over the measured time of all
    realizations, divided by the larger of what went in and what came out (Eq. 33).
    """
    put_in = load = loss = stored = 0.0
    for m in moments:
        total = m.integrals.sum(axis=0)
        put_in += total[QUANTITIES.index("input_power")]
        load += total[QUANTITIES.index("load_power")]
        loss += total[QUANTITIES.index("loss_power")]
        stored += stored_change(m, parameters)
    scale = max(abs(put_in), load + loss)
    if scale == 0.0 and stored == 0.0:
        # The device is at rest and nothing drives it.
        return 0.0
    return float((put_in - load - loss - stored) / scale) if scale > 0.0 else math.nan


def stored_change(moments: Moments, parameters: System) -> float:
    """Change of ½X'² + U + ½βV² over the measured time of one realization (scaled)."""
    last, first = (
        system.stored_energy(parameters, point[1], point[2], point[STATE])
        for point in (moments.last, moments.first)
    )
    return last - first

"""The energy balance of a run (Eq. 33)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from harvester.device import system
from harvester.device.record import Record
from harvester.device.system import System
from harvester.statistics.batch_means import complete_batches, ratio_estimate
from harvester.statistics.estimate import Estimate
from harvester.statistics.moments import QUANTITIES, Moments

STATE = Record._fields.index("transducer_state")
# Share of the energy input or output below which the device's stored energy is negligible.
NEGLIGIBLE = 1e-3


def energy_balance_residual(moments: Sequence[Moments], parameters: System) -> float:
    """Energy input that is not stored, lost or delivered, relative to the energy throughput.

    ∫ηX'dt − Δ(½X'² + U + ½βV²) − ∫loss dt − ∫load dt, over the measured time of all
    realizations, divided by the larger of energy input and output (Eq. 33).
    """
    put_in, out, stored = _energies(moments, parameters)
    scale = max(abs(put_in), out)
    if scale == 0.0 and stored == 0.0:
        # The device is at rest without excitation.
        return 0.0
    return float((put_in - out - stored) / scale) if scale > 0.0 else math.nan


def device_storage(
    moments: Sequence[Moments], weighted: Sequence[Moments], parameters: System, error_of: Callable
) -> dict[str, Estimate]:
    """Mean power into the device's kinetic, spring and transducer energy; empty if negligible.

    `weighted` are the moments with the weights of `harvester.statistics.well_balance`.
    """
    put_in, out, stored = _energies(moments, parameters)
    batches = complete_batches(weighted)
    if batches is None or abs(stored) <= NEGLIGIBLE * max(abs(put_in), out):
        return {}
    series = {name: batches[:, :, row] for row, name in enumerate(QUANTITIES)}
    # Energies at the ends of batches are unknown: stored energy is input − output − residual.
    residual = (put_in - out - stored) / sum(m.integrals[:, 0].sum() for m in moments)
    change = series["input_power"] - series["load_power"] - series["loss_power"]
    change = change - residual * series["time"]
    estimate = ratio_estimate(change, series["time"], "power", error_of=error_of)
    return {"mean_device_storage_power": estimate}


def _energies(moments, parameters):
    """Energy input, energy lost and delivered, and energy stored, over all realizations."""
    totals = [m.integrals.sum(axis=0) for m in moments]
    put_in, load, loss = (
        sum(float(total[QUANTITIES.index(f"{name}_power")]) for total in totals)
        for name in ("input", "load", "loss")
    )
    return put_in, load + loss, sum(stored_change(m, parameters) for m in moments)


def stored_change(moments: Moments, parameters: System) -> float:
    """Change of ½X'² + U + ½βV² over the measured time of one realization, scaled."""
    last, first = (
        system.stored_energy(parameters, point[1], point[2], point[STATE])
        for point in (moments.last, moments.first)
    )
    return last - first

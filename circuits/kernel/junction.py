"""The p–n junction: Shockley's law with emission coefficient, breakdown and junction charge.

i = Is (exp(v/nVt) − 1) + gmin v − Ib exp(−(v + Vb)/nVt); beyond `LARGEST_CURRENT` either
exponential goes on as its tangent, so that Newton's iterations stay among finite numbers. Charge:
τ i and the depletion capacitance Cj (1 − v/Vj)^−m, from F Vj on as its tangent.
"""

from __future__ import annotations

import math

import numpy as np

from harvester.compilation import compiled

# kT/q at 27 °C (V), and the conductance beside every junction (S), ngspice's own.
THERMAL_VOLTAGE = 1.380649e-23 * 300.15 / 1.602176634e-19
LEAST_CONDUCTANCE = 1e-12
# A: where the exponential ends.
LARGEST_CURRENT = 100.0
# Columns of the table of junctions.
(
    SATURATION, SWING, RESISTANCE, BREAKDOWN, BREAKDOWN_CURRENT, HIGHEST, TRANSIT,
    CAPACITANCE, POTENTIAL, GRADING, EDGE, LOWEST, BREAKDOWN_SWING, COLUMNS,
) = range(14)  # fmt: skip


def table_row(model: dict[str, float], area: float) -> np.ndarray:
    """One junction's numbers; shape (COLUMNS,).

    Parameters
    ----------
    model : dict of str to float
        A diode's model by ngspice's names.
    area : float
        How many of them lie side by side.
    """
    saturation = area * model.get("is", 1e-14)
    swing = model.get("n", 1.0) * THERMAL_VOLTAGE
    row = np.zeros(COLUMNS)
    row[SATURATION], row[SWING] = saturation, swing
    row[RESISTANCE] = model.get("rs", 0.0) / area
    row[BREAKDOWN] = model.get("bv", math.inf)
    row[BREAKDOWN_SWING] = model.get("nbv", model.get("n", 1.0)) * THERMAL_VOLTAGE
    # Where ngspice lets it break down: the current given flows at the voltage given where the
    # emission coefficient of breakdown is 1.
    emission = row[BREAKDOWN_SWING] / THERMAL_VOLTAGE
    given = max(area * model.get("ibv", 1e-3), saturation)
    row[BREAKDOWN_CURRENT] = saturation * (1.0 + given / saturation) ** (1.0 / emission)
    row[HIGHEST] = swing * max(math.log(LARGEST_CURRENT / saturation), 1.0)
    row[LOWEST] = row[BREAKDOWN_SWING] * max(
        math.log(LARGEST_CURRENT / row[BREAKDOWN_CURRENT]), 1.0
    )
    row[TRANSIT] = model.get("tt", 0.0)
    row[CAPACITANCE] = area * model.get("cjo", model.get("cj0", 0.0))
    row[POTENTIAL], row[GRADING] = model.get("vj", 1.0), model.get("m", 0.5)
    row[EDGE] = model.get("fc", 0.5) * row[POTENTIAL]
    return row


@compiled
def current(table: np.ndarray, k: int, v: float) -> tuple[float, float]:
    """Current (A) of junction k of a table and its slope (S) at a voltage (V)."""
    swing, saturation = table[k, SWING], table[k, SATURATION]
    if v > -40.0 * swing:
        excess = v - table[k, HIGHEST]
        rise = saturation * np.exp((v - max(excess, 0.0)) / swing)
        slope = rise / swing
        through = rise - saturation + slope * max(excess, 0.0)
    else:
        through, slope = -saturation, 0.0
    beyond = -v - table[k, BREAKDOWN]
    swing = table[k, BREAKDOWN_SWING]
    if beyond > -40.0 * swing:
        excess = max(beyond - table[k, LOWEST], 0.0)
        rise = table[k, BREAKDOWN_CURRENT] * np.exp((beyond - excess) / swing)
        through -= rise + rise / swing * excess
        slope += rise / swing
    return through + LEAST_CONDUCTANCE * v, slope + LEAST_CONDUCTANCE


@compiled
def holds_charge(table: np.ndarray, k: int) -> bool:
    """Whether junction k has a charge of its own."""
    return table[k, TRANSIT] != 0.0 or table[k, CAPACITANCE] != 0.0


@compiled
def charge(
    table: np.ndarray, k: int, v: float, through: float, slope: float
) -> tuple[float, float]:
    """Charge (C) and capacitance (F) at a junction voltage with this current and slope."""
    stored, capacitance = table[k, TRANSIT] * through, table[k, TRANSIT] * slope
    size = table[k, CAPACITANCE]
    if size > 0.0:
        potential, grading, edge = table[k, POTENTIAL], table[k, GRADING], table[k, EDGE]
        ratio = 1.0 - min(v, edge) / potential
        here = size * ratio**-grading
        stored += size * potential / (1.0 - grading) * (1.0 - ratio ** (1.0 - grading))
        if v > edge:
            bend = here * grading / (potential * ratio)
            stored += (v - edge) * (here + 0.5 * bend * (v - edge))
            here += bend * (v - edge)
        capacitance += here
    return stored, capacitance


@compiled
def limited(table: np.ndarray, k: int, old: float, new: float, predicted: float) -> float:
    """The voltage of junction k to go on from, after Newton's step from `old` to `new`.

    Where the step leads up the exponential, the current that it predicts tells the voltage: one
    iteration then goes as far as many.
    """
    swing = table[k, SWING]
    if new - old > swing:
        if predicted <= 0.0:
            return min(new, max(old, 0.0) + swing)
        v = swing * np.log(1.0 + predicted / table[k, SATURATION])
        return min(max(v, old), new)
    if -new > table[k, BREAKDOWN] and new < old:
        size = max(-predicted / table[k, BREAKDOWN_CURRENT], 1.0)
        return max(-table[k, BREAKDOWN] - table[k, BREAKDOWN_SWING] * np.log(size), new)
    return new

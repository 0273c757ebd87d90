"""The p–n junction: Shockley's law with emission coefficient, breakdown and junction charge.

i = Is (exp(v/nVt) − 1) + gmin v − Ib exp(−(v + Vb)/nVt), where below −3 n Vt the first term is
−Is (1 + (3 n Vt/e v)³); beyond `LARGEST_CURRENT` either
exponential continues as its tangent, so that Newton's iterations stay among finite numbers. Charge:
τ i and the depletion capacitance Cj (1 − v/Vj)^−m, from F Vj on as its tangent. If the model
has it, recombination adds Ir (exp(v/Nr Vt) − 1) ((1 − v/Vj)² + 0.005)^(m/2), which below −3 n Vt
stays constant, and the sum i becomes i/(1 + √(i/Ik)) at the knee.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from circuits.kernel.diode_temperature import at_temperature
from circuits.netlist.part_models import TEMPERATURE

if TYPE_CHECKING:
    from circuits.kernel.emitter import Emitter, Number

# Conductance in parallel with every junction, in siemens, as in ngspice.
LEAST_CONDUCTANCE = 1e-12
# Current, in amperes, above which the exponential continues as its tangent.
LARGEST_CURRENT = 100.0
# Columns of the table of junctions.
(
    SATURATION, SWING, RESISTANCE, BREAKDOWN, BREAKDOWN_CURRENT, HIGHEST, TRANSIT,
    CAPACITANCE, POTENTIAL, GRADING, EDGE, LOWEST, BREAKDOWN_SWING, PER_SWING,
    PER_BREAKDOWN_SWING, KNEE, RECOMBINATION, PER_RECOMBINATION_SWING, COLUMNS,
) = range(19)  # fmt: skip
# Newton's iterations end at a step below this share of the swing n kT/q: the next step would be
# half its square. The voltage is then accurate to 1/50 of the swing, 1 mV, without loss of charge.
JUNCTION_STEP = 0.2
# Exponentials with smaller exponents count as 0.
BLOCKED = -40.0
# Below minus this many swings (n kT/q) a junction counts as blocked, and its recombination stays
# constant.
REVERSE = 3.0
# Smallest square of the recombination's width.
RECOMBINATION_FLOOR = 0.005
# Largest exponent of the recombination current.
MOST_SWINGS = 300.0


class Traits(NamedTuple):
    """Terms in a junction's law; code for other terms is omitted."""

    resistance: bool
    breakdown: bool
    transit: bool
    depletion: bool
    knee: bool
    recombination: bool

    @property
    def charge(self) -> bool:
        """Whether the junction stores charge."""
        return self.transit or self.depletion


def traits(row: np.ndarray) -> Traits:
    """The `Traits` of one junction, from its row in the table of junctions."""
    return Traits(
        bool(row[RESISTANCE] > 0.0),
        bool(np.isfinite(row[BREAKDOWN])),
        bool(row[TRANSIT] != 0.0),
        bool(row[CAPACITANCE] != 0.0),
        bool(row[KNEE] > 0.0),
        bool(row[RECOMBINATION] > 0.0),
    )


def table_row(
    model: dict[str, float], area: float, many: float = 1.0, celsius: float = TEMPERATURE
) -> np.ndarray:
    """One junction's numbers; shape (COLUMNS,).

    Parameters
    ----------
    model : dict of str to float
        A diode's model by ngspice's names.
    area : float
        Area of its junction, in units of the model's.
    many : float
        Number of identical junctions in parallel.
    celsius : float
        Temperature of the junction (°C).
    """
    model = at_temperature(model, celsius)
    saturation, all_of_them = area * model["is"], area * many
    volts = model["vt"]
    swing = model["n"] * volts
    row = np.zeros(COLUMNS)
    row[SATURATION], row[SWING] = many * saturation, swing
    row[RESISTANCE] = model["rs"] / all_of_them
    row[BREAKDOWN] = model.get("bv", math.inf)
    row[BREAKDOWN_SWING] = model.get("nbv", model["n"]) * volts
    at_breakdown = _at_breakdown(model.get("ibv", 1e-3), saturation, row, volts)
    row[BREAKDOWN_CURRENT] = many * at_breakdown
    row[HIGHEST] = swing * max(math.log(LARGEST_CURRENT / row[SATURATION]), 1.0)
    row[LOWEST] = row[BREAKDOWN_SWING] * max(
        math.log(LARGEST_CURRENT / row[BREAKDOWN_CURRENT]), 1.0
    )
    row[TRANSIT] = model["tt"]
    row[CAPACITANCE] = all_of_them * model["cjo"]
    row[POTENTIAL], row[GRADING] = model["vj"], model["m"]
    row[KNEE] = all_of_them * model.get("ikf", 0.0)
    row[RECOMBINATION] = all_of_them * model["isr"]
    row[PER_RECOMBINATION_SWING] = 1.0 / (model["nr"] * volts)
    row[PER_SWING], row[PER_BREAKDOWN_SWING] = 1.0 / swing, 1.0 / row[BREAKDOWN_SWING]
    row[EDGE] = model["fc"] * row[POTENTIAL]
    return row


def slope(row: np.ndarray, voltage: float) -> float:
    """Conductance (S) of a junction of the table at a voltage, without its series resistance."""
    forward = min(voltage, row[HIGHEST]) * row[PER_SWING]
    through = row[SATURATION] * row[PER_SWING] * math.exp(max(forward, BLOCKED))
    if math.isfinite(row[BREAKDOWN]):
        beyond = min(-voltage - row[BREAKDOWN], row[LOWEST]) * row[PER_BREAKDOWN_SWING]
        per_swing = row[BREAKDOWN_CURRENT] * row[PER_BREAKDOWN_SWING]
        through += per_swing * math.exp(max(beyond, BLOCKED))
    through += LEAST_CONDUCTANCE
    return float(through / (1.0 + through * row[RESISTANCE]))


def _at_breakdown(given, saturation, row, volts):
    """Current (A) at the breakdown voltage.

    As in ngspice, the current `given`, for any area, is reduced by (onset/volts − 1) times the
    saturation current, with the voltage `onset` at which breakdown begins.
    """
    onset = row[BREAKDOWN]
    if not math.isfinite(onset) or given < saturation * onset / volts:
        return saturation
    # At most as many iterations as in ngspice.
    for _ in range(25):
        current = given + saturation * (1.0 - onset / volts)
        onset = row[BREAKDOWN] - row[BREAKDOWN_SWING] * math.log(current / saturation)
    return current


class Law:
    """Writes the law of a vector of junctions with the same traits into a function's code.

    Parameters
    ----------
    e : Emitter
        Emitter of the function.
    place, stride : int
        Memory index of the first junction's numbers, and distance to the next column.
    count : int
        Number of junctions.
    has : Traits
    """

    def __init__(self, e: Emitter, place: int, stride: int, count: int, has: Traits) -> None:
        self._e, self._place, self._stride, self._count = e, place, stride, count
        self._has = has

    def _value(self, column: int) -> Number:
        return self._e.load(self._place + column * self._stride, count=self._count)

    def _constant(self, value: float) -> Number:
        return self._e.constant(value, self._count)

    def _current(self, v: Number) -> tuple[Number, Number]:
        """Current (A) and its slope (S) at a junction voltage."""
        saturation, per_swing = self._value(SATURATION), self._value(PER_SWING)

        def conducting():
            excess = (v - self._value(HIGHEST)).greater(0.0)
            swings = (v - excess) * per_swing
            rise = saturation * swings.greater(BLOCKED).exponential()
            slope = rise * per_swing
            through = rise - saturation + slope * excess
            # ngspice's law of a blocked junction, with continuous slope.
            inverse = 1.0 / swings.lesser(-REVERSE)
            share = inverse * (REVERSE / math.e)
            back, reverse = saturation * share * share * share, swings < -REVERSE
            through = (-saturation - back).where(reverse, through)
            return through, (back * inverse * per_swing * 3.0).where(reverse, slope)

        live = self._e.any(v * per_swing > BLOCKED)
        through, slope = self._e.choose(
            live, conducting, lambda: (-saturation, self._constant(0.0))
        )
        if self._has.recombination:
            recombined, steeper = self._recombination(v)
            through, slope = through + recombined, slope + steeper
        if self._has.knee:
            root = (through.greater(0.0) / self._value(KNEE)).function("sqrt")
            share = 1.0 / (root + 1.0)
            through, slope = through * share, slope * (root * 0.5 + 1.0) * share * share
        if self._has.breakdown:
            lost, steeper = self._breakdown(v)
            through, slope = through - lost, slope + steeper
        return through + v * LEAST_CONDUCTANCE, slope + LEAST_CONDUCTANCE

    def _recombination(self, v):
        per_swing, potential = self._value(PER_RECOMBINATION_SWING), self._value(POTENTIAL)
        end = self._value(SWING) * -REVERSE
        held = v.greater(end)
        rise = (held * per_swing).lesser(MOST_SWINGS).exponential()
        ratio = 1.0 / potential * -held + 1.0
        width, half = ratio * ratio + RECOMBINATION_FLOOR, self._value(GRADING) * 0.5
        factor = self._value(RECOMBINATION) * width.function("pow", half)
        bend = factor * self._value(GRADING) * ratio / (width * potential)
        slope = factor * rise * per_swing - bend * (rise - 1.0)
        return factor * (rise - 1.0), slope.where(v > end, self._constant(0.0))

    def _breakdown(self, v):
        beyond, per_swing = -v - self._value(BREAKDOWN), self._value(PER_BREAKDOWN_SWING)

        def breaking():
            excess = (beyond - self._value(LOWEST)).greater(0.0)
            swings = ((beyond - excess) * per_swing).greater(BLOCKED)
            rise = self._value(BREAKDOWN_CURRENT) * swings.exponential()
            return rise + rise * per_swing * excess, rise * per_swing

        nothing = self._constant(0.0)
        live = self._e.any(beyond * per_swing > BLOCKED)
        return self._e.choose(live, breaking, lambda: (nothing, nothing))

    def linear(self, v: Number, delta: Number, charge: Number) -> tuple[Number, Number]:
        """Slope and value, at the iterated voltage, of δ i and the change of charge."""
        self._through, self._slope = self._current(v)
        self._share = self._constant(1.0)
        if self._has.resistance:
            self._share = 1.0 / (self._slope * self._value(RESISTANCE) + 1.0)
        share = self._share * delta
        g, i = self._slope * share, self._through * share
        if self._has.charge:
            stored, capacitance = self._stored(v, self._through, self._slope)
            g, i = g + capacitance, i + (stored - charge)
        return g, i

    def charge(self, v: Number) -> Number:
        """Charge (C) at a junction voltage."""
        return self._stored(v, *self._current(v))[0]

    def _stored(self, v, through, slope):
        """Charge (C) and capacitance (F) at a voltage with this current and slope."""
        stored, capacitance = self._constant(0.0), self._constant(0.0)
        if self._has.transit:
            stored = self._value(TRANSIT) * through
            capacitance = self._value(TRANSIT) * slope
        if self._has.depletion:
            size, potential = self._value(CAPACITANCE), self._value(POTENTIAL)
            grading, edge = self._value(GRADING), self._value(EDGE)
            ratio = 1.0 / potential * -(v.lesser(edge)) + 1.0
            depletion = size * ratio.function("pow", -grading)
            complement = -(grading - 1.0)
            stored = (
                stored + size * potential / complement - depletion * ratio * potential / complement
            )
            beyond, bend = (v - edge).greater(0.0), depletion * grading / (potential * ratio)
            stored = stored + beyond * (depletion + bend * beyond * 0.5)
            capacitance = capacitance + depletion + bend * beyond
        return stored, capacitance

    def moved(self, old: Number, across: Number) -> tuple[Number, Any]:
        """Junction voltages for the next Newton iteration; `across` includes the series resistance.

        Call after `linear`. Also returns whether all changes are within the tolerance. If Newton's
        step goes up the exponential, the voltage follows from the predicted current, which saves
        many iterations.
        """
        predicted = (self._through + self._slope * (across - old)) * self._share
        new = across
        if self._has.resistance:
            new = across - self._value(RESISTANCE) * predicted
        chosen = self._up(old, new, predicted)
        if self._has.breakdown:
            chosen = self._into_breakdown(old, chosen, predicted)
        swing = self._value(SWING)
        free = swing * JUNCTION_STEP * self._flatness(old, chosen)
        if self._has.depletion:
            free = free.lesser((swing + (-chosen).greater(0.0)) * JUNCTION_STEP)
        # The comparison is false for NaN.
        near = self._e.both((chosen - old).size() <= free, (chosen - new).size() <= free)
        return chosen, self._e.all(near)

    def _up(self, old, new, predicted):
        swing = self._value(SWING)
        up = new - old > swing

        def limited():
            by_voltage = new.lesser(old.greater(0.0) + swing)
            within = self._within_knee(predicted) if self._has.knee else predicted
            current = (within / self._value(SATURATION) + 1.0).greater(1.0)
            by_current = (swing * current.function("log")).greater(old).lesser(new)
            return [by_current.where(predicted > 0.0, by_voltage).where(up, new)]

        return self._e.choose(self._e.any(up), limited, lambda: [new])[0]

    def _within_knee(self, current):
        """The current without the knee, from the current with it."""
        knee = self._value(KNEE)
        share = current.greater(0.0) / knee
        root = (share + (share * (share + 4.0)).function("sqrt")) * 0.5
        return knee * root * root

    def _into_breakdown(self, old, new, predicted):
        breakdown = self._value(BREAKDOWN)
        into = self._e.both(-new > breakdown, new < old)

        def limited():
            size = (-predicted / self._value(BREAKDOWN_CURRENT)).greater(1.0)
            v = -breakdown - self._value(BREAKDOWN_SWING) * size.function("log")
            return [v.greater(new).where(into, new)]

        return self._e.choose(self._e.any(into), limited, lambda: [new])[0]

    def _flatness(self, old, new):
        """Factor on Newton's tolerance for blocked junctions: a bound of exp(depth/2).

        `depth` is how far both voltages lie below the exponential's rise, in swings n kT/q. There
        the exponential part of the current is smaller by at least this factor.
        """
        depth = -(old.greater(new)) * self._value(PER_SWING)
        if self._has.breakdown:
            above = old.lesser(new) + self._value(BREAKDOWN)
            depth = depth.lesser(above * self._value(PER_BREAKDOWN_SWING))
        depth = depth.greater(0.0)
        return (depth * (depth * (depth * (1.0 / 48.0) + 0.125) + 0.5)) + 1.0

"""A spring from a table of force over displacement: a piecewise cubic; its energy is the integral.

Between two points the force F(x) is a cubic; beyond the first and last point F continues as a
straight line. F and F' are continuous. The sum starts with the piece about x = 0 and goes outwards,

    F(x) = k0 + k1 x + k2 x² + k3 x³ + Σ (square + cube·d) d²,   d = max(side·x − offset, 0),

one term per junction of two pieces. The sum needs no search or branch, so that compiled code
processes several realizations at a time. A steep outer piece adds nothing nearer to x = 0.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from harvester.base import compilation
from harvester.base.compilation import overload
from harvester.device.dispatch import Values

MOST_PIECES = 32
# Every table is padded with zero terms to this number, so that the same compiled code serves all.
TERMS = MOST_PIECES + 1
# Points of a smoothed table per piece.
POINTS_PER_PIECE = 3
# A table is symmetric if its force differs from the mirrored force by less than this share of the
# greatest force.
SYMMETRY = 1e-9
CHECKED_POINTS = 201
INTERPOLATIONS = ("monotone", "smooth")


class ForceTable(NamedTuple):
    """A piecewise cubic restoring force; see `harvester.device.spring` for the equations.

    Attributes
    ----------
    core : tuple of float
        (k0, k1, k2, k3) of the piece about x = 0.
    sides, offsets : tuple of float
        ±1, and the distance of each junction from x = 0.
    squares, cubes : tuple of float
        Coefficients of (distance)² and (distance)³ in the force of each piece.
    energy_cubes, energy_fourths : tuple of float
        The coefficients of the energy, U = … + Σ (energy_cube + energy_fourth·d) d³.
    steepest : float
        Greatest |F'|.
    """

    core: tuple
    sides: tuple
    offsets: tuple
    squares: tuple
    cubes: tuple
    energy_cubes: tuple
    energy_fourths: tuple
    steepest: float

    @property
    def symmetric(self) -> bool:
        """Whether F(−x) = −F(x) up to rounding."""
        x = np.linspace(0.0, 1.05 * max(map(abs, self.offsets)), CHECKED_POINTS)
        right, left = self.force(x), self.force(-x)
        return bool(np.all(np.abs(right + left) <= SYMMETRY * np.abs(right).max()))

    @property
    def straight(self) -> bool:
        bends = (*self.core[2:], *self.squares, *self.cubes)
        return not any(bends)

    @property
    def linear(self) -> float:
        """The stiffness at x = 0."""
        return self.core[1]

    @property
    def line(self) -> tuple[float, float]:
        """Constant and linear part of the force: both 0, since `nonlinear_formula` has it all."""
        return 0.0, 0.0

    @property
    def odd_cubic(self) -> None:
        """None: there is no closed form."""
        return

    @property
    def range(self) -> tuple[float, float]:
        """Range of the force: all displacements, as straight lines beyond the table."""
        return -math.inf, math.inf

    def force(self, x: Values) -> Values:
        k0, k1, k2, k3 = self.core
        bent = bends_squared(self.sides, self.offsets, self.squares, self.cubes, x)
        return k0 + x * (k1 + x * (k2 + x * k3)) + bent

    def energy(self, x: Values) -> Values:
        k0, k1, k2, k3 = self.core
        bent = bends_cubed(self.sides, self.offsets, self.energy_cubes, self.energy_fourths, x)
        return x * (k0 + x * (k1 / 2.0 + x * (k2 / 3.0 + x * k3 / 4.0))) + bent

    def greatest_stiffness(self, x: Values) -> Values:
        return self.steepest + 0.0 * x

    def slope(self, x: Values) -> Values:
        return self.taylor(x)[0]

    def taylor(self, x: Values) -> tuple[Values, Values, Values]:
        k1, k2, k3 = self.core[1:]
        rows = (self.sides, self.offsets, self.squares, self.cubes)
        s, offsets, a, b = (np.reshape(row, (-1,) + (1,) * np.ndim(x)) for row in rows)
        inside = s * x - offsets > 0.0
        d = np.where(inside, s * x - offsets, 0.0)
        linear = np.sum(s * (2.0 * a + 3.0 * b * d) * d, axis=0)
        square, cube = np.sum(np.where(inside, a + 3.0 * b * d, 0.0), 0), np.sum(s * b * inside, 0)
        return (k1 + x * (2.0 * k2 + x * 3.0 * k3) + linear, k2 + 3.0 * k3 * x + square, k3 + cube)

    def breaks(self) -> np.ndarray:
        """Displacements at which pieces meet, ascending, including both ends."""
        bent = [
            side * offset
            for side, offset, a, b in zip(
                self.sides, self.offsets, self.squares, self.cubes, strict=True
            )
            if a or b
        ]
        return np.unique(bent) if bent else np.array([0.0])

    def pieces(self) -> tuple[tuple[float, np.ndarray], ...]:
        """(origin, coefficients by powers of x − origin) of each piece, from the left."""
        return _pieces(self)

    def roots(self) -> np.ndarray:
        return _roots(self).copy()

    def turning_points(self, energy: float) -> tuple[float, float]:
        level = energy + min((float(self.energy(x)) for x in self.roots()), default=0.0)

        def excess(origin, force):
            rising = force / np.arange(1, 5)
            return np.concatenate([[float(self.energy(origin)) - level], rising])

        levels = self._levels(lambda x: self.energy(x) - level, excess, self._outermost(level))
        return float(levels.min()), float(levels.max())

    def _outermost(self, level):
        """Indices of the outermost pieces in which the energy falls to a level, and of both end
        lines.

        None (search all pieces) if the level is above the energy at an end of the table.
        """
        places, energies = _ladder(self)
        below, breaks = places[energies <= level], self.breaks()
        if not below.size or np.isin(breaks[[0, -1]], below).any():
            return None
        first = int(np.searchsorted(breaks, below[0], side="left"))
        return {0, first, int(np.searchsorted(breaks, below[-1], side="right")), breaks.size}

    def _levels(self, value, polynomial, some=None):
        """Zeros of a function with one polynomial per piece, on all or some pieces."""
        breaks = self.breaks()
        ends = [-math.inf, *breaks, math.inf]
        least = 1e-12 * (abs(breaks[0]) + abs(breaks[-1]) or 1.0)
        solutions = [x for x in breaks if value(x) == 0.0] if some is None else []
        for k, (origin, force) in enumerate(self.pieces()):
            if some is not None and k not in some:
                continue
            low, high = ends[k], ends[k + 1]
            roots = np.polynomial.Polynomial(np.trim_zeros(polynomial(origin, force), "b")).roots()
            real = origin + roots.real[np.abs(roots.imag) < 1e-7 * (least + np.abs(roots.real))]
            solutions += [x for x in real if low - least <= x <= high + least]
        if not solutions and some is not None:
            return self._levels(value, polynomial)
        places = np.sort(solutions)
        # A rest position that differs from 0 by rounding would be mistaken for a device length.
        places[np.abs(places) < 10.0 * least] = 0.0
        return places[np.diff(places, prepend=-math.inf) > 10.0 * least]

    def nonlinear_formula(self, x: str, rate: float, number: Callable) -> str:
        """A formula of F(x)/rate² for netlists."""
        pieces = [(origin, force / rate**2) for origin, force in self.pieces()]
        return self._chosen(x, "force", pieces, "F/rate^2", number)

    @property
    def gain_is_product(self) -> bool:
        return False

    def gain_formula(self, x: str, gap: float, rate: float, number: Callable) -> str:
        """Netlist formula for 2 [U(x) − U(gap)]/rate².

        U is the potential energy of the spring, `gap` the displacement at which a contact begins,
        `rate` the number of scaled time units per second.
        """
        pieces = []
        for origin, force in self.pieces():
            below = float(self.energy(origin)) - float(self.energy(gap))
            rising = np.concatenate([[below], force / np.arange(1, 5)])
            pieces.append((origin, 2.0 * rising / rate**2))
        return self._chosen(x, "gain", pieces, "2 [U - U(gap)]/rate^2", number)

    def _chosen(self, x, name, pieces, meaning, number):
        """The polynomial of the piece that contains x, as nested conditions (bisection)."""
        breaks = self.breaks()
        ends = [number(f"{name}_end{k}", end, "end of a piece") for k, end in enumerate(breaks)]

        def leaf(k):
            coefficients = pieces[k][1]
            way = f"({x}-{ends[max(k - 1, 0)]})"
            texts = [
                number(f"{name}{k}_{n}", float(coefficient), f"{meaning}, power {n}")
                for n, coefficient in enumerate(coefficients)
                if n < 2 or np.any(coefficients[n:])
            ]
            inner = texts.pop()
            for text in reversed(texts):
                inner = f"({text}+{way}*{inner})"
            return inner

        def half(low, high):
            if low == high:
                return leaf(low)
            middle = (low + high) // 2
            return f"(({x}<{ends[middle]}) ? {half(low, middle)} : {half(middle + 1, high)})"

        return half(0, len(pieces) - 1)


# Cached, since preparing a scene calls these functions six times.
@functools.lru_cache(maxsize=64)
def _pieces(table: ForceTable) -> tuple[tuple[float, np.ndarray], ...]:
    """See `ForceTable.pieces`."""
    breaks, pieces = table.breaks(), []
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    # The straight lines beyond both ends begin at the ends.
    for origin, inside in zip(
        [breaks[0], *breaks], [breaks[0] - 1.0, *middles, breaks[-1] + 1.0], strict=True
    ):
        linear, square, cube = (float(term) for term in table.taylor(inside))
        # The same cubic, expanded about the origin. numpy's Polynomial would take 80 ms per device,
        # and a yield study has hundreds of devices.
        away = float(origin) - float(inside)
        bent = square + cube * away
        first, second = linear + bent * away, bent + cube * away
        value = float(table.force(inside)) + first * away
        cubic = np.array([value, first + second * away, second + cube * away, cube])
        if not breaks[0] < inside < breaks[-1]:
            cubic[2:] = 0.0
        cubic.setflags(write=False)
        pieces.append((float(origin), cubic))
    return tuple(pieces)


@functools.lru_cache(maxsize=64)
def _roots(table: ForceTable) -> np.ndarray:
    """See `ForceTable.roots`."""
    return table._levels(table.force, lambda origin, force: force)


@functools.lru_cache(maxsize=64)
def _ladder(table: ForceTable) -> tuple[np.ndarray, np.ndarray]:
    """Ends of pieces and rest positions, ascending, and the energy there, monotone in between.

    With this table, turning points need the roots of 4 pieces instead of 34; these took 0.3 s in
    the 60 iterations for a device's frequency under noise.
    """
    places = np.unique(np.concatenate([table.breaks(), table.roots()]))
    return places, np.array([float(table.energy(x)) for x in places])


def force_table(
    points: Sequence[tuple[float, float]], interpolation: str = INTERPOLATIONS[0]
) -> ForceTable:
    """The spring through a table's points, or a smooth fit to them.

    `points`: displacement and force, the displacements ascending, the first below 0 and the last
    above. `interpolation`: "monotone": through every point without overshoot (scipy's PCHIP), with
    at most `MOST_PIECES` + 1 points. "smooth": a cubic least-squares spline with continuous F'' and
    at least three points per piece.
    """
    from scipy.interpolate import PchipInterpolator, PPoly, make_lsq_spline

    x, force = np.array(points, dtype=float).T
    if interpolation == "monotone":
        interpolant = PchipInterpolator(x, force)
        breaks, coefficients = interpolant.x, interpolant.c
    else:
        count = min(MOST_PIECES, (x.size - 1) // POINTS_PER_PIECE)
        inner = np.interp(np.arange(1, count) / count, np.linspace(0.0, 1.0, x.size), x)
        knots = np.concatenate([[x[0]] * 4, inner, [x[-1]] * 4])
        piecewise = PPoly.from_spline(make_lsq_spline(x, force, knots, 3))
        nonempty = np.diff(piecewise.x) > 0.0
        breaks, coefficients = (
            np.append(piecewise.x[:-1][nonempty], x[-1]),
            piecewise.c[:, nonempty],
        )
    return _of_pieces(breaks, coefficients[::-1].T)


def _of_pieces(breaks, rising):
    """Table of the pieces between breaks, with coefficients in rising powers."""
    middle = int(np.clip(np.searchsorted(breaks, 0.0, side="right") - 1, 0, len(rising) - 1))
    lengths = np.diff(breaks)
    ends = rising[:, 2] + 3.0 * rising[:, 3] * lengths
    terms = []
    for k in range(middle + 1, len(rising) + 1):
        square, cube = rising[k][2:] if k < len(rising) else (0.0, 0.0)
        terms.append((1.0, breaks[k], square - ends[k - 1], cube - rising[k - 1][3]))
    for k in range(middle, -1, -1):
        square, cube = (ends[k - 1], rising[k - 1][3]) if k > 0 else (0.0, 0.0)
        terms.append((-1.0, -breaks[k], square - rising[k][2], rising[k][3] - cube))
    terms += [(1.0, 0.0, 0.0, 0.0)] * (TERMS - len(terms))
    sides, offsets, squares, cubes = (tuple(map(float, row)) for row in zip(*terms, strict=True))
    core = np.polynomial.Polynomial(rising[middle])(
        np.polynomial.Polynomial([-breaks[middle], 1.0])
    )
    table = ForceTable(
        core=tuple(map(float, np.append(core.coef, np.zeros(4))[:4])),
        sides=sides,
        offsets=offsets,
        squares=squares,
        cubes=cubes,
        energy_cubes=tuple(s * a / 3.0 for s, a in zip(sides, squares, strict=True)),
        energy_fourths=tuple(s * b / 4.0 for s, b in zip(sides, cubes, strict=True)),
        steepest=0.0,
    )
    return table._replace(steepest=_steepest(breaks, rising))


def _steepest(breaks, rising):
    """Greatest |F'|: at an end of a piece or where F'' vanishes within it."""
    slopes = []
    for (_, k1, k2, k3), length in zip(rising, np.diff(breaks), strict=True):
        places = [0.0, length]
        if k3 != 0.0:
            places.append(float(np.clip(-k2 / (3.0 * k3), 0.0, length)))
        slopes += [abs(k1 + d * (2.0 * k2 + 3.0 * k3 * d)) for d in places]
    return float(max(slopes))


def _bent(sides, offsets, firsts, seconds, x, power):
    """The sum of a `ForceTable`'s terms, for calls from Python: terms that are zero are skipped."""
    x = float(x) if np.ndim(x) == 0 else np.asarray(x, dtype=float)
    total = 0.0 * x
    for s, offset, first, second in zip(sides, offsets, firsts, seconds, strict=True):
        if first or second:
            way = s * x - offset
            d = max(way, 0.0) if isinstance(way, float) else np.maximum(way, 0.0)
            total = total + (first + second * d) * d**power
    return total


def bends_squared(sides: tuple, offsets: tuple, squares: tuple, cubes: tuple, x: Values) -> Values:
    """Σ (square + cube·d) d² of the terms, d = max(side·x − offset, 0)."""
    return _bent(sides, offsets, squares, cubes, x, 2)


def bends_cubed(sides: tuple, offsets: tuple, cubes: tuple, fourths: tuple, x: Values) -> Values:
    """Σ (cube + fourth·d) d³ of the terms."""
    return _bent(sides, offsets, cubes, fourths, x, 3)


@functools.cache
def _sum_of_terms(power):
    """Sum of the terms as unrolled LLVM instructions: a loop would prevent vectorization."""

    @compilation.intrinsic
    def summed(
        typing_context: Any, sides: Any, offsets: Any, firsts: Any, seconds: Any, x: Any
    ) -> Any:
        rows = (sides, offsets, firsts, seconds)

        def code(context, builder, signature, arguments):
            *tuples, position = arguments
            zero, total = position.type(0.0), position.type(0.0)
            for k in range(rows[0].count):
                s, offset, first, second = (builder.extract_value(row, k) for row in tuples)
                way = builder.fsub(builder.fmul(s, position), offset)
                d = builder.select(builder.fcmp_ordered(">", way, zero), way, zero)
                term = builder.fadd(first, builder.fmul(second, d))
                for _ in range(power):
                    term = builder.fmul(term, d)
                total = builder.fadd(total, term)
            return total

        float64 = compilation.types.float64
        return float64(*rows, float64), code

    return summed


@overload(bends_squared)
def _bends_squared(sides, offsets, squares, cubes, x):
    summed = _sum_of_terms(2)
    return lambda sides, offsets, squares, cubes, x: summed(sides, offsets, squares, cubes, x)


@overload(bends_cubed)
def _bends_cubed(sides, offsets, cubes, fourths, x):
    summed = _sum_of_terms(3)
    return lambda sides, offsets, cubes, fourths, x: summed(sides, offsets, cubes, fourths, x)

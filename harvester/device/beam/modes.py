"""Bending modes of a cantilever of uniform pieces with a rigid body at its tip.

Euler–Bernoulli: every piece is solved exactly, so the only error comes from the root search
(1e-13). The state along the beam is (w, w', EI w'', EI w''').
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

# Gauss quadrature points per piece; the first modes have at most a few waves per piece.
GAUSS_POINTS = 24
# The search for roots raises the eigenvalue λ ∝ √ω: by FACTOR below λ = 1, by STEP above.
FACTOR, STEP = 1.1, 0.1
# Smallest λ of the search; a tip of 1e6 times the beam's mass has λ = 0.04.
SMALLEST_LAMBDA = 1e-3


class Piece(NamedTuple):
    """A uniform piece: length (m), EI (N m²), mass per length (kg/m), moment per volt (N m/V)."""

    length: float
    rigidity: float
    mass: float
    moment_per_volt: float


class Tip(NamedTuple):
    """A rigid body: mass (kg), centre beyond the beam's end (m), inertia about that end (kg m²)."""

    mass: float = 0.0
    offset: float = 0.0
    inertia: float = 0.0


class Mode(NamedTuple):
    """A mode of unit modal mass.

    Attributes
    ----------
    angular_frequency
        rad/s, electrodes short-circuited.
    tip, tip_slope
        φ(L), φ'(L).
    forcing
        Response γ = ∫ m φ + M_t φ(L) + M_t o φ'(L) to the base's acceleration; M_t: tip mass, o:
        its offset.
    coupling
        χ = ∫ ϑ φ'', with the moment per volt ϑ of a piece (N m/V).
    curvatures
        φ'' at the beginning and the end of each piece.
    """

    angular_frequency: float
    tip: float
    tip_slope: float
    forcing: float
    coupling: float
    curvatures: tuple[tuple[float, float], ...]


class ResidualModes(NamedTuple):
    """Static sums over all modes: Σ χr²/ωr² (F) and Σ χr γr/ωr² (C s²/m).

    `moments` are the bending moments of a unit acceleration (N s²) at the beginning and the end of
    each piece.
    """

    capacitance: float
    charge: float
    moments: tuple[tuple[float, float], ...]


def modes(
    pieces: Sequence[Piece], tip: Tip, count: int = 1, root_compliance: float = 0.0
) -> list[Mode]:
    """The lowest modes of the beam.

    `pieces`: the beam's pieces from the clamp to the tip. `root_compliance`: rotation of the clamp
    per moment (rad/(N m)); 0: rigid.
    """
    from scipy.optimize import brentq

    lowest: list[Mode] = []
    before, start = SMALLEST_LAMBDA, _mismatch(SMALLEST_LAMBDA, pieces, tip, root_compliance)
    while len(lowest) < count:
        after = before * FACTOR if before < 1.0 else before + STEP
        end = _mismatch(after, pieces, tip, root_compliance)
        if start * end <= 0.0:
            call = (pieces, tip, root_compliance)
            root = brentq(_mismatch, before, after, args=call, xtol=1e-14, rtol=1e-14)
            lowest.append(_mode(root, *call))
        before, start = after, end
    return lowest


def clamp_compliance(pieces: Sequence[Piece], tip: Tip, angular_frequency: float) -> float:
    """The rotation per moment of the clamp with which the first mode has this frequency.

    Negative if the frequency is above the frequency with a rigid clamp.
    """
    square = _square_root_scale(pieces)
    value = math.sqrt(angular_frequency / square)
    rigid = _ends(value, pieces, tip)
    # The determinant is linear in the compliance; its root is where determinant + compliance ·
    # turned = 0.
    determinant = rigid[0, 2] * rigid[1, 3] - rigid[0, 3] * rigid[1, 2]
    turned = rigid[0, 1] * rigid[1, 3] - rigid[0, 3] * rigid[1, 1]
    return -determinant / turned


def rest(pieces: Sequence[Piece], tip: Tip) -> ResidualModes:
    """Static sums over all modes: ∫ ϑ²/EI, and ∫ ϑ G/EI.

    ϑ is the moment per volt, EI the rigidity, G the bending moment of a unit acceleration. The
    clamp's compliance has no effect, as the beam is statically determinate.
    """
    capacitance = charge = 0.0
    moment, shear = tip.mass * tip.offset, tip.mass
    moments: list[tuple[float, float]] = []
    for piece in reversed(pieces):
        length, flux = piece.length, piece.moment_per_volt / piece.rigidity
        capacitance += piece.moment_per_volt * flux * length
        area = moment * length + shear * length**2 / 2.0 + piece.mass * length**3 / 6.0
        charge += flux * area
        end, moment = moment, moment + shear * length + piece.mass * length**2 / 2.0
        moments.insert(0, (moment, end))
        shear += piece.mass * length
    return ResidualModes(capacitance, charge, tuple(moments))


def shape(
    pieces: Sequence[Piece], tip: Tip, root_compliance: float = 0.0, points: int = 40
) -> tuple[np.ndarray, np.ndarray]:
    """Positions along the beam (m), and the first mode's displacement relative to the tip's."""
    frequency = modes(pieces, tip, 1, root_compliance)[0].angular_frequency
    value = math.sqrt(frequency / _square_root_scale(pieces))
    places, values, begin = [0.0], [0.0], 0.0
    for piece, state, wave in _walk(value, pieces, tip, root_compliance):
        for x in np.linspace(0.0, piece.length, points)[1:]:
            places.append(begin + float(x))
            values.append(float((_transfer(float(x), piece.rigidity, wave) @ state)[0]))
        begin += piece.length
    return np.array(places), np.array(values) / values[-1]


def _square_root_scale(pieces):
    """ω/λ² (rad/s) of a uniform beam with the mean rigidity and mass; λ = wave number × L."""
    length = sum(piece.length for piece in pieces)
    rigidity = length / sum(piece.length / piece.rigidity for piece in pieces)
    mass = sum(piece.mass * piece.length for piece in pieces) / length
    return math.sqrt(rigidity / mass) / length**2


def _transfer(x, rigidity, wave):
    """Transfer matrix of the state from a piece's beginning to x (Krylov functions)."""
    angle = wave * x
    cosh, cos, sinh, sin = math.cosh(angle), math.cos(angle), math.sinh(angle), math.sin(angle)
    fourth = wave**4
    k0, k1 = (cosh + cos) / 2.0, (sinh + sin) / (2.0 * wave)
    k2, k3 = (cosh - cos) / (2.0 * wave**2), (sinh - sin) / (2.0 * wave**3)
    return np.array(
        [
            [k0, k1, k2 / rigidity, k3 / rigidity],
            [fourth * k3, k0, k1 / rigidity, k2 / rigidity],
            [rigidity * fourth * k2, rigidity * fourth * k3, k0, k1],
            [rigidity * fourth * k1, rigidity * fourth * k2, fourth * k3, k0],
        ]
    )


def _waves(value, pieces):
    """Angular frequency (rad/s) for a value of λ, and the wave number (1/m) of each piece."""
    frequency = value**2 * _square_root_scale(pieces)
    return frequency, [(piece.mass * frequency**2 / piece.rigidity) ** 0.25 for piece in pieces]


def _ends(value, pieces, tip):
    """Residuals of the tip's two boundary conditions, per unit component of the clamp's state."""
    frequency, waves = _waves(value, pieces)
    transfer = np.eye(4)
    for piece, wave in zip(pieces, waves, strict=True):
        transfer = _transfer(piece.length, piece.rigidity, wave) @ transfer
    square, first = frequency**2, tip.mass * tip.offset
    moment = transfer[2] - square * (first * transfer[0] + tip.inertia * transfer[1])
    shear = transfer[3] + square * (tip.mass * transfer[0] + first * transfer[1])
    return np.array([moment, shear])


def _mismatch(value, pieces, tip, root_compliance):
    """The characteristic determinant, which vanishes at a mode."""
    ends = _ends(value, pieces, tip)
    first = ends[:, 2] + root_compliance * ends[:, 1]
    return first[0] * ends[1, 3] - first[1] * ends[0, 3]


def _walk(
    value: float, pieces: Sequence[Piece], tip: Tip, root_compliance: float
) -> Iterator[tuple[Piece, np.ndarray, float]]:
    """Yield each piece with the state at its beginning and its wave number."""
    ends = _ends(value, pieces, tip)
    first = ends[:, 2] + root_compliance * ends[:, 1]
    row = int(np.argmax(np.abs(ends[:, 3])))
    ratio = -first[row] / ends[row, 3]
    state = np.array([0.0, root_compliance, 1.0, ratio])
    for piece, wave in zip(pieces, _waves(value, pieces)[1], strict=True):
        yield piece, state, wave
        state = _transfer(piece.length, piece.rigidity, wave) @ state


def _mode(value, pieces, tip, root_compliance):
    """The mode that belongs to a root λ, normalized to unit modal mass."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    kinetic = forcing = coupling = 0.0
    state, curvatures = np.zeros(4), []
    for piece, begin, wave in _walk(value, pieces, tip, root_compliance):
        half = piece.length / 2.0
        inside = [_transfer(half * (1.0 + x), piece.rigidity, wave) @ begin for x in nodes]
        w = np.array([inner[0] for inner in inside])
        kinetic += piece.mass * half * float(weights @ w**2)
        forcing += piece.mass * half * float(weights @ w)
        state = _transfer(piece.length, piece.rigidity, wave) @ begin
        coupling += piece.moment_per_volt * (state[1] - begin[1])
        curvatures.append(np.array([begin[2], state[2]]) / piece.rigidity)
    end, slope = float(state[0]), float(state[1])
    first = tip.mass * tip.offset
    kinetic += tip.mass * end**2 + 2.0 * first * end * slope + tip.inertia * slope**2
    forcing += tip.mass * end + first * slope
    unit = math.copysign(1.0 / math.sqrt(kinetic), end)
    return Mode(
        angular_frequency=_waves(value, pieces)[0],
        tip=unit * end,
        tip_slope=unit * slope,
        forcing=unit * forcing,
        coupling=unit * float(coupling),
        curvatures=tuple((unit * float(begin), unit * float(end)) for begin, end in curvatures),
    )

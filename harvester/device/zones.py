"""Detects where a step leaves its contact zone, by the cubic through the step's two ends."""

from __future__ import annotations

from harvester.base.compilation import compiled


@compiled
def _hermite(x, v, x1, v1, h, u):
    """Displacement and its derivative at the share u of a step, by the cubic through both ends."""
    rise = x1 - x
    a = h * v - rise
    b = rise - h * v1
    w = 1.0 - u
    bend = u * w * (a * w + b * u)
    slope = rise + (w - u) * (a * w + b * u) + u * w * (b - a)
    return x + rise * u + bend, slope


@compiled
def overshoots(low: float, high: float, x: float, v: float, x1: float, v1: float, h: float) -> bool:
    """Whether a step that starts and ends within a zone leaves it in between."""
    turn = _hermite(x, v, x1, v1, h, v / (v - v1))[0]
    return turn > high or turn < low


@compiled
def crossing(
    edge: float, direction: int, x: float, v: float, x1: float, v1: float, h: float
) -> float:
    """Time from the step's beginning at which x first passes the edge in the direction ±1.

    Newton's method on the cubic, safeguarded by bisection. A mass that starts on the edge and moves
    away passes it on its way back.
    """
    low, high = 0.0, 1.0
    inside = direction * (x1 - edge) <= 0.0
    if inside:
        high = v / (v - v1)
    u = 0.5 * high
    if high == 1.0:
        u = (edge - x) / (x1 - x) if direction * v > 0.0 else 1.0
    for _ in range(60):
        value, slope = _hermite(x, v, x1, v1, h, u)
        excess = direction * (value - edge)
        if excess > 0.0:
            high = u
        else:
            low = u
        step = -excess / (direction * slope)
        u += step
        if not low <= u <= high:
            u = 0.5 * (low + high)
        elif abs(step) < 1e-9:
            break
    return max(u, 1e-9) * h

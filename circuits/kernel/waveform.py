"""Independent sources: a constant, a sine, a pulse train, exponentials or straight lines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.compilation import compiled

if TYPE_CHECKING:
    from circuits.netlist.waveform import Waveform

SINE, PULSE, EXPONENTIAL, LINES = range(4)
# Numbers of a changing source: sign, its first and last corner, and up to seven parameters.
SIGN, FIRST, LAST = range(3)
OWN = 3
COLUMNS = OWN + 7
KINDS = {"sin": SINE, "pulse": PULSE, "exp": EXPONENTIAL, "pwl": LINES}
# Steps per period of a sine, with an error of about 0.1 %.
STEPS_OF_SINE = 40.0


def shape(wave: Waveform) -> tuple[int, list[float], list[tuple[float, float]]]:
    """(kind, seven numbers, corners) of a changing source."""
    numbers = list(wave.numbers)
    if wave.kind == "pwl":
        return LINES, [0.0] * 7, list(zip(numbers[::2], numbers[1::2], strict=True))
    if wave.kind == "sin":
        numbers[5] = math.radians(numbers[5])
    return KINDS[wave.kind], numbers + [0.0] * (7 - len(numbers)), []


@compiled
def value(kind: int, row: np.ndarray, corners: np.ndarray, time: float) -> float:
    """Value of a changing source at a time."""
    if kind == LINES:
        first, last = int(row[FIRST]), int(row[LAST])
        if time <= corners[first, 0]:
            return row[SIGN] * corners[first, 1]
        for k in range(first + 1, last):
            if time < corners[k, 0]:
                share = (time - corners[k - 1, 0]) / (corners[k, 0] - corners[k - 1, 0])
                rise = corners[k, 1] - corners[k - 1, 1]
                return row[SIGN] * (corners[k - 1, 1] + share * rise)
        return row[SIGN] * corners[last - 1, 1]
    a, b, c, d, e, f, g = row[3], row[4], row[5], row[6], row[7], row[8], row[9]
    if kind == SINE:
        if time < d:
            return row[SIGN] * (a + b * np.sin(f))
        late = time - d
        return row[SIGN] * (a + b * np.sin(2.0 * np.pi * c * late + f) * np.exp(-late * e))
    if kind == PULSE:
        late = time - c
        if late >= g > 0.0:
            late -= g * np.floor(late / g)
        if late <= 0.0 or late >= d + f + e:
            return row[SIGN] * a
        if late < d:
            return row[SIGN] * (a + (b - a) * late / d)
        if late <= d + f:
            return row[SIGN] * b
        return row[SIGN] * (b + (a - b) * (late - d - f) / e)
    total = a
    if time > c:
        total += (b - a) * (1.0 - np.exp(-(time - c) / d))
    if time > e:
        total += (a - b) * (1.0 - np.exp(-(time - e) / f))
    return row[SIGN] * total


@compiled
def next_corner(kind: int, row: np.ndarray, corners: np.ndarray, time: float) -> float:
    """The next time at which a time-varying source has a corner; infinite without one."""
    if kind == LINES:
        for k in range(int(row[FIRST]), int(row[LAST])):
            if corners[k, 0] > time:
                return corners[k, 0]
        return np.inf
    if kind == SINE:
        return row[6] if row[6] > time else np.inf
    if kind == EXPONENTIAL:
        return _first_after(time, row[5], row[7])
    delay, rise, fall, width, every = row[5], row[6], row[7], row[8], row[9]
    begin = delay
    if time > delay and every > 0.0:
        begin += every * np.floor((time - delay) / every)
    bends = (begin, begin + rise, begin + rise + width, begin + rise + width + fall)
    corner = begin + every if every > 0.0 else np.inf
    for bend in bends:
        if time < bend < corner:
            corner = bend
    return corner


@compiled
def _first_after(time, one, other):
    earliest = np.inf
    for candidate in (one, other):
        if time < candidate < earliest:
            earliest = candidate
    return earliest


@compiled
def longest_step(kind: int, row: np.ndarray) -> float:
    """The longest step that resolves a source between corners; infinite for straight lines."""
    if kind == SINE and row[5] > 0.0:
        return 1.0 / (STEPS_OF_SINE * row[5])
    return np.inf

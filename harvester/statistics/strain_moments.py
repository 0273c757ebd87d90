"""Streaming strain and stress of a beam's layers: squares, peaks, and the damage of its cycles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.base.compilation import compiled
from harvester.base.libraries import optional_library
from harvester.device.beam.strain import strain_of_layers
from harvester.device.record import Record
from harvester.scene.prepared import Prepared

# Columns of `StrainMoments.peaks`; in `StrainMoments.squares` the time precedes them.
STRAIN, STRESS = 0, 1


@dataclass
class StrainMoments:
    """Sums and peaks of one realization's strain and stress, in the batches of `Moments`.

    Attributes
    ----------
    rows : strain and stress (Pa) for each scaled displacement and voltage.
    squares
        Time, and time integrals of the strain's and the stress's square; shape (batches, 3).
    peaks
        Largest magnitude of strain and stress; shape (batches, 2).
    damage
        Damage by the cycles that end in each batch; None without a Basquin curve, and before the
        realization's end.
    """

    rows: np.ndarray
    squares: np.ndarray
    peaks: np.ndarray
    damage: np.ndarray | None = None

    @classmethod
    def of(cls, prepared_scene: Prepared, batches: int) -> StrainMoments | None:
        """Empty moments; None for a scene without a drawing."""
        if prepared_scene.scene.beam is None:
            return None
        layers, scales = strain_of_layers(prepared_scene.scene.beam), prepared_scene.scales
        strain = np.array([layers.per_displacement, layers.per_volt])
        stress = layers.modulus * strain + [0.0, layers.stress_per_volt]
        rows = np.array([strain, stress]) * [scales.displacement, scales.voltage]
        return cls(rows, np.zeros((batches, 3)), np.zeros((batches, 2)))


class StrainWatch:
    """Add one realization's record to its `StrainMoments`.

    `line`: strain, cycles and exponent of the Basquin curve if cycles are to be counted. This needs
    the package rainflow; otherwise MissingLibrary is raised.
    """

    def __init__(self, moments: Any, line: tuple[float, float, float] | None) -> None:
        self._moments, self._line = moments, line
        self._strain: Any = moments.strain
        self._turns: list[np.ndarray] = []
        self._rainflow: Any = line and optional_library("rainflow", "a life", "fatigue")
        # Time, strain and stress of the last two points.
        self._last = np.full((2, 3), np.nan)

    def add(self, record: Record) -> None:
        """Add the points of one chunk."""
        if record.time.size == 0:
            return
        of, strain = self._moments, self._strain
        turns = np.empty((record.time.size if self._line else 0, 2))
        count = _add_points(
            record.time, record.displacement, record.voltage, strain.rows, of.start,
            of.batch_length, strain.squares, strain.peaks, self._last, turns,
        )  # fmt: skip
        if count:
            self._turns.append(turns[:count].copy())

    def close(self) -> None:
        """Count the cycles of the whole realization and add their damage (Miner's rule)."""
        if self._line is None:
            return
        limit, cycles, exponent = self._line
        damage = np.zeros(len(self._strain.squares))
        turns = (
            np.concatenate([*self._turns, self._last[1:, :2]]) if self._turns else np.empty((0, 2))
        )
        extracted = self._rainflow.extract_cycles(turns[:, 1]) if len(turns) else ()
        for span, _, share, _, end in extracted:
            batch = int((turns[end, 0] - self._moments.start) / self._moments.batch_length)
            damage[min(batch, len(damage) - 1)] += share * (0.5 * span / limit) ** exponent
        self._strain.damage = damage / cycles


@compiled
def _add_points(time, x, voltage, rows, start, length, squares, peaks, last, turns):
    """Add points that follow `last`, two rows of (time, strain, stress); count turning points.

    Turning points of the strain are written as (time, strain), including the first measured point.
    A peak between points is the vertex of the parabola through three of them.
    """
    count, batches, point = 0, len(squares), np.empty(3)
    for i in range(time.size):
        point[0] = time[i]
        for k in range(2):
            point[k + 1] = rows[k, 0] * x[i] + rows[k, 1] * voltage[i]
        if last[1, 0] >= start:
            interval = point[0] - last[1, 0]
            batch = min(int((0.5 * (point[0] + last[1, 0]) - start) / length), batches - 1)
            squares[batch, 0] += interval
            for k in range(2):
                before, now = last[1, k + 1], point[k + 1]
                squares[batch, k + 1] += 0.5 * interval * (before * before + now * now)
                peaks[batch, k] = max(peaks[batch, k], abs(before), abs(now))
                rise, fall = before - last[0, k + 1], now - before
                if last[0, 0] >= start and (rise * fall < 0.0 or (fall == 0.0 and rise != 0.0)):
                    top = _vertex(last[0], last[1], point, k + 1)
                    peaks[batch, k] = max(peaks[batch, k], abs(top))
                    if k == 0 and turns.size > 0:
                        turns[count, 0], turns[count, 1] = last[1, 0], top
                        count += 1
            if not last[0, 0] >= start and turns.size > 0:
                turns[count, 0], turns[count, 1] = last[1, 0], last[1, 1]
                count += 1
        for k in range(3):
            last[0, k], last[1, k] = last[1, k], point[k]
    return count


@compiled
def _vertex(first, middle, end, k):
    """The vertex of the parabola through three points, if it is near the middle one."""
    before, after = first[0] - middle[0], end[0] - middle[0]
    rise, fall = first[k] - middle[k], end[k] - middle[k]
    below = before * after * (before - after)
    if below == 0.0:
        return middle[k]
    bend = (after * rise - before * fall) / below
    slope = (before * before * fall - after * after * rise) / below
    if bend == 0.0:
        return middle[k]
    return middle[k] - 0.25 * slope * slope / bend


def prepare() -> None:
    """Load the compiled code, so that its time does not count as simulation time."""
    points, nothing = np.zeros(2), np.zeros((1, 3))
    _add_points(
        np.array([0.0, 1.0]), points, points, np.zeros((2, 2)), 0.0, 1.0, nothing, np.zeros((1, 2)),
        np.full((2, 3), np.nan), np.empty((2, 2)),
    )  # fmt: skip

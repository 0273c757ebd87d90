"""Devices that others measured, with what this program predicts of them, misses included.

Read from the papers' tables and figures; no figure of theirs is shipped. A point's limit follows
from how well it was read and from the measurement's own scatter, and from nothing that this program
computes: at one frequency every linear device with any source impedance gives a resistor R the
power R/(a + b R + c R²), and what the points leave of the best such curve is their scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harvester.engines.request import Request
from harvester.scene.model import Scene
from harvester.validation import SIGNIFICANT_SIGMAS
from harvester.validation.downloaded import downloaded
from harvester.validation.truth import Truth

GRAVITY = 9.80665
# A run settles for so many time constants of the device, and averages so many periods.
SETTLING, PERIODS = 12.0, 100.0
# The rectifier's storage discharges to 1/e in 10 periods, and its runs settle for 260. The paper
# does not state the storage; the ripple of this one costs less than 0.1 % of the power.
STORED, RECTIFIED = 10.0, 260.0


@dataclass(frozen=True)
class LumpedCantilever:
    """A cantilever's first mode, in SI: M, K, θ, Cp, μ and ζ."""

    mass: float
    stiffness: float
    coupling: float
    capacitance: float
    base_factor: float
    damping_ratio: float

    def scene(self, frequency: float, acceleration: float, load: dict[str, Any]) -> Scene:
        """The scene of this device with a load, its base driven by a sine (Hz, m/s²)."""
        damping = 2.0 * self.damping_ratio * (self.stiffness * self.mass) ** 0.5
        decay = self.damping_ratio * (self.stiffness / self.mass) ** 0.5
        waits = RECTIFIED / frequency if "netlist" in load else SETTLING / decay
        tables = {
            "units": "SI",
            "oscillator": {
                "mass": self.mass,
                "damping": damping,
                "linear_stiffness": self.stiffness,
                "base_factor": self.base_factor,
            },
            "piezo": {"coupling": self.coupling, "capacitance": self.capacitance},
            "load": load,
            "excitation": {"kind": "sine", "amplitude": acceleration, "frequency": frequency},
            "run": {"seed": 1, "realizations": 1, "settle": waits, "duration": PERIODS / frequency},
        }
        return Scene.from_tables(tables, name="measured device")


@dataclass(frozen=True)
class MeasuredDevice:
    """A published measurement.

    Attributes
    ----------
    name : str
    source : str
    remarks : tuple of str
        Sentences on what the paper states, what is inferred, and how the limit is set.
    lumped : LumpedCantilever
    reading : float
        Relative error of a power as it was read, and of what was taken from such a point.
    series : dict of float to (resistances, powers)
        Load resistances (kΩ) and mean powers (W) by frequency (Hz).
    acceleration : float
        Acceleration of the base (m/s²).
    methods : tuple of str
    scatter : float or None
        Relative, where no curve of a linear device gives it.
    """

    name: str
    source: str
    remarks: tuple[str, ...]
    lumped: LumpedCantilever
    reading: float
    series: dict[float, tuple[tuple[float, ...], tuple[float, ...]]]
    acceleration: float = GRAVITY
    methods: tuple[str, ...] = ("monte-carlo",)
    scatter: float | None = None

    def truths(self) -> list[Truth]:
        """The known results of this device, one for each measured point."""
        truths = []
        for frequency, (resistances, powers) in self.series.items():
            scatter = self.own_scatter(frequency)
            for kilo, power in zip(resistances, powers, strict=True):
                load, quantity = self._load(frequency, 1e3 * kilo, power)
                scene = self.lumped.scene(frequency, self.acceleration, load)
                truths.append(
                    Truth(
                        f"{self.name}, {frequency:g} Hz, {kilo:g} kΩ",
                        self.source,
                        power,
                        (self.reading + SIGNIFICANT_SIGMAS * scatter) * power,
                        {method: Request(scene, method) for method in self.methods},
                        quantity,
                        "W",
                        self.name,
                    )
                )
        return truths

    def own_scatter(self, frequency: float) -> float:
        """Relative rms of the points about the curve of a linear device."""
        return self.scatter if self.scatter is not None else linear_scatter(*self.series[frequency])

    def _load(self, frequency, resistance, power):
        if self.scatter is None:
            return {"resistance": resistance}, "mean_power"
        storage = STORED / (frequency * resistance)
        initial = (power * resistance) ** 0.5
        values = {"resistance": resistance, "storage": storage, "initial": initial}
        return {"netlist": "bridge", "parameters": values}, "mean_output_power"


def linear_scatter(resistances: Sequence[float], powers: Sequence[float]) -> float:
    """Relative rms of powers about the best R/(a + b R + c R²), a, b, c ≥ 0."""
    from scipy.optimize import least_squares, nnls

    r, p = np.array(resistances, dtype=float), np.array(powers, dtype=float)
    table = np.column_stack([1.0 / r, np.ones_like(r), r]) * p[:, None]
    sizes = table.max(axis=0)
    begun = np.log(np.maximum(nnls(table / sizes, np.ones_like(r))[0], 1e-9) / sizes)

    def residuals(logarithms: np.ndarray) -> np.ndarray:
        a, b, c = np.exp(logarithms)
        return np.log(p * (a / r + b + c * r))

    return float(np.sqrt(np.sum(least_squares(residuals, begun).fun ** 2) / (r.size - begun.size)))


def _halves(unit: float, peaks: Sequence[float]) -> tuple[float, ...]:
    """Mean powers (W) of published peak powers |V|²/R."""
    return tuple(0.5 * unit * peak for peak in peaks)


_BARE = (0.47, 1.2, 6.7, 9.9, 21.5, 44.9, 90.0, 246.0, 317.0, 398.0, 491.0, 995.0)
_TIPPED = (1.0, 6.7, 11.8, 22.0, 33.0, 47.0, 100.0, 470.0)
_RECTIFIED = (22.0, 32.6, 46.2, 79.8, 114.5, 204.0, 296.0, 403.5, 549.3)

DEVICES = (
    MeasuredDevice(
        "bare bimorph",
        "Erturk and Inman 2011, Proc. IMechE I 225, 485, table 2 and figure 6",
        (
            "T226-H4-203X (PZT-5H, series), resistor, per g² of the base's acceleration.",
            "Stated: dimensions and materials, from which mass, stiffness, coupling, capacitance "
            "and μ follow by the first mode of an Euler–Bernoulli beam.",
            "Taken from the measurement: ζ = 0.0088, from the paper's own point at 470 Ω and "
            "502.5 Hz. That point is not blind, and each point at resonance rests on it.",
            "Limit: 2 % for the reading, 2 % for that of the point that gave ζ, and three times "
            "the scatter.",
        ),
        LumpedCantilever(0.20546e-3, 2048.98, 1.20724e-3, 7.568e-9, 1.5660, 0.0088),
        0.04,
        {
            502.5: (
                _BARE,
                _halves(1e-6, (46.1, 101.8, 221.8, 219.0, 170.3, 108.4, 63.1, 25.56, 20.1, 16.06,
                               12.97, 6.58)),
            ),
            524.7: (
                _BARE,
                _halves(1e-6, (2.046, 5.25, 27.9, 39.2, 76.2, 129.2, 186.0, 213.6, 208.3, 190.7,
                               176.9, 118.3)),
            ),
        },
    ),
    MeasuredDevice(
        "bimorph with a tip mass",
        "Erturk and Inman 2009, Smart Mater. Struct. 18, 025009, table 1 and figure 10c",
        (
            "T226-A4-503X (series) with 12 g at its tip, resistor, per g².",
            "Stated: dimensions and materials, as above. Taken from the measurement: ζ = 0.027, "
            "from 1 kΩ at 45.6 Hz.",
            "Not stated: the voltmeter's own resistance; 1 MΩ beside the load would explain the "
            "highest load.",
            "Limit: 2 % for the reading, 2 % for that of the point that gave ζ, and three times "
            "the scatter. The scatter is large: these points test the prediction to a third only.",
        ),
        LumpedCantilever(14.04e-3, 1157.9, 2.327e-3, 41.26e-9, 1.0854, 0.027),
        0.04,
        {
            45.6: (_TIPPED, _halves(1e-3, (2.473, 15.39, 19.59, 21.92, 24.10, 18.61, 17.37, 4.64))),
            48.4: (_TIPPED, _halves(1e-3, (0.5515, 3.122, 5.709, 10.0, 11.78, 11.99, 22.11,
                                           15.13))),
        },
    ),
    MeasuredDevice(
        "bridge rectifier",
        "Shu and Lien 2006, Smart Mater. Struct. 15, 1499, section 4.2 and figure 8",
        (
            "Triple-layer bender, bridge and storage, driven at 53.7 Hz with 1.856 m/s²; power in "
            "the resistor behind the bridge.",
            "Stated: dimensions, masses, ζ = 0.01, k² = 0.0289 of θ²/(K Cp), 52.9 Hz short.",
            "Inferred: Cp = 42.51 nF and θ = 0.36265 mN/V from the paper's theoretical optimum of "
            "210 kΩ. Assumed, for the paper does not say it: diodes 1N4148 (ideal ones are 3 to "
            "34 % higher), a storage of ten periods.",
            "Limit: 0.6 % for the reading of the voltage (0.3 %), and three times the scatter of "
            "V²/R about the power, as both were read, 0.5 %. What is inferred and assumed is not "
            "in it: the misses show what that is worth.",
        ),
        LumpedCantilever(0.96895e-3, 107.0465, 3.6265e-4, 42.51e-9, 1.3266, 0.01),
        0.006,
        {53.7: (_RECTIFIED, tuple(1e-6 * power for power in (24.4, 32.5, 40.0, 51.2, 61.0, 68.9,
                                                             68.8, 66.5, 62.9)))},
        1.856,
        ("circuit", "monte-carlo"),
        0.005,
    ),
)  # fmt: skip


def measured() -> list[Truth]:
    """All points, and the sets that the reader has downloaded."""
    return [*(truth for device in DEVICES for truth in device.truths()), *downloaded()]

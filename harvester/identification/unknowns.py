"""The unknowns of a fit (values of the scene and of the sensors) with their bounds and sizes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harvester.base.errors import HarvesterError, SceneError
from harvester.base.plain_text import named, nearest
from harvester.identification.sensors import HIGHPASSES, PROBE, VELOCITY_SCALE, sensor_keys
from harvester.scene.numbers import numbers
from harvester.scene.units import restoring_spring, setting

if TYPE_CHECKING:
    from harvester.identification.measured_response import MeasuredResponse
    from harvester.identification.measurement import Measurement
    from harvester.scene.model import Scene
    from harvester.scene.tables import Oscillator

# Tables of the scene whose numbers describe the device; the load's values are given.
DEVICE_TABLES = ("oscillator", "stoppers", "piezo", "coil")
# Keys that are not free by default: they are known from a scale, a data sheet or an ohmmeter, and
# records hardly determine them.
KNOWN = (
    "mass", "base_factor", "base_charge", "exponent", "resistance", "inductance",
    "leakage_resistance", "leakage_rate",
)  # fmt: skip
BASE_FACTOR, BASE_SCALE = "oscillator.base_factor", "sensor.acceleration_scale"
# Word for all keys that are free by default.
DEVICE = "device"
MASS, LOAD, SPRING = "oscillator.mass", "load.resistance", "oscillator.restoring_force"
FORCE = f"{SPRING}[{{}}]"
ORIGIN, DRAG = FORCE.format(0), "oscillator.quadratic_damping"
SHORT_NAMES = {"oscillator.linear_stiffness": 1, "oscillator.cubic_stiffness": 3}
# A number that must be positive stays above this share of its size or initial value.
SMALLEST_SHARE = 1e-3
SHARE_OF_PERIOD = 0.1
# Initial values of sensors' effects that must be positive, and of factors.
STARTS_OF_EFFECTS = {"scale": 1.0, "resistance": PROBE}
# Share of a size that is too small to change the motion.
LITTLE = 1e-6
POWERS = 8


@dataclass(frozen=True)
class Unknown:
    """One unknown of a fit.

    Attributes
    ----------
    key : str
        `table.key` of the scene, or `sensor.QUANTITY_EFFECT`.
    start, low, high : float
        Initial value of a fit, and bounds of the value, in the scene's units.
    size : float
        Typical magnitude of a change of the value; > 0.
    """

    key: str
    start: float
    low: float
    high: float
    size: float

    def begun(self, value: float) -> Unknown:
        """The unknown with another start, which may be far from the first."""
        # A scale's size follows its start; any other value near zero keeps its first size.
        if self.key.endswith("_scale"):
            size = abs(value)
            return replace(self, start=value, low=SMALLEST_SHARE * size, size=size)
        return replace(self, start=value, size=max(self.size, abs(value)))


def default_keys(scene: Scene, outputs: Sequence[str], volts: bool = False) -> list[str]:
    """Keys that are free by default: the device's numbers that a record determines.

    Mass, winding, leak and a contact's exponent are assumed known. Without a displacement no record
    shows the position of x = 0, so the constant force is fixed. If the velocity is in `volts`, its
    scale is free.
    """
    keys = [VELOCITY_SCALE] if volts else []
    for key, (value, _) in numbers(scene).items():
        table, _, name = key.rpartition(".")
        is_of_device = table.partition("[")[0] in DEVICE_TABLES and name not in KNOWN
        # A value of 0 means that the device lacks this part.
        exists = value != 0.0 or key in (ORIGIN, "oscillator.damping")
        needed = {ORIGIN: "displacement", "piezo": "voltage", "coil": "voltage"}
        output = needed.get(key) or needed.get(table)
        if is_of_device and exists and output in (None, *outputs):
            keys.append(key)
    return keys


def checked_keys(scene: Scene, keys: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """Check that each key to free exists, and return the keys.

    Raises
    ------
    HarvesterError
        A key is unknown (with the nearest valid key) or repeated.
    """
    names = [*numbers(scene), *sensor_keys(outputs)]
    names = [key for key in names if not key.startswith("excitation.")]
    if DEVICE in keys:
        default = [key for key in default_keys(scene, outputs) if key not in keys]
        keys = [*default, *(key for key in keys if key != DEVICE)]
    for index, key in enumerate(keys):
        if key not in names:
            raise HarvesterError(
                f"--free {named(key)}: not a number of this scene or its sensors"
                f"{nearest(key, names)}; there are {', '.join(names)}"
            )
        if key in keys[:index]:
            raise HarvesterError(f"--free {named(key)}: occurs twice: remove one")
    if BASE_FACTOR in keys and BASE_SCALE in keys:
        raise HarvesterError(
            f"--free {BASE_FACTOR} {BASE_SCALE}: records determine only their ratio; give one "
            "of them: the factor from the beam's drawing, or the scale from the sensor's data sheet"
        )
    return list(keys)


def unknowns(scene: Scene, keys: Sequence[str], sizes: dict[str, float]) -> list[Unknown]:
    """The unknowns of a fit, with bounds from the scene's checks.

    Parameters
    ----------
    sizes : dict of str to float
        Sizes of keys whose initial value may be 0.
    """
    specified = numbers(scene)
    result = []
    for key in keys:
        if factor_of(key) or key.startswith("sensor."):
            effect = "scale" if factor_of(key) else key.rpartition("_")[2]
            # An effect that may be 0 starts there, as the signal without a sensor.
            start = STARTS_OF_EFFECTS.get(effect, 0.0)
            least = 0.0 if effect in ("filter", *HIGHPASSES) else -math.inf
            low = SMALLEST_SHARE * start if start else least
            result.append(Unknown(key, start, low, math.inf, start or sizes[key]))
            continue
        start, spec = specified[key]
        size = abs(start) or sizes.get(key, 0.0) or 1.0
        low = spec.low
        if math.isfinite(low) and not spec.low_allowed:
            low += SMALLEST_SHARE * size
        if key == DRAG:
            # The scene omits a drag of 0, so the bound is above 0.
            low = LITTLE * size
        result.append(Unknown(key, float(start), low, spec.high, size))
    return result


def as_coefficients(keys: Sequence[str]) -> list[str]:
    """Keys with the spring's values replaced by coefficients of powers."""
    return [FORCE.format(SHORT_NAMES[key]) if key in SHORT_NAMES else key for key in keys]


def spring_coefficients(scene: Scene) -> list[float]:
    """Coefficients (F0, k1, k2, …) of the spring; empty for a force table."""
    return [k or 0.0 for k in scene.oscillator.coefficients]


def spring_key(oscillator: Oscillator, power: int) -> str:
    """Key of the spring's coefficient of a power of x; empty if there is none."""
    if oscillator.restoring_force is not None:
        return FORCE.format(power)
    return next((key for key, n in SHORT_NAMES.items() if n == power), "")


def power_of(key: str) -> int:
    """Power of x of a key's spring coefficient; 0 for other keys."""
    index = key.removeprefix(FORCE[:-3]).rstrip("]")
    return SHORT_NAMES.get(key, 0) or (int(index) if index.isdigit() else 0)


def factor_key(key: str, records: Iterable[int]) -> str:
    """Key of a factor that multiplies an assumed value in these records (numbers)."""
    return f"{key}@{','.join(map(str, records))}"


def factor_of(key: str) -> tuple[str, list[int]] | None:
    """Key of the assumed value that a factor multiplies, and its records; None for other keys."""
    name, _, records = key.partition("@")
    return (name, [int(number) for number in records.split(",")]) if records else None


def with_values(scene: Scene, values: Mapping[str, Any]) -> Scene | None:
    """The scene with these values, except those of sensors and factors; None if it is invalid."""
    changes = {
        key: value
        for key, value in values.items()
        if not key.startswith("sensor.") and not factor_of(key)
    }
    try:
        return scene.replace(changes)
    except SceneError:
        return None


def sizes_of(
    scene: Scene, measurements: Sequence[Measurement | MeasuredResponse], reach: float, speed: float
) -> dict[str, float]:
    """Typical magnitudes of the unknowns, including the sensors', by key.

    Parameters
    ----------
    reach, speed : float
        Largest displacement and rms velocity, in the scene's units.
    """
    force = spring_coefficients(scene)
    # The largest contribution of a power of the spring at the largest displacement.
    greatest = max((abs(k) * reach**n for n, k in enumerate(force)), default=0.0)
    if scene.oscillator.force_table is not None:
        greatest = float(np.abs(restoring_spring(scene.oscillator).force(reach)))
    greatest = greatest or 1.0
    powers: dict[str, float] = {**{FORCE.format(n): n for n in range(POWERS)}, **SHORT_NAMES}
    powers["stoppers.stiffness"] = 1.5
    sizes = {key: greatest / reach**n for key, n in powers.items()}
    damping = scene.oscillator.damping or 1e-2 * greatest / speed
    sizes |= {"oscillator.damping": damping, DRAG: damping / speed, "stoppers.gap": reach}
    frequency = measurements[0].frequencies[0]
    for name in ("acceleration", "voltage"):
        sizes |= {f"sensor.{name}_{effect}": SHARE_OF_PERIOD * frequency for effect in HIGHPASSES}
    base = measurements[0].acceleration
    sizes["sensor.acceleration_offset"] = 1.0 if base is None else float(np.std(base)) or 1.0
    for name, values in measurements[0].sensed.items():
        sizes[f"sensor.{name}_offset"] = float(np.std(values))
        for effect in ("delay", "filter"):
            sizes[f"sensor.{name}_{effect}"] = SHARE_OF_PERIOD / frequency
    return sizes


def first_sizes(
    scene: Scene, measurements: Sequence[Measurement | MeasuredResponse]
) -> dict[str, float]:
    """Sizes before any fit: for motion of one length unit at the measured frequency."""
    length = setting(scene).length
    speed = 2.0 * np.pi * measurements[0].frequencies[0] * length
    return sizes_of(scene, measurements, length, speed)

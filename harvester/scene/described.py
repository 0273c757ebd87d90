"""A device described by frequency, quality factor, coupling and matched load."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from harvester.base.formatting import quantity
from harvester.device import timescales
from harvester.scene.prepared import prepared
from harvester.scene.tables import key_words, value_words

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Maximum number of values of a key that are listed.
MOST_VALUES = 8


def device_line(scene: Scene) -> tuple[str, ...]:
    """One line on an SI scene's device at its stiffest rest position; empty for scaled scenes.

    Frequency and quality factor belong to mass, spring, compressed stoppers and damper alone (a
    shorted piezo). The damping of a contact does not count.
    k² = θ²/(K Cp) raises the frequency of the open piezo by √(1 + k²).
    """
    if scene.units != "SI" or scene.excitation.prescribes_displacement:
        return ()
    oscillator, system = scene.oscillator, prepared(scene).system
    mass: Any = oscillator.mass
    wells = {timescales.stiffness(system, well): well for well in timescales.wells(system)}
    stiffness = mass * max(wells, default=0.0)
    if stiffness <= 0.0:
        return ()
    rate = math.sqrt(stiffness / mass)
    ratio = 0.5 * oscillator.damping / (mass * rate)
    parts = [
        f"device: {quantity(1e3 * mass, 'g', 3)}",
        f"{quantity(rate / (2.0 * math.pi), 'Hz')} at rest",
        f"stiffness {stiffness:.4g} N/m",
        f"damping {oscillator.damping:.3g} N s/m",
    ]
    parts += _wells(scene)
    if ratio > 0.0:
        low, high = timescales.free_zone(system)
        pressed = not low < wells[max(wells)] < high
        parts.append(
            f"Q = {0.5 / ratio:.3g}, damping ratio {ratio:.3g}"
            + " (damper alone, without the pressed stopper)" * pressed
        )
    transducer: Any = scene.transducer
    matched = "the winding's"
    if getattr(transducer, "capacitance", None):
        matched = "1/(ω Cp) ="
        coupling = transducer.coupling**2 / (stiffness * transducer.capacitance)
        parts.append(f"k² = {coupling:.3g}")
    resistance = quantity(transducer.matched_resistance(rate), "Ω", 3)
    return (f"{', '.join(parts)}, matched load without coupling {matched} {resistance}",)


def _wells(scene):
    """Texts on the wells and the energy barriers between them; empty for a single well."""
    model = prepared(scene)
    wells = sorted(timescales.wells(model.system))
    if len(wells) < 2:
        return []
    length, energy = model.scales.of("displacement"), model.scales.of("energy")
    positions = ", ".join(quantity(length * well, "m", 3) for well in wells)
    barriers = [energy * timescales.barrier(model.system, well) for well in wells]
    heights = ", ".join(quantity(barrier, "J", 3) for barrier in barriers)
    return [f"wells at {positions}", f"energy barriers {heights}"]


def scene_rows(scenes: Sequence[Scene]) -> list[tuple[str, str]]:
    """Every key of the scenes and its values as text, with the unit if it is known."""
    texts: dict[str, dict[str, None]] = {}
    for scene in scenes:
        for name, value in _entries("", scene.to_tables()):
            text = _entry_words(name, value, scene.units)
            texts.setdefault(name, {})[text] = None
    rows = []
    for name, values in texts.items():
        words = [*values]
        if len(words) > MOST_VALUES:
            words[1:-1] = [f"… ({len(words)} values) …"]
        rows.append((name, ", ".join(words)))
    return rows


def _entry_words(name, value, units):
    if isinstance(value, (str, float)):
        return value_words(name, value, units)
    unit = key_words(name, units)[1]
    return json.dumps(value, ensure_ascii=False) + f" {unit}" * (unit not in ("", "1"))


def _entries(name, value):
    """Yield the dotted key and the value of every entry of nested tables."""
    if not isinstance(value, dict):
        yield name, value
        return
    for key, entry in value.items():
        yield from _entries(f"{name}.{key}" if name else key, entry)

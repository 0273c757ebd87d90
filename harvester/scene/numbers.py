"""The numbers of a scene that a study may vary, by their dotted keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import named, nearest
from harvester.device.beam.lumped import Beam
from harvester.device.keys import NUMBER, Key, class_of
from harvester.scene.tables import KINDS, Oscillator, rows_of

if TYPE_CHECKING:
    from harvester.scene.model import Scene


# Numerical settings and the range of validity, which are not properties of the device.
NOT_VARIED = ("knot_spacing", "restoring_force_range")


def numbers(scene: Scene) -> dict[str, Any]:
    """The numbers of a scene's device, load and excitation by key; [run] is excluded.

    Items of repeated tables and lists are indexed, as in `stoppers[1].gap` and
    `oscillator.restoring_force[2]`.
    """
    values: dict[str, Any] = {}
    for name, cls, content in rows_of(scene.to_tables()):
        if name != "run":
            _collect(values, name, cls, content)
    # These keys are omitted from the tables if they have their defaults.
    if scene.beam:
        for name, value in scene.beam.default_values().items():
            values.setdefault(f"beam.{name}", (value, Beam.KEYS[name]))
    else:
        factor = scene.oscillator.base_factor, Oscillator.KEYS["base_factor"]
        values.setdefault("oscillator.base_factor", factor)
    circuit = scene.load.circuit
    if circuit:
        for name, value in {**dict(circuit.defaults), **dict(circuit.parameters)}.items():
            values[f"load.parameters.{name}"] = value, NUMBER
    return values


def number(scene: Scene, key: str, option: str) -> tuple[float, Key]:
    """The number of a key, and the key's declaration.

    Raises HarvesterError, which names the nearest valid key.
    """
    available = numbers(scene)
    if key not in available:
        raise HarvesterError(
            f"{option} {named(key)}: not a number of this scene{nearest(key, available)}; there "
            f"are {', '.join(available)}"
        )
    return available[key]


def _collect(collected, name, cls, values):
    """Add a table's numbers to `collected`."""
    for key, spec in cls.KEYS.items():
        if key not in values or key in NOT_VARIED:
            continue
        if spec.element and spec.element.kind is dict:
            for index, part in enumerate(values[key]):
                _collect(collected, f"{name}.{key}[{index}]", class_of(KINDS, part), part)
        elif spec.element == NUMBER and name == "oscillator":
            collected |= {
                f"{name}.{key}[{n}]": (value, spec.element) for n, value in enumerate(values[key])
            }
        elif spec.is_number:
            collected[f"{name}.{key}"] = values[key], spec

"""The keys a scene may hold, their ranges, and the check that refuses all others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.base.registry import Registry
from harvester.device.beam.lumped import Beam
from harvester.device.beam.magnets import Magnets
from harvester.device.coil import CoilTable
from harvester.device.contact import LAWS, SIDES
from harvester.device.force_table import INTERPOLATIONS, MOST_PIECES, POINTS_PER_PIECE, force_table
from harvester.device.keys import (
    BOTH,
    NAMED_VALUES,
    SCALED,
    SI,
    Key,
    check_value,
    is_word,
    not_negative,
    positive,
)
from harvester.device.piezo import PiezoTable
from harvester.device.terminals import TransducerTable

# The transducers that a scene may have, by the name of their table.
TRANSDUCERS: Registry[type[TransducerTable]] = Registry(
    "harvester.transducers", {"piezo": PiezoTable, "coil": CoilTable}
)
# Largest number of points in a force table. With more than `MOST_PIECES` + 1 it must be smoothed.
MOST_POINTS = 2000
# Largest seed: numpy draws seeds of 128 bits.
LARGEST_SEED = 2**128 - 1

TOP = {"units": Key(kind=str, words=BOTH, required=True), "length_scale": positive(units=(SI,))}

# Keys of all tables but the transducer's, whose class defines its own.
OTHER_KEYS: dict[str, Any] = {
    "beam": Beam.KEYS,
    "magnets": Magnets.KEYS,
    "oscillator": {
        "mass": positive(units=(SI,), required=True),
        "damping": not_negative(),
        "quality_factor": positive(units=(SI,)),
        "damping_ratio": not_negative(units=(SI,)),
        "quadratic_damping": not_negative(),
        "linear_stiffness": Key(),
        "frequency": positive(units=(SI,)),
        "cubic_stiffness": not_negative(),
        "restoring_force": Key(element=Key(), count=(2, 8)),
        "base_factor": positive(),
        "force_table": Key(element=Key(element=Key(), count=(2, 2)), count=(2, MOST_POINTS)),
        "force_interpolation": Key(kind=str, words=INTERPOLATIONS),
        "restoring_force_range": Key(element=Key(), count=(2, 2)),
    },
    "stoppers": {
        "gap": positive(required=True),
        "stiffness": not_negative(required=True),
        "restitution": Key(low=0.0, high=1.0, required=True),
        "impact_velocity": Key(kind=str, words=("energy", "event")),
        "side": Key(kind=str, words=tuple(SIDES)),
        "exponent": Key(low=1.0, high=5.0),
        "law": Key(kind=str, words=LAWS),
    },
    "start": {"displacement": Key(), "velocity": Key(), "voltage": Key()},
    "load": {
        "kind": Key(kind=str, words=("resistor",)),
        "resistance": positive(units=(SI,)),
        "decay_rate": positive(units=(SCALED,)),
        "netlist": Key(kind=str),
        "subcircuit": Key(kind=str),
        "parameters": Key(kind=NAMED_VALUES),
    },
    # The keys depend on the table's `kind`.
    "excitation": None,
    "run": {
        "duration": positive(),
        "settle": not_negative(),
        "seed": Key(kind=int, low=0, high=LARGEST_SEED),
        "realizations": Key(kind=int, low=1, high=1_000_000),
        "starts": Key(kind=int, low=1, high=1_000_000),
        "orbit": Key(kind=str, words=("rest", "best", "weighted")),
    },
}

OPTIONAL_TABLES = ("beam", "magnets", "stoppers", "start")
# Tables that may stand several times, with the largest number.
SEVERAL = {"stoppers": 16}
NESTED_TABLES = {
    f"{table}.{name}"
    for table, keys in OTHER_KEYS.items()
    for name, key in (keys or {}).items()
    if key.kind is NAMED_VALUES
}
# A load is the built-in resistor or a netlist. Setting a key of one removes the keys of the other.
RESISTOR_KEYS, NETLIST_KEYS = (
    ("kind", "resistance", "decay_rate"),
    ("netlist", "subcircuit", "parameters"),
)
TABLE_KEYS = ("force_table", "force_interpolation")
SHORT_KEYS = ("linear_stiffness", "cubic_stiffness", "frequency")
REPLACED_KEYS = {
    "load.netlist": RESISTOR_KEYS,
    "load.resistance": NETLIST_KEYS,
    "load.decay_rate": NETLIST_KEYS,
    "beam.damping_ratio": ("quality_factor",),
    "beam.quality_factor": ("damping_ratio",),
    "oscillator.restoring_force": (*SHORT_KEYS, *TABLE_KEYS),
    "oscillator.force_table": (*SHORT_KEYS, "restoring_force"),
    "oscillator.linear_stiffness": ("restoring_force", "frequency", *TABLE_KEYS),
    "oscillator.frequency": ("restoring_force", "linear_stiffness", *TABLE_KEYS),
    "oscillator.cubic_stiffness": ("restoring_force", *TABLE_KEYS),
    "oscillator.damping": ("quality_factor", "damping_ratio"),
    "oscillator.quality_factor": ("damping", "damping_ratio"),
    "oscillator.damping_ratio": ("damping", "quality_factor"),
}
# Alternatives: each key gives the same property, and a scene holds one of each line.
SPRING_KEYS = ("linear_stiffness", "frequency", "restoring_force", "force_table")
DAMPING_KEYS = ("damping", "quality_factor", "damping_ratio")


def table_keys() -> dict[str, Any]:
    """The keys of every table a scene may have: {table: {name: Key}}."""
    return {**OTHER_KEYS, **{name: table.KEYS for name, table in TRANSDUCERS.items()}}


def check_tables(
    tables: dict[str, Any], origin: str, kinds: dict[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Checked copy of a scene's nested dictionaries.

    `tables`: the scene as read from TOML: top-level keys and tables. `kinds`: keys of the tables
    whose `kind` decides which keys they have: {table: {kind: class with KEYS}}. Raises SceneError
    for an unknown, missing or misplaced key, a wrong type or a value out of range. Numbers of the
    copy are float or int.
    """
    for name in {*tables} - {*TOP, *OTHER_KEYS}:
        # Another package's transducer is looked up by the name of its table.
        name in TRANSDUCERS  # noqa: B015
    every_table = table_keys()
    names = [*TOP, *every_table]
    for name, value in tables.items():
        if name not in names:
            raise SceneError(f"{origin}: unknown key {named(name)}{_instead(name, names)}")
        if name in SEVERAL and isinstance(value, (list, tuple)):
            most = SEVERAL[name]
            if not 1 <= len(value) <= most or not all(isinstance(part, dict) for part in value):
                raise SceneError(f"{origin}: [[{name}]] must be 1 to {most} tables")
        elif (name in every_table) != isinstance(value, dict):
            noun = "a table" if name in every_table else "a value, not a table"
            raise SceneError(f"{origin}: {name} must be {noun}")
    top = {name: value for name, value in tables.items() if name in TOP}
    units = tables.get("units", SCALED)
    checked = check_table("", top, TOP, units if is_word(units, BOTH) else SCALED, origin)
    for table, keys in every_table.items():
        if isinstance(tables.get(table), (list, tuple)):
            checked[table] = tuple(
                check_table(f"{table}[{index}]", values, keys, units, origin)
                for index, values in enumerate(tables[table])
            )
        elif table in tables:
            values = tables[table]
            keys = keys or _keys_of_kind(table, values, kinds[table], origin)
            checked[table] = check_table(table, values, keys, units, origin, kinds.get(table))
        elif table not in OPTIONAL_TABLES and table not in TRANSDUCERS:
            raise SceneError(f"{origin}: table [{table}] is missing")
    _check_load(checked["load"], units, origin)
    _check_oscillator(checked["oscillator"], units, origin)
    _check_transducer(checked, origin)
    _check_physics(checked, origin)
    return checked


def _check_oscillator(oscillator, units, origin):
    """Spring and damper in one of their forms each, and where the spring is meant."""
    _only(oscillator, DAMPING_KEYS, units, origin)
    low, high = oscillator.get("restoring_force_range", (-1.0, 1.0))
    if not low < 0.0 < high:
        raise SceneError(
            f"{origin}: oscillator.restoring_force_range = {[low, high]}: must be a displacement "
            "below 0 and one above"
        )
    if "force_interpolation" in oscillator and "force_table" not in oscillator:
        raise SceneError(f"{origin}: oscillator.force_interpolation needs oscillator.force_table")
    form = _only(oscillator, SPRING_KEYS, units, origin)
    if form in ("linear_stiffness", "frequency"):
        oscillator.setdefault("cubic_stiffness", 0.0)
    elif "cubic_stiffness" in oscillator:
        raise _twice(origin, "cubic_stiffness", form)
    if form == "frequency":
        rate = 2.0 * math.pi * oscillator["frequency"]
        oscillator["linear_stiffness"] = oscillator["mass"] * rate**2
    if form == "force_table":
        _check_force_table(oscillator, origin)


def _only(oscillator, names, units, origin):
    """The one of several keys for the same thing that the oscillator has."""
    present = [name for name in names if name in oscillator]
    if len(present) > 1:
        raise _twice(origin, *present[:2])
    if not present:
        first, *others = (n for n in names if units in OTHER_KEYS["oscillator"][n].units)
        alternatives = (
            "" if not others else f", or give oscillator.{' or oscillator.'.join(others)}"
        )
        allowed = OTHER_KEYS["oscillator"][first].allowed()
        raise SceneError(
            f"{origin}: oscillator.{first} is missing; it takes {allowed}{alternatives}"
        )
    return present[0]


def _twice(origin, first, second):
    return SceneError(
        f"{origin}: oscillator.{first} and oscillator.{second} say the same thing twice; take one "
        "out"
    )


def _check_force_table(oscillator, origin):
    """Displacements that ascend through 0, and as many as the interpolation takes."""
    points = oscillator["force_table"]
    where = f"{origin}: oscillator.force_table"
    for index, (before, after) in enumerate(pairwise(points), start=1):
        if not after[0] > before[0]:
            raise SceneError(
                f"{where}[{index}] = {list(after)}: displacements must ascend, and the one before "
                f"is {before[0]:g}"
            )
    if not points[0][0] < 0.0 < points[-1][0]:
        raise SceneError(
            f"{where} goes from {points[0][0]:g} to {points[-1][0]:g}: it must hold displacements "
            "on both sides of 0, where the other keys begin to count"
        )
    smooth = oscillator.get("force_interpolation", INTERPOLATIONS[0]) == "smooth"
    if not smooth and len(points) > MOST_PIECES + 1:
        raise SceneError(
            f"{where} has {len(points)} points: at most {MOST_PIECES + 1} are taken as they are; "
            'set oscillator.force_interpolation = "smooth", or leave points out'
        )
    if smooth and len(points) <= POINTS_PER_PIECE:
        raise SceneError(
            f"{where} has {len(points)} points: smoothing takes at least {POINTS_PER_PIECE + 1}"
        )


def _transducer_of(scene):
    """The name of the one transducer's table."""
    return next(name for name in TRANSDUCERS if name in scene)


def _check_transducer(scene, origin):
    """One transducer and no other; and what a start says of it."""
    present = [f"[{name}]" for name in TRANSDUCERS if name in scene]
    first, *others = (f"[{name}]" for name in TRANSDUCERS)
    if not present:
        raise SceneError(f"{origin}: table {first} is missing (or {', '.join(others)})")
    if len(present) > 1:
        raise SceneError(
            f"{origin}: {' and '.join(present)}: a device has one of them; take the other out "
            f"(--set {present[0][1:-1]}=none)"
        )
    name = _transducer_of(scene)
    voltage = scene.get("start", {}).get("voltage", 0.0)
    if voltage != 0.0 and not TRANSDUCERS[name].takes_voltage:
        raise SceneError(
            f"{origin}: start.voltage belongs to a transducer whose capacitance holds it, such as "
            f"a piezo, and this is a {name}; take it out"
        )


def _keys_of_kind(table, values, kinds, origin):
    """The keys of a table by its `kind`, the first of them where it is left out."""
    spec = Key(kind=str, words=kinds)
    word = check_value(f"{table}.kind", values.get("kind", next(iter(kinds))), spec, origin)
    return {"kind": spec, **kinds[word].KEYS}


def check_table(
    table: str,
    values: dict[str, Any],
    keys: dict[str, Key],
    units: str,
    origin: str,
    kinds: Any = None,
) -> dict[str, Any]:
    """The values of one table, each checked by its key. Raises SceneError."""
    checked = {}
    prefix = f"{table}." if table else ""
    for name, value in values.items():
        if name not in keys:
            fitting = [key for key, spec in keys.items() if units in spec.units]
            raise SceneError(
                f"{origin}: unknown key {prefix}{named(name)}{_instead(name, fitting)}"
            )
        spec = keys[name]
        if units not in spec.units:
            raise SceneError(
                f'{origin}: {prefix}{name} belongs to scenes with units = "{spec.units[0]}", '
                f'and this one has "{units}"'
            )
        where = f"{prefix}{name}"
        checked[name] = check_value(where, value, spec, origin)
        if spec.element and spec.element.kind is dict:
            checked[name] = tuple(
                check_table(
                    f"{where}[{index}]",
                    part,
                    _keys_of_kind(f"{where}[{index}]", part, kinds, origin),
                    units,
                    origin,
                    kinds,
                )
                for index, part in enumerate(checked[name])
            )
    for name, spec in keys.items():
        if spec.required and units in spec.units and name not in checked:
            raise SceneError(f"{origin}: {prefix}{name} is missing; it takes {spec.allowed()}")
    return checked


def _instead(name, names):
    """The nearest key, or all keys where none is near."""
    return nearest(name, names) or f"; there are {', '.join(names)}"


def _check_load(load, units, origin):
    """Either the built-in resistor with its value, or a netlist."""
    if "netlist" in load:
        for name in RESISTOR_KEYS:
            if name in load:
                raise SceneError(
                    f"{origin}: load.{name} belongs to the built-in resistor, and load.netlist is "
                    f"{shown(load['netlist'])}; take one out (a netlist's values: load.parameters)"
                )
        return
    for name in NETLIST_KEYS[1:]:
        if name in load:
            raise SceneError(
                f"{origin}: load.{name} needs load.netlist (a load study's --load takes "
                "--sweep load.parameters.NAME=VALUE)"
            )
    needed = "resistance" if units == SI else "decay_rate"
    if needed not in load:
        allowed = OTHER_KEYS["load"][needed].allowed()
        raise SceneError(f"{origin}: load.{needed} is missing; it takes {allowed}")
    load.setdefault("kind", "resistor")


def _check_physics(scene, origin):
    """Refuse values that together allow a motion without bounds or without a stationary state."""
    oscillator, stoppers = scene["oscillator"], scene.get("stoppers", ())
    stoppers = [stoppers] if isinstance(stoppers, dict) else stoppers
    _check_bounded(oscillator, stoppers, origin)
    _check_held(stoppers, origin)
    name = _transducer_of(scene)
    uncoupled = scene[name].get("coupling") == 0.0
    damped = (
        any(oscillator.get(key, 0.0) > 0.0 for key in DAMPING_KEYS)
        or oscillator.get("quadratic_damping", 0.0) > 0.0
    )
    if not damped and uncoupled:
        raise SceneError(
            f"{origin}: oscillator.damping = 0 with {name}.coupling = 0: nothing takes the energy "
            "out, so there is no stationary state; give one of them a value > 0"
        )
    if scene["units"] == SI and uncoupled:
        raise SceneError(
            f"{origin}: {name}.coupling = 0.0: must be a number > 0 in SI, where it sets the "
            "voltage scale (Eq. 3); a scaled scene can be without coupling"
        )


def _check_held(stoppers, origin):
    """One impact speed is held at a time: `event` takes one stopper on a side."""
    for side in ("right", "left"):
        facing = [stopper for stopper in stoppers if stopper.get("side", "both") in (side, "both")]
        if len(facing) > 1 and any(stopper.get("impact_velocity") == "event" for stopper in facing):
            raise SceneError(
                f'{origin}: stoppers.impact_velocity = "event" with {len(facing)} stoppers on the '
                f'{side}: one impact speed is held there; choose "energy", or take the others out'
            )


def _check_bounded(oscillator, stoppers, origin):
    """The force must lead back far out on both sides: by the spring, or by stoppers there."""
    if "restoring_force_range" in oscillator:
        return
    if "force_table" in oscillator:
        spring = force_table(
            oscillator["force_table"], oscillator.get("force_interpolation", INTERPOLATIONS[0])
        )
        ends = spring.breaks()[[0, -1]]
        for side, sign, end in (("left", -1.0, ends[0]), ("right", 1.0, ends[1])):
            order, slope, force = 1, spring.slope(end), sign * spring.force(end)
            if slope > 0.0 or (slope == 0.0 and force > 0.0) or _stopped(stoppers, side, order):
                continue
            raise SceneError(
                f"{origin}: oscillator.force_table ends on the {side} with a slope of {slope:.3g}, "
                "and so it goes on beyond: the motion is unbounded there; go on until the force "
                "leads back, put a stopper there, or say by oscillator.restoring_force_range that "
                "the mass stays within the table"
            )
        return
    force = oscillator.get("restoring_force")
    key = "oscillator.restoring_force"
    if force is None:
        force = (0.0, oscillator["linear_stiffness"], 0.0, oscillator["cubic_stiffness"])
        key = "oscillator.linear_stiffness"
    order = max((n for n, k in enumerate(force) if k != 0.0), default=0)
    for side, sign in (("right", 1.0), ("left", -1.0)):
        if order and force[order] * sign ** (order + 1) > 0.0:
            continue
        if _stopped(stoppers, side, order):
            continue
        value = list(force) if key.endswith("force") else f"{force[1]:g}"
        raise SceneError(
            f"{origin}: {key} = {value} leaves the motion unbounded on the {side}: the highest "
            "power must be odd with a coefficient > 0 (cubic_stiffness > 0 in the short form), "
            f"a stopper with a greater exponent must stand on the {side}, or "
            "oscillator.restoring_force_range must say between which displacements it is meant"
        )


def _stopped(stoppers, side, order):
    """Whether a stopper on this side grows faster with depth than a force of this power."""
    return any(
        stopper["stiffness"] > 0.0
        and stopper.get("side", "both") in (side, "both")
        and stopper.get("exponent", 1.5) > order
        for stopper in stoppers
    )

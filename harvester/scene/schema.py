"""The keys a scene may hold, their ranges, and the check that refuses all others."""

import math
from dataclasses import dataclass

from harvester.device.contact import LAWS, SIDES
from harvester.errors import SceneError
from harvester.files.plain_text import named, nearest, shown

SCALED, SI = "scaled", "SI"
BOTH = (SCALED, SI)
NAMED_VALUES = "named values"
# Numbers beyond these, zero aside, overflow or vanish in products of a few of them.
SMALLEST, LARGEST = 1e-30, 1e30
# As wide as what numpy draws one from.
LARGEST_SEED = 2**128 - 1


@dataclass(frozen=True)
class Key:
    """What one key accepts: a number in a range, a text, one of a few words, a list, named values.

    `kind` is float, int, str, (str, int), `NAMED_VALUES` for a table of numbers or texts, or dict
    for a table with a `kind` of its own. With `each`, a list of `count` (fewest, most) values of
    that key's sort.
    """

    kind: type | tuple | str = float
    low: float = -math.inf
    high: float = math.inf
    low_allowed: bool = True
    words: tuple = ()
    units: tuple = BOTH
    required: bool = False
    each: "Key | None" = None
    count: tuple = (0, 0)

    def allowed(self):
        """The accepted values, in words."""
        if self.each:
            few, many = self.count
            return f"a list of {few if few == many else f'{few} to {many}'}: {self.each.allowed()}"
        if self.words:
            return "one of " + ", ".join(f'"{word}"' for word in self.words)
        if self.kind in _NOUNS:
            return _NOUNS[self.kind]
        noun = "a whole number" if self.kind is int else "a number"
        if self.low == -math.inf:
            return noun
        if self.high == math.inf:
            return f"{noun} {'≥' if self.low_allowed else '>'} {self.low:g}"
        return f"{noun} in {'[' if self.low_allowed else '('}{self.low:g}, {self.high:g}]"


_NOUNS = {
    str: "a text",
    (str, int): "a name or a whole number ≥ 0",
    dict: "a table",
    NAMED_VALUES: 'a table of numbers, or of texts like "100k"',
}


def positive(**more):
    """A key for a number > 0."""
    return Key(low=0.0, low_allowed=False, **more)


def not_negative(**more):
    """A key for a number ≥ 0."""
    return Key(low=0.0, **more)


TOP = {
    "units": Key(kind=str, words=BOTH, required=True),
    "length_scale": positive(units=(SI,)),
}

KEYS = {
    "oscillator": {
        "mass": positive(units=(SI,), required=True),
        "damping": not_negative(required=True),
        "quadratic_damping": not_negative(),
        "linear_stiffness": Key(),
        "cubic_stiffness": not_negative(),
        "restoring_force": Key(each=Key(), count=(2, 8)),
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
    "piezo": {
        "coupling": not_negative(required=True),
        "capacitance": positive(units=(SI,), required=True),
        "leakage_resistance": positive(units=(SI,)),
        "leakage_rate": not_negative(units=(SCALED,)),
    },
    "coil": {
        "coupling": positive(required=True, units=(SI,)),
        "resistance": positive(required=True, units=(SI,)),
        "inductance": not_negative(units=(SI,)),
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
    # Decided by the table's own `kind`.
    "excitation": None,
    "run": {
        "duration": positive(required=True),
        "settle": not_negative(),
        "seed": Key(kind=int, low=0, high=LARGEST_SEED),
        "realizations": Key(kind=int, low=1, high=1_000_000),
    },
}

# Keys of an excitation of another kind.
OPTIONAL_TABLES = ("stoppers", "piezo", "coil", "start")
# Tables that may be there several times, and how often.
SEVERAL = {"stoppers": 16}
NESTED_TABLES = {
    f"{table}.{name}"
    for table, keys in KEYS.items()
    for name, key in (keys or {}).items()
    if key.kind is NAMED_VALUES
}
# A load is the built-in resistor or a netlist: an override of one takes the other's keys out.
RESISTOR_KEYS, NETLIST_KEYS = (
    ("kind", "resistance", "decay_rate"),
    ("netlist", "subcircuit", "parameters"),
)
REPLACED_KEYS = {
    "load.netlist": RESISTOR_KEYS,
    "load.resistance": NETLIST_KEYS,
    "load.decay_rate": NETLIST_KEYS,
    "oscillator.restoring_force": ("linear_stiffness", "cubic_stiffness"),
    "oscillator.linear_stiffness": ("restoring_force",),
    "oscillator.cubic_stiffness": ("restoring_force",),
}


def check_tables(tables, origin, kinds):
    """Checked copy of a scene's nested dictionaries.

    Parameters
    ----------
    tables : dict
        As read from TOML: top-level keys and tables.
    origin : str
        File or scene name, for messages.
    kinds : dict of str to dict
        For tables whose `kind` decides what else they hold: {table: {kind: class with KEYS}}.

    Returns
    -------
    dict
        The same with numbers as float or int.

    Raises
    ------
    SceneError
        Unknown, missing or misplaced key, wrong type, value out of range.
    """
    known = [*TOP, *KEYS]
    for name, value in tables.items():
        if name not in known:
            raise SceneError(f"{origin}: unknown key {named(name)}{nearest(name, known)}")
        if name in SEVERAL and isinstance(value, (list, tuple)):
            _check_several(name, value, origin)
        elif (name in KEYS) != isinstance(value, dict):
            noun = "a table" if name in KEYS else "a value, not a table"
            raise SceneError(f"{origin}: {name} must be {noun}")
    top = {name: value for name, value in tables.items() if name in TOP}
    units = tables.get("units", SCALED)
    checked = _check_table("", top, TOP, units if _is_word(units, BOTH) else SCALED, origin)
    for table, keys in KEYS.items():
        if isinstance(tables.get(table), (list, tuple)):
            checked[table] = tuple(
                _check_table(f"{table}[{place}]", values, keys, units, origin)
                for place, values in enumerate(tables[table])
            )
        elif table in tables:
            values = tables[table]
            keys = keys or _keys_of_kind(table, values, kinds[table], origin)
            checked[table] = _check_table(table, values, keys, units, origin, kinds.get(table))
        elif table not in OPTIONAL_TABLES:
            raise SceneError(f"{origin}: table [{table}] is missing")
    _check_load(checked["load"], units, origin)
    _check_oscillator(checked["oscillator"], origin)
    _check_transducer(checked, origin)
    _check_physics(checked, origin)
    return checked


def _check_several(name, values, origin):
    most = SEVERAL[name]
    if not 1 <= len(values) <= most or not all(isinstance(each, dict) for each in values):
        raise SceneError(f"{origin}: [[{name}]] must be 1 to {most} tables")


def _check_oscillator(oscillator, origin):
    """The restoring force in one of its two forms, and a potential that is bounded below."""
    force = oscillator.get("restoring_force")
    if force is None:
        if "linear_stiffness" not in oscillator:
            raise SceneError(
                f"{origin}: oscillator.linear_stiffness is missing; it takes a number, or give "
                "oscillator.restoring_force = [F0, k1, k2, …]"
            )
        oscillator.setdefault("cubic_stiffness", 0.0)
        return
    for name in ("linear_stiffness", "cubic_stiffness"):
        if name in oscillator:
            raise SceneError(
                f"{origin}: oscillator.{name} and oscillator.restoring_force say the same thing "
                "twice; take one out"
            )


def _check_transducer(scene, origin):
    """A piezo or a coil, one of them; and what a start says of it."""
    found = [name for name in ("piezo", "coil") if name in scene]
    if not found:
        raise SceneError(f"{origin}: table [piezo] is missing (or [coil], in a scene in SI units)")
    if len(found) == 2:
        raise SceneError(
            f"{origin}: [piezo] and [coil]: a device has one of them; take the other out "
            "(--set piezo=none)"
        )
    if "coil" in scene and scene.get("start", {}).get("voltage", 0.0) != 0.0:
        raise SceneError(
            f"{origin}: start.voltage belongs to a piezo, whose capacitance holds it; take it out"
        )


def _keys_of_kind(table, values, kinds, origin):
    """The keys of a table by its `kind`, the first of them where it is left out."""
    spec = Key(kind=str, words=tuple(kinds))
    word = _check_value(f"{table}.kind", values.get("kind", spec.words[0]), spec, origin)
    return {"kind": spec, **kinds[word].KEYS}


def _check_table(table, values, keys, units, origin, kinds=None):
    checked = {}
    prefix = f"{table}." if table else ""
    for name, value in values.items():
        if name not in keys:
            fitting = [key for key, spec in keys.items() if units in spec.units]
            raise SceneError(f"{origin}: unknown key {prefix}{named(name)}{nearest(name, fitting)}")
        spec = keys[name]
        if units not in spec.units:
            raise SceneError(
                f'{origin}: {prefix}{name} belongs to scenes with units = "{spec.units[0]}", '
                f'and this one has "{units}"'
            )
        where = f"{prefix}{name}"
        checked[name] = _check_value(where, value, spec, origin)
        if spec.each and spec.each.kind is dict:
            checked[name] = tuple(
                _check_table(
                    f"{where}[{place}]",
                    part,
                    _keys_of_kind(f"{where}[{place}]", part, kinds, origin),
                    units,
                    origin,
                    kinds,
                )
                for place, part in enumerate(checked[name])
            )
    for name, spec in keys.items():
        if spec.required and units in spec.units and name not in checked:
            raise SceneError(f"{origin}: {prefix}{name} is missing; it takes {spec.allowed()}")
    return checked


def _check_value(where, value, spec, origin):
    def refuse():
        hint = nearest(value, spec.words) if isinstance(value, str) else ""
        raise SceneError(f"{origin}: {where} = {shown(value)}: must be {spec.allowed()}{hint}")

    if spec.each:
        few, many = spec.count
        if not isinstance(value, (list, tuple)) or not few <= len(value) <= many:
            refuse()
        return tuple(
            _check_value(f"{where}[{place}]", part, spec.each, origin)
            for place, part in enumerate(value)
        )
    if spec.kind is NAMED_VALUES:
        return dict(value) if isinstance(value, dict) and _named_values(value) else refuse()
    if spec.words:
        return value if _is_word(value, spec.words) else refuse()
    if spec.kind in _NOUNS:
        fits = isinstance(value, spec.kind) and value is not True and value is not False
        return value if fits else refuse()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        refuse()
    if spec.kind is int and not isinstance(value, int):
        refuse()
    too_low = value < spec.low or (value == spec.low and not spec.low_allowed)
    if not value <= spec.high or too_low:
        refuse()
    if spec.kind is float and value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        raise SceneError(
            f"{origin}: {where} = {shown(value)}: must be {spec.allowed()}, and of a size that "
            f"can be computed with: {SMALLEST:g} to {LARGEST:g}"
        )
    return spec.kind(value)


def _is_word(value, words):
    # An array of numpy is compared item by item.
    return isinstance(value, str) and value in words


def _named_values(table):
    """Whether all values are numbers of a sane size, or texts; the load refuses others of them."""
    return all(
        isinstance(v, str)
        or (isinstance(v, (int, float)) and not isinstance(v, bool) and not abs(v) > LARGEST)
        for v in table.values()
    )


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
            raise SceneError(f"{origin}: load.{name} needs load.netlist")
    needed = "resistance" if units == SI else "decay_rate"
    if needed not in load:
        allowed = KEYS["load"][needed].allowed()
        raise SceneError(f"{origin}: load.{needed} is missing; it takes {allowed}")
    load.setdefault("kind", "resistor")


def _check_physics(scene, origin):
    """What no single value shows: a motion without bounds or without a stationary state."""
    oscillator, stoppers = scene["oscillator"], scene.get("stoppers", ())
    stoppers = [stoppers] if isinstance(stoppers, dict) else stoppers
    _check_bounded(oscillator, stoppers, origin)
    _check_held(stoppers, origin)
    transducer = scene.get("piezo") or scene["coil"]
    damped = oscillator["damping"] > 0.0 or oscillator.get("quadratic_damping", 0.0) > 0.0
    if not damped and transducer["coupling"] == 0.0:
        raise SceneError(
            f"{origin}: oscillator.damping = 0 with piezo.coupling = 0: nothing takes the energy "
            "out, so there is no stationary state; give one of them a value > 0"
        )
    if scene["units"] == SI and transducer["coupling"] == 0.0:
        raise SceneError(
            f"{origin}: piezo.coupling = 0.0: must be a number > 0 in SI, where it sets the "
            "voltage scale (Eq. 3); a scaled scene can be without coupling"
        )


def _check_held(stoppers, origin):
    """One impact speed is held at a time: `event` takes one stopper on a side."""
    for side in ("right", "left"):
        there = [each for each in stoppers if each.get("side", "both") in (side, "both")]
        if len(there) > 1 and any(each.get("impact_velocity") == "event" for each in there):
            raise SceneError(
                f'{origin}: stoppers.impact_velocity = "event" with {len(there)} stoppers on the '
                f'{side}: one impact speed is held there; choose "energy", or take the others out'
            )


def _check_bounded(oscillator, stoppers, origin):
    """The force must lead back far out on both sides: by the spring, or by stoppers there."""
    force = oscillator.get("restoring_force")
    key = "oscillator.restoring_force"
    if force is None:
        force = (0.0, oscillator["linear_stiffness"], 0.0, oscillator["cubic_stiffness"])
        key = "oscillator.linear_stiffness"
    order = max((n for n, k in enumerate(force) if k != 0.0), default=0)
    for side, sign in (("right", 1.0), ("left", -1.0)):
        if order and force[order] * sign ** (order + 1) > 0.0:
            continue
        if any(
            each["stiffness"] > 0.0
            and each.get("side", "both") in (side, "both")
            and each.get("exponent", 1.5) > order
            for each in stoppers
        ):
            continue
        value = list(force) if key.endswith("force") else f"{force[1]:g}"
        raise SceneError(
            f"{origin}: {key} = {value} leaves the motion unbounded on the {side}: the highest "
            "power must be odd with a coefficient > 0 (cubic_stiffness > 0 in the short form), or "
            f"a stopper with a greater exponent must stand on the {side}"
        )

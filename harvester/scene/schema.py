"""Checks of a scene: forbidden keys, and values that contradict each other."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, nearest, shown
from harvester.device.force_table import MOST_PIECES, POINTS_PER_PIECE, force_table
from harvester.device.keys import SI, check_table, check_value, every_key
from harvester.scene.drawn import with_drawing
from harvester.scene.tables import OPTIONAL, SEVERAL, TRANSDUCERS, Top, all_keys, all_tables


def check_tables(tables: dict[str, Any], origin: str) -> dict[str, Any]:
    """Return the tables of a scene as objects of their classes.

    `tables`: the scene as read from TOML, with top-level keys and tables. The result stores the
    top-level keys under "". Numbers are float or int. Raises SceneError for an unknown, missing or
    misplaced key, a wrong type or a value out of range.
    """
    for name in {*tables} - {*Top.KEYS, *all_tables()}:
        # The registry loads another package's transducer at the look-up of its table's name.
        name in TRANSDUCERS  # noqa: B015
    classes = all_tables()
    names = [*Top.KEYS, *classes]
    for name, value in tables.items():
        if name not in names:
            # Of similar keys, those in a table that the scene has come first.
            near = sorted(all_keys(), key=lambda key: key.partition(".")[0] not in tables)
            hint = f"{nearest(name, [*names, *near])}; there are {', '.join(names)}"
            raise SceneError(f"{origin}: unknown key {named(name)}{hint}")
        if name in SEVERAL and isinstance(value, (list, tuple)):
            most = SEVERAL[name]
            if not 1 <= len(value) <= most or not all(isinstance(part, dict) for part in value):
                raise SceneError(f"{origin}: [[{name}]] must be 1 to {most} tables")
        elif (name in classes) != isinstance(value, dict):
            noun = "a value, not a table"
            if name in classes:
                specs = every_key(classes[name]).items()
                numeric = (key for key, spec in specs if spec.kind is not str)
                noun = f'a table such as {{"{next(numeric, "key")}": …}}'
            raise SceneError(f"{origin}: {name} = {shown(value)}: must be {noun}")
    spec = Top.KEYS["units"]
    if "units" not in tables:
        raise SceneError(f"{origin}: units is missing; it takes {spec.allowed()}")
    units = check_value("units", tables["units"], spec, origin)
    tables = with_drawing(tables, origin)
    top = {name: value for name, value in tables.items() if name in Top.KEYS}
    parts: dict[str, Any] = {"": check_table("", top, Top, units, origin)}
    for name, cls in classes.items():
        values = tables.get(name)
        if isinstance(values, (list, tuple)):
            parts[name] = tuple(
                check_table(f"{name}[{index}]", part, cls, units, origin)
                for index, part in enumerate(values)
            )
        elif values is not None:
            part = check_table(name, values, cls, units, origin)
            parts[name] = (part,) if name in SEVERAL else part
        elif name not in OPTIONAL and name not in TRANSDUCERS:
            keys = ", ".join(every_key(cls))
            raise SceneError(f"{origin}: table [{name}] is missing; it takes {keys}")
    _check_spring(parts["oscillator"], origin)
    _check_transducer(parts, origin)
    _check_physics(parts, origin)
    return parts


def _check_spring(oscillator, origin):
    """Raise if the range does not contain 0, or the points do not define a curve."""
    low, high = oscillator.restoring_force_range or (-1.0, 1.0)
    if not low < 0.0 < high:
        raise SceneError(
            f"{origin}: oscillator.restoring_force_range = {[low, high]}: must be a displacement "
            "below 0 and one above"
        )
    points = oscillator.force_table
    if points is None:
        return
    where = f"{origin}: oscillator.force_table"
    for index, (before, after) in enumerate(pairwise(points), start=1):
        if not after[0] > before[0]:
            raise SceneError(
                f"{where}[{index}] = {list(after)}: displacements must ascend, and the one before "
                f"is {before[0]:g}"
            )
    if not points[0][0] < 0.0 < points[-1][0]:
        raise SceneError(
            f"{where} goes from {points[0][0]:g} to {points[-1][0]:g}: must have displacements "
            "on both sides of 0"
        )
    smooth = oscillator.force_interpolation == "smooth"
    if not smooth and len(points) > MOST_PIECES + 1:
        raise SceneError(
            f"{where} has {len(points)} points: at most {MOST_PIECES + 1} work without smoothing; "
            'set oscillator.force_interpolation = "smooth", or leave points out'
        )
    if smooth and len(points) <= POINTS_PER_PIECE:
        raise SceneError(
            f"{where} has {len(points)} points: smoothing needs at least {POINTS_PER_PIECE + 1}"
        )


def transducer_of(tables: Any) -> str:
    """The name of the one transducer's table."""
    return next(name for name in TRANSDUCERS if name in tables)


def _check_transducer(parts, origin):
    """Raise unless there is one transducer, and it can have the start's voltage."""
    present = [f"[{name}]" for name in TRANSDUCERS if name in parts]
    first, *alternatives = (f"[{name}]" for name in TRANSDUCERS)
    if not present:
        raise SceneError(f"{origin}: table {first} is missing (or {', '.join(alternatives)})")
    if len(present) > 1:
        raise SceneError(
            f"{origin}: {' and '.join(present)}: a device has only one; remove the other "
            f"(--set {present[0][1:-1]}=none)"
        )
    name = transducer_of(parts)
    if "start" in parts and parts["start"].voltage and not parts[name].takes_voltage:
        raise SceneError(
            f"{origin}: start.voltage needs a transducer with a capacitance, such as "
            f"a piezo, but this is a {name}; remove it"
        )


def _check_physics(parts, origin):
    """Raise if the values together allow unbounded motion or no stationary state."""
    oscillator, stoppers = parts["oscillator"], parts.get("stoppers", ())
    _check_bounded(oscillator, stoppers, origin)
    # With `event` one impact speed is stored per side, so a side can have only one stopper.
    for side in ("right", "left"):
        facing = [stopper for stopper in stoppers if stopper.side in (side, "both")]
        if len(facing) > 1 and any(stopper.impact_velocity == "event" for stopper in facing):
            raise SceneError(
                f'{origin}: stoppers.impact_velocity = "event" with {len(facing)} stoppers on the '
                f'{side}: only one of them can store its impact speed; choose "energy", or remove '
                "the others"
            )
    name = transducer_of(parts)
    uncoupled = getattr(parts[name], "coupling", None) == 0.0
    names = ("damping", "quality_factor", "damping_ratio", "quadratic_damping")
    if uncoupled and not any(getattr(oscillator, key) for key in names):
        raise SceneError(
            f"{origin}: oscillator.damping = 0 with {name}.coupling = 0: no energy is lost, "
            "so there is no stationary state; give one of them a value > 0"
        )
    if uncoupled and parts[""].units == SI:
        raise SceneError(
            f"{origin}: {name}.coupling = 0.0: must be a number > 0 in SI, because it sets the "
            "voltage scale (Eq. 3); a scaled scene can be without coupling"
        )


def _check_bounded(oscillator, stoppers, origin):
    """Raise if, on either side, neither the spring nor a stopper limits the motion."""
    if oscillator.restoring_force_range is not None:
        return
    if oscillator.force_table is not None:
        spring = force_table(oscillator.force_table, oscillator.force_interpolation)
        ends = spring.breaks()[[0, -1]]
        for side, sign, end in (("left", -1.0, ends[0]), ("right", 1.0, ends[1])):
            slope, force = spring.slope(end), sign * spring.force(end)
            if slope > 0.0 or (slope == 0.0 and force > 0.0) or _stopped(stoppers, side, 1):
                continue
            raise SceneError(
                f"{origin}: oscillator.force_table ends on the {side} with a slope of {slope:.3g}, "
                "which continues beyond it, so the motion is unbounded: add points until the force "
                "is restoring, put a stopper there, or state by oscillator.restoring_force_range "
                "that the mass stays within the table"
            )
        return
    force = oscillator.coefficients
    order = max((n for n, k in enumerate(force) if k != 0.0), default=0)
    for side, sign in (("right", 1.0), ("left", -1.0)):
        if (order and force[order] * sign ** (order + 1) > 0.0) or _stopped(stoppers, side, order):
            continue
        short = f"linear_stiffness = {force[1]:g}"
        value = short if oscillator.is_short_form else f"restoring_force = {list(force)}"
        raise SceneError(
            f"{origin}: oscillator.{value} leaves the motion unbounded on the {side}: the "
            "highest power must be odd with a coefficient > 0 (cubic_stiffness > 0 in the short "
            f"form), a stopper with a greater exponent must be on the {side}, or "
            "oscillator.restoring_force_range must give the interval in which the force is known"
        )


def _stopped(stoppers, side, order):
    """Whether a stopper on this side grows faster with depth than a force of this order."""
    return any(
        stopper.stiffness > 0.0 and stopper.side in (side, "both") and stopper.exponent > order
        for stopper in stoppers
    )

"""The points of a study: every load at every combination of swept values, on common noise."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from circuits.netlist.subcircuits import UnknownParameter
from harvester.base.arguments import listed, real_numbers, table
from harvester.base.errors import HarvesterError, SceneError
from harvester.base.plain_text import name, nearest, shown
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers
from harvester.scene.steps import fixes_knots, spacing_of
from harvester.scene.tables import all_keys

# Both keys refer to the load's resistor, whether built-in or a netlist's parameter.
RESISTANCES = ("load.parameters.resistance", "load.resistance")
# Keys of [run] with integer values.
WHOLE = ("run.seed", "run.realizations")
# Minimum settling time of a realization, in time constants of the load's output.
CHARGING_TIMES = 5.0
OWN_LOAD = "scene"
GRID_WRITTEN = 'over={"load.resistance": [1e4, 1e5]}'


@dataclass(frozen=True)
class GridPoint:
    """One load at one point of the grid.

    Attributes
    ----------
    load
        The load's label.
    place
        Value of each swept key.
    """

    load: str
    place: tuple[Any, ...]
    scene: Scene


@dataclass(frozen=True)
class Grid:
    """The loads and swept values of a study, with the scene of every point.

    Attributes
    ----------
    scene
        The scene, with the knot spacing common to all points.
    loads
        Labels.
    sweeps
        The swept values by key.
    points
        The points, of which the load varies slowest and the last sweep fastest.
    """

    scene: Scene
    loads: tuple[str, ...]
    sweeps: dict[str, tuple[Any, ...]]
    points: tuple[GridPoint, ...]
    notes: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid: (loads, values of the first sweep, …)."""
        return (len(self.loads), *(len(values) for values in self.sweeps.values()))

    @property
    def curve(self) -> int | None:
        """Index of the longest sweep, along which optima are sought."""
        lengths = [len(values) for values in self.sweeps.values()]
        return lengths.index(max(lengths)) if lengths else None


def make_grid(
    scene: Scene,
    loads: Sequence[str],
    sweeps: Mapping[str, Sequence[Any]],
    any_key: bool = False,
) -> Grid:
    """Build a study's grid; check the scene of every point.

    Parameters
    ----------
    loads
        Names in netlists/ or paths; empty: the scene's load.
    sweeps : "table.key" to values.
    any_key : bool
        Whether all keys and text values are allowed, rather than only numbers of device, load and
        excitation.

    Raises
    ------
    HarvesterError
        An unknown key or load, a value out of range, a repeated load.
    """
    written = 'loads=["bridge"]'
    loads = [str(k) if isinstance(k, Path) else k for k in listed(loads, "loads", written)]
    loads = listed(loads, "loads", written, str) or (OWN_LOAD,)
    sweeps = {
        key: listed(levels, f"over[{shown(key)}]", "[0.1, 0.2]")
        for key, levels in table(sweeps, "over", GRID_WRITTEN).items()
    }
    if any_key and not sweeps:
        raise HarvesterError(f"--over: names no key; write {GRID_WRITTEN}")
    labels = tuple(name(Path(load).stem if _is_path(load) else load) for load in loads)
    for label in labels:
        if labels.count(label) > 1:
            raise HarvesterError(f"--load {label}: occurs twice: remove one")
    loaded = {k: _with_load(scene, load) for k, load in zip(labels, loads, strict=True)}
    for key, values in sweeps.items():
        _check_sweep(scene, key, values, any_key, loaded)
    points = [
        GridPoint(label, point, _at(loaded[label], dict(zip(sweeps, point, strict=True))))
        for label in labels
        for point in itertools.product(*sweeps.values())
    ]
    points, notes = _with_storage(points)
    netlists = ", ".join(label for label in labels if loaded[label].load.netlist)
    if RESISTANCES[1] in sweeps and netlists:
        notes += (f"{RESISTANCES[1]} sets {RESISTANCES[0]} of {netlists}",)
    # The scene itself also gets the common knot spacing; its load and values are unchanged.
    given, *points = _on_common_knots([GridPoint("", (), scene), *points])
    swept = {
        key: tuple(v if isinstance(v, str) else float(v) for v in values)
        for key, values in sweeps.items()
    }
    return Grid(given.scene, labels, swept, tuple(points), notes)


def _is_path(load):
    return "." in load or "/" in load


def _with_load(scene, load):
    if load in (OWN_LOAD, scene.load.netlist):
        return scene
    tables = scene.to_tables()
    tables["load"] = {"netlist": load}
    return Scene.from_tables(tables, name=scene.name, origin=scene.name, folder=scene.folder)


def _check_sweep(scene, key, values, any_key, loaded):
    """Raise if a sweep has no list of values, or its key is not a number of this scene."""
    loads = (loaded_scene.load for loaded_scene in loaded.values())
    parameters = [name for load in loads if load.netlist for name in load.circuit.values]
    parameter_keys = (f"load.parameters.{name}" for name in parameters)
    number_keys = [*dict.fromkeys((*numbers(scene), *parameter_keys))]
    option = "--over" if any_key else "--sweep"
    listed = key in number_keys or key in RESISTANCES or key.startswith("load.parameters.")
    if not listed and not (any_key and key in all_keys()):
        raise HarvesterError(
            f"{option} {key}: not a number of this scene{nearest(key, number_keys)}; there are "
            f"{', '.join(number_keys)}"
        )
    for value in values:
        if not (any_key and not listed and isinstance(value, str)):
            real_numbers([value], f"{option} {key}", "[0.1, 0.2]")
    if len(values) == 0 or len(set(values)) < len(values):
        raise HarvesterError(f"{option} {key}: give at least one value, and none twice")
    if len(loaded) > 1:
        _check_shared(f"{option} {key}", key, values[0], loaded)


def _check_shared(where, key, value, loaded):
    """Raise if some of the loads lack a parameter; if all lack it, the message names one load."""
    lacking = {}
    for label, scene in loaded.items():
        try:
            _at(scene, {key: value})
        except UnknownParameter as error:
            lacking[label] = error.args[1]
    having = [label for label in loaded if label not in lacking]
    if lacking and having:
        lacks = [
            f"{label} (it has {', '.join(names) or 'none'})" for label, names in lacking.items()
        ]
        raise HarvesterError(
            f"{where}: {', '.join(having)} {'has' if len(having) == 1 else 'have'} this parameter, "
            f"but not {', '.join(lacks)}: give it the same name in all these netlists, or study "
            "the loads separately"
        )


def _at(scene, values):
    """The scene with these values; a resistance key is replaced by the key that the load uses."""
    changes = {}
    for key, value in values.items():
        if key in RESISTANCES:
            key = RESISTANCES[0 if scene.load.netlist else 1]
            if scene.load.decay_rate is not None:
                if value == 0.0:
                    raise HarvesterError(f"--sweep {RESISTANCES[1]}: 0: must be a number > 0")
                # In scaled scenes λ = 1/R gives the resistor.
                key, value = "load.decay_rate", 1.0 / value
        changes[key] = int(value) if key in WHOLE and value % 1 == 0 else value
    return scene.replace(changes)


def _with_storage(points):
    """Reduce storage capacitors of built-in loads so that they charge while a run settles.

    A value given by the user is kept. The default of 10 µF takes minutes to charge at 10 MΩ.
    """
    changed = []
    for k, point in enumerate(points):
        load, settle = point.scene.load, point.scene.run.settle
        if not load.netlist or _is_path(load.netlist) or settle == 0.0:
            continue
        values = load.circuit.values
        if "storage" in (load.parameters or {}) or not {"storage", "resistance"} <= {*values}:
            continue
        fitting = settle / CHARGING_TIMES / values["resistance"]
        if 0.0 < fitting < values["storage"]:
            scene = point.scene.replace({"load.parameters.storage": fitting})
            points[k] = GridPoint(point.load, point.place, scene)
            changed.append(point.load)
    if not changed:
        return points, ()
    return points, (
        f"storage capacitor of {', '.join(dict.fromkeys(changed))}: the netlist's value, or the "
        f"one that charges with a time constant of settle/{CHARGING_TIMES:g} = "
        f"{settle / CHARGING_TIMES:g} s if this is smaller; swept values of "
        "load.parameters.storage override it",
    )


def _on_common_knots(points):
    """Give all points the finest knot spacing among them, so that they have common noise."""
    spacings = [spacing_of(point.scene) for point in points]
    if min(spacings) == max(spacings) and fixes_knots(points[0].scene):
        return points
    try:
        change = {"excitation.knot_spacing": min(spacings)}
        return [GridPoint(p.load, p.place, p.scene.replace(change)) for p in points]
    except SceneError as error:
        raise HarvesterError(f"the points need common sample times of the noise: {error}") from None

"""Scenes: the input of a simulation, read from TOML and checked before anything runs."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import html
import json
import math
from dataclasses import field, replace
from pathlib import Path
from typing import Any, NoReturn

from harvester.base import plain_text
from harvester.base.errors import SceneError
from harvester.base.plain_text import named, shown
from harvester.base.signatures import Overrides, named_as_called
from harvester.device import timescales
from harvester.device.beam.lumped import Beam
from harvester.device.beam.magnets import Magnets
from harvester.device.keys import SI, Table, computed, table
from harvester.device.terminals import TransducerTable
from harvester.excitation.base import Excitation, Run
from harvester.scene.drawn import without_drawn
from harvester.scene.force_file import read_points_of
from harvester.scene.overrides import put_all
from harvester.scene.schema import check_tables, transducer_of
from harvester.scene.source import BUILT_IN, built_in_names, tables_of
from harvester.scene.tables import TRANSDUCERS, Load, Oscillator, Start, Stopper, all_tables
from harvester.scene.toml import parts_of, plain_tables
from harvester.scene.units import rest_stiffness, scale

# Built-in loads whose defaults are for scaled scenes, and the values that SI scenes must give.
SCALED_LOADS = {"bridge_ideal": ("resistance", "storage", "conductance")}


@table
class Scene(Table):
    """One device, its load, its excitation and its run: the input of every engine.

    `Scene.read(source)` reads one, `replace` gives a changed copy; both raise `SceneError`.
    Each table is an attribute: `scene.oscillator`, `scene.load`, `scene.run`, …; [piezo], [coil] or
    another transducer is `scene.transducer`.

    >>> Scene.read("paper").replace({"excitation.intensity": 0.1}).excitation.intensity
    0.1
    """

    NAME = ""

    name: str
    units: str
    oscillator: Oscillator
    transducer: TransducerTable
    excitation: Excitation
    run: Run
    load: Load
    stoppers: tuple[Stopper, ...] = ()
    start: Start | None = None
    length_scale: float | None = None
    # The drawing from which oscillator and transducer were computed, if there is one.
    beam: Beam | None = None
    magnets: Magnets | None = None
    # Folder of the scene's file. With a netlist as load: all folders in which it is searched, in
    # order.
    folder: str | tuple | None = field(default=None, compare=False, repr=False)

    def __getitem__(self, key: object) -> NoReturn:
        raise SceneError(f"scene[{shown(key)}]: write its attribute, such as scene.oscillator.mass")

    def __setitem__(self, key: str, value: object) -> None:
        setattr(self, key, value)

    @classmethod
    def read(cls, source: str | Path, overrides: Overrides = ()) -> Scene:
        """Read a scene from a TOML file or by the name of a built-in one.

        Parameters
        ----------
        source : str or Path
            Built-in name, or path of a TOML file.
        overrides : iterable of str, or dict
            `table.key=value` as on the command line; `table=none` removes a table. A dict is as in
            `replace`.

        Raises
        ------
        SceneError
            The file, a key or a value is not usable.
        NetlistError
            The load's netlist cannot be read.
        """
        with named_as_called(cls.read):
            tables, path = tables_of(source, overrides)
        folder = None if path.parent == BUILT_IN else str(path.parent.absolute())
        return cls.from_tables(tables, name=path.stem, origin=named(str(source)), folder=folder)

    @staticmethod
    def names() -> list[str]:
        """Names of the built-in scenes, sorted."""
        return built_in_names()

    @classmethod
    def from_tables(
        cls,
        tables: dict[str, Any],
        name: object = "scene",
        origin: str = "scene",
        folder: str | tuple[str, ...] | None = None,
        changed: Scene | None = None,
    ) -> Scene:
        """Build and check a scene from nested dictionaries with the structure of a TOML file.

        A load's netlist is searched in `folder`, then in the current folder. The scene holds its
        content. If `changed` is given, its netlist is not read again, and its record files must be
        unchanged.
        """
        tables = {"run": {}, **plain_tables(tables, origin)}
        read_points_of(tables, origin)
        parts = check_tables(tables, origin)
        top, transducer = parts.pop(""), transducer_of(parts)
        if parts["load"].netlist is not None:
            folder = _folders(folder)
            parts["load"] = _with_circuit(parts["load"], folder, top.units, origin, changed)
        parts["oscillator"] = _damped(parts["oscillator"], origin)
        parts["excitation"].check(top.units, parts["run"], origin)
        parts["run"] = _lasting(parts["run"], parts["excitation"], origin)
        parts["transducer"] = _coupled(
            parts.pop(transducer), transducer, parts["oscillator"], origin
        )
        name = plain_text.name(name)
        scene = cls(name, top.units, length_scale=top.length_scale, folder=folder, **parts)
        if scene.run.starts is not None and scene.excitation.random:
            raise SceneError(
                f"{origin}: run.starts = {scene.run.starts}: starts are for a deterministic "
                "excitation, a sine or one pass of a record; under noise set run.realizations"
            )
        if scene.run.orbit in ("best", "weighted") and scene.run.starts is None:
            raise SceneError(
                f'{origin}: run.orbit = "{scene.run.orbit}" needs random starts: set '
                "run.starts = 16 or more"
            )
        if scene.run.starts and scene.start and scene.run.orbit != "rest":
            raise SceneError(
                f"{origin}: run.starts = {scene.run.starts} draws where each realization begins: "
                'leave out the table [start], or run.starts, or set run.orbit = "rest"'
            )
        _check_range(scene, origin)
        _check_sampling(scene, origin)
        return scene

    def replace(self, changes: dict[str, Any] | None = None, /, **tables: Any) -> Scene:
        """Return a checked copy with changed values.

        Parameters
        ----------
        changes : dict, optional
            Dotted keys to values, {"stoppers.gap": 1.2}.
        **tables : dict or None
            Tables to change key by key; None removes the table. `name="..."` is the copy's name.
        """
        new = self._tables() | {"name": self.name}
        if not isinstance(changes, (dict, type(None))):
            raise SceneError(
                f"replace {shown(changes)}: give a dictionary of dotted keys to values"
            )
        combined = dict(changes or {})
        for name, values in tables.items():
            if not isinstance(values, dict):
                combined[name] = values
                continue
            for key, value in values.items():
                last = key if isinstance(key, str) else shown(key)
                combined[f"{name}.{last}"] = value
        put_all(new, combined, "replace")
        name = new.pop("name", None)
        if not isinstance(name, str):
            raise SceneError(f"replace name = {shown(name)}: must be a text")
        return self.from_tables(new, name, self.name, self.folder, changed=self)

    def to_tables(self) -> dict[str, Any]:
        """Nested dictionaries with the structure of a TOML file, without omitted keys."""
        return self._tables("sha256")

    def _tables(self, *without):
        """Nested dictionaries of all fields except those in `without`."""
        tables: dict[str, Any] = {"units": self.units}
        if self.length_scale is not None:
            tables["length_scale"] = self.length_scale
        parts = {self.transducer_name: self.transducer, **vars(self)}
        for name in all_tables():
            part = parts.get(name)
            if isinstance(part, tuple):
                plain = [_plain(item, without) for item in part]
                # One pair of equal stoppers is written as [stoppers], all others as [[stoppers]].
                content = plain[0] if len(part) == 1 and part[0].side == "both" else plain
            else:
                content = part and _plain(part, without)
            tables |= {name: content} if content else {}
        return without_drawn(tables) if self.beam else tables

    @property
    def transducer_name(self) -> str:
        """The name of the transducer's table."""
        return TRANSDUCERS.name_of(type(self.transducer))

    def without_drawing(self) -> Scene:
        """The scene with the lumped values of its drawing instead of the drawing."""
        return dataclasses.replace(self, beam=None, magnets=None)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a result's JSON: name, digests and tables."""
        return {"name": self.name, "sha256": self.digest(), **self._tables()}

    @classmethod
    def from_dict(cls, content: dict[str, Any], folder: str | None = None) -> Scene:
        """Build the scene from the return value of `to_dict`.

        Its files (a record, a load's netlist) are read again, the netlist from `folder` or the
        current one.

        Raises
        ------
        SceneError
            A value is invalid, or a file is missing or has changed.
        NetlistError
            The load's netlist cannot be read.
        """
        if not isinstance(content, dict):
            raise SceneError(
                f"{shown(content)}: not a scene: pass the return value of Scene.to_dict"
            )
        tables = copy.deepcopy({k: v for k, v in content.items() if k not in ("name", "sha256")})
        # A record without a stored digest is read again.
        for _, excitation in parts_of(tables.get("excitation")):
            excitation.pop("sha256", None)
        name = str(content.get("name", "scene"))
        scene = cls.from_tables(tables, name=name, origin=name, folder=folder)
        if "sha256" in content and scene.digest() != content["sha256"]:
            raise SceneError(
                f"{scene.name}: the digest is no longer sha256 = {shown(content['sha256'])}: "
                "a value or a file of the scene has changed since"
            )
        return scene

    def _repr_html_(self) -> str:
        """The scene as TOML in a notebook."""
        from harvester.scene.text import key_comments, scene_text

        return f"<pre>{html.escape(scene_text(self, key_comments(self), [self.name]))}</pre>"

    def digest(self) -> str:
        """SHA-256 of the scene's values: the same device and run give the same digest.

        It includes the contents of a record and a load's netlist, and ignores their paths.
        """
        text = json.dumps(self._tables("file"), sort_keys=True)
        if self.load.circuit:
            text += self.load.circuit.text
            text += "".join(measure.text for measure in self.load.circuit.measures)
        return hashlib.sha256(text.encode()).hexdigest()


def _damped(oscillator, origin):
    """The oscillator; if ζ or Q is given, with the damping 2 ζ √(K M), K at rest."""
    if oscillator.damping is not None:
        return oscillator
    ratio = oscillator.damping_ratio
    name = "quality_factor" if ratio is None else "damping_ratio"
    stiffness = _stiffness_at_rest(oscillator, f"oscillator.{name}", "damping", origin)
    ratio = 0.5 / oscillator.quality_factor if ratio is None else ratio
    return replace(oscillator, damping=2.0 * ratio * math.sqrt(stiffness * oscillator.mass))


def _coupled(transducer, name, oscillator, origin):
    """The transducer; if k² is given, with the coupling that follows from it."""
    if getattr(transducer, "k2", None) is None:
        return transducer
    stiffness = _stiffness_at_rest(oscillator, f"{name}.k2", "coupling", origin)
    coupling = transducer.coupling_at(stiffness)
    if not coupling > 0.0:
        raise SceneError(f"{origin}: {name}.k2 needs {name}.inductance > 0: give {name}.coupling")
    return replace(transducer, coupling=coupling)


def _stiffness_at_rest(oscillator, key, instead, origin):
    """The stiffness at rest, which `key` needs; raise SceneError if it is not positive."""
    stiffness = rest_stiffness(oscillator)
    if not stiffness > 0.0:
        raise SceneError(
            f"{origin}: {key} needs a frequency, but the spring has no stiffness at rest: give "
            f"{key.partition('.')[0]}.{instead}"
        )
    return stiffness


def _lasting(run, excitation, origin):
    """The run with its duration; by default the record's remaining time after settling."""
    if run.duration is not None:
        return run
    length = excitation.own_duration
    if length is None:
        allowed = Run.KEYS["duration"].allowed()
        raise SceneError(f"{origin}: run.duration is missing; it takes {allowed}")
    if not run.settle < length:
        raise SceneError(
            f"{origin}: run.settle = {run.settle:g}: must be less than the record's {length:g} s"
        )
    return replace(run, duration=length - run.settle)


def _check_range(scene, origin):
    """Raise if the spring's range has no rest position or does not contain the start."""
    limits = scene.oscillator.restoring_force_range
    if limits is None:
        return
    scale(scene)
    start = scene.start.displacement if scene.start else None
    if start is not None and not limits[0] <= start <= limits[1]:
        raise SceneError(
            f"{origin}: start.displacement = {start:g}: must lie within "
            f"oscillator.restoring_force_range = {list(limits)}"
        )


def _check_sampling(scene, origin):
    """Raise if a record's sampling rate is too low for the device's frequency."""
    highest = scene.excitation.highest_frequency
    if math.isinf(highest):
        return
    frequency = timescales.angular_frequency(scale(scene)[0]) / (2.0 * math.pi)
    if frequency > highest:
        raise SceneError(
            f"{origin}: the record's samples are {0.5 / highest:.4g} s apart, which resolves up to "
            f"{highest:.3g} Hz, but the device moves at {frequency:.3g} Hz: correct the unit "
            "in the time column's heading, or if it has none give excitation.time_unit "
            '("ms", "us", … or "samples" with sampling_rate), or take a finer record'
        )


def _folders(folder):
    """Folders in which a load's netlist is searched: the scene's, then the current one."""
    if isinstance(folder, tuple):
        return folder
    current = str(Path.cwd())
    return tuple(dict.fromkeys((folder or current, current)))


def _with_circuit(load, folders, units, origin, changed):
    """The load with its netlist, which is read unless `changed` contains it."""
    from circuits.netlist.subcircuits import find_netlist, read_load

    values = load.parameters or {}
    if changed and changed.load.netlist == load.netlist:
        file, cards = changed.load.circuit.source
    else:
        file, cards = find_netlist(load.netlist, folders), None
    circuit = read_load(file, load.subcircuit, values, cards)
    needed = {*SCALED_LOADS.get(load.netlist, ())} - {*values}
    if units == SI and needed:
        raise SceneError(
            f"{origin}: load.netlist = {load.netlist!r}: its defaults are for scaled scenes: "
            f"give {', '.join(sorted(needed))} in load.parameters, or choose another load"
        )
    return replace(load, circuit=circuit)


def _plain(part, without):
    """A table as plain values, without computed or omitted fields and those in `without`."""
    values, left_out = {}, {"circuit", *computed(part), *without}
    for entry in dataclasses.fields(part):
        name, value = entry.name, getattr(part, entry.name)
        rare = name in part.KEYS and part.KEYS[name].rare
        if value is None or (rare and value == entry.default) or name in left_out:
            continue
        value = dict(value) if isinstance(value, dict) else value
        parts = isinstance(value, tuple) and any(map(dataclasses.is_dataclass, value))
        values[name] = [_plain(item, without) for item in value] if parts else value
    return values

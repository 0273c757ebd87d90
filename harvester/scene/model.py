"""Scenes: what is simulated, read from TOML and checked before anything runs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harvester.base import plain_text
from harvester.base.errors import SceneError
from harvester.base.plain_text import named, shown
from harvester.device import timescales
from harvester.device.beam.lumped import Beam
from harvester.device.beam.magnets import Magnets
from harvester.device.keys import SI, names_replace
from harvester.device.terminals import TransducerTable
from harvester.excitation import KINDS, build
from harvester.excitation.base import Excitation, Run
from harvester.excitation.recorded import RecordedMotion
from harvester.scene.drawn import DRAWN, with_drawing
from harvester.scene.force_file import with_points
from harvester.scene.overrides import put
from harvester.scene.schema import TRANSDUCERS, check_tables
from harvester.scene.source import BUILT_IN, built_in_names, tables_of
from harvester.scene.toml import plain_tables
from harvester.scene.units import rest_stiffness, scale

# Loads whose own values are for scaled scenes, with those that an SI scene has to give.
SCALED_LOADS = {"bridge_ideal": ("resistance", "storage", "conductance")}
# A scene is written without these keys if they have their default values.
RARE_KEYS = (
    "base_charge", "base_factor", "force_interpolation", "quadratic_damping", "side", "exponent",
    "law",
)  # fmt: skip


@names_replace
@dataclass(frozen=True)
class Oscillator:
    """Mass, spring and damper.

    `restoring_force` holds F0, k1, k2, … of F(x) = F0 + k1 x + k2 x² + …; `linear_stiffness` and
    `cubic_stiffness` are the short form of (0, k1, 0, k3); `force_table` holds points (x, F), and
    `restoring_force_range` the displacements between which any of these is meant. SI: kg, N s/m,
    N s²/m² for `quadratic_damping`, N, N/m, N/m², …. Scaled: c, −ω0², κ of Eq. 4a and so on, and
    no mass.
    `base_factor` is μ: the base's acceleration counts μ times in a lumped mode of a beam.

    In SI `frequency` (Hz), of the mass on the linear spring alone, may stand for
    `linear_stiffness`, and `quality_factor` or `damping_ratio`, at the stiffest rest position, for
    `damping`: a scene keeps what it was given, and these two are computed from it.
    """

    damping: float
    linear_stiffness: float | None = None
    cubic_stiffness: float | None = None
    mass: float | None = None
    restoring_force: tuple | None = None
    quadratic_damping: float = 0.0
    base_factor: float = 1.0
    force_table: tuple | None = None
    force_interpolation: str = "monotone"
    restoring_force_range: tuple | None = None
    frequency: float | None = None
    quality_factor: float | None = None
    damping_ratio: float | None = None

    @property
    def computed(self) -> tuple[str, ...]:
        """Names of the values that others were given for."""
        spring = ("linear_stiffness",) if self.frequency is not None else ()
        ratios = (self.quality_factor, self.damping_ratio)
        return (*spring, *(() if ratios == (None, None) else ("damping",)))

    @property
    def is_short_form(self) -> bool:
        """Whether the spring is one of `linear_stiffness` and `cubic_stiffness` alone."""
        others = (self.restoring_force, self.force_table, self.restoring_force_range)
        return all(form is None for form in others)

    @property
    def coefficients(self) -> tuple[float | None, ...]:
        """(F0, k1, k2, …) whichever form the scene has; empty of a table."""
        if self.force_table is not None:
            return ()
        if self.restoring_force is not None:
            return self.restoring_force
        return (0.0, self.linear_stiffness, 0.0, self.cubic_stiffness)


@names_replace
@dataclass(frozen=True)
class Stopper:
    """A Hertz-damp stopper at a distance from x = 0, on one side or on both (Eq. 5).

    SI: m, N/m^exponent. Scaled: δ, K.
    """

    gap: float
    stiffness: float
    restitution: float
    impact_velocity: str = "energy"
    side: str = "both"
    exponent: float = 1.5
    law: str = "hertz-damp"


@names_replace
@dataclass(frozen=True)
class Start:
    """The state in which every realization starts, at rest in the wells in turn without it.

    Units of the scene: m, m/s, V; without `displacement` the wells are still taken in turn.
    """

    displacement: float | None = None
    velocity: float = 0.0
    voltage: float = 0.0


class NamedValues(dict):
    """A dictionary that cannot be changed; equal to any with the same names and values.

    >>> {NamedValues(resistance=1e5): "a load"}[NamedValues({"resistance": 1e5})]
    'a load'
    """

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedValues, (dict(self),)

    def _refuse(self, *_, **__):
        raise TypeError("these values are fixed: make a changed copy, dict(values)")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse


@names_replace
@dataclass(frozen=True)
class Load:
    """The load of the transducer: the built-in resistor, or a netlist.

    `kind`, `resistance` (SI, Ω), `decay_rate` (scaled, λ = 1/(R Cp)) are the built-in resistor's.
    `netlist` is a name in netlists/ or a path, `subcircuit` the one meant of its file,
    `parameters` its values; `circuit` is what was read there
    (circuits.netlist.load_circuit.LoadCircuit).
    """

    kind: str | None = None
    resistance: float | None = None
    decay_rate: float | None = None
    netlist: str | None = None
    subcircuit: str | None = None
    parameters: NamedValues | None = None
    circuit: Any = field(default=None, repr=False)

    @property
    def is_resistor(self) -> bool:
        """Whether λ describes it: the built-in resistor, or a netlist that holds only one."""
        return self.circuit is None or self.circuit.resistance is not None


def _tables() -> dict[str, tuple[str, Any]]:
    """Table in the file → attribute of Scene, what builds it."""
    return {
        "beam": ("beam", Beam),
        "magnets": ("magnets", Magnets),
        "oscillator": ("oscillator", Oscillator),
        "stoppers": ("stoppers", Stopper),
        **{name: ("transducer", table) for name, table in TRANSDUCERS.items()},
        "load": ("load", Load),
        "start": ("start", Start),
        "excitation": ("excitation", build),
        "run": ("run", Run),
    }


@names_replace
@dataclass(frozen=True)
class Scene:
    """One device, its load, its excitation and its run: the input of every engine.

    `Scene.read(source)` reads one, `replace` gives a changed copy; both raise `SceneError`.
    Each table is an attribute: `scene.oscillator`, `scene.load`, `scene.run`, …; [piezo], [coil] or
    another transducer is `scene.transducer`.

    >>> Scene.read("paper").replace({"excitation.intensity": 0.1}).excitation.intensity
    0.1
    """

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

    @classmethod
    def read(cls, source: str | Path, overrides: Iterable[str] = ()) -> Scene:
        """Read a scene from a TOML file or by the name of a built-in one.

        Parameters
        ----------
        source : str or Path
            Built-in name, or path of a TOML file.
        overrides : iterable of str
            `table.key=value` as on the command line; `table=none` removes a table.

        Raises
        ------
        SceneError
            The file, a key or a value is not usable.
        """
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
        """Build a scene from nested dictionaries of the TOML file's form, checked.

        A load's netlist is looked for in `folder`, then in the current one, and read here: the
        scene holds its content. The netlist of a scene that is `changed` is not read again, and
        its records must be as they were.
        """
        tables = {"run": {}, **with_points(plain_tables(tables, origin), origin)}
        tables = with_drawing(tables, origin)
        checked = check_tables(tables, origin, {"excitation": KINDS})
        if "netlist" in checked["load"]:
            folder = _folders(folder)
            before = changed.load if changed else None
            checked["load"]["circuit"] = _read_netlist(checked["load"], folder, before)
            _check_scaled_load(checked, origin)
            if "parameters" in checked["load"]:
                checked["load"]["parameters"] = NamedValues(checked["load"]["parameters"])
        if "damping" not in checked["oscillator"]:
            checked["oscillator"]["damping"] = _damping(checked["oscillator"], origin)
        if "duration" not in checked["run"]:
            checked["run"]["duration"] = _own_duration(checked, origin)
        top = {key: checked[key] for key in ("units", "length_scale") if key in checked}
        parts = {
            attribute: _made(make, checked[table])
            for table, (attribute, make) in _tables().items()
            if table in checked
        }
        if "stoppers" in parts and isinstance(parts["stoppers"], Stopper):
            parts["stoppers"] = (parts["stoppers"],)
        scene = cls(name=plain_text.name(name), folder=folder, **top, **parts)
        digests = _records(changed.excitation) if changed else {}
        for file, digest in _records(scene.excitation).items():
            if digests.get(file, digest) != digest:
                raise SceneError(f"{named(file)}: the record has changed since the scene was read")
        scene.excitation.check(scene.units, scene.run, origin)
        if scene.run.starts is not None and scene.excitation.random:
            raise SceneError(
                f"{origin}: run.starts = {scene.run.starts}: starts are for an excitation without "
                "chance, a sine or one pass of a record; under noise set run.realizations"
            )
        if scene.run.orbit in ("best", "weighted") and scene.run.starts is None:
            raise SceneError(
                f'{origin}: run.orbit = "{scene.run.orbit}" needs drawn starts: set '
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
        """A checked copy with other values.

        Parameters
        ----------
        changes : dict, optional
            Dotted keys to values, {"stoppers.gap": 1.2}.
        **tables : dict or None
            Tables to change key by key; None removes the table.
        """
        new = self.to_tables()
        if not isinstance(changes, (dict, type(None))):
            raise SceneError(
                f"replace {shown(changes)}: give a dictionary of dotted keys to values"
            )
        for key, value in (changes or {}).items():
            put(new, key, value, "replace")
        for table, values in tables.items():
            if isinstance(values, dict):
                for key, value in values.items():
                    name = key if isinstance(key, str) else shown(key)
                    put(new, f"{table}.{name}", value, "replace")
            else:
                put(new, table, values, "replace")
        return self.from_tables(new, self.name, self.name, self.folder, changed=self)

    def to_tables(self) -> dict[str, Any]:
        """Nested dictionaries of the TOML file's form, without what is left out."""
        return self._tables(lambda field: field.init)

    def _tables(self, keep):
        """Nested dictionaries of the fields that `keep` accepts."""
        tables: dict[str, Any] = {"units": self.units}
        if self.length_scale is not None:
            tables["length_scale"] = self.length_scale
        transducer = TRANSDUCERS.name_of(type(self.transducer))
        for table, (attribute, _) in _tables().items():
            part = getattr(self, attribute)
            if attribute == "transducer" and table != transducer:
                continue
            if isinstance(part, tuple):
                plain = [_plain(item, keep) for item in part]
                # One pair of equal stoppers is written as [stoppers], all others as [[stoppers]].
                part = plain[0] if len(part) == 1 and part[0].side == "both" else plain
                tables.update({table: part} if part else {})
            elif part is not None:
                tables[table] = _plain(part, keep)
        for table in DRAWN if self.beam else ():
            left = {key: value for key, value in tables[table].items() if key not in DRAWN[table]}
            tables = {key: content for key, content in tables.items() if key != table}
            tables.update({table: left} if left else {})
        return tables

    def without_drawing(self) -> Scene:
        """The scene with the lumped values of its drawing in place of the drawing."""
        return dataclasses.replace(self, beam=None, magnets=None)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a result's JSON: name, digests and tables."""
        return {"name": self.name, "sha256": self.digest(), **self._tables(lambda field: True)}

    @classmethod
    def from_dict(cls, content: dict[str, Any], folder: str | None = None) -> Scene:
        """The scene that `to_dict` made plain values of.

        Its files (a record, a load's netlist) are read again, the netlist from `folder` or the
        current one.

        Raises
        ------
        SceneError
            A value is not usable, a file is missing or holds something else than then.
        """
        if not isinstance(content, dict):
            raise SceneError(f"{shown(content)}: no scene: give what Scene.to_dict returned")
        tables = {key: value for key, value in content.items() if key not in ("name", "sha256")}
        if isinstance(tables.get("excitation"), dict):
            tables["excitation"] = _without_computed(tables["excitation"])
        name = str(content.get("name", "scene"))
        scene = cls.from_tables(tables, name=name, origin=name, folder=folder)
        if scene.digest() != content.get("sha256"):
            raise SceneError(
                f"{scene.name}: its digest is no longer sha256 = {shown(content.get('sha256'))}: "
                "a value or a file that it names has changed since"
            )
        return scene

    def digest(self) -> str:
        """SHA-256 of the scene's values: the same device and run give the same digest.

        A record and a load's netlist count by their content, wherever they lie.
        """
        text = json.dumps(self._tables(lambda field: field.name != "file"), sort_keys=True)
        if self.load.circuit:
            text += self.load.circuit.text
            text += "".join(measure.text for measure in self.load.circuit.measures)
        return hashlib.sha256(text.encode()).hexdigest()


def _damping(table, origin):
    """C = 2 ζ √(K M), with the stiffness at rest, where the damping is given by ζ or Q."""
    stiffness = rest_stiffness(Oscillator(damping=0.0, **table))
    name = "quality_factor" if "quality_factor" in table else "damping_ratio"
    if not stiffness > 0.0:
        raise SceneError(
            f"{origin}: oscillator.{name} needs a frequency, and the spring has no stiffness at "
            "rest: give oscillator.damping"
        )
    ratio = table[name] if name == "damping_ratio" else 0.5 / table[name]
    return 2.0 * ratio * math.sqrt(stiffness * table["mass"])


def _own_duration(checked, origin):
    """Time that is left of a record after settling, where the run has no duration (s)."""
    length, settle = build(**checked["excitation"]).own_duration, checked["run"].get("settle", 0.0)
    if length is None:
        raise SceneError(f"{origin}: run.duration is missing; it takes a number > 0")
    if not settle < length:
        raise SceneError(
            f"{origin}: the record lasts {length:g} s, and run.settle = {settle:g}: must be less"
        )
    return length - settle


def _check_range(scene, origin):
    """Refuse a range without a rest position, and a start outside."""
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
    """Refuse a record whose samples are too far apart to hold the device's frequency."""
    highest = scene.excitation.highest_frequency
    if math.isinf(highest):
        return
    frequency = timescales.angular_frequency(scale(scene)[0]) / (2.0 * math.pi)
    if frequency > highest:
        raise SceneError(
            f"{origin}: the record's samples are {0.5 / highest:.4g} s apart, which holds no more "
            f"than {highest:.3g} Hz, and the device moves at {frequency:.3g} Hz: say what the time "
            'column is in by excitation.time_unit ("ms", "us", … or "samples" with sampling_rate)'
            ", or take a finer record"
        )


def _without_computed(table: dict[str, Any]) -> dict[str, Any]:
    """An excitation's table without the fields that were computed from its files."""
    kinds: Iterable[Any] = KINDS.values()
    computed = {
        entry.name for kind in kinds for entry in dataclasses.fields(kind) if not entry.init
    }
    stated = {key: value for key, value in table.items() if key not in computed}
    if "parts" in stated:
        stated["parts"] = [_without_computed(part) for part in stated["parts"]]
    return stated


def _made(make, table):
    """A part from its table, or a tuple of parts from several."""
    if isinstance(table, tuple):
        return tuple(make(**item) for item in table)
    return make(**table)


def _folders(folder):
    """Where a load's netlist is looked for: a copy of the scene may be made in another folder."""
    if isinstance(folder, tuple):
        return folder
    current = str(Path.cwd())
    return tuple(dict.fromkeys((folder or current, current)))


def _read_netlist(load, folders, before):
    from circuits.netlist.subcircuits import find_netlist, read_load

    unchanged = before is not None and before.netlist == load["netlist"]
    file, cards = (
        before.circuit.source if unchanged else (find_netlist(load["netlist"], folders), None)
    )
    return read_load(file, load.get("subcircuit"), load.get("parameters"), cards)


def _records(excitation):
    """Digests of an excitation's records by their files."""
    parts = (excitation, *getattr(excitation, "parts", ()))
    return {part.file: part.sha256 for part in parts if isinstance(part, RecordedMotion)}


def _check_scaled_load(checked, origin):
    """Refuse an SI scene whose load has values for scaled ones."""
    load = checked["load"]
    needed = {*SCALED_LOADS.get(load["netlist"], ())} - {*load.get("parameters", ())}
    if checked["units"] == SI and needed:
        raise SceneError(
            f"{origin}: load.netlist = {load['netlist']!r}: its own values are for scaled scenes: "
            f"give {', '.join(sorted(needed))} in load.parameters, or take another load"
        )


def _plain(part, keep):
    """A dataclass as plain values, without what is left out."""
    values = {}
    for entry in dataclasses.fields(part):
        name, value = entry.name, getattr(part, entry.name)
        unused = value is None or (value == entry.default and name in RARE_KEYS)
        if unused or name == "circuit" or name in getattr(part, "computed", ()) or not keep(entry):
            continue
        value = dict(value) if isinstance(value, dict) else value
        parts = isinstance(value, tuple) and any(map(dataclasses.is_dataclass, value))
        values[name] = [_plain(item, keep) for item in value] if parts else value
    return values

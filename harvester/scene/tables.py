"""The tables of a scene: each key is declared as a field of its table's class."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import field
from typing import Any, ClassVar

from harvester.base.formatting import engineering, quantity
from harvester.base.registry import Registry
from harvester.device.beam.lumped import Beam
from harvester.device.beam.magnets import Magnets
from harvester.device.coil import CoilTable
from harvester.device.contact import LAWS, SIDES
from harvester.device.force_table import INTERPOLATIONS
from harvester.device.keys import (
    BOTH,
    NAMED_VALUES,
    NUMBER,
    SCALED,
    SI,
    Key,
    NamedValues,
    OneOf,
    Table,
    class_of,
    every_key,
    key,
    not_negative,
    positive,
    table,
    word,
)
from harvester.device.piezo import PiezoTable
from harvester.device.terminals import TransducerTable
from harvester.excitation import KINDS
from harvester.excitation.base import Run

# The transducers that a scene may have, by the name of their table.
TRANSDUCERS: Registry[type[TransducerTable]] = Registry(
    "harvester.transducers", {"piezo": PiezoTable, "coil": CoilTable}
)
# Maximum number of points in a force table. More than `MOST_PIECES` + 1 points need smoothing.
MOST_POINTS = 2000
# Optional tables, and the maximum numbers of repeated tables.
OPTIONAL, SEVERAL = ("beam", "magnets", "stoppers", "start"), {"stoppers": 16}


@table
class Top(Table):
    """Keys outside the tables."""

    units: str = word("unit system of all values", BOTH, required=True)
    length_scale: float | None = positive(
        "length unit of the scaled equations: by default derived from the device", "m",
        units=(SI,),
    )  # fmt: skip


@table
class Oscillator(Table):
    """Mass, spring and damper. The scene keeps the keys that were given.

    `restoring_force` holds F0, k1, k2, … of F(x) = F0 + k1 x + k2 x² + …; `linear_stiffness` and
    `cubic_stiffness` are the short form of (0, k1, 0, k3).
    """

    mass: Any = positive("mass", "kg", units=(SI,), required=True, usual=(1e-7, 100.0), drawn=True)
    damping: float = not_negative("damping: C", "N s/m", "c", drawn=True)
    quality_factor: float | None = positive(
        "quality factor Q: 1/(2ζ) at the stiffest rest position", "1",
        units=(SI,), usual=(1.0, 1e6), drawn=True,
    )  # fmt: skip
    damping_ratio: float | None = not_negative(
        "damping ratio: ζ at the stiffest rest position", "1", units=(SI,), drawn=True
    )
    quadratic_damping: float = not_negative(
        "quadratic damping: C2, air drag", "N s²/m²", "C2 l/M", default=0.0, rare=True
    )
    linear_stiffness: float | None = key(
        "linear stiffness: k1, negative if bistable", "N/m", "−ω0²", drawn=True
    )
    frequency: float | None = positive(
        "frequency, terminals shorted: √(K/M)/2π of the mass on a linear spring", "Hz",
        units=(SI,), usual=(0.1, 1e5), drawn=True,
    )  # fmt: skip
    cubic_stiffness: float | None = not_negative(
        "cubic stiffness: k3, by default 0", "N/m³", "κ", drawn=True
    )
    restoring_force: tuple | None = key(
        "restoring force: [F0, k1, k2, …] up to the seventh power", "N, N/m, N/m², …",
        "each kₙ lⁿ⁻¹/M", element=NUMBER, count=(2, 8), drawn=True,
    )  # fmt: skip
    base_factor: float = positive(
        "base factor: μ, 1 if all mass is at the tip; the base's acceleration counts μ times", "1",
        default=1.0, rare=True, usual=(0.5, 2.0), drawn=True,
    )  # fmt: skip
    force_table: tuple | None = key(
        "table of the force: displacement and force of each point, or a file of two columns",
        "m, N", "l, F/(M l)", element=Key(element=NUMBER, count=(2, 2)), count=(2, MOST_POINTS),
        file=True, drawn=True,
    )  # fmt: skip
    force_interpolation: str = word(
        "interpolation of the table: through every point, or least squares", INTERPOLATIONS,
        default="monotone", rare=True, drawn=True,
    )  # fmt: skip
    restoring_force_range: tuple | None = key(
        "range of the spring: displacements between which the force is known", "m", "l",
        element=NUMBER, count=(2, 2),
    )  # fmt: skip

    ALTERNATIVES: ClassVar = (
        OneOf(("damping", "quality_factor", "damping_ratio")),
        OneOf(
            ("linear_stiffness", "frequency", "restoring_force", "force_table"),
            {
                "cubic_stiffness": ("linear_stiffness", "frequency"),
                "force_interpolation": ("force_table",),
            },
        ),
    )

    def __post_init__(self) -> None:
        if self.frequency is not None:
            rate = 2.0 * math.pi * self.frequency
            object.__setattr__(self, "linear_stiffness", self.mass * rate**2)
        if self.linear_stiffness is not None and self.cubic_stiffness is None:
            object.__setattr__(self, "cubic_stiffness", 0.0)

    @property
    def is_short_form(self) -> bool:
        """Whether the spring is one of `linear_stiffness` and `cubic_stiffness` alone."""
        return self.linear_stiffness is not None and self.restoring_force_range is None

    @property
    def coefficients(self) -> tuple[float | None, ...]:
        """The coefficients (F0, k1, k2, …), from either form; empty for a force table."""
        if self.force_table is not None:
            return ()
        return self.restoring_force or (0.0, self.linear_stiffness, 0.0, self.cubic_stiffness)


@table
class Stopper(Table):
    """A Hertz-damp stopper at a distance from x = 0, on one side or on both (Eq. 5)."""

    NAME = "stoppers"

    gap: float = positive("gap to the stoppers: from x = 0", "m", "δr", required=True)
    stiffness: float = not_negative(
        "stiffness of the stoppers: K, in N/m^exponent", "N/m^1.5", "K", required=True
    )
    restitution: float = key(
        "restitution of the stoppers: coefficient e", "1", "e", low=0.0, high=1.0, required=True
    )
    impact_velocity: str = word(
        "impact velocity: computed from the energy, or held from the moment of impact",
        ("energy", "event"),
        default="energy",
    )
    side: str = word("side", tuple(SIDES), default="both", rare=True)
    exponent: float = key(
        "exponent of the contact's spring", "1", low=1.0, high=5.0, default=1.5, rare=True
    )
    law: str = word("law of the contact", LAWS, default="hertz-damp", rare=True)


@table
class Start(Table):
    """The state in which every realization starts; by default, rest in successive wells."""

    displacement: float | None = key("displacement: by default at rest in a well", "m", "l")
    velocity: float = key("velocity", "m/s", "l/s", default=0.0)
    voltage: float = key("voltage: of a piezo", "V", "θ l/Cp", default=0.0)


@table
class Load(Table):
    """The load of the transducer: the built-in resistor, or a netlist.

    `circuit`: the netlist that was read (circuits.netlist.load_circuit.LoadCircuit).
    """

    kind: str | None = word("kind: of the built-in load", ("resistor",))
    resistance: float | None = positive("load resistance", "Ω", units=(SI,), usual=(0.1, 1e12))
    decay_rate: float | None = positive(
        "decay rate of the load", "1/s", "λ = 1/(R Cp)", units=(SCALED,)
    )
    netlist: str | None = key("netlist: a name in netlists/ or a file", kind=str)
    subcircuit: str | None = key("sub-circuit of the netlist", kind=str)
    parameters: NamedValues | None = key("parameters of the netlist", kind=NAMED_VALUES)
    circuit: Any = field(default=None, repr=False)

    ALTERNATIVES: ClassVar = (
        OneOf(
            ("resistance", "decay_rate", "netlist"),
            {
                "kind": ("resistance", "decay_rate"),
                "subcircuit": ("netlist",),
                "parameters": ("netlist",),
            },
            hint=" (a netlist's values: load.parameters; values of a load study's --load: --sweep "
            "load.parameters.NAME=VALUE)",
        ),
    )

    def __post_init__(self) -> None:
        if self.netlist is None:
            object.__setattr__(self, "kind", "resistor")

    @property
    def is_resistor(self) -> bool:
        """Whether the load is the built-in resistor, or a netlist that contains only one."""
        return self.circuit is None or self.circuit.resistance is not None


def all_tables() -> dict[str, Any]:
    """The class of every table, in writing order; for the excitation, the classes of its kinds."""
    return {
        "beam": Beam, "magnets": Magnets, "oscillator": Oscillator, "stoppers": Stopper,
        **TRANSDUCERS, "load": Load, "start": Start, "excitation": KINDS, "run": Run,
    }  # fmt: skip


def all_keys() -> list[str]:
    """`table.key` of all keys that a scene may contain."""
    tables = all_tables().items()
    return [f"{name}.{key}" for name, classes in tables for key in every_key(classes)]


def rows_of(tables: dict[str, Any]) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Name, class and values of every table; repeated tables are named `name[k]`."""
    for name, classes in all_tables().items():
        content = tables.get(name, ())
        if isinstance(content, dict):
            yield name, class_of(classes, content), content
        else:
            yield from ((f"{name}[{k}]", classes, values) for k, values in enumerate(content))


def key_named(dotted: str) -> Key:
    """The declaration of `table.key` or `table[k].key`; an empty declaration if there is none."""
    name, _, last = dotted.partition(".")
    tables = all_tables().get(name.partition("[")[0])
    last = last if tables is not KINDS else last.rpartition(".")[2]
    return every_key(tables).get(last.partition("[")[0], Key()) if tables else Key()


def key_words(dotted: str, units: str) -> tuple[str, str]:
    """Description of a scene's key, and its unit; the unit is empty if unknown or scaled."""
    spec = key_named(dotted)
    table_name, _, name = dotted.rpartition(".")
    if dotted == "load.parameters.resistance":
        return key_words("load.resistance", units)
    words = spec.name or name.replace("_", " ")
    return words + (f" ({table_name})" if "[" in table_name else ""), spec.unit_in(units)


def value_words(dotted: str, value: float | str, units: str) -> str:
    """A value of a key with its unit, such as "27.3 kΩ", or "10u" without; texts are unchanged."""
    if isinstance(value, str):
        return value
    unit = key_words(dotted, units)[1]
    if dotted.startswith("load.parameters.") and not unit:
        return engineering(value)
    return quantity(value, unit, 6)


def key_label(dotted: str, units: str) -> str:
    """Label of a key on a figure's axis, such as "load resistance [Ω]"."""
    words, unit = key_words(dotted, units)
    return f"{words} [{unit}]" if unit and unit != "1" else words


def key_column(dotted: str, units: str) -> str:
    """Name of a key's column in a table of numbers, such as "load.resistance [Ω]"."""
    unit = key_words(dotted, units)[1]
    return f"{dotted} [{unit}]" if unit else dotted

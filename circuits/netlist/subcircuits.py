"""Reads and checks loads: sub-circuits of the library or of a user's netlist."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from circuits.netlist import vetting
from circuits.netlist.dialects import ambiguity
from circuits.netlist.expansion import Expansion
from circuits.netlist.flattening import calls, elements, outermost
from circuits.netlist.kinds import OUTPUT
from circuits.netlist.load_checks import check_load, check_needs
from circuits.netlist.load_circuit import OUTPUT_PINS, PIEZO_PINS, LoadCircuit
from circuits.netlist.measurement import evaluated
from circuits.netlist.measures import vet_measures
from circuits.netlist.numbers import number
from circuits.netlist.reader import Card, read_cards
from circuits.netlist.tree import parse, written
from circuits.netlist.vetting import (
    check_expression,
    check_nodes,
    check_value,
    listed,
    refuse,
    rewritten,
    vet_element,
)
from harvester.base.errors import NetlistError
from harvester.base.plain_text import nearest
from harvester.device.terminals import GROUND

EXPECTED = "p n, or p n out ref (p n: the piezo's terminals; out ref: the DC side), in any order"
# Matches ambiguous suffixes: M and F.
_MISREAD = re.compile(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)(M(?![eE][gG]|[iI][lL])|F)", re.ASCII)
_READINGS = {"M": ("a million", "a thousandth"), "F": ("a farad", "a femtofarad")}


def load_names() -> list[str]:
    """Sorted names of the loads in netlists/: files with a sub-circuit of the same name."""
    names = []
    for file in resources.files("netlists").iterdir():
        name, ending = file.name.partition(".")[::2]
        if ending == "lib" and f".subckt {name} " in file.read_text(encoding="utf-8"):
            names.append(name)
    return sorted(names)


def find_netlist(netlist: str, folders: Sequence[str | Path] = (".",)) -> Path:
    """The file of a load.

    Parameters
    ----------
    netlist : str
        A name in netlists/, or a path (contains a dot or a slash).
    folders : sequence of str or Path
        Folders searched for a relative path, in order.

    Raises
    ------
    NetlistError
    """
    if re.fullmatch(r"\w+", netlist):
        names = load_names()
        if netlist not in names:
            raise NetlistError(
                f"load.netlist = {netlist[:60]!r}: no such load{nearest(netlist, names)}; there "
                f"are {', '.join(names)}; name your own file with its extension"
            )
        return Path(str(resources.files("netlists").joinpath(f"{netlist}.lib")))
    for folder in folders:
        path = Path(folder) / netlist
        # A name that the system rejects is not a file.
        if os.path.isfile(path):
            return path
        if os.path.isdir(path):
            raise NetlistError(f"load.netlist = {netlist[:200]!r}: is a folder: name a file in it")
    looked = " and ".join(str(Path(folder).absolute()) for folder in folders)
    raise NetlistError(f"load.netlist = {netlist[:200]!r}: no such file in {looked}")


def read_load(
    path: Path,
    subcircuit: str | None = None,
    parameters: dict[str, Any] | None = None,
    cards: Sequence[Card] | None = None,
) -> LoadCircuit:
    """Read, vet and prepare a load.

    Parameters
    ----------
    path : Path
        Path from `find_netlist`.
    subcircuit : str or None
        Name in the file; None: the sub-circuit named like the file, or the only one that fits.
    parameters : dict of str to (float or str), optional
        Values of the sub-circuit's parameters and the file's `.param`; "100k" means 1e5.
    cards : sequence of Card, optional
        Cards of the file from an earlier call: the file is not read again.

    Raises
    ------
    NetlistError
        One line with file, line and fault.
    """
    path = Path(path)
    cards = [vetting.tidy(card) for card in read_cards(path)] if cards is None else [*cards]
    root = parse(cards, path.name)
    top = _chosen(root, path, subcircuit)
    values = _override(root, top, parameters or {}, path)
    _check_pins(top)
    _vet(root)
    Expansion(root).content(top)
    scope = outermost(root, top.name, values)
    check_needs(scope)
    for call in calls(scope):
        if call.circuit is not top and call.circuit.measures:
            refuse(call.circuit.measures[0], "measure: put it into the load's sub-circuit")
    parts = tuple(elements(scope))
    measures = vet_measures([*root.measures, *top.measures], top.scope())
    output = _across_output(top, parts, measures)
    defaults = {**root.local, **top.parameters, **top.local}
    sizes = ((name, number(defaults[name])) for name in top.parameters)
    letters = {"b" if part.expression is not None else part.letter for part in parts}
    load = LoadCircuit(
        text="\n".join(written(root)) + "\n",
        name=top.name,
        pins=top.pins,
        parameters=tuple(values.items()),
        defaults=tuple((name, size) for name, size in sizes if size is not None),
        across_output=tuple(output),
        linear=letters <= {"r", "c"},
        switches=not letters <= {"r", "c", "d"},
        resistance=_single_resistance(top, parts),
        measures=evaluated(measures, scope, parts),
        file=top.card.where.rpartition(":")[0],
        elements=parts,
        ambiguity="" if root.dialect else ambiguity(cards),
        source=(path, tuple(cards)),
    )
    check_load(load.elements, load.pins)
    return load


def _chosen(root, path, name):
    if not root.inner:
        raise NetlistError(f"{path.name}: contains no .subckt: put the load into one")
    if name is None:
        fitting = [name for name, circuit in root.inner.items() if _fits(circuit)]
        names = fitting or [*root.inner]
        name = path.stem.lower() if path.stem.lower() in root.inner else names[0]
        if name != path.stem.lower() and len(names) > 1:
            raise NetlistError(
                f"{path.name}: contains {listed(root.inner)}: choose one by load.subcircuit"
            )
    if name.lower() not in root.inner:
        raise NetlistError(
            f"{path.name}: no .subckt {name[:60]}{nearest(name.lower(), root.inner)}; there are "
            f"{listed(root.inner)}"
        )
    return root.inner[name.lower()]


def _fits(circuit):
    return {*circuit.pins} in ({*PIEZO_PINS}, {*PIEZO_PINS, *OUTPUT_PINS})


def _check_pins(top):
    if not top.elements:
        refuse(top.card, f".subckt {top.name[:40]} contains no element")
    if not _fits(top):
        refuse(
            top.card,
            f".subckt {top.name[:40]} has the pins {listed(top.pins)}; expected {EXPECTED}",
        )


class UnknownParameter(NetlistError):
    """A load has no parameter of this name; `args[1]` are the existing names."""

    def __str__(self) -> str:
        return self.args[0]


def _override(root, top, user_values, path):
    """Insert the user's values, and return the sub-circuit's parameters."""
    values = {}
    existing = {**root.local, **top.local, **top.parameters}
    for key, value in user_values.items():
        name = key.lower()
        where = f"load.parameters.{key[:60]} = {value!r:.60}"
        if name not in existing:
            hint = f"; there are {listed(existing)}" if existing else "; it has none"
            raise UnknownParameter(
                f"{where}: {path.name} has no such parameter{nearest(name, existing)}{hint}",
                tuple(existing),
            )
        if isinstance(value, str) and (read := _MISREAD.match(value)):
            mega, small = _READINGS[read.group(2)]
            raise NetlistError(
                f"{where}: {value[:30]} means {small} in SPICE and {mega} in SI: write "
                f"{read.group(1)}{'meg' if read.group(2) == 'M' else ''} or "
                f"{read.group(1)}{read.group(2).lower()}"
            )
        size = number(value) if isinstance(value, str) else float(value)
        if size is None or not abs(size) < float("inf"):
            raise NetlistError(f'{where}: must be a finite number, or one like "100k"')
        if name in top.parameters:
            values[name] = size
        else:
            (top.local if name in top.local else root.local)[name] = repr(size)
    return values


def _vet(circuit):
    """Check every card of a sub-circuit and of nested ones, and replace it by its `Line`."""
    scope = circuit.scope()
    for values in (circuit.parameters, circuit.local):
        for name, value in values.items():
            if number(value) is None and not value.startswith("{"):
                value = "{" + value + "}"
            values[name] = check_value(circuit.place(name), value, scope, name)
    for name, (card, kind, pairs) in circuit.models.items():
        checked = [(k, v and check_value(card, v, scope, k)) for k, v in pairs]
        circuit.models[name] = (card, kind, checked)
    for k, card in enumerate(circuit.needs):
        text = check_expression(card, card.text, scope)
        if text != rewritten(card.text):
            circuit.needs[k] = card._replace(text=text)
    for name, (card, arguments, expression) in circuit.functions.items():
        inside = scope._replace(parameters=scope.parameters.new_child(dict.fromkeys(arguments)))
        circuit.functions[name] = (card, arguments, check_expression(card, expression, inside))
    circuit.elements = [_vetted(card, circuit, scope) for card in circuit.elements]
    names = set()
    for line in circuit.elements:
        if line.name in names:
            refuse(line.card, f"{line.name[:40]} is defined twice")
        names.add(line.name)
    coils = {name for name in names if name[0] == "l"}
    for line in circuit.elements:
        for name in line.controls if line.name[0] == "k" else ():
            if name not in coils:
                hint = nearest(name, coils)
                refuse(line.card, f"{line.name}: no inductor {name} in its sub-circuit{hint}")
    for inner in circuit.inner.values():
        _vet(inner)


def _vetted(card, circuit, scope):
    """Check one element; a call is checked against the called sub-circuit."""
    if not card.text.startswith("x"):
        return vet_element(card, scope)
    words = re.sub(r"\bparams:\s*", "", card.text).split()
    bare = [word for word in words if "=" not in word]
    target = circuit.find(bare[-1])
    if target is None:
        missing = f"{bare[-1][:40]}{nearest(bare[-1], circuit.known())}"
        refuse(card, f"no .subckt {missing}: copy it into the file, or .include its file")
    nodes = bare[1:-1]
    check_nodes(card, [bare[0], *nodes])
    if len(nodes) != len(target.pins):
        refuse(card, f"{bare[0][:40]}: {target.name[:40]} has the pins {listed(target.pins)}")
    pairs = vetting.vet_parameters(card, " ".join(word for word in words if "=" in word))
    for name in pairs:
        if name == "m" and name not in target.parameters:
            refuse(card, "m= on a call: ngspice 39 and 46 differ: write the call m times")
        if name not in target.parameters:
            hint = nearest(name, target.parameters)
            refuse(card, f"{target.name[:40]} has no parameter {name[:40]}{hint}")
    values = {name: check_value(card, value, scope, name) for name, value in pairs.items()}
    given = [bare[-1], *(f"{name}={value}" for name, value in values.items())]
    return vetting.Line(card, bare[0], nodes, given, named=values, calls=bare[-1])


def _single_resistance(top, parts):
    """The resistance of a load that is one resistor between its pins, else None."""
    if {*top.pins} != {*PIEZO_PINS} or len(parts) != 1 or parts[0].letter != "r":
        return None
    ends = {*parts[0].nodes} in ({"p", "n"}, {"p", GROUND})
    return parts[0].size if ends and (parts[0].size or 0.0) > 0.0 else None


def _across_output(top, parts, measures):
    """The resistors and capacitors across the output."""
    if OUTPUT_PINS[0] not in top.pins:
        if measures:
            refuse(top.card, f"measures need a load with the pins {' '.join(OUTPUT_PINS)}")
        return []
    joining = (part for part in parts if {*part.nodes[:2]} == {*OUTPUT_PINS})
    across = [part for part in joining if part.written_letter in "rc"]
    for part in across:
        if part.value is None:
            raise NetlistError(
                f"{part.where}: {part.name} is across out and ref: give it a constant value"
            )
        if part.letter == "r" and (part.size or 0.0) < 0.0:
            raise NetlistError(
                f"{part.where}: {part.name} is across out and ref: its resistance, "
                f"{part.size:g} Ω, must be above 0"
            )
    if not across and all(measure.kind != OUTPUT for measure in measures):
        refuse(
            top.card,
            "no resistor or capacitor is across out and ref, and no measure is an output: "
            "nothing to harvest"
            + "; node 0 is the pin n: write ref"
            * any(GROUND in part.ends for part in parts),
        )
    return across

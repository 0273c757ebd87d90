"""Loads as sub-circuits: a library's or a user's netlist, vetted."""

import re
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from circuits import elements, vetting
from circuits.netlist_reader import Card, read_cards
from circuits.places import places
from circuits.vetting import Scope, check_nodes, check_value, nearest, refuse, vet_element
from harvester.errors import NetlistError

# What a load's sub-circuit is connected by: the piezo's terminals, and its DC side if it has one.
PIEZO_PINS, OUTPUT_PINS = ("p", "n"), ("out", "ref")
EXPECTED = "p n, or p n out ref (p n: the piezo's terminals; out ref: the DC side), in any order"
# Elements of a load with all that its sub-circuits hold.
MOST_ELEMENTS = 2000


@dataclass(frozen=True)
class LoadCircuit:
    """A load ready to hang on the piezo.

    Attributes
    ----------
    text : str
        Cards for ngspice, includes in, ending with a newline.
    name : str
        Of its sub-circuit.
    pins : tuple of str
        As declared, from `PIEZO_PINS` and `OUTPUT_PINS`.
    parameters : tuple of (str, float)
        Values other than the netlist's own, given where it is called.
    defaults : tuple of (str, float)
        The netlist's own values of its sub-circuit's parameters, where they are plain numbers.
    output_resistors, storage : tuple of str
        Resistors and capacitors across the output, by ngspice's names.
    linear, switches : bool
        Resistors and capacitors only; anything beside them and diodes.
    resistance : float or None
        Of a load that is one resistor between p and n, in Ω.
    places : tuple of circuits.places.Place
        Where its elements stand in its files.
    """

    text: str
    name: str
    pins: tuple
    parameters: tuple
    defaults: tuple
    output_resistors: tuple
    storage: tuple
    linear: bool
    switches: bool
    resistance: float | None
    places: tuple = field(default=(), compare=False, repr=False)

    @property
    def has_output(self):
        """Whether it has a DC side."""
        return OUTPUT_PINS[0] in self.pins


@dataclass
class _Subcircuit:
    """A .subckt under way, or the file around them (no name)."""

    card: Card | None
    name: str = ""
    pins: tuple = ()
    parameters: dict = field(default_factory=dict)
    local: dict = field(default_factory=dict)
    functions: dict = field(default_factory=dict)
    models: dict = field(default_factory=dict)
    elements: list = field(default_factory=list)
    inner: dict = field(default_factory=dict)
    outer: "_Subcircuit | None" = None

    def scope(self):
        """Names from here outwards."""
        outer = self.outer.scope() if self.outer else Scope(*[frozenset()] * 3)
        return Scope(
            outer.parameters | {*self.parameters, *self.local},
            outer.functions | {*self.functions},
            outer.models | {*self.models},
        )

    def find(self, name):
        """A sub-circuit by name, from here outwards, or None."""
        if name in self.inner:
            return self.inner[name]
        return self.outer.find(name) if self.outer else None

    def known(self):
        """Names of all sub-circuits that can be called from here."""
        return {*self.inner, *(self.outer.known() if self.outer else ())}


def load_names():
    """Names of the loads in netlists/, sorted; a file without one of its name is for others."""
    names = []
    for file in resources.files("netlists").iterdir():
        name, ending = file.name.partition(".")[::2]
        if ending == "lib" and f".subckt {name} " in file.read_text(encoding="utf-8"):
            names.append(name)
    return sorted(names)


def find_netlist(netlist, folders=(".",)):
    """The file of a load.

    Parameters
    ----------
    netlist : str
        A name in netlists/, or a path (with a dot or a slash in it).
    folders : sequence of str or Path
        Where a relative path is looked for, in order.

    Raises
    ------
    NetlistError
    """
    if re.fullmatch(r"\w+", netlist):
        names = load_names()
        if netlist not in names:
            raise NetlistError(
                f"load.netlist = {netlist!r}: no such load{nearest(netlist, names)}; there are "
                f"{', '.join(names)}; a file of your own is named with its ending"
            )
        return Path(str(resources.files("netlists").joinpath(f"{netlist}.lib")))
    for folder in folders:
        path = Path(folder) / netlist
        if path.is_file():
            return path
    looked = " and ".join(str(Path(folder).absolute()) for folder in folders)
    raise NetlistError(f"load.netlist = {netlist!r}: no such file in {looked}")


def read_load(path, subcircuit=None, parameters=None):
    """Read, vet and prepare a load.

    Parameters
    ----------
    path : Path
        From `find_netlist`.
    subcircuit : str or None
        Which of the file's; None: the one called as the file, or the only one.
    parameters : dict of str to (float or str), optional
        Values for the sub-circuit's parameters and for the file's `.param`; "100k" means 1e5.

    Returns
    -------
    LoadCircuit

    Raises
    ------
    NetlistError
        One line with file, line and fault.
    """
    path = Path(path)
    cards = [vetting.tidy(card) for card in read_cards(path)]
    root = _parse(cards)
    top = _chosen(root, path, subcircuit)
    values = _override(root, top, parameters or {}, path)
    defaults = {name: vetting.number(value) for name, value in top.parameters.items()}
    _check_pins(top)
    _vet(root)
    count, letters = _size(top, ())
    if count > MOST_ELEMENTS:
        refuse(top.card, f"{count} elements: a load has at most {MOST_ELEMENTS}")
    resistance = _single_resistance(root, top, values, letters)
    output_resistors, storage = _across_output(top)
    return LoadCircuit(
        text="\n".join(_written(root)) + "\n",
        name=top.name,
        pins=top.pins,
        parameters=tuple(values.items()),
        defaults=tuple((name, size) for name, size in defaults.items() if size is not None),
        output_resistors=output_resistors,
        storage=storage,
        linear=letters <= {"r", "c"},
        switches=not letters <= {"r", "c", "d"},
        resistance=resistance,
        places=places(cards),
    )


def _parse(cards):
    """Cards as nested sub-circuits, elements not yet judged."""
    root = here = _Subcircuit(None)
    for card in cards:
        first, _, rest = card.text.partition(" ")
        if first == ".subckt":
            here = _opened(here, card, rest)
        elif first == ".ends":
            if here is root:
                refuse(card, ".ends without its .subckt")
            if rest and rest != here.name:
                refuse(card, f".ends {rest} closes .subckt {here.name}")
            here = here.outer
        elif first in (".param", ".params"):
            here.local.update(vetting.vet_parameters(card, rest))
        elif first == ".func":
            name, arguments, expression = vetting.vet_function(card)
            here.functions[name] = (card, arguments, expression)
        elif first == ".model":
            name, kind, pairs = vetting.vet_model(card)
            here.models[name] = (card, kind, pairs)
        elif first.startswith("."):
            refuse(
                card,
                f"{first} is not accepted: a load holds elements, .model, .param, .func, .subckt "
                "and .include, and is no program",
            )
        elif here is root:
            refuse(card, f"{first}: an element outside a .subckt; put it into one")
        else:
            here.elements.append(card)
    if here is not root:
        refuse(here.card, f".subckt {here.name} without its .ends")
    return root


def _opened(outer, card, rest):
    words = re.sub(r"\bparams:\s*", "", rest).split()
    names = [word for word in words if "=" not in word]
    if not names or not re.fullmatch(r"[a-z_][\w.\-]*", names[0]) or len(names) < 2:
        refuse(card, "write it as .subckt name pins parameter=value")
    if names[0] in outer.inner:
        refuse(card, f".subckt {names[0]} is there twice")
    check_nodes(card, names[1:])
    if len({*names[1:]}) < len(names[1:]) or {"0", "gnd"} & {*names[1:]}:
        refuse(card, f"the pins {' '.join(names[1:])} must differ, and none is 0")
    parameters = vetting.vet_parameters(card, " ".join(word for word in words if "=" in word))
    inner = _Subcircuit(card, names[0], tuple(names[1:]), parameters, outer=outer)
    outer.inner[names[0]] = inner
    return inner


def _chosen(root, path, name):
    if not root.inner:
        raise NetlistError(f"{path.name}: holds no .subckt")
    if name is None:
        name = path.stem.lower() if path.stem.lower() in root.inner else None
        if name is None and len(root.inner) > 1:
            raise NetlistError(
                f"{path.name}: holds {', '.join(root.inner)}: say which by load.subcircuit"
            )
        name = name or next(iter(root.inner))
    if name.lower() not in root.inner:
        raise NetlistError(
            f"{path.name}: no .subckt {name}{nearest(name.lower(), root.inner)}; there are "
            f"{', '.join(root.inner)}"
        )
    return root.inner[name.lower()]


def _check_pins(top):
    pins = {*top.pins}
    if pins not in ({*PIEZO_PINS}, {*PIEZO_PINS, *OUTPUT_PINS}):
        refuse(
            top.card, f".subckt {top.name} has the pins {' '.join(top.pins)}; expected {EXPECTED}"
        )


def _override(root, top, given, path):
    """Put the user's values in; those of the sub-circuit's own parameters are returned."""
    values = {}
    known = {**root.local, **top.local, **top.parameters}
    for key, value in given.items():
        name = key.lower()
        where = f"load.parameters.{key} = {value!r}"
        if name not in known:
            there = f"; there are {', '.join(known)}" if known else "; it has none"
            raise NetlistError(
                f"{where}: {path.name} has no such parameter{nearest(name, known)}{there}"
            )
        size = vetting.number(value) if isinstance(value, str) else float(value)
        if size is None or not abs(size) < float("inf"):
            raise NetlistError(f'{where}: must be a finite number, or one like "100k"')
        if name in top.parameters:
            values[name] = size
        else:
            place = top.local if name in top.local else root.local
            place[name] = elements.number(size)
    return values


def _vet(circuit):
    """Judge every card of a sub-circuit and of those within it, in place."""
    scope = circuit.scope()
    place = circuit.card or Card("", "the load")
    for values in (circuit.parameters, circuit.local):
        for name, value in values.items():
            if vetting.number(value) is None and not value.startswith("{"):
                value = "{" + value + "}"
            values[name] = check_value(place, value, scope, name)
    for name, (card, kind, pairs) in circuit.models.items():
        checked = [(k, v and check_value(card, v, scope, k)) for k, v in pairs]
        circuit.models[name] = (card, kind, checked)
    for card, arguments, expression in circuit.functions.values():
        own = scope._replace(parameters=scope.parameters | {*arguments})
        check_value(card, "{" + expression + "}", own)
    circuit.elements = [_vetted(card, circuit, scope) for card in circuit.elements]
    for inner in circuit.inner.values():
        _vet(inner)


def _vetted(card, circuit, scope):
    """(card, words) of one element; a call is checked against what it calls."""
    if not card.text.startswith("x"):
        return card, vet_element(card, scope)
    words = re.sub(r"\bparams:\s*", "", card.text).split()
    bare = [word for word in words if "=" not in word]
    target = circuit.find(bare[-1])
    if target is None:
        refuse(card, f"no .subckt {bare[-1]}{nearest(bare[-1], circuit.known())}")
    nodes = bare[1:-1]
    check_nodes(card, [bare[0], *nodes])
    if len(nodes) != len(target.pins):
        refuse(card, f"{bare[0]}: {target.name} has the pins {' '.join(target.pins)}")
    pairs = vetting.vet_parameters(card, " ".join(word for word in words if "=" in word))
    for name in pairs:
        if name not in target.parameters:
            refuse(
                card,
                f"{target.name} has no parameter {name}{nearest(name, target.parameters)}",
            )
    given = [f"{name}={check_value(card, value, scope, name)}" for name, value in pairs.items()]
    return card, [*bare, *given]


def _size(circuit, calling):
    """Elements of a sub-circuit with all it calls, and the letters among them."""
    if circuit.name in calling:
        refuse(circuit.card, f".subckt {circuit.name} holds itself")
    count, letters = 0, set()
    sizes = {}
    for card, words in circuit.elements:
        letter = words[0][0]
        if letter != "x":
            count += 1
            letters.add("b" if letter in "rc" and _varies(words) else letter)
            continue
        target = circuit.find(next(w for w in reversed(words) if "=" not in w))
        if target.name not in sizes:
            sizes[target.name] = _size(target, (*calling, circuit.name))
        count += sizes[target.name][0]
        letters |= sizes[target.name][1]
        if count > MOST_ELEMENTS:
            refuse(card, f"more than {MOST_ELEMENTS} elements")
    return count, letters


def _single_resistance(root, top, values, letters):
    """The resistance of a load that is one resistor between its pins, else None."""
    if {*top.pins} != {*PIEZO_PINS} or letters != {"r"} or len(top.elements) != 1:
        return None
    words = top.elements[0][1]
    if {*words[1:3]} != {*PIEZO_PINS} or len(words) != 4:
        return None
    name = words[3].strip("{}")
    known = {**root.local, **top.local, **top.parameters, **values}
    value = known.get(name, name)
    return vetting.number(value) if isinstance(value, str) else value


def _across_output(top):
    """ngspice's names of the resistors and of the capacitors across the output."""
    found = {"r": [], "c": []}
    for card, words in top.elements:
        letter = words[0][0]
        if letter in found and {*words[1:3]} == {*OUTPUT_PINS}:
            if _varies(words):
                refuse(card, f"{words[0]} lies across out and ref: give it a constant value")
            found[letter].append(f"{letter}.xload.{words[0]}")
    if OUTPUT_PINS[0] in top.pins and not any(found.values()):
        refuse(top.card, "no resistor or capacitor lies across out and ref: nothing to harvest")
    return tuple(found["r"]), tuple(found["c"])


def _varies(words):
    """Whether a value depends on the solution."""
    return any("v(" in word or "i(" in word for word in words)


def _written(circuit):
    """The lines of a sub-circuit, or of all of a file."""
    lines = []
    if circuit.name:
        given = [f"{name}={value}" for name, value in circuit.parameters.items()]
        lines.append(" ".join([".subckt", circuit.name, *circuit.pins, *given]))
    lines += [f".param {name}={value}" for name, value in circuit.local.items()]
    for name, (_, arguments, expression) in circuit.functions.items():
        lines.append(f".func {name}({','.join(arguments)}) {{{expression}}}")
    for name, (_, kind, pairs) in circuit.models.items():
        inside = " ".join(f"{key}={value}" if value else key for key, value in pairs)
        lines.append(f".model {name} {kind}({inside})")
    for inner in circuit.inner.values():
        lines += _written(inner)
    lines += [" ".join(words) for _, words in circuit.elements]
    return [*lines, f".ends {circuit.name}"] if circuit.name else lines

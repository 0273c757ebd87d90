"""A load as ngspice runs it: one flat sub-circuit with every number written out.

It contains no parameters, functions, defaults or suffixes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from circuits.netlist.elements import Element
from circuits.netlist.expression import ELSEWHERE_ALONE, FUNCTIONS, Tree
from circuits.netlist.expression import written as expression_written
from circuits.netlist.functions import CONSTANTS, SOLUTION, VARYING
from circuits.netlist.numbers import number
from circuits.netlist.potentials import starts

# Matches characters of a name that could be read as an operator, and underscores that could be read
# as the beginning of such a character's code: names stay distinct.
_ODD = re.compile(r"[^\w.#]|_(?=[0-9a-f]{2}(?:_|[^\w.#]))", re.ASCII)


def node_name(name: str) -> str:
    """Name of a load's node in the run's netlist."""
    if name in VARYING:
        # ngspice reads these names as quantities even within v().
        return f"_{ord(name[0]):x}_{name[1:]}"
    return _ODD.sub(lambda odd: f"_{ord(odd.group()):x}_", name)


def element_name(letter: str, name: str) -> str:
    """Name of a load's element in the run's netlist, which begins with the kind's letter."""
    own_name = name if name.startswith(letter) and "." not in name else f"{letter}.{name}"
    return _ODD.sub(lambda odd: f"_{ord(odd.group()):x}_", own_name)


def current_name(name: str) -> str:
    """Name in the run's netlist of a source; its letter follows the last dot of its full name."""
    return element_name(name.rpartition(".")[2][0], name)


def run_text(name: str, pins: Iterable[str], elements: Iterable[Element]) -> str:
    """Text of the sub-circuit for ngspice, ending with a newline."""
    elements = tuple(elements)
    names = _model_names(elements)
    models = [_model(name, model) for model, name in names.items()]
    lines = [_line(element, names) for element in elements]
    lines += [f".ic v({node_name(k)})={_number(v)}" for k, v in starts(elements).items()]
    return "\n".join([f".subckt {name} {' '.join(pins)}", *models, *lines, f".ends {name}"]) + "\n"


def reads_alike(text: str, elements: tuple[Element, ...]) -> bool:
    """Whether ngspice would read these elements from a file's text.

    It would not if a parameter has the name of a function or constant of ngspice, if a word is from
    another SPICE, or if an initial value must be given.
    """
    named = {*re.findall(r"(?<![\w.])([a-z_]\w*)=", text)}
    operands = {*re.findall(r"(?<![\w.])([a-z_]\w*)(?=[-+*/^<>?:,!&|})])", text)}
    called = {*re.findall(r"(?<![\w.])([a-z_]\w*)\(", text)}
    definitions = re.findall(r"(?m)^\.param (\w+)=(\S+)", text)
    # A parameter that equals ngspice's constant of the same name is harmless.
    parameters = {
        name
        for name, definition in definitions
        if (value := number(definition)) is None
        or not math.isclose(value, CONSTANTS.get(name, 0.0), rel_tol=1e-6)
    }
    parameters |= {*re.findall(r" (\w+)=", " ".join(re.findall(r"(?m)^\.subckt .*", text)))}
    return not (
        any(element.is_smooth_switch for element in elements)
        or starts(elements)
        or called & ELSEWHERE_ALONE
        or parameters & ((FUNCTIONS - SOLUTION) | {"pi", "e"})
        or (operands & {*CONSTANTS} - {"temper"}) - named
    )


def _model_names(elements):
    """Map (kind, numbers, flags) of each distinct model to its name."""
    names: dict[tuple, str] = {}
    for model in (element.model for element in elements if element.model is not None):
        if model[1:] not in names:
            name = node_name(model.name)
            while name in names.values():
                name += "_"
            names[model[1:]] = name
    return names


def _model(name, model):
    kind, numbers, flags = model
    inside = " ".join([*(f"{key}={_number(value)}" for key, value in numbers), *flags])
    return f".model {name} {kind}({inside})"


def _number(value):
    """A number with all digits; integers without a decimal point, as for levels."""
    is_whole = float(value).is_integer() and abs(value) < 1e6
    return str(int(value)) if is_whole else repr(float(value))


def _line(element, names):
    words = [element_name(element.letter, element.name), *map(node_name, element.nodes)]
    words += [current_name(name) for name in element.controls]
    numbers = [f"{key}={_number(value)}" for key, value in element.numbers]
    if element.expression is not None:
        return " ".join([*words, *_by_expression(element)])
    if element.wave is not None:
        inside = " ".join(map(_number, element.wave.numbers))
        return " ".join([*words, f"{element.wave.kind}({inside})"])
    if element.model is not None:
        words.append(names[element.model[1:]])
    elif element.letter in "vi":
        words.append(f"dc {_number(element.value)}")
    elif element.letter in "rcl":
        words.append(f"{element.letter}={_number(element.value)}")
    elif element.letter == "k":
        words.append(_number(element.value))
    else:
        # ngspice multiplies the gain of a controlled source by `m`.
        return " ".join([*words, _number(element.value * element.many)])
    return " ".join([*words, *numbers, *element.flags])


def _by_expression(element):
    text = said(element.expression)
    if element.letter in "cl":
        numbers = [f"{key}={_number(value)}" for key, value in element.numbers]
        return [f"{element.letter}='{text}'", *numbers]
    if element.many != 1.0:
        text = f"({text})*{_number(element.many)}"
    if element.letter == "b":
        return [f"{'v' if element.voltage else 'i'}={text}"]
    return [f"{'vol' if element.voltage else 'cur'}='{text}'"]


def said(tree: Tree) -> str:
    """An expression of a load, with the run's names of nodes and sources."""
    return expression_written(tree, node_name, current_name)

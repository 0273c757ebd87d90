"""What a load's netlist may hold: a list of what is allowed, and a one-line refusal of the rest.

A netlist from elsewhere is data. Nothing in it may run a program, touch a file, reach a node of
the device, or stop ngspice's process; what LTspice writes and ngspice would silently ignore or
misread is put right where its meaning is plain, and refused by name where it is not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, NoReturn

from circuits.loads.expressions import NAMES, SOLUTION, VARYING, expression_fault
from circuits.loads.reader import Card
from harvester.errors import NetlistError
from harvester.files.plain_text import nearest

FACTORS = {
    "t": 1e12, "g": 1e9, "meg": 1e6, "k": 1e3, "mil": 25.4e-6, "m": 1e-3, "u": 1e-6, "n": 1e-9,
    "p": 1e-12, "f": 1e-15,
}  # fmt: skip
MODELS = {
    "d", "npn", "pnp", "njf", "pjf", "nmos", "pmos", "vdmos", "sw", "csw", "r", "c", "l",
}  # fmt: skip
# Data-sheet facts that LTspice keeps beside a model or a part and that do not enter it.
FACTS = {"mfg", "type", "iave", "vpk", "vceo", "icrating", "tol", "pwr", "irms", "ipk", "pn", "v"}
VDMOS_FACTS = {"vds", "ron", "qg"}
# Of LTspice's idealised diode, which ngspice would ignore.
IDEAL_DIODE = {"ron", "roff", "vfwd", "vrev", "rrev", "ilimit", "revilimit", "epsilon"}
PART_PARAMETERS = {
    "m", "ic", "temp", "dtemp", "area", "pj", "w", "ad", "as", "pd", "ps", "nrd", "nrs",
    "tc", "tc1", "tc2", "scale", "noisy", "r", "c", "l",
}  # fmt: skip
# Of LTspice's parts; 0 is none of those in SERIES, and LTspice writes it so.
SERIES = {"rser", "lser"}
PARASITICS = {"rser", "rpar", "cpar", "lser", "rlshunt"}
WAVEFORMS = {"dc", "ac", "pulse", "sin", "exp", "sffm", "am", "pwl"}
FLAGS = {"on", "off", "nchan", "pchan"}
# Element letter → nodes, and what follows them.
ELEMENTS = {
    "r": (2, "value"), "c": (2, "value"), "l": (2, "value"), "k": (0, "coupling"),
    "d": (2, "model"), "q": (3, "model"), "j": (3, "model"), "m": (3, "model"),
    "s": (4, "model"), "w": (2, "model"), "v": (2, "source"), "i": (2, "source"),
    "e": (2, "controlled"), "g": (2, "controlled"), "f": (2, "controlled"),
    "h": (2, "controlled"), "b": (2, "behavioural"),
}  # fmt: skip

_CHARACTERS = re.compile(r"[\w\s.+\-*/^(){}\[\],=<>?:!&|%#~\"]*", re.ASCII)
_NUMBER = re.compile(
    r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)(meg|mil|[tgkmunpf])?([a-z]*)", re.ASCII
)
# A thousandth of an inch is one only outside of expressions, there it is a thousandth.
_MIL = re.compile(r"(?<![\w.])((?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)mil(?![\w.])")
# Of a name or a number.
LONGEST_WORD = 250
_LONG_WORD = re.compile(rf"[\w.]{{{LONGEST_WORD + 1}}}")
# Of names in messages.
MOST_SHOWN, LONGEST_SHOWN = 20, 60
LONGEST_FAULT = 300
# LTspice's 4k7, and a pair name=value whose value may be an expression.
_INFIX = re.compile(r"(?<![\w.])(\d+)(meg|[tgkmunp])(\d+)(?![\w.])")
_PAIR = re.compile(r"([a-z_]\w*)=(\{[^{}]*\}|[^\s{}()=]+)")
_NODE = re.compile(r"[\w.+\-#/\[\]]+")


class Scope(NamedTuple):
    """Names that mean something where a card stands."""

    parameters: Mapping
    functions: Mapping
    models: Mapping


def number(text: str) -> float | None:
    """A SPICE number like "100k" or "4k7" as a float, or None where it is none."""
    match = _NUMBER.fullmatch(_INFIX.sub(r"\1.\3\2", text.strip().lower()))
    if not match:
        return None
    value = float(match.group(1)) * FACTORS.get(match.group(2), 1.0)
    return value if math.isfinite(value) else None


def listed(names: Iterable[str]) -> str:
    """Names in one line, the first of many."""
    names = [name[:LONGEST_SHOWN] for name in names]
    more = f" … ({len(names)} in all)" if len(names) > MOST_SHOWN else ""
    return ", ".join(names[:MOST_SHOWN]) + more


def refuse(card: Card, fault: str) -> NoReturn:
    """Raise NetlistError with the place and the fault, as much of it as one line takes."""
    end = " …" if len(fault) > LONGEST_FAULT else ""
    raise NetlistError(f"{card.where}: {fault[:LONGEST_FAULT]}{end}")


def tidy(card: Card) -> Card:
    """The card with quotes as braces, no blanks within expressions, and only safe characters."""
    if _LONG_WORD.search(card.text):
        refuse(card, f"a name or number of more than {LONGEST_WORD} characters")
    text = re.sub(r"'([^']*)'", r"{\1}", card.text)
    if not _CHARACTERS.fullmatch(text):
        odd = next(c for c in text if not _CHARACTERS.fullmatch(c))
        refuse(card, f"the character {odd!r} has no place in a load")
    if re.search(r"(?<!\w)(file|pwlfile)\s*=|(?<!\w)wavefile", text):
        refuse(card, "file= is not accepted: a load reads no files")
    if '"' in text:
        refuse(card, "a double quote has no place in a load but around an included file's name")
    text = re.sub(r"(?<![=<>!])\s*=\s*(?!=)", "=", text)
    return Card(_joined_braces(card, text), card.where)


def _joined_braces(card, text):
    """Blanks out of braces, so that an expression is one word."""
    parts, depth = [], 0
    for character in text:
        depth += (character == "{") - (character == "}")
        if depth not in (0, 1):
            break
        if not (depth and character == " "):
            parts.append(character)
    if depth:
        refuse(card, f"braces do not match in {text[:50]!r}")
    return "".join(parts)


def vet_model(card: Card) -> tuple[str, str, list[tuple[str, str]]]:
    """A .model card as ngspice reads it: (name, text)."""
    match = re.fullmatch(r"\.model (\S+) (\w+)\s*(.*)", card.text)
    kind = match.group(2) if match else ""
    if not match or kind not in MODELS:
        known = ", ".join(sorted(MODELS))
        refuse(card, f".model takes a name and one of {known}{nearest(kind, MODELS)}")
    rest = match.group(3).strip()
    if rest.startswith("(") and rest.endswith(")"):
        rest = rest[1:-1]
    pairs = []
    for name, value in _pairs(card, rest.replace(",", " "), FLAGS):
        if name in FACTS or (kind == "vdmos" and name in VDMOS_FACTS):
            continue
        if kind == "d" and name in IDEAL_DIODE:
            refuse(
                card,
                f"{name} belongs to LTspice's idealised diode, which ngspice does not have; "
                "give is, n and rs",
            )
        if kind == "sw" and name in ("lser", "vser", "ilimit"):
            refuse(card, f"{name} belongs to LTspice's switch, which ngspice does not have")
        pairs.append((name, value))
    return match.group(1), kind, pairs


def vet_parameters(card: Card, text: str) -> dict[str, Any]:
    """Pairs of a list of parameters, {name: value}; the last of a name counts."""
    pairs = dict(_pairs(card, text, ()))
    for name in VARYING & {*pairs}:
        refuse(card, f"{name} is ngspice's own and no parameter; give it another name")
    return pairs


def vet_function(card: Card) -> tuple[str, list[str], str]:
    """A .func card: (name, arguments, expression)."""
    match = re.fullmatch(r"\.func ([a-z_]\w*)\s*\(([\w\s,]*)\)\s*=?\s*\{?([^{}]*)\}?", card.text)
    if not match:
        refuse(card, "write it as .func name(x, y) {expression}")
    if match.group(1) in SOLUTION:
        refuse(card, f"{match.group(1)} is ngspice's own function; give yours another name")
    arguments = [argument.strip() for argument in match.group(2).split(",") if argument.strip()]
    return match.group(1), arguments, match.group(3)


def _pairs(card, text, flags):
    """(name, value) of "a=1 b={2*a} off"; a flag has no value."""
    pairs = []
    for word in re.sub(r"=([^={}\s]+)\s*\(", r"=\1(", text).split():
        match = _PAIR.fullmatch(word)
        if match:
            pairs.append((match.group(1), _INFIX.sub(r"\1.\3\2", match.group(2))))
        elif word in flags:
            pairs.append((word, ""))
        else:
            refuse(card, f"{word[:40]!r} is not of the form name=value")
    return pairs


def check_value(card: Card, value: str, scope: Scope, what: str = "value") -> str:
    """The value, a bare parameter or expression in braces; refused unless it means a number."""
    if value.startswith("{") and value.endswith("}"):
        expression = rewritten(value[1:-1])
        fault = expression_fault(expression, scope.parameters, scope.functions)
        if fault or not expression:
            refuse(card, f"{fault or 'nothing'} in {{{expression[:50]}}}")
        return "{" + expression + "}"
    size = number(value)
    if size is not None:
        # What ngspice takes for a thousandth in a .param, or in another release for 1e-18.
        unclear = re.search(r"mil|\da", value)
        return repr(size) if unclear else _INFIX.sub(r"\1.\3\2", value)
    if value in scope.parameters:
        return "{" + value + "}"
    if _NUMBER.fullmatch(value):
        refuse(card, f"{what} {value[:LONGEST_SHOWN]} is not finite")
    refuse(card, f"{what} {value[:40]!r} is no number{nearest(value, scope.parameters)}")


def rewritten(expression: str) -> str:
    """LTspice's spelling in ngspice's."""
    text = re.sub(r"(?<![\w.])if\(", "ternary_fcn(", expression.replace(" ", ""))
    return _MIL.sub(r"(\1*25.4e-6)", _INFIX.sub(r"\1.\3\2", text))


def vet_element(card: Card, scope: Scope) -> list[str]:
    """An element's card as ngspice reads it: a list of words, name first."""
    name, *words = re.split(r"\s+", card.text)
    if name[0] not in ELEMENTS:
        known = " ".join(sorted(ELEMENTS)).upper()
        refuse(
            card, f"{name[:40]}: an element of this letter is not accepted; these are: X {known}"
        )
    count, kind = ELEMENTS[name[0]]
    nodes, rest = words[:count], words[count:]
    if not re.fullmatch(r"[\w.+\-#]+", name) or len(nodes) < count or not rest:
        refuse(card, f"{card.text[:50]!r}: too few nodes or no value")
    check_nodes(card, nodes)
    return [name, *nodes, *_KINDS[kind](card, rest, scope)]


def check_nodes(card: Card, nodes: list[str]) -> None:
    """Refuse node names that ngspice could take for something else."""
    for node in nodes:
        if not _NODE.fullmatch(node):
            refuse(card, f"{node[:40]!r} is no name of a node")


def _value(card, rest, scope):
    """Value, model and parameters of R, C and L."""
    words, named = [], False
    for word in rest:
        if "=" in word and not word.startswith("{"):
            words += _part_parameter(card, word, scope)
            named = named or word[0:2] in ("r=", "c=", "l=")
        elif word in scope.models:
            words.append(word)
        else:
            named = True
            words.append(check_value(card, word, scope))
    if not named and not any(word in scope.models for word in words):
        refuse(card, f"{card.text[:50]!r}: no value")
    return words


def _part_parameter(card, word, scope):
    match = _PAIR.fullmatch(word)
    key = match.group(1) if match else ""
    if key in FACTS or (key in SERIES and number(match.group(2)) == 0.0):
        return []
    if key in PARASITICS:
        refuse(card, f"{key}= is LTspice's alone: write it as an element of its own")
    if key not in PART_PARAMETERS:
        refuse(card, f"unknown {word[:40]!r}{nearest(key, PART_PARAMETERS)}")
    return [f"{key}={check_value(card, match.group(2), scope, key)}"]


def _coupling(card, rest, scope):
    if len(rest) < 3:
        refuse(card, "write it as Kname L1 L2 coefficient")
    check_nodes(card, rest[:-1])
    return [*rest[:-1], check_value(card, rest[-1], scope)]


def _model(card, rest, scope):
    """Further nodes, the model's name, its parameters."""
    words, found = [], False
    for word in rest:
        if "=" in word:
            words += _part_parameter(card, word, scope)
        elif word in scope.models and not found:
            found = True
            words.append(word)
        elif found and word not in FLAGS:
            words.append(check_value(card, word, scope))
        else:
            check_nodes(card, [word])
            words.append(word)
    if not found:
        bare = [word for word in rest if "=" not in word]
        unknown = bare[-1] if bare else ""
        refuse(card, f"no .model {unknown[:LONGEST_SHOWN]}{nearest(unknown, scope.models)}")
    return words


def _source(card, rest, scope):
    """A number or one of the plain waveforms with numbers."""
    words = []
    for word in re.sub(r"([(),])", r" \1 ", " ".join(rest)).split():
        if word in WAVEFORMS or word in "(),":
            words.append(word)
        elif "=" in word:
            match = re.fullmatch(r"(dc|ac|r|td)=(\S+)", word)
            if not match:
                refuse(card, f"{word[:40]!r} is not accepted in a source")
            words.append(f"{match.group(1)}={check_value(card, match.group(2), scope)}")
        elif word[0].isalpha() and word not in scope.parameters:
            known = ", ".join(sorted(WAVEFORMS))
            refuse(card, f"{word[:40]!r} is no waveform of a load's source; these are: {known}")
        else:
            words.append(check_value(card, word, scope))
    return words


def _controlled(card, rest, scope):
    """Nodes or a source's name with a gain, or value={expression}."""
    if any(re.match(r"(poly|laplace|table|freq)\b", word) for word in rest):
        refuse(card, "poly, laplace, table and freq are not accepted: write a B source")
    match = re.fullmatch(r"(value|vol|cur)=(.*)", " ".join(rest))
    if match:
        expression = match.group(2).strip()
        braced = expression if expression.startswith("{") else "{" + expression + "}"
        _check_constants(card, expression, scope)
        return [f"{match.group(1)}={check_value(card, braced, scope)}"]
    check_nodes(card, rest[:-1])
    if len(rest) != (3 if card.text[0] in "eg" else 2):
        refuse(card, f"{card.text[:50]!r}: takes what controls it, and a gain")
    return [*rest[:-1], check_value(card, rest[-1], scope)]


def _behavioural(card, rest, scope):
    match = re.fullmatch(r"([iv])=(.+)", " ".join(rest))
    if not match:
        refuse(card, f"{card.text[:50]!r}: write it as Bname n+ n- i=expression")
    expression = rewritten(match.group(2).replace("{", "(").replace("}", ")"))
    fault = expression_fault(expression, scope.parameters, scope.functions)
    if fault:
        refuse(card, f"{fault} in {expression[:60]!r}")
    _check_constants(card, expression, scope)
    return [f"{match.group(1)}={expression}"]


def _check_constants(card, expression, scope):
    """Refuse a constant of ngspice's that hides a parameter where the value follows the circuit."""
    for name in re.findall(r"[a-z_]\w*", re.sub(r"\b[vi]\([^()]*\)", "", expression)):
        if name in NAMES and name in scope.parameters:
            value = number(str(scope.parameters[name]))
            if name != "pi" or not math.isclose(value or 0.0, math.pi, rel_tol=1e-6):
                refuse(card, f"{name} means ngspice's constant here: rename the parameter")


_KINDS = {
    "value": _value,
    "coupling": _coupling,
    "model": _model,
    "source": _source,
    "controlled": _controlled,
    "behavioural": _behavioural,
}

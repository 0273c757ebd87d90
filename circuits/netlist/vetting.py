"""Checks that a load's netlist contains only allowed elements.

A netlist is untrusted data: it must not run a program, access files, use nodes of the device or
stop ngspice's process. LTspice's syntax that ngspice would silently ignore or misread is converted
if its meaning is clear, and rejected otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, NoReturn

from circuits.netlist.dialects import in_ngspices_words
from circuits.netlist.expression import ExpressionError, check
from circuits.netlist.functions import SOLUTION, VARYING
from circuits.netlist.numbers import AMPERE, INFIX, NUMBER, THOUSANDTH_OF_AN_INCH, number
from circuits.netlist.part_models import unknown_word
from circuits.netlist.reader import Card
from circuits.netlist.waveform import KINDS
from harvester.base.errors import NetlistError
from harvester.base.plain_text import nearest

MODELS = {
    "d", "npn", "pnp", "njf", "pjf", "nmos", "pmos", "vdmos", "sw", "csw", "r", "c", "l",
    "vswitch", "iswitch",
}  # fmt: skip
# Data-sheet entries that LTspice adds to a model or part, without effect.
FACTS = {"mfg", "type", "iave", "vpk", "vceo", "icrating", "tol", "pwr", "irms", "ipk", "pn", "v"}
VDMOS_FACTS = {"vds", "ron", "qg"}
# Parameters of LTspice's idealised diode, which ngspice would ignore.
IDEAL_DIODE = {"ron", "roff", "vfwd", "vrev", "rrev", "ilimit", "revilimit", "epsilon"}
# Allowed keys by element letter.
_OF_ALL, _OF_VALUES = {"m", "temp", "dtemp"}, {"tc", "tc1", "tc2", "scale"}
PART_PARAMETERS = {
    "r": _OF_ALL | _OF_VALUES | {"r", "tce", "noisy", "w", "l"},
    "c": _OF_ALL | _OF_VALUES | {"c", "ic", "w", "l"},
    "l": _OF_ALL | _OF_VALUES | {"l", "ic"},
    "d": _OF_ALL | {"ic", "area", "pj", "w", "l"},
    "q": _OF_ALL | {"ic", "area"},
    "j": _OF_ALL | {"ic", "area"},
    "m": _OF_ALL | {"ic", "w", "l", "ad", "as", "pd", "ps", "nrd", "nrs"},
    "s": set(), "w": set(),
}  # fmt: skip
# LTspice's parasitic series parts; 0 if there is none.
SERIES = {"rser", "lser"}
PARASITICS = {"rser", "rpar", "cpar", "lser", "rlshunt"}
WAVEFORMS = {"dc", "ac", "sine", "am", *KINDS}
FLAGS = {"on", "off", "nchan", "pchan"}
# Number of nodes by element letter, and the parser of the words after them.
ELEMENTS = {
    "r": (2, "value"), "c": (2, "value"), "l": (2, "value"), "k": (0, "coupling"),
    "d": (2, "model"), "q": (3, "model"), "j": (3, "model"), "m": (3, "model"),
    "s": (4, "model"), "w": (2, "model"), "v": (2, "source"), "i": (2, "source"),
    "e": (2, "controlled"), "g": (2, "controlled"), "f": (2, "controlled"),
    "h": (2, "controlled"), "b": (2, "behavioural"),
}  # fmt: skip

# Largest number of optional words before the model: bulk or substrate, or the controlling source of
# a W.
_FURTHER = {"q": 1, "m": 1, "w": 1}
_CHARACTERS = re.compile(r"[\w\s.+\-*/^(){}\[\],=<>?:!&|%#~\"]*", re.ASCII)
# Longest name or number, in characters.
LONGEST_WORD = 250
_LONG_WORD = re.compile(rf"[\w.]{{{LONGEST_WORD + 1}}}")
# Largest number of names in a message, and longest name shown in full.
MOST_SHOWN, LONGEST_SHOWN = 20, 60
LONGEST_FAULT = 300
# Matches a pair name=value, whose value may be an expression in braces.
_PAIR = re.compile(r"([a-z_]\w*)=(\{[^{}]*\}|[^\s{}()=]+)")
_QUOTED_FACT = re.compile(rf'\s*\b({"|".join(sorted(FACTS))}) ?= ?"[^"]*"')
# Matches both temperature coefficients after one key.
_TWO_COEFFICIENTS = re.compile(
    r" tc=(\{[^{}]*\}|[^\s,={}]+)(?: ?, ?| )(\{[^{}]*\}|[-+.\d][^\s=]*)(?= |$)"
)
_NODE = re.compile(r"[\w.+\-#/\[\]]+")
_SOURCE_WORD = re.compile(r"\w+=\{[^{}]*\}|\{[^{}]*\}|[(),]|[^\s(),{}]+|\S")


class Visible(NamedTuple):
    """Names that are visible at a card's position."""

    parameters: Mapping
    functions: Mapping
    models: Mapping
    dialect: str = ""


@dataclass(eq=False)
class Line:
    """One checked element, with values as text.

    Attributes
    ----------
    words : all words after name and nodes, as written to a netlist.
    values : values of R, C, L in their order; the gain of a controlled source or K; values of Q and
        J after the model; constants of a source.
    bare : values without a key, a part of `values`.
    controls : sources or coils that control it.
    models : names of its models; only R, C and L may have several, rejected later.
    named : name=value settings.
    flags : "on" or "off".
    waves : kind and numbers of each waveform of a source.
    expression : expression of a B, or of E and G with value=.
    voltage : whether the expression sets a voltage.
    calls : sub-circuit of an X.
    """

    card: Card
    name: str
    nodes: list[str]
    words: list[str] = field(default_factory=list)
    values: list[str] = field(default_factory=list)
    bare: list[str] = field(default_factory=list)
    controls: list[str] = field(default_factory=list)
    models: list[str] = field(default_factory=list)
    named: dict[str, str] = field(default_factory=dict)
    flags: list[str] = field(default_factory=list)
    waves: list[tuple[str, list[str]]] = field(default_factory=list)
    expression: str = ""
    voltage: bool = False
    calls: str = ""

    @property
    def text(self) -> str:
        """The element in ngspice's syntax."""
        return " ".join([self.name, *self.nodes, *self.words])


def listed(names: Iterable[str]) -> str:
    """Names in one line; long lists are shortened."""
    names = [name[:LONGEST_SHOWN] for name in names]
    remainder = f" … ({len(names)} in all)" if len(names) > MOST_SHOWN else ""
    return ", ".join(names[:MOST_SHOWN]) + remainder


def refuse(card: Card, fault: str) -> NoReturn:
    """Raise NetlistError with file, line and error, shortened to one line."""
    end = " …" if len(fault) > LONGEST_FAULT else ""
    raise NetlistError(f"{card.where}: {fault[:LONGEST_FAULT]}{end}")


def tidy(card: Card) -> Card:
    """Convert quotes to braces, remove blanks in expressions, and reject unsafe characters.

    Quoted data-sheet entries, such as `mfg="KEMET"`, are removed.
    """
    card = card._replace(text=_QUOTED_FACT.sub("", card.text))
    if _LONG_WORD.search(card.text):
        refuse(card, f"a name or number of more than {LONGEST_WORD} characters")
    text = re.sub(r"'([^']*)'", r"{\1}", card.text)
    if not _CHARACTERS.fullmatch(text):
        odd = next(c for c in text if not _CHARACTERS.fullmatch(c))
        refuse(card, f"the character {odd!r} is not allowed in a load")
    if re.search(r"(?<!\w)(file|pwlfile)\s*=|(?<!\w)wavefile", text):
        refuse(card, "file= is not accepted: a load reads no files")
    if '"' in text:
        refuse(card, "double quotes are allowed only around an included file's name")
    text = re.sub(r"(?<![=<>!])\s*=\s*(?!=)", "=", text)
    return Card(_joined_braces(card, text), card.where)


def _joined_braces(card, text):
    """Remove blanks in braces, so that an expression is one word."""
    depth = deepest = 0
    for character in text:
        depth += (character == "{") - (character == "}")
        deepest = max(deepest, depth)
        if depth not in (0, 1):
            break
    if depth:
        refuse(card, f"braces do not match in {text[:50]!r}")
    return re.sub(r"\{[^{}]*\}", lambda braces: joined(card, braces.group()), text)


def joined(card: Card, expression: str) -> str:
    """Remove blanks from an expression; raise if one separates two words."""
    for before, after in re.findall(r"([\w.)]+) +(?=([\w.(]+))", expression):
        words = {before, after} & {"and", "or", "not"}
        if words:
            refuse(card, f"{min(words)}: write && for and, || for or, ! for not")
        # A blank between a function and its arguments is allowed.
        if before[-1] == ")" or after[0] != "(":
            refuse(card, f"an operator is missing between {before[:40]!r} and {after[:40]!r}")
    return expression.replace(" ", "")


def vet_model(card: Card) -> tuple[str, str, list[tuple[str, str]]]:
    """Check a .model card: (name, kind, parameters)."""
    if re.match(r"\.model \S+ ako:", card.text):
        refuse(card, "ako: write out the parameters of the base model")
    match = re.fullmatch(r"\.model (\S+) (\w+)\s*(.*)", card.text)
    kind = match.group(2) if match else ""
    if not match or kind not in MODELS:
        kinds = ", ".join(sorted(MODELS))
        refuse(card, f".model takes a name and one of {kinds}{nearest(kind, MODELS)}")
    remainder = match.group(3).strip()
    if remainder.startswith("(") and remainder.endswith(")"):
        remainder = remainder[1:-1]
    pairs = []
    for name, value in _pairs(card, remainder.replace(",", " "), FLAGS):
        if name in FACTS or (kind == "vdmos" and name in VDMOS_FACTS):
            continue
        if kind == "d" and name in IDEAL_DIODE:
            refuse(
                card,
                f"{name} belongs to LTspice's idealised diode, which ngspice lacks; "
                "give is, n and rs",
            )
        if fault := unknown_word(kind, name):
            refuse(card, fault)
        pairs.append((name, value))
    return match.group(1), kind, pairs


def vet_parameters(card: Card, text: str) -> dict[str, Any]:
    """A list of parameters as {name: value}; for repeated names the last value counts."""
    pairs = dict(_pairs(card, text, ()))
    for name, value in pairs.items():
        if THOUSANDTH_OF_AN_INCH.fullmatch(value):
            cure = "ngspice reads mil as 1e-3 in a parameter: multiply by 25.4u instead"
            refuse(card, f"{name}={value[:LONGEST_SHOWN]}: {cure}")
    for name in VARYING & {*pairs}:
        refuse(card, f"{name} is reserved by ngspice; rename the parameter")
    return pairs


def vet_function(card: Card) -> tuple[str, list[str], str]:
    """A .func card: (name, arguments, expression)."""
    match = re.fullmatch(r"\.func ([a-z_]\w*)\s*\(([\w\s,]*)\)\s*=?\s*\{?([^{}]*)\}?", card.text)
    if not match:
        refuse(card, "write it as .func name(x, y) {expression}")
    if match.group(1) in SOLUTION:
        refuse(card, f"{match.group(1)} is a function of ngspice; rename yours")
    arguments = [argument.strip() for argument in match.group(2).split(",") if argument.strip()]
    if len({*arguments}) < len(arguments):
        refuse(card, f"the arguments {listed(arguments)} of {match.group(1)[:40]} must differ")
    return match.group(1), arguments, match.group(3)


def _pairs(card, text, flags):
    """Parse "a=1 b={2*a} off" into (name, value) pairs; a flag has no value."""
    pairs = []
    for word in re.sub(r"=([^={}\s]+)\s*\(", r"=\1(", text).split():
        match = _PAIR.fullmatch(word)
        if match:
            pairs.append((match.group(1), match.group(2)))
        elif word in flags:
            pairs.append((word, ""))
        else:
            cure = "; write an expression in braces, name={2*a}" if "=" in word else ""
            refuse(card, f"{word[:40]!r} is not of the form name=value{cure}")
    return pairs


def check_value(card: Card, value: str, scope: Visible, what: str = "value") -> str:
    """Check a value, a parameter's name or an expression in braces; raise unless it is a number."""
    if value.startswith("{") and value.endswith("}"):
        return "{" + check_expression(card, value[1:-1], scope) + "}"
    size = number(value)
    if size is not None:
        return repr(size) if "mil" in value else INFIX.sub(r"\1.\3\2", value)
    if value in scope.parameters:
        return "{" + value + "}"
    excerpt = f"{what} {value[:LONGEST_SHOWN]}"
    if AMPERE.fullmatch(value):
        refuse(card, f"{excerpt}: ngspice 46 reads A as 1e-18, version 39 as 1: omit the A")
    if NUMBER.fullmatch(value):
        refuse(card, f"{excerpt} is not finite")
    refuse(card, f"{what} {value[:40]!r} is not a number{nearest(value, scope.parameters)}")


def check_expression(card: Card, expression: str, scope: Visible) -> str:
    """Check an expression and return it without blanks in ngspice's syntax."""
    text = rewritten(joined(card, expression))
    try:
        text = in_ngspices_words(text, scope.dialect)
        check(text, scope.parameters, scope.functions)
    except ExpressionError as fault:
        refuse(card, f"{{{text[:50]}}}: {fault}")
    return text


def rewritten(expression: str) -> str:
    """Convert LTspice's 4k7 to ngspice's notation."""
    return INFIX.sub(r"\1.\3\2", expression.replace(" ", ""))


def vet_element(card: Card, scope: Visible) -> Line:
    """Check an element's card."""
    text = card.text
    if text[0] in "rcl":
        text = _TWO_COEFFICIENTS.sub(r" tc1=\1 tc2=\2", text)
    name, *words = re.split(r"\s+", text)
    check_form(card, name, words)
    count, kind = ELEMENTS[name[0]]
    check_nodes(card, words[:count])
    line = Line(card, name, words[:count])
    _KINDS[kind](line, words[count:], scope)
    return line


def check_form(card: Card, name: str, words: list[str]) -> None:
    """Raise for an unsupported element letter or too few words."""
    letter = name[0].lower()
    if letter not in ELEMENTS:
        fault = "an element of this letter is not supported; supported are: X"
        refuse(card, f"{name[:40]}: {fault} {' '.join(sorted(ELEMENTS)).upper()}")
    if not re.fullmatch(r"[\w.+\-#]+", name) or len(words) <= ELEMENTS[letter][0]:
        refuse(card, f"{card.text[:50]!r}: too few nodes or no value")


def check_nodes(card: Card, nodes: list[str]) -> None:
    """Raise for node names that ngspice could misinterpret."""
    for node in nodes:
        if not _NODE.fullmatch(node):
            refuse(card, f"{node[:40]!r} is not a valid node name")


def _value(line, rest, scope):
    """Value, model and parameters of R, C and L."""
    for word in rest:
        if "=" in word and not word.startswith("{"):
            for key, value in _part_parameter(line.card, word, scope):
                line.words.append(f"{key}={value}")
                if key == line.name[0]:
                    line.values.append(value)
                else:
                    line.named[key] = value
        elif word in scope.models and number(word) is None and word not in scope.parameters:
            # A number, or a parameter with a model's name, has precedence over the model.
            line.words.append(word)
            line.models.append(word)
        else:
            value = check_value(line.card, word, scope)
            for part in (line.words, line.values, line.bare):
                part.append(value)
    if not (line.values or line.models):
        refuse(line.card, f"{line.card.text[:50]!r}: no value")


def _part_parameter(card, word, scope):
    """(key, value) of a part's setting; empty if it has no effect."""
    match = _PAIR.fullmatch(word)
    key, value = match.groups() if match else ("", "")
    if key in FACTS or (key in SERIES and number(value) == 0.0):
        return []
    if key in PARASITICS:
        refuse(card, f"{key}= exists only in LTspice: write it as a separate element")
    keys = PART_PARAMETERS[card.text[0]]
    if key not in keys:
        refuse(card, f"{card.text[0].upper()} has no parameter {word[:40]!r}{nearest(key, keys)}")
    # `tc` and `tc1` are the same parameter; the last one counts.
    key = "tc1" if key == "tc" else key
    return [(key, check_value(card, value, scope, key))]


def _coupling(line, rest, scope):
    if len(rest) < 3:
        refuse(line.card, "write it as Kname L1 L2 coefficient")
    *line.controls, size = rest
    check_nodes(line.card, line.controls)
    line.values = [check_value(line.card, size, scope)]
    line.words = line.controls + line.values


def _model(line, rest, scope):
    """Additional nodes, the model's name, and parameters."""
    card, letter, position = line.card, line.name[0], 0
    further: list[str] = []
    for word in rest:
        if "=" in word:
            pairs = _part_parameter(card, word, scope)
            line.named.update(pairs)
            line.words += [f"{key}={value}" for key, value in pairs]
        elif not line.models and word in scope.models:
            position = len(further) + len(line.words)
            line.models.append(word)
            line.words.append(word)
        elif not line.models:
            check_nodes(card, [word])
            further.append(word)
        elif word in FLAGS:
            line.words.append(word)
            (line.flags if word in ("on", "off") or letter in "sw" else line.values).append(word)
        else:
            if letter in "msw":
                refuse(card, f"{word[:40]!r} after the model has no effect: remove it")
            value = check_value(card, word, scope)
            line.words.append(f"area={value}" if letter == "d" else value)
            if letter == "d":
                line.named["area"] = value
            else:
                line.values.append(value)
    if not line.models:
        bare = [word for word in rest if "=" not in word]
        unknown = bare[-1] if bare else ""
        missing = f"{unknown[:LONGEST_SHOWN]}{nearest(unknown, scope.models)}"
        refuse(
            card, f"no .model {missing}: copy its .model line into the file, or .include its file"
        )
    if position > _FURTHER.get(letter, 0) or (letter == "w" and not position):
        refuse(card, f"{card.text[:50]!r}: too many or too few nodes before the model")
    if letter == "w":
        line.controls, line.words = further, further + line.words
    else:
        line.nodes += further


def _source(line, rest, scope):
    """Constants and waveforms with their numbers; values of ac are ignored."""
    card = line.card
    # A number belongs to the preceding waveform, "dc" or "ac" (two numbers), or is a constant.
    target, skipped = line.values, 0
    tokens = _SOURCE_WORD.findall(" ".join(rest))
    after = dict(pairwise([k for k, word in enumerate(tokens) if word not in "(),"]))
    for k, word in enumerate(tokens):
        following = tokens[after[k]] if k in after else "="
        if word in "(),":
            line.words.append(word)
        elif word == "dc" and (following in WAVEFORMS or re.match(r"\w*=", following)):
            refuse(card, f"{line.name}: dc without a value")
        elif word in WAVEFORMS:
            line.words.append(word)
            target, skipped = line.values, 2 if word == "ac" else 0
            if word not in ("dc", "ac"):
                target = []
                line.waves.append((word, target))
        elif "=" in word and word[0] != "{":
            match = re.fullmatch(r"(dc|ac|r|td)=(\S+)", word)
            if not match:
                refuse(card, f"{word[:40]!r} is not accepted in a source")
            key, value = match.group(1), check_value(card, match.group(2), scope)
            line.words.append(f"{key}={value}")
            target, skipped = line.values, 0
            if key == "dc":
                line.values.append(value)
            elif key != "ac":
                line.named[key] = value
        elif word[0].isalpha() and word not in scope.parameters:
            waveforms = ", ".join(sorted(WAVEFORMS))
            refuse(card, f"{word[:40]!r} is not a supported waveform; supported are: {waveforms}")
        else:
            line.words.append(check_value(card, word, scope))
            if not skipped:
                target.append(line.words[-1])
            skipped = max(skipped - 1, 0)


def _controlled(line, rest, scope):
    """Nodes or a source's name and a gain, or value={expression}."""
    card, letter = line.card, line.name[0]
    if any(re.match(r"(poly|laplace|table|freq)\b", word) for word in rest):
        refuse(card, "poly, laplace, table and freq are not supported: write a B source")
    text = _multiplied(line, " ".join(rest), scope)
    line.voltage = letter in "eh"
    match = re.fullmatch(r"(value|vol|cur)[= ](.*)", text)
    if match:
        expression = match.group(2).strip()
        braced = expression if expression.startswith("{") else "{" + expression + "}"
        line.expression = check_value(card, braced, scope)
        line.words.insert(0, f"{match.group(1)}={line.expression}")
        return
    # PSpice writes the controlling nodes as (c,d).
    *controls, gain = re.sub(r"\(([^(),]+),([^(),]+)\)", r"\1 \2", text).split()
    check_nodes(card, controls)
    if len(controls) != (2 if letter in "eg" else 1):
        refuse(card, f"{card.text[:50]!r}: needs controlling nodes or a source, and a gain")
    line.values = [check_value(card, gain, scope)]
    if letter in "eg":
        line.nodes += controls
        controls = []
    line.controls, line.words = controls, controls + line.values + line.words


def _multiplied(line, text, scope):
    """Remove m=… from a source's text and store it in the line; raise for voltage sources."""
    match = re.fullmatch(r"(.*\S) m=(\S+)", text)
    if not match:
        return text
    if line.name[0] in "eh" or match.group(1).startswith("v="):
        cure = "parallel voltage sources are equal to one: remove m="
        refuse(line.card, f"m={match.group(2)[:40]}: {cure}")
    line.named["m"] = check_value(line.card, match.group(2), scope)
    line.words.append(f"m={line.named['m']}")
    return match.group(1)


def _behavioural(line, rest, scope):
    text = _multiplied(line, " ".join(rest), scope)
    match = re.fullmatch(r"([iv])=(.+)", text)
    if not match:
        refuse(line.card, f"{line.card.text[:50]!r}: write it as Bname n+ n- i=expression")
    key, expression = match.group(1), match.group(2).replace("{", "(").replace("}", ")")
    line.expression = check_expression(line.card, expression, scope)
    line.voltage = key == "v"
    line.words.insert(0, f"{key}={line.expression}")


_KINDS = {
    "value": _value, "coupling": _coupling, "model": _model, "source": _source,
    "controlled": _controlled, "behavioural": _behavioural,
}  # fmt: skip

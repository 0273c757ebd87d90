"""`harvester new`: a commented scene of one's own, copied from a built-in one."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from harvester.base.errors import OutputError, SceneError
from harvester.base.numbers import NotANumber, number
from harvester.base.plain_text import named, nearest, one_line
from harvester.base.signatures import File, Kind
from harvester.cli.shown import say
from harvester.device.beam.materials import ACTIVE, PASSIVE

if TYPE_CHECKING:
    from harvester.scene.model import Scene

DEFAULT = "cantilever"
HEAD = """\
# A scene of your own, copied from the built-in scene `{scene}`, whose comments follow.
# Change what you like: an unknown key or a value that no device has is refused in one line.
# docs/scenes.md lists every key with its unit. Quickest look: `harvester average` and this file.

"""
OWN_HEAD = """\
# A scene of your own: your answers, and elsewhere the values of the built-in scene `{scene}`.
# An unknown key or a value that no device has is refused in one line. docs/scenes.md lists every
# key with its unit. Quickest look: `harvester average` and this file.

"""
# A value with its comment: the unit after one space, and a remark after more.
COMMENTED = re.compile(
    r"^(?P<value>[^#\n]*?\S) *#(?: (?P<unit>[^\s,]+)(?=$|,|  ))?[^\n]*$", re.MULTILINE
)


class Question(NamedTuple):
    """A question at the terminal, asked if the scene has its key.

    Attributes
    ----------
    keys
        Of the scene; a bare number is the first, the others are answered as NAME=VALUE. `k2` and
        `rms` stand for coupling and intensity, which are computed from them.
    words : str
    units
        Factor by the unit that may stand behind a bare number; the first is the key's own.
    low, high
        Between which such devices lie in SI; a bare number beyond was meant for something
        else, such as another question, and is taken only with its unit.
    names
        What may be answered in place of a number.
    """

    keys: tuple[str, ...]
    words: str
    units: dict[str, float]
    low: float = -math.inf
    high: float = math.inf
    names: tuple[str, ...] = ()


OHM = {"Ohm": 1.0, "Ω": 1.0}
METRE = {"m": 1.0, "mm": 1e-3}
QUESTIONS = (
    Question(("beam.length",), "length from the clamp", METRE, 1e-4, 1.0),
    Question(("beam.width",), "width", METRE, 1e-5, 1.0),
    Question(("beam.thickness",), "thickness of the substrate", METRE, 1e-6, 0.02),
    Question(("beam.piezo_thickness",), "thickness of a piezo layer", METRE, 1e-7, 0.01),
    Question(("beam.material",), "substrate", {}, names=tuple(PASSIVE)),
    Question(("beam.piezo",), "piezo layers", {}, names=tuple(ACTIVE)),
    Question(("beam.connection",), "the two layers", {}, names=("series", "parallel")),
    Question(("beam.tip_mass",), "tip mass", {"kg": 1.0, "g": 1e-3}, 0.0, 10.0),
    Question(("beam.quality_factor", "beam.damping_ratio"), "quality factor Q", {}, 1.0, 1e6),
    Question(("oscillator.mass",), "mass", {"kg": 1.0, "g": 1e-3}, 1e-7, 100.0),
    Question(
        ("oscillator.frequency", "oscillator.linear_stiffness"),
        "frequency, terminals shorted", {"Hz": 1.0}, 0.1, 1e5,
    ),
    Question(
        ("oscillator.quality_factor", "oscillator.damping_ratio", "oscillator.damping"),
        "quality factor Q", {}, 1.0, 1e6,
    ),
    Question(("oscillator.base_factor",), "base factor, 1 if all mass is at the tip", {}, 0.5, 2.0),
    Question(("piezo.capacitance",), "capacitance", {"F": 1.0}, 1e-13, 1e-3),
    Question(("piezo.coupling", "piezo.k2"), "coupling", {"N/V": 1.0}, 1e-8, 1.0),
    Question(("coil.coupling",), "coupling", {"N/A": 1.0, "V s/m": 1.0}, 1e-4, 1e4),
    Question(("coil.resistance",), "resistance of the winding", OHM, 1e-2, 1e6),
    Question(("load.resistance",), "load", OHM, 0.1, 1e12),
    Question(("excitation.correlation_time",), "correlation time", {"s": 1.0}, 1e-6, 10.0),
    Question(
        ("excitation.rms", "excitation.intensity"),
        "base acceleration, rms", {"m/s^2": 1.0, "g": 9.80665}, 1e-4, 1e4,
    ),
)  # fmt: skip


def new(
    file: File, /, *, scene: Annotated[str, Kind("SCENE", option="from")] | None = None
) -> None:
    """Write a commented scene of your own to start from.

    It is copied from a built-in one; at a terminal and without --from it asks for the device's
    values.

    Parameters
    ----------
    file : str
        A new .toml file; - for standard output.
    scene : str or None
        The built-in scene that is copied (default: cantilever).
    """
    from harvester.base.writing import is_standard_output, write_text

    to_file = not is_standard_output(file)
    if to_file:
        _check_new(file)
    asking = scene is None and all(
        stream is not None and stream.isatty() for stream in (sys.stdin, sys.stderr)
    )
    name = scene or (_chosen() if asking else DEFAULT)
    text = _copied(name)
    write_text(file, _changed(text, name) if asking else text)
    if to_file:
        from harvester.scene.described import device_line
        from harvester.scene.model import Scene

        for line in device_line(Scene.read(file)):
            say(line)
        say(f"written: {file}; now try: harvester average {file}")


def _check_new(file):
    """Refuse what is there already, and what could be taken for a built-in scene's name."""
    if not file.endswith(".toml"):
        raise OutputError(f"{named(file)}: a scene's file ends in .toml: give {named(file)}.toml")
    if os.path.lexists(file):
        raise OutputError(f"{named(file)}: is there already, and stays; name a new file")


def _copied(name):
    """Text of a built-in scene with a head of its own."""
    from harvester.scene.source import BUILT_IN, built_in_names

    names = built_in_names()
    if name not in names:
        raise SceneError(
            f"{named(name)}: no built-in scene{nearest(name, names)}; there are {', '.join(names)}"
        )
    return HEAD.format(scene=name) + (BUILT_IN / f"{name}.toml").read_text("utf-8")


def _chosen():
    from harvester.scene.source import built_in_names

    names = built_in_names()
    print(
        f"Built-in scenes: {', '.join(names)} (bimorph asks for a drawing). Enter keeps a value; "
        "200k, 41n are numbers.",
        file=sys.stderr,
    )
    while (answer := _answer("Scene to begin with", DEFAULT)) not in names:
        print(f"{named(answer)}: no built-in scene{nearest(answer, names)}", file=sys.stderr)
    return answer


def _changed(text, name):
    """The text with the values that were given for those asked for."""
    from harvester.scene.model import Scene

    scene, answered = Scene.read(name), False
    for question in QUESTIONS:
        # A scaled scene has damping and intensity alone of the alternatives to them.
        scaled = {"oscillator.damping", "excitation.intensity"} & {*question.keys}
        keys = tuple(scaled) if scaled and scene.units != "SI" else question.keys
        line = next(filter(None, (_line_of(text, key) for key in keys)), None)
        stiffness = scene.oscillator.linear_stiffness
        is_bistable = not stiffness or stiffness < 0.0
        if line is None or ("oscillator.frequency" in keys and is_bistable):
            continue
        key, value, scene = _accepted(scene, question, keys, line)
        if key is not None:
            # The comment holds the key's unit, so another key does without.
            end = line.end("value") if key == line["key"] else line.end()
            text = f"{text[: line.start('key')]}{key} = {json.dumps(value)}{text[end:]}"
            answered = True
    return _with_units_only(text, name) if answered else text


def _with_units_only(text, name):
    """The text without what the comments of the built-in scene say of its own device."""
    body = re.sub(r"^#.*\n+", "", text, flags=re.MULTILINE)
    return OWN_HEAD.format(scene=name) + COMMENTED.sub(
        lambda line: line["value"] + (f"  # {line['unit']}" if line["unit"] else ""), body
    )


def _line_of(text, key):
    """Match of the line of "table.key", with `key` and `value`."""
    table, _, name = key.partition(".")
    above = rf"^\[{table}\]\n(?:(?!\[).*\n)*?"
    line = rf"(?P<key>{name}) *= *(?P<value>\S+)[^\n]*$"
    return re.search(above + line, text, re.MULTILINE)


def _accepted(scene, question, keys, line):
    """Ask until the scene accepts the answer: (key without table, value, scene); Nones if
    unchanged.
    """
    table = keys[0].partition(".")[0]
    words = f"{table}: {question.words}"
    if scene.units == "SI" and question.units:
        words += f" in {next(iter(question.units))}"
    words += "".join(f", or {key.partition('.')[2]}=" for key in keys[1:])
    words += f" ({', '.join(question.names)})" if question.names else ""
    while True:
        answer = _answer(words, f"{line['key']} = {line['value']}")
        if answer == f"{line['key']} = {line['value']}":
            return None, None, scene
        try:
            key, value = _read(answer, question, keys, scene.units)
            key, value = _in_scene(key, value, scene)
            return key.partition(".")[2], value, scene.replace({key: value})
        except NotANumber as reason:
            print(f"{answer!r}: {reason}; this asks for: {words}", file=sys.stderr)
        except SceneError as error:
            print(error, file=sys.stderr)


def _read(answer, question, keys, units):
    """The key that an answer is for, and its number in the key's unit, or its name."""
    if question.names:
        return keys[0], answer.strip("\"'")
    name, equals, number_text = (part.strip() for part in answer.partition("="))
    if equals:
        key_by_name = {key.partition(".")[2]: key for key in keys}
        if name not in key_by_name:
            raise NotANumber(f"no {name} here{nearest(name, key_by_name)}")
        return key_by_name[name], number(number_text)
    for unit, factor in sorted(question.units.items(), key=lambda item: -len(item[0])):
        if units == "SI" and answer.endswith(unit):
            return keys[0], factor * number(answer.removesuffix(unit).replace(" ", ""))
    value = number(answer)
    if units == "SI" and not question.low <= value <= question.high:
        spelling = f"{answer} {next(iter(question.units))}" if question.units else f"NAME={answer}"
        raise NotANumber(
            f"such devices have {question.low:g} to {question.high:g}; write {spelling} if it is "
            "meant"
        )
    return keys[0], value


def _in_scene(key: str, value: Any, scene: Scene) -> tuple[str, Any]:
    """The key and value that set an answer in the scene: k² and rms are converted."""
    if key == "piezo.k2":
        from harvester.scene.units import rest_stiffness

        capacitance: Any = getattr(scene.transducer, "capacitance", None)
        return "piezo.coupling", math.sqrt(value * rest_stiffness(scene.oscillator) * capacitance)
    if key == "excitation.rms":
        time = getattr(scene.excitation, "correlation_time", 1.0)
        return "excitation.intensity", value**2 * time
    return key, value


def _answer(question, usual):
    """The line typed, or the default if it is empty or the input has ended."""
    print(f"{question} [{usual}]: ", end="", file=sys.stderr, flush=True)
    return one_line(sys.stdin.readline().strip()) or usual

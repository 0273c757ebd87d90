"""`harvester new`: a commented scene to edit; `harvester schema`: the JSON Schema of scenes."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, NamedTuple

from harvester.base.arguments import check_name
from harvester.base.errors import OutputError, SceneError
from harvester.base.numbers import NotANumber, number
from harvester.base.plain_text import named, nearest, one_line
from harvester.base.signatures import File, Kind
from harvester.cli.shown import say

if TYPE_CHECKING:
    from harvester.device.keys import Key
    from harvester.scene.model import Scene

DEFAULT = "cantilever"
HINT = """\
Unknown keys and invalid values are reported in one line. docs/reference/scene-keys.md
lists every key with its unit. Quickest test: `harvester average FILE` with this file."""
HEAD = "A scene of your own, copied from the built-in scene `{}`, whose comments follow."
OWN_HEAD = "A scene of your own: your answers; all other values are from the built-in scene `{}`."
# Factors of other units that the user may type after a value, by the key's unit.
UNITS = {
    "m": {"mm": 1e-3}, "kg": {"g": 1e-3}, "Ω": {"Ohm": 1.0}, "V s/m": {"N/A": 1.0},
    "m/s²": {"m/s^2": 1.0, "g": 9.80665},
}  # fmt: skip


class Question(NamedTuple):
    """A question at the terminal about one of several keys that define the same property.

    Attributes
    ----------
    keys
        `table.key`: a bare number is the value of the first; NAME=VALUE gives another.
    spec : Key
        Declaration of the first key. A bare number outside its usual range probably answers another
        question, and is accepted only with its unit.
    """

    keys: tuple[str, ...]
    spec: Key

    @property
    def words(self) -> str:
        """The question."""
        unit = self.spec.unit
        words = f"{self.keys[0].partition('.')[0]}: {self.spec.name}"
        words += f" in {unit}" if unit not in ("", "1") and self.spec.usual else ""
        words += "".join(f", or {key.partition('.')[2]}=" for key in self.keys[1:])
        return words + (f" ({', '.join(self.spec.words)})" if self.spec.words else "")


def schema(file: File | None = None, /) -> None:
    """Write the JSON Schema of scenes, for editors that complete and check TOML.

    Parameters
    ----------
    file : str or None
        Output file (default: standard output).

    Examples
    --------
    ::

        harvester schema scene.schema.json
    """
    from harvester.base.writing import write_text
    from harvester.scene.json_schema import json_schema

    write_text(file or "-", json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n")


def new(
    file: File, /, *, scene: Annotated[str, Kind("SCENE", option="from")] | None = None
) -> None:
    """Write a commented scene of your own to start from.

    It is a copy of a built-in scene. At a terminal and without --from, it asks for the device's
    values.

    Parameters
    ----------
    file : str
        A new .toml file; - for standard output.
    scene : str or None
        The built-in scene to copy (default: cantilever).

    Examples
    --------
    ::

        harvester new beam.toml --from asymmetric
    """
    from harvester.base.writing import is_standard_output, write_text
    from harvester.scene.source import BUILT_IN, built_in_names

    to_file = not is_standard_output(file)
    if to_file and not file.endswith(".toml"):
        # Without the suffix, the file could be confused with a built-in scene.
        raise OutputError(f"{named(file)}: a scene's file ends in .toml: give {named(file)}.toml")
    if to_file and os.path.lexists(file):
        raise OutputError(f"{named(file)}: exists and is not overwritten; name a new file")
    asking = scene is None and all(
        stream is not None and stream.isatty() for stream in (sys.stdin, sys.stderr)
    )
    name = scene or (_chosen() if asking else DEFAULT)
    check_name("built-in scene", name, built_in_names())
    heading = "".join(f"# {line}\n" for line in [HEAD.format(name), *HINT.splitlines()])
    text = f"{heading}\n" + (BUILT_IN / f"{name}.toml").read_text("utf-8")
    write_text(file, _answered(text, name) if asking else text)
    if to_file:
        from harvester.scene.described import device_line
        from harvester.scene.model import Scene

        for line in device_line(Scene.read(file)):
            say(line)
        say(f"written: {file}; now try: harvester average {file}")


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


def _answered(text, name):
    """The scene's text with the answers inserted; unchanged if there are none."""
    from harvester.scene.model import Scene
    from harvester.scene.text import key_comments, scene_text

    scene = begun = Scene.read(name)
    for question in questions(scene):
        scene = _accepted(scene, question)
    if scene == begun:
        return text
    return scene_text(scene, key_comments(scene), [OWN_HEAD.format(name), *HINT.splitlines()])


def questions(scene: Scene) -> Iterator[Question]:
    """The questions for a scene: keys whose values a device's manufacturer states."""
    from harvester.scene.tables import rows_of

    for table, cls, values in rows_of(scene.to_tables()):
        for name, spec in cls.KEYS.items():
            groups = [group.keys for group in cls.ALTERNATIVES if name in group.keys]
            alternatives = [other for keys in groups for other in keys if other != name]
            names = [
                other
                for other in (name, *alternatives)
                if scene.units in cls.KEYS[other].units
                and (other == name or cls.KEYS[other].is_number)
            ]
            # A bistable device has several frequencies, and a scaled scene no quality factor.
            several_wells = name == "frequency" and not (scene.oscillator.linear_stiffness or 0) > 0
            if (spec.usual or spec.asked) and {*names} & {*values} and not several_wells:
                yield Question(tuple(f"{table}.{other}" for other in names), cls.KEYS[names[0]])


def _accepted(scene, question):
    """The scene with the first valid answer; unchanged if the default is chosen."""
    table = question.keys[0].partition(".")[0]
    values = scene.to_tables()[table]
    key = next(key for key in question.keys if key.partition(".")[2] in values).partition(".")[2]
    usual = f"{key} = {json.dumps(values[key])}"
    while (answer := _answer(question.words, usual)) != usual:
        try:
            return scene.replace(dict([_read(answer, question, scene.units)]))
        except NotANumber as reason:
            print(f"{answer!r}: {reason}; this asks for: {question.words}", file=sys.stderr)
        except SceneError as error:
            print(error, file=sys.stderr)
    return scene


def _read(answer, question, units):
    """The key that an answer refers to, and its value in the key's unit, or a word."""
    keys, spec = question
    if spec.words:
        return keys[0], answer.strip("\"'")
    name, equals, number_text = (part.strip() for part in answer.partition("="))
    if equals:
        key_by_name = {key.partition(".")[2]: key for key in keys}
        if name not in key_by_name:
            raise NotANumber(f"unknown key {name}{nearest(name, key_by_name)}")
        return key_by_name[name], number(number_text)
    factors = {} if spec.unit == "1" else {spec.unit: 1.0, **UNITS.get(spec.unit, {})}
    for unit in sorted(factors, key=len, reverse=True):
        if units == "SI" and answer.endswith(unit):
            return keys[0], factors[unit] * number(answer.removesuffix(unit).replace(" ", ""))
    value = number(answer)
    low, high = spec.usual or (-sys.float_info.max, sys.float_info.max)
    if units == "SI" and not low <= value <= high:
        spelling = f"NAME={answer}" if spec.unit in ("", "1") else f"{answer} {spec.unit}"
        raise NotANumber(f"the usual range is {low:g} to {high:g}; write {spelling} to use it")
    return keys[0], value


def _answer(question, usual):
    """The line typed by the user; the default if it is empty or the input has ended."""
    print(f"{question} [{usual}]: ", end="", file=sys.stderr, flush=True)
    return one_line(sys.stdin.readline().strip()) or usual

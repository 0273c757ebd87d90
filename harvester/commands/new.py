"""`harvester new`: a commented scene of one's own, copied from a built-in one."""

from __future__ import annotations

import os
import re
import sys
from typing import Annotated

from harvester.commands.quiet import say
from harvester.errors import OutputError, SceneError
from harvester.files.plain_text import named, nearest, one_line
from harvester.signatures import File, Kind

DEFAULT = "device"
HEAD = """\
# A scene of your own, copied from the built-in scene `{scene}`, whose comments follow.
# Change what you like: an unknown key or a value that no device has is refused in one line.
# docs/scenes.md lists every key with its unit. Quickest look: `harvester average` and this file.

"""
# What is asked for at a terminal, where the scene has it.
ASKED = (
    "oscillator.mass",
    "oscillator.damping",
    "piezo.coupling",
    "piezo.capacitance",
    "coil.coupling",
    "coil.resistance",
    "load.resistance",
    "excitation.intensity",
    "excitation.correlation_time",
)


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
        The built-in scene that is copied (default: device).
    """
    from harvester.files.writing import is_standard_output, write_text

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
    print(f"Built-in scenes: {', '.join(names)}. Enter keeps a value.", file=sys.stderr)
    while (answer := _answer("Scene to begin with", DEFAULT)) not in names:
        print(f"{named(answer)}: no built-in scene{nearest(answer, names)}", file=sys.stderr)
    return answer


def _changed(text, name):
    """The text with the values that were given for those asked for."""
    from harvester.scene.model import Scene

    scene = Scene.load(name)
    for key in ASKED:
        line = _line_of(text, key)
        if line is None:
            continue
        old, comment = line["value"], line["comment"] or ""
        new, scene = _accepted(scene, key, old, re.sub(r"\s{2,}", ", ", comment))
        if new != old:
            said = f"{new}  # {f'{comment}; ' if comment else ''}{old} in `{name}`"
            text = text[: line.start("value")] + said + text[line.end() :]
    return text


def _line_of(text, key):
    """Match of the line of "table.key", with `value` and `comment`."""
    table, _, name = key.partition(".")
    above = rf"^\[{table}\]\n(?:(?!\[).*\n)*?"
    line = rf"{name} *= *(?P<value>\S+)[^\S\n]*(?:# *(?P<comment>.*))?$"
    return re.search(above + line, text, re.MULTILINE)


def _accepted(scene, key, old, comment):
    """An answer that the scene takes, as text of a number, and the scene with it."""
    while True:
        answer = _answer(f"{key} ({comment})" if comment else key, old)
        if answer == old:
            return old, scene
        try:
            number = float(answer)
            return repr(number), scene.replace({key: number})
        except ValueError:
            print(f"{answer!r} is no number", file=sys.stderr)
        except SceneError as error:
            print(error, file=sys.stderr)


def _answer(question, usual):
    """What is typed, or the usual where that is nothing or the input has ended."""
    print(f"{question} [{usual}]: ", end="", file=sys.stderr, flush=True)
    return one_line(sys.stdin.readline().strip()) or usual

"""`harvester completion`: the shell completes commands, options and built-in scenes."""

from __future__ import annotations

from typing import Annotated

from harvester.errors import HarvesterError
from harvester.files.plain_text import nearest
from harvester.signatures import Kind

SHELLS = ("bash", "zsh", "fish")


def completion(shell: Annotated[str, Kind("SHELL")], /) -> None:
    """Print the completion script of a shell.

    For this session: eval it; for good: write it where the shell looks, such as
    ~/.local/share/bash-completion/completions/harvester.

    Parameters
    ----------
    shell : str
        bash, zsh, fish.
    """
    import shtab

    from harvester.command_line import build_parser
    from harvester.scene.source import built_in_names

    if shell not in SHELLS:
        raise HarvesterError(
            f"{shell}: no such shell{nearest(shell, SHELLS)}; there are {', '.join(SHELLS)}"
        )
    parser, commands = build_parser()
    for command in commands.choices.values():
        for action in command._actions:
            if action.dest == "scene":
                action.choices = built_in_names()
            elif action.dest == "shell":
                action.choices = SHELLS
            elif action.metavar in ("FILE", "DIR"):
                action.complete = shtab.FILE if action.metavar == "FILE" else shtab.DIRECTORY
    print(shtab.complete(parser, shell))

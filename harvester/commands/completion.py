"""`harvester completion`: the shell completes commands, options and built-in scenes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harvester.errors import HarvesterError

if TYPE_CHECKING:
    from argparse import Namespace

SHELLS = ("bash", "zsh", "fish")


def add(commands: Any) -> None:
    """The command's arguments."""
    command = commands.add_parser(
        "completion",
        help="print the completion script of a shell",
        description="print the completion script of a shell; for this session: eval it; for good: "
        "write it where the shell looks, such as "
        "~/.local/share/bash-completion/completions/harvester",
        epilog="example: harvester completion bash",
    )
    command.add_argument("shell", metavar="SHELL", help=", ".join(SHELLS))
    command.set_defaults(command=run, json=None, output=None)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    import shtab

    from harvester.command_line import build_parser
    from harvester.files.plain_text import nearest
    from harvester.scene.model import Scene

    if options.shell not in SHELLS:
        raise HarvesterError(
            f"{options.shell}: no such shell{nearest(options.shell, SHELLS)}; "
            f"there are {', '.join(SHELLS)}"
        )
    parser, commands = build_parser()
    for command in commands.choices.values():
        for action in command._actions:
            if action.dest == "scene":
                action.choices = Scene.names()
            elif action.dest == "shell":
                action.choices = SHELLS
            elif action.metavar in ("FILE", "DIR"):
                action.complete = shtab.FILE if action.metavar == "FILE" else shtab.DIRECTORY
    print(shtab.complete(parser, options.shell))

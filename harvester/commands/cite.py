"""`harvester cite`: the sources of the methods, of all or of those that a result used."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.errors import HarvesterError

if TYPE_CHECKING:
    from argparse import Namespace

# Bytes: a device may never end.
LARGEST_RESULT = 100_000_000


def add(commands: Any) -> None:
    """The command's arguments."""
    command = commands.add_parser(
        "cite",
        help="the sources of the methods that a result used",
        description="the sources of the methods that a result used, or of all methods",
        epilog="example: harvester cite results/paper-validate.json",
    )
    command.add_argument(
        "result", nargs="?", metavar="FILE", help="JSON of simulate, average or validate"
    )
    command.set_defaults(command=run, json=None, output=None)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    from harvester.commands.citations import SOURCES, sources_of

    found: Sequence = SOURCES
    if options.result:
        try:
            found = sources_of(_read(options.result))
        except HarvesterError as error:
            raise HarvesterError(f"{options.result}: {error}") from None
    for source in found:
        print(f"{source.method}:\n    {source.reference}")


def _read(name):
    try:
        with Path(name).open("rb") as file:
            content = file.read(LARGEST_RESULT + 1)
        if len(content) > LARGEST_RESULT:
            raise HarvesterError(f"is larger than {LARGEST_RESULT // 10**6} MB: no result")
        return json.loads(content)
    except OSError as error:
        raise HarvesterError(
            f"cannot be read: {error.strerror}; give a file that --json or --output wrote"
        ) from None
    except (ValueError, RecursionError):
        raise HarvesterError("is no JSON; give a file that --json or --output wrote") from None

"""`harvester engine`: the ngspice that was found."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from argparse import Namespace


def add(commands: Any) -> None:
    """The command's arguments."""
    command = commands.add_parser(
        "engine",
        help="show the ngspice that was found",
        description="show the ngspice that was found, its features and the compiled device",
        epilog="example: harvester engine --json -",
    )
    command.add_argument("--json", metavar="FILE", help="write JSON; - for standard output")
    command.set_defaults(command=run, output=None)


def run(options: Namespace) -> None:
    """Carry it out; returns the exit code, or None for 0."""
    from circuits.ngspice.engine import describe
    from harvester.commands.console import show_engine
    from harvester.files.writing import check_writable, is_standard_output, write_json
    from harvester.workers.process import Worker

    if options.json:
        check_writable(options.json)
    with closing(Worker()) as worker:
        found = worker.call(describe, {}, time_limit=60.0)
    show_engine(found, to_stderr=is_standard_output(options.json))
    if options.json:
        write_json(options.json, found)

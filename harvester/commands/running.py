"""Common steps of commands: open a runner, check where files go, show a result."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Unpack

from harvester.commands.quiet import complain
from harvester.signatures import RunnerOptions

if TYPE_CHECKING:
    from harvester.commands.shown import Tabled
    from harvester.running.runner import Runner


@contextlib.contextmanager
def study_runner(label: str | None, **running: Unpack[RunnerOptions]) -> Iterator[Runner]:
    """A runner for the block, with a progress bar; afterwards says what to do next.

    Parameters
    ----------
    label : str or None
        Label of the progress bar; None: the study draws its own.
    **running
        See `harvester.running.open_runner`.
    """
    from harvester.commands.console import progress
    from harvester.running import open_runner

    try:
        with progress() as follow:
            running["progress"] = follow(label, None) if label else None
            with open_runner(**running) as runner:
                yield runner
                for line in runner.warnings:
                    complain(line)
                if runner.out_of_time:
                    complain("the time budget was spent: the same command goes on where it ended")
    except KeyboardInterrupt as interrupt:
        hint = "what is finished is kept: the same command goes on" if running.get("output") else ""
        raise KeyboardInterrupt(str(interrupt) or hint) from None


def check_places(
    json: str | None,
    output: str | os.PathLike | None,
    report: str | None = None,
    waveform: str | None = None,
    files: Iterable[str] = (),
) -> None:
    """Refuse places that cannot be written to, before anything runs.

    Parameters
    ----------
    json, report, waveform : str or None
        Files that the user named.
    output : str or None
        A folder.
    files : iterable of str
        Names of the files that will be written there.
    """
    from harvester.files.writing import check_folder, check_writable, in_folder
    from harvester.results.waveform import check_ending

    if waveform:
        check_ending(waveform)
    for file in filter(None, (json, report, waveform)):
        check_writable(file)
    if output:
        folder = os.fspath(output)
        check_folder(folder)
        for file in files:
            in_folder(folder, file)


def show(content: Tabled, title: str, json: str | None = None) -> None:
    """Show a result's table: on standard error where standard output gets the JSON."""
    from harvester.commands.console import show_table
    from harvester.files.writing import is_standard_output

    alarms = content.alarms() if hasattr(content, "alarms") else ()
    show_table(content, title, to_stderr=is_standard_output(json), alarms=alarms)

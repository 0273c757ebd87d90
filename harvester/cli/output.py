"""Helpers of commands: open a runner, check output paths, show and write a result."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import named
from harvester.base.signatures import RunnerOptions
from harvester.cli.shown import print_error, say

if TYPE_CHECKING:
    from harvester.engines.runner import Runner
    from harvester.results.view import ResultBase


@contextlib.contextmanager
def study_runner(**running: Unpack[RunnerOptions]) -> Iterator[Runner]:
    """Yield an open runner (`harvester.open_runner`); if the block is interrupted, raise
    KeyboardInterrupt with advice on how to continue.
    """
    from harvester.engines.opening import open_runner

    try:
        with open_runner(**running) as runner:
            yield runner
            for line in runner.warnings:
                print_error(line)
    except KeyboardInterrupt as interrupt:
        hint = "the same command continues from finished answers" if running.get("output") else ""
        raise KeyboardInterrupt(str(interrupt) or hint) from None


def check_outputs(
    json: str | None,
    output: str | os.PathLike | None,
    report: str | None = None,
    waveform: str | None = None,
    names: Iterable[str] = (),
) -> None:
    """Raise if a file or the folder cannot be written to.

    `names`: names of the results for the folder; its existing files of these names are checked too.
    """
    from harvester.base.writing import check_folder, check_writable, in_folder
    from harvester.results.files import ENDINGS

    if waveform and Path(waveform).suffix not in ENDINGS:
        raise HarvesterError(f"--waveform {named(waveform)}: must end in {', '.join(ENDINGS)}")
    for file in filter(None, (json, report, waveform)):
        check_writable(file)
    if output:
        folder = os.fspath(output)
        check_folder(folder)
        for file in os.listdir(folder) if os.path.isdir(folder) else ():
            if any(file.startswith((f"{name}.", f"{name}-")) for name in names):
                in_folder(folder, file)


def show(result: ResultBase, title: str, json: str | None = None) -> None:
    """Show a result's table, on standard error if the JSON is on standard output."""
    from harvester.base.writing import is_standard_output
    from harvester.cli.console import show_view

    if result.scene is not None:
        title = f"{result.scene.name}: {title}"
    show_view(result.view(), title, to_stderr=is_standard_output(json))


def write_result(
    json: str | None, output: str | os.PathLike | None, name: str, result: ResultBase
) -> None:
    """Write the requested files; for the files of a folder see `harvester.save`."""
    from harvester.base.writing import write_json
    from harvester.results.files import save

    # If writing the JSON fails, the folder is still written.
    try:
        if json:
            write_json(json, result.to_dict())
    finally:
        if output:
            save(result, output, name)
            say(f"written to {output}: {name}.*")

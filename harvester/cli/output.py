"""What commands share: open a runner, check where files go, show and write a result."""

from __future__ import annotations

import contextlib
import importlib.util
import os
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Unpack

from harvester.base.signatures import RunnerOptions
from harvester.cli.shown import print_error, say

if TYPE_CHECKING:
    from harvester.engines.runner import Runner
    from harvester.results.view import ResultBase

# Endings of the files of a result in its folder.
ENDINGS = (
    ".json", ".csv", ".nc", ".png", "-joint.png", "-densities.csv", "-profile.csv", ".md",
    "-measured.md", ".html", ".toml", "-proposed.toml",
)  # fmt: skip


@contextlib.contextmanager
def study_runner(**running: Unpack[RunnerOptions]) -> Iterator[Runner]:
    """A runner for the block, see `harvester.open_runner`; afterwards says what to do next."""
    from harvester.engines.opening import open_runner

    try:
        with open_runner(**running) as runner:
            yield runner
            for line in runner.warnings:
                print_error(line)
            if runner.out_of_time:
                print_error("the time budget was spent: the same command goes on where it ended")
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
    """Refuse files, and a folder with its future `files`, that cannot be written to."""
    from harvester.base.writing import check_folder, check_writable, in_folder
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


def show(result: ResultBase, title: str, json: str | None = None) -> None:
    """Show a result's table: on standard error where standard output gets the JSON."""
    from harvester.base.writing import is_standard_output
    from harvester.cli.console import show_view

    if result.scene is not None:
        title = f"{result.scene.name}: {title}"
    show_view(result.view(), title, to_stderr=is_standard_output(json))


def result_files(name: str) -> list[str]:
    """Names of all files that `write_result` may write."""
    return [f"{name}{ending}" for ending in ENDINGS]


def write_result(
    json: str | None, output: str | os.PathLike | None, name: str, result: ResultBase
) -> None:
    """Write the files that were asked for.

    The folder gets JSON, a CSV table, the figures, the result's own texts and, of a result with
    axes of its own, NetCDF.
    """
    from harvester.base.writing import write_json

    # If one place is full, the other still gets the result.
    try:
        if json:
            write_json(json, result.to_dict())
    finally:
        if output:
            _write_folder(os.fspath(output), name, result)


def _write_folder(folder, name, result):
    from harvester.base.tables import write_csv, write_netcdf
    from harvester.base.writing import in_folder, write_json, write_text
    from harvester.results import figures

    def file(ending):
        return in_folder(folder, f"{name}{ending}")

    view = result.view()
    write_json(file(".json"), result.to_dict())
    write_csv(file(".csv"), *view.data())
    # NetCDF is an extra; the other files hold the same.
    if view.dataset and importlib.util.find_spec("xarray"):
        write_netcdf(file(".nc"), view.dataset())
    for ending, text in view.texts().items() if view.texts else ():
        write_text(file(ending), text)
    for picture in view.pictures:
        figure = picture.figure()
        if figure is not None:
            figures.write(figure, file(f"{picture.name and '-'}{picture.name}.png"))
    say(f"written to {folder}: {name}.*")

"""The files of a result: JSON, tables, figures and pages, in a folder of the user's."""

from __future__ import annotations

import importlib.util
import os
from typing import TYPE_CHECKING

from harvester.commands.quiet import say

if TYPE_CHECKING:
    from harvester.commands.shown import Shown

# Endings of the files of a result in its folder.
RESULT_FILES = (".json", "-densities.csv", ".png", "-joint.png", ".csv", ".nc", ".md")
TEXT_FILES = (".toml", "-proposed.toml", "-measured.md", ".html", "-profile.csv")


def result_files(name: str) -> list[str]:
    """Names of all files that `write_result` may write."""
    return [f"{name}{ending}" for ending in (*RESULT_FILES, *TEXT_FILES)]


def write_result(
    json: str | None, output: str | os.PathLike | None, name: str, content: Shown
) -> None:
    """Write the files that were asked for.

    The folder gets JSON and the figure, and what else the result has: a CSV table where it has
    `data()`, NetCDF with `to_xarray()` too, the figure of `joint_figure()`, the page of
    `markdown()`, and by their endings the files of `texts()`.
    """
    from harvester.files.writing import write_json

    # If one place is full, the other still gets the result.
    try:
        if json:
            write_json(json, content.to_dict())
    finally:
        if output:
            _write_folder(os.fspath(output), name, content)


def _write_folder(folder: str, name: str, content: Shown) -> None:
    from harvester.files.tables import write_csv, write_netcdf
    from harvester.files.writing import in_folder, write_json, write_text
    from harvester.show import figures

    places = [in_folder(folder, f"{name}{ending}") for ending in RESULT_FILES]
    json_file, densities, picture, joint_picture, table, grid, page = places
    write_json(json_file, content.to_dict())
    if hasattr(content, "density_table"):
        write_text(densities, content.density_table())
    if hasattr(content, "data"):
        write_csv(table, *content.data())
        # NetCDF is an extra; the other files hold the same.
        if hasattr(content, "to_xarray") and importlib.util.find_spec("xarray"):
            write_netcdf(grid, content.to_xarray())
    if hasattr(content, "markdown"):
        write_text(page, content.markdown())
    for ending, text in content.texts().items() if hasattr(content, "texts") else ():
        write_text(in_folder(folder, f"{name}{ending}"), text)
    figure = content.figure()
    if figure is not None:
        figures.write(figure, picture)
    joint = content.joint_figure() if hasattr(content, "joint_figure") else None
    if joint is not None:
        figures.write(joint, joint_picture)
    several = figure is not None or hasattr(content, "markdown")
    say(f"written to {folder}: {name}.{'*' if several else 'json'}")

"""The files of a result: JSON, tables, figures and other texts."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path

from harvester.base.errors import HarvesterError, OutputError
from harvester.base.plain_text import shown
from harvester.base.tables import write_csv, write_netcdf
from harvester.base.writing import in_folder, write_json, write_text
from harvester.results import figures
from harvester.results.view import ResultBase

ENDINGS = (".csv", ".nc", ".png", ".svg", ".pdf")


def save(result: ResultBase, target: str | os.PathLike, name: str = "") -> list[str]:
    """Write a result into a folder, or into one file, each file whole or not at all.

    A folder gets JSON, a CSV table, the figures, the result's texts and, of a result with axes of
    its own, NetCDF if xarray is installed.

    Parameters
    ----------
    result : ResultBase
    target : str or Path
        A file that ends in .json, .csv, .nc, .png, .svg or .pdf; without an ending a folder.
    name : str
        Beginning of the names of the folder's files (default: the scene's name and the kind of
        result).

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    HarvesterError
        It is no result; `OutputError` where a file cannot be written.
    """
    if not isinstance(result, ResultBase):
        raise HarvesterError(
            f"save: {shown(result)}: is no result: pass the return value of simulate or of a study"
        )
    if not isinstance(target, (str, os.PathLike)):
        raise HarvesterError(f"save: {shown(target)}: is no path of a file or a folder")
    directory = Path(target)
    has_ending = directory.suffix[1:].isalpha() and not directory.is_dir()
    if directory.suffix in ENDINGS or (has_ending and not name):
        _write_one(result, directory)
        return [directory.name]
    view, names = result.view(), []
    kind = re.sub("(?<=[a-z])(?=[A-Z])", "-", type(result).__name__).lower()
    name = name or "-".join([*([result.scene.name] if result.scene else []), kind])

    def file(ending):
        names.append(f"{name}{ending}")
        return in_folder(directory, names[-1])

    write_json(file(".json"), result.to_dict())
    write_csv(file(".csv"), *view.data())
    if view.dataset and importlib.util.find_spec("xarray"):
        write_netcdf(file(".nc"), view.dataset())
    for ending, text in view.texts().items() if view.texts else ():
        write_text(file(ending), text)
    for picture in view.pictures:
        figure = picture.figure()
        if figure is not None:
            figures.write(figure, file(f"{picture.name and '-'}{picture.name}.png"))
    return names


def _write_one(result, path):
    if path.suffix == ".json":
        write_json(path, result.to_dict())
    elif path.suffix == ".csv":
        result.to_csv(path)
    elif path.suffix == ".nc":
        write_netcdf(path, result.to_xarray())
    elif path.suffix not in ENDINGS:
        raise HarvesterError(
            f"save: {path}: its ending says the kind: .json, {', '.join(ENDINGS)}, or none"
        )
    else:
        figure = result.figure()
        if figure is None:
            raise OutputError(f"{path}: the result has no figure")
        figures.write(figure, path)

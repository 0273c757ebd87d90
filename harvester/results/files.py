"""Write a result's files: JSON, tables, figures and texts."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path

from harvester.base.errors import HarvesterError, OutputError, UnknownQuantity
from harvester.base.plain_text import named, shown
from harvester.base.tables import write_csv, write_netcdf
from harvester.base.writing import in_folder, write_json, write_text
from harvester.results import figures
from harvester.results.view import ResultBase
from harvester.scene.model import Scene
from harvester.scene.text import key_comments, scene_text

ENDINGS = (".csv", ".nc", ".png", ".svg", ".pdf")
KINDS = f"a file that ends in .json, {', '.join(ENDINGS)}, or a folder"


def save(result: ResultBase | Scene, target: str | os.PathLike, name: str = "") -> list[str]:
    """Write a result to a folder or a file, each file completely or not at all.

    A folder receives JSON, a CSV table, the figures and the result's texts. If the result has its
    own axes and xarray is installed, it also receives NetCDF.

    Parameters
    ----------
    result : ResultBase or Scene
        A scene needs a file that ends in .toml.
    target : str or Path
        A file that ends in .json, .csv, .nc, .png, .svg, .pdf or .toml; without a suffix, a folder.
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
        `result` or `target` is not usable; `OutputError` if a file cannot be written.
    """
    if not isinstance(target, (str, os.PathLike)) or not str(target).strip():
        raise HarvesterError(f"save: {shown(target)} is not a path; give {KINDS}")
    # A command has already expanded `~`, and its folder may contain intermediate results.
    directory = Path(target if name else os.path.expanduser(target))
    ending = directory.suffix.lower()
    if isinstance(result, Scene) and ending == ".toml":
        write_text(directory, scene_text(result, key_comments(result), [result.name]))
        return [directory.name]
    if isinstance(result, Scene):
        raise HarvesterError(f"save: {named(str(directory))}: a scene's file ends in .toml")
    if not isinstance(result, ResultBase):
        raise HarvesterError(
            f"save: {shown(result)} is not a result; pass the return value of simulate or of a "
            "study, or a scene"
        )
    if not name and (not directory.is_dir() or directory.name == ".."):
        if ending in (".json", *ENDINGS):
            _write_one(result, directory, ending)
            return [directory.name]
        if ending or directory.name.startswith("."):
            raise HarvesterError(f"save: {named(str(directory))}: give {KINDS} without a dot")
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


def _write_one(result, path, ending):
    if ending == ".json":
        write_json(path, result.to_dict())
    elif ending == ".csv":
        result.to_csv(path)
    elif ending == ".nc":
        write_netcdf(path, result.to_xarray())
    else:
        try:
            figures.write(result.figure(), path)
        except UnknownQuantity as error:
            raise OutputError(f"{path}: {error}") from None

"""Formats of `harvester export` by name, with functions that write files and return paths.

To add a format, write such a function of a prepared scene and add it to `FORMATS`. Its optional
arguments are the format's options of `harvester export`.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.base.errors import HarvesterError
from harvester.base.plain_text import nearest

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# Module and function of each format; a module is imported at its first use.
FORMATS = {
    "deck": ("deck", "write_deck"),
    "subckt": ("block", "write_subcircuit"),
    "verilog-a": ("block", "write_verilog_a"),
    "fmu": ("fmu", "write_fmu"),
    "c": ("device_code", "write_c"),
    "csv": ("traces", "write_csv"),
    "shepherd": ("traces", "write_shepherd"),
}


def write(
    scene: Scene,
    kind: str,
    output: str | Path,
    report: Callable[[str], None] = lambda text: None,
    **options: Any,
) -> list[Path]:
    """Write a scene in one of the formats.

    Parameters
    ----------
    kind : str
        A name in `FORMATS`.
    output : str or Path
        Folder; for a deck also a file, or - for standard output.
    report : callable
        Called with one-line notes and with the names of the files.
    **options
        Options of the format; None means the format's default.

    Returns
    -------
    list of Path
        Written files; empty for standard output.

    Raises
    ------
    HarvesterError
        The format is unknown or does not have an option.
    """
    # Imported here, since the command line's help imports this module and numpy would delay it.
    from harvester.scene.prepared import prepared

    if kind not in FORMATS:
        raise HarvesterError(
            f"--as {kind}: no such kind{nearest(kind, FORMATS)}; there are {', '.join(FORMATS)}"
        )
    module, function = FORMATS[kind]
    writer = getattr(importlib.import_module(f"harvester.interop.{module}"), function)
    arguments = {name: value for name, value in options.items() if value is not None}
    parameters = inspect.signature(writer).parameters
    for name in arguments:
        if name not in parameters:
            raise HarvesterError(
                f"--{name.replace('_', '-')}: `export --as {kind}` has no such option; leave it out"
            )
    if "report" in parameters:
        arguments["report"] = report
    paths = writer(prepared(scene), output, **arguments)
    for path in paths:
        report(f"written: {path}")
    return paths

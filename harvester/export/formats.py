"""Formats of `harvester export` by name: each is a function that writes files and returns their
paths.

A further kind is a function here and its entry in `FORMATS`. Its keyword arguments are those
options of `harvester export` that it has.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harvester.errors import HarvesterError
from harvester.files.plain_text import nearest

if TYPE_CHECKING:
    from harvester.scene.model import Scene


def write(
    scene: Scene,
    kind: str,
    output: str | Path,
    report: Callable[[str], None] = lambda text: None,
    **options: Any,
) -> list[Path]:
    """Write a scene as one of the kinds.

    Parameters
    ----------
    scene : harvester.scene.model.Scene
    kind : str
        A name in `FORMATS`.
    output : str or Path
        Folder; for a deck also a file, or - for standard output.
    report : callable
        Told what the reader must know of what is written, in a line each.
    **options
        Those of the kind; None stands for the kind's own default.

    Returns
    -------
    list of Path
        The files that were written; none for standard output.

    Raises
    ------
    HarvesterError
        No such kind, or an option that it does not have.
    """
    if kind not in FORMATS:
        raise HarvesterError(
            f"--as {kind}: no such kind{nearest(kind, FORMATS)}; there are {', '.join(FORMATS)}"
        )
    writer = FORMATS[kind]
    arguments = {name: value for name, value in options.items() if value is not None}
    parameters = inspect.signature(writer).parameters
    for name in arguments:
        if name not in parameters:
            raise HarvesterError(
                f"--{name.replace('_', '-')}: `export --as {kind}` has no such option; leave it out"
            )
    if "report" in parameters:
        arguments["report"] = report
    return writer(scene, output, **arguments)


def deck(
    scene: Scene,
    output: str | Path,
    *,
    dialect: str = "ngspice",
    step: str | float = "default",
    realization: int = 0,
) -> list[Path]:
    """A whole deck with load and noise, see `harvester.export.deck.write_deck`."""
    from harvester.export.deck import write_deck

    return write_deck(scene, output, dialect, step, realization)


def subckt(
    scene: Scene,
    output: str | Path,
    *,
    dialect: str = "ngspice",
    step: str | float = "default",
    realization: int = 0,
    displacement_unit: float = 1e-3,
    duration: float | None = None,
) -> list[Path]:
    """A sub-circuit in SI, see `harvester.export.block.write_subcircuit`."""
    from harvester.export.block import write_subcircuit

    return write_subcircuit(scene, output, dialect, step, realization, displacement_unit, duration)


def verilog_a(
    scene: Scene,
    output: str | Path,
    *,
    step: str | float = "default",
    realization: int = 0,
    displacement_unit: float = 1e-3,
    duration: float | None = None,
) -> list[Path]:
    """A Verilog-A module in SI, see `harvester.export.block.write_verilog_a`."""
    from harvester.export.block import write_verilog_a

    return write_verilog_a(scene, output, step, realization, displacement_unit, duration)


def c(scene: Scene, output: str | Path) -> list[Path]:
    """The device as C, see `harvester.export.device_code.write_c`."""
    from harvester.export.device_code import write_c

    return write_c(scene, output)


def fmu(scene: Scene, output: str | Path, *, report: Callable[[str], None]) -> list[Path]:
    """The device as FMUs of both versions, see `harvester.export.fmu.write_fmu`."""
    from harvester.export.fmu import write_fmu

    return write_fmu(scene, output, report)


def csv(
    scene: Scene,
    output: str | Path,
    *,
    rate: float | None = None,
    duration: float | None = None,
    realization: int = 0,
    report: Callable[[str], None],
) -> list[Path]:
    """Voltage and current over time, see `harvester.export.traces.write_csv`."""
    from harvester.export.traces import write_csv

    return write_csv(scene, output, rate, duration, realization, report)


def shepherd(
    scene: Scene,
    output: str | Path,
    *,
    data: str = "ivsample",
    duration: float | None = None,
    realization: int = 0,
    report: Callable[[str], None],
) -> list[Path]:
    """The same for the Shepherd testbed, see `harvester.export.traces.write_shepherd`."""
    from harvester.export.traces import write_shepherd

    return write_shepherd(scene, output, data, duration, realization, report)


FORMATS: dict[str, Callable[..., list[Path]]] = {
    "deck": deck,
    "subckt": subckt,
    "verilog-a": verilog_a,
    "fmu": fmu,
    "c": c,
    "csv": csv,
    "shepherd": shepherd,
}

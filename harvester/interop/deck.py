"""`harvester netlist`: a complete deck of a scene, with load and noise."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from circuits.equivalent.export import for_ltspice, stand_alone
from harvester.base.errors import HarvesterError
from harvester.base.plain_text import name as name_of
from harvester.base.plain_text import nearest
from harvester.base.writing import check_writable, in_folder, is_stream, write_text
from harvester.engines.simulate import check_step
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import Prepared

if TYPE_CHECKING:
    from harvester.scene.model import Scene

DIALECTS = ("ngspice", "ltspice")


def write_deck(
    setup: Prepared,
    output: str | Path,
    dialect: str = "ngspice",
    step: str | float = "default",
    realization: int = 0,
) -> list[Path]:
    """Write a self-contained .cir with load and noise; for LTspice the noise in a second file.

    Parameters
    ----------
    output : str or Path
        File, or folder for SCENE.cir; - for standard output.
    dialect : str
        One of `DIALECTS`.
    step : str or float
        Longest step, see `harvester.scene.steps.steps_per_sample`.
    realization : int
        Number of the realization that defines the noise path.

    Raises
    ------
    HarvesterError
    """
    check_dialect(dialect, DIALECTS)
    scene, target = setup.scene, output
    if is_stream(target) and dialect != "ngspice":
        raise HarvesterError(
            "--dialect ltspice also writes a noise file: name the deck by --output FILE.cir"
        )
    if not is_stream(target) and (Path(target).is_dir() or not Path(target).suffix):
        target = in_folder(target, f"{scene.name}.cir")
    check_writable(target)
    check_realization(scene, realization)
    call = (setup, noise_path(setup, realization))
    start, longest = start_state(setup, realization), check_step(step)
    if dialect == "ngspice":
        write_text(target, stand_alone(*call, start, longest).text + ".end\n")
        return [] if is_stream(target) else [Path(target)]
    # The netlist refers to the noise file by this name.
    noise_file = name_of(Path(target).with_suffix("").name) + "-noise.txt"
    text, noise = for_ltspice(*call, noise_file, start, longest)
    written = [Path(target)]
    if noise is not None:
        written.append(in_folder(Path(target).parent, noise_file))
        write_text(written[-1], noise)
    write_text(target, text)
    return written


def check_dialect(dialect: str, dialects: tuple[str, ...]) -> None:
    """Raise HarvesterError if a dialect is unknown."""
    if dialect not in dialects:
        raise HarvesterError(
            f"--dialect {dialect}: no such dialect{nearest(dialect, dialects)}; "
            f"there are {', '.join(dialects)}"
        )


def check_realization(scene: Scene, realization: int) -> None:
    """Raise HarvesterError if the scene does not have a realization."""
    if not 0 <= realization < scene.run.realizations:
        raise HarvesterError(
            f"--realization {realization}: must be a whole number in "
            f"[0, {scene.run.realizations - 1}]"
        )

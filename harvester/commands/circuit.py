"""Commands about the circuit: its netlist, its drawing, and the ngspice that runs it."""

from __future__ import annotations

import re
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from harvester.commands.quiet import say
from harvester.errors import HarvesterError
from harvester.files.plain_text import name as name_of
from harvester.files.plain_text import nearest
from harvester.signatures import File, Step

if TYPE_CHECKING:
    from harvester.scene.model import Scene

# The cost of a new load is stated for a record of this length, in seconds.
RECORD = 10.0
DIALECTS = ("ngspice", "ltspice")


def netlist(
    scene: Scene,
    *,
    output: File = "-",
    dialect: str = "ngspice",
    step: Step = "default",
    realization: int = 0,
) -> None:
    """Write a stand-alone .cir that plain `ngspice -b` runs.

    Parameters
    ----------
    scene : Scene
    output : str
        File, or folder for SCENE.cir (default: standard output).
    dialect : str
        ngspice, or ltspice, with the noise in FILE-noise.txt beside FILE.
    step : str or float
        default, fine, finest, or the longest step in seconds.
    realization : int
        Whose noise path.
    """
    from circuits.export import for_ltspice, stand_alone
    from harvester.files.writing import check_writable, in_folder, is_stream, write_text
    from harvester.prepared.paths import noise_path, start_state
    from harvester.prepared.prepared import prepared
    from harvester.simulation.simulate import check_step

    if dialect not in DIALECTS:
        raise HarvesterError(
            f"--dialect {dialect}: no such dialect{nearest(dialect, DIALECTS)}; "
            f"there are {', '.join(DIALECTS)}"
        )
    target: str | Path = output
    if is_stream(target) and dialect != "ngspice":
        raise HarvesterError(
            "--dialect ltspice writes a second file, the noise: say where, --output FILE.cir"
        )
    if target != "-" and Path(target).is_dir():
        target = in_folder(target, f"{scene.name}.cir")
    check_writable(target)
    if not 0 <= realization < scene.run.realizations:
        raise HarvesterError(
            f"--realization {realization}: must be a whole number in "
            f"[0, {scene.run.realizations - 1}]"
        )
    ready = prepared(scene)
    call = (ready, noise_path(ready, realization))
    start, longest = start_state(ready, realization), check_step(step)
    if dialect == "ngspice":
        write_text(target, stand_alone(*call, start, longest).text + ".end\n")
        return
    # The netlist refers to the file of the noise by this name.
    noise_file = name_of(Path(target).with_suffix("").name) + "-noise.txt"
    text, noise = for_ltspice(*call, noise_file, start, longest)
    if noise is not None:
        write_text(in_folder(Path(target).parent, noise_file), noise)
    write_text(target, text)


def load(
    file: File,
    /,
    *,
    nodes: str | None = None,
    remove: str = "",
    output: File = "-",
) -> None:
    """Make a load of a schematic's netlist, as LTspice writes it (.net, .cir).

    Parameters
    ----------
    file : str
    nodes : str or None
        The harvester's two nodes and the output's two, P,N,OUT,REF or P,N (default: asked for).
    remove : str
        Elements that stand for the harvester, beside the sources between its nodes: V1,C1.
    output : str
        The load's file, NAME.lib (default: standard output).
    """
    from circuits.loads.imported import candidates, imported
    from circuits.loads.own_motion import following_notes
    from circuits.loads.reader import read_text
    from circuits.loads.subcircuits import read_load
    from harvester.files.writing import check_writable, is_stream, write_text

    check_writable(output)
    text = read_text(Path(file))
    given = nodes or _asked(candidates(text))
    stem = Path(file if is_stream(output) else output).stem
    made = imported(text, re.sub(r"\W", "_", stem).lower(), _words(given), _words(remove))
    write_text(output, made.text)
    for line in made.rewritten:
        say(line)
    if not is_stream(output):
        for note in following_notes(read_load(Path(output)), RECORD):
            say(note)
        say(f"written: {output}; now try: harvester simulate device --set load.netlist={output}")


def _words(text):
    return [word.strip() for word in text.split(",") if word.strip()]


def _asked(found):
    """The harvester's nodes, from whoever sits at the terminal."""
    listed = f"nodes: {', '.join(found)}"
    if not sys.stdin.isatty():
        raise HarvesterError(f"--nodes P,N,OUT,REF: say which are the harvester's; {listed}")
    print(f"{listed}\nharvester's two and the output's two, P,N,OUT,REF: ", end="", file=sys.stderr)
    return sys.stdin.readline()


def schematic(scene: Scene, *, output: File = "-") -> None:
    """Draw the circuit that the scene really builds, as SVG or PNG.

    Parameters
    ----------
    scene : Scene
    output : str
        An .svg or .png file, or folder for SCENE-schematic.svg (default: SVG to standard output).
    """
    from circuits.schematic.drawing import schematic
    from harvester.files.writing import in_folder, is_stream, write_text

    drawing = schematic(scene)
    if is_stream(output):
        write_text(output, drawing.image().decode() + "\n")
        return
    target = Path(output)
    if target.is_dir() or not target.suffix:
        target = in_folder(target, f"{scene.name}-schematic.svg")
    drawing.save(target)
    say(f"written to {target}")


def engine(*, json: File | None = None) -> None:
    """Show the ngspice that was found, its features and the compiled device.

    Parameters
    ----------
    json : str or None
        Write JSON; - for standard output.
    """
    from circuits.ngspice.engine import describe
    from harvester.commands.console import show_engine
    from harvester.files.writing import check_writable, is_standard_output, write_json
    from harvester.workers.process import Worker

    if json:
        check_writable(json)
    with closing(Worker()) as worker:
        found = worker.call(describe, {}, time_limit=60.0)
    show_engine(found, to_stderr=is_standard_output(json))
    if json:
        write_json(json, found)

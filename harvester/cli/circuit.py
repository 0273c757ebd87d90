"""Commands about the circuit: its netlist, its drawing, and the ngspice that runs it."""

from __future__ import annotations

import re
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from harvester.base.errors import HarvesterError
from harvester.base.signatures import File, Hertz, Kind, Metres, Seconds, Step
from harvester.cli.shown import is_quiet, say
from harvester.interop.formats import write
from harvester.scene.calling import takes_scene

if TYPE_CHECKING:
    from harvester.scene.model import Scene

Output = Annotated[str | Path, Kind("FILE", "a path", lambda value: isinstance(value, (str, Path)))]
# The notes on a new load give its computing time for a record of this length, in seconds.
RECORD = 10.0


@takes_scene
def netlist(
    scene: Scene,
    *,
    output: Output = "-",
    dialect: str = "ngspice",
    step: Step = "default",
    realization: int = 0,
) -> None:
    """Write a self-contained .cir that plain `ngspice -b -r FILE.raw` runs.

    Parameters
    ----------
    scene : Scene
    output : str
        File, or folder for SCENE.cir (default: standard output).
    dialect : str
        ngspice, or ltspice, with the noise in FILE-noise.txt next to FILE.
    step : str or float
        default, fine, finest, or the longest step in seconds.
    realization : int
        Number of the realization whose noise path is written.

    Examples
    --------
    ::

        harvester netlist paper --set run.duration=100 --output paper.cir
    """
    write(scene, "deck", output, say, dialect=dialect, step=step, realization=realization)


@takes_scene
def export(
    scene: Scene,
    *,
    kind: Annotated[str, Kind("KIND", option="as")] = "deck",
    output: Output = "-",
    dialect: str | None = None,
    step: Step | None = None,
    realization: int | None = None,
    displacement_unit: Metres | None = None,
    duration: Seconds | None = None,
    rate: Hertz | None = None,
    data: str | None = None,
) -> None:
    """Export a scene to other tools.

    Parameters
    ----------
    scene : Scene
    kind : str
        deck, the whole circuit with its noise (default); subckt and verilog-a, a block in SI for
        your circuits; fmu, for co-simulation; c, the device's code; csv and shepherd, voltage and
        current of the load over time.
    output : str
        Folder, or for a deck also a file (default: standard output).
    dialect : str or None
        ngspice (default), ltspice; of a subckt also pspice, xyce.
    step : str or float
        default, fine, finest, or the longest step in seconds.
    realization : int or None
        Number of the realization whose noise path is written (default: 0).
    displacement_unit : float or None
        Displacement in metres that one volt at a block's pin x represents (default: 1e-3).
    duration : float or None
        For a block: duration of its test deck and vibration, in s (default: 25 periods); for a
        trace: its duration (default: the scene's).
    rate : float or None
        For csv: samples per second (default: 10000); Shepherd's rate is 100000.
    data : str or None
        For shepherd: ivsample (default), or isc_voc.

    Examples
    --------
    ::

        harvester export device --as deck --output block
    """
    from harvester.cli.console import progress

    options: dict[str, Any] = {
        "dialect": dialect, "step": step, "realization": realization,
        "displacement_unit": displacement_unit, "duration": duration, "rate": rate, "data": data,
    }  # fmt: skip
    with progress("export"):
        write(scene, kind, output, say, **options)


def load(file: File, /, *, nodes: str | None = None, remove: str = "", output: File = "-") -> None:
    """Convert a schematic's netlist, as LTspice writes it (.net, .cir), to a load.

    Parameters
    ----------
    file : str
    nodes : str or None
        The harvester's two nodes and the output's two, P,N,OUT,REF or P,N (default: asked for).
    remove : str
        Elements that represent the harvester, in addition to the sources between its nodes: V1,C1.
    output : str
        The load's file, NAME.lib (default: standard output).

    Examples
    --------
    ::

        harvester load rectifier.net --nodes N001,N002,out,0 --output rectifier.lib
    """
    from circuits.netlist.imported import candidates, imported
    from circuits.netlist.load_notes import following_notes
    from circuits.netlist.reader import read_cards, read_text
    from circuits.netlist.subcircuits import read_load
    from circuits.netlist.vetting import tidy
    from harvester.base.writing import check_writable, is_stream, write_text

    check_writable(output)
    text = read_text(Path(file))
    listed = f"nodes: {', '.join(candidates(text))}"
    if not nodes and not sys.stdin.isatty():
        raise HarvesterError(f"--nodes P,N,OUT,REF: name the harvester's nodes; {listed}")
    if not nodes:
        print(f"{listed}\nharvester's two and the output's, P,N,OUT,REF: ", end="", file=sys.stderr)
        nodes = sys.stdin.readline()
    stem = Path(file if is_stream(output) else output).stem
    name = re.sub(r"\W", "_", stem).lower()
    converted = imported(text, name, _words(nodes), _words(remove), Path(file).name)
    target = Path(file).with_suffix(".lib") if is_stream(output) else Path(output)
    # The load has no file yet, so messages name the lines of the netlist.
    lines = enumerate(converted.cards, start=1)
    origins = {f"{target.name}:{number}": card.where for number, card in lines}
    cards = [
        tidy(card._replace(where=origins.get(card.where, card.where)))
        for card in read_cards(target, converted.text)
    ]
    notes = following_notes(read_load(target, cards=cards), RECORD)
    write_text(output, converted.text)
    for line in (*converted.rewritten, *notes):
        say(line)
    if not is_stream(output):
        say(f"written: {output}; now try: harvester simulate device --set load.netlist={output}")


def _words(text):
    return [word.strip() for word in text.split(",") if word.strip()]


def schematic(scene: Scene, *, output: File = "-") -> None:
    """Draw the circuit that is simulated for a scene, as SVG or PNG.

    Parameters
    ----------
    scene : Scene
    output : str
        An .svg or .png file, or folder for SCENE-schematic.svg (default: SVG to standard output).

    Examples
    --------
    ::

        harvester schematic device --set load.netlist=bridge --output bridge.svg
    """
    from circuits.equivalent.schematic.drawing import schematic
    from harvester.base.writing import in_folder, is_stream, write_text

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
    """Show the ngspice that was found, its features, and the state of the compiled device.

    Parameters
    ----------
    json : str or None
        File for JSON; - is standard output.

    Examples
    --------
    ::

        harvester engine --json -
    """
    from circuits.ngspice.engine import describe
    from harvester.base.worker_process import Worker
    from harvester.base.writing import check_writable, is_standard_output, write_json

    if json:
        check_writable(json)
    with closing(Worker()) as worker:
        description = worker.call(describe, {}, time_limit=60.0)
    features = [name for name in ("xspice", "cider", "osdi", "klu") if description[name]]
    if not is_quiet():
        print(
            f"{description['version']} from {description['library']}",
            f"features: {', '.join(features) or 'none of XSPICE, CIDER, OSDI, KLU'}",
            f"compiled device: {description['compiled_device_off'] or 'on'}",
            sep="\n",
            file=sys.stderr if is_standard_output(json) else sys.stdout,
        )
    if json:
        write_json(json, description)

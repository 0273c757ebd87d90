"""Writes a device as a `.subckt` or a Verilog-A module, with a test deck and its vibration."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from circuits.equivalent.assembly import RECTIFIER_NEWTON
from circuits.equivalent.block.head import head, longest_step
from circuits.equivalent.block.parameters import Parameters, check_block
from circuits.equivalent.block.spice import PINS, subcircuit
from circuits.equivalent.block.target_dialects import DIALECTS, in_dialect
from circuits.equivalent.block.verilog_a import module
from circuits.equivalent.elements import STRAY_SHARE
from circuits.equivalent.export import MOST_KNOTS
from harvester.base.errors import HarvesterError, NetlistError
from harvester.base.writing import check_folder, in_folder, is_stream, write_text
from harvester.device import timescales
from harvester.engines.simulate import check_step
from harvester.interop.deck import check_dialect, check_realization
from harvester.interop.symbols import kicad_symbol, ltspice_symbol
from harvester.scene.paths import noise_path, start_state
from harvester.scene.steps import STEP_LEVELS, knot_spacing

if TYPE_CHECKING:
    from harvester.scene.prepared import Prepared

# Default duration of the deck, in periods of the device.
TEST_PERIODS = 25
# Tolerance of the deck: with ngspice's default of 1e-3 Newton's iterations end early; from 1e-6 to
# 1e-9 the path error of the scene `tristable` halves. A rectifier does not converge at 1e-9.
TOLERANCES = "reltol=1e-9"
POINTS_PER_LINE = 4
# Endings of names that are files, not folders.
DATA_SUFFIXES = (".csv", ".h5", ".hdf5")


@dataclass(frozen=True)
class Block:
    """A device's block with the data that its deck needs.

    Attributes
    ----------
    name : str
        Name of sub-circuit or module, and of the files.
    vibration : ndarray of shape (knots, 2)
        Time (s) and acceleration of the base (m/s²), linear between the knots.
    step, stop : float
        Longest step and end of the deck (s).
    """

    ready: Prepared
    name: str
    parameters: Parameters
    vibration: np.ndarray
    step: float
    stop: float

    @property
    def comment(self) -> list[str]:
        """The header of the block's file; see `circuits.equivalent.block.head.head`."""
        return head(self.ready, self.parameters)

    @property
    def covered(self) -> str:
        """A sentence on the time that the vibration covers."""
        return (
            f"the vibration covers {self.vibration[-1, 0]:.4g} s and then keeps its last value: "
            "--duration SECONDS lengthens it"
        )

    @property
    def load_resistance(self) -> float:
        """Resistance (Ω) of the scene's resistor, else a nearly optimal one."""
        table, resistance = self.ready.scene.transducer, self.ready.setting.resistance
        return resistance or table.matched_resistance(self.parameters.rate)


def block_of(
    setup: Prepared,
    step: str | float = "default",
    realization: int = 0,
    displacement_unit: float = 1e-3,
    duration: float | None = None,
) -> Block:
    """The block of a scene.

    Parameters
    ----------
    step : str or float
        Longest step of the deck: a name in `STEP_LEVELS`, or seconds.
    realization : int
        Number of the realization that defines vibration and start.
    displacement_unit : float
        Metres per volt at the pin `x`.
    duration : float or None
        Duration of the deck (s); None: `TEST_PERIODS`.

    Raises
    ------
    HarvesterError
    """
    scene = setup.scene
    check_block(setup)
    check_realization(scene, realization)
    longest = check_step(step)
    if isinstance(longest, str):
        longest = longest_step(setup) / STEP_LEVELS[longest]
    stop = duration or TEST_PERIODS * 2.0 * math.pi / timescales.angular_frequency(setup.system)
    name = "harvester_" + re.sub(r"\W", "_", scene.name)
    parameters = Parameters(setup, start_state(setup, realization), displacement_unit)
    return Block(setup, name, parameters, _vibration(setup, realization, stop), longest, stop)


def _vibration(ready, realization, stop):
    spacing = knot_spacing(ready)
    knots = math.ceil(stop / spacing - 1e-9) + 1
    if knots > MOST_KNOTS:
        raise NetlistError(
            f"{stop:.4g} s with a sample of the vibration every {spacing:.3g} s are {knots:.3g} "
            f"points, and at most {MOST_KNOTS} are written: choose --duration "
            f"{MOST_KNOTS * spacing:.3g} or less"
        )
    noise = noise_path(ready, realization).read(knots)
    return np.column_stack([spacing * np.arange(knots), -ready.excitation_unit * noise])


def folder_of(output: str | Path, kind: str) -> Path:
    """Return the folder for several files; raise HarvesterError if it cannot be written."""
    if is_stream(output):
        raise HarvesterError(f"--as {kind} writes several files: name a folder by --output DIR")
    if Path(output).suffix.lower() in DATA_SUFFIXES and not Path(output).is_dir():
        folder = Path(output).with_suffix("")
        raise HarvesterError(
            f"--as {kind} chooses file names: --output {output} must be a folder, such as "
            f"--output {folder}"
        )
    check_folder(output)
    return Path(output)


def write_files(folder: Path, files: dict[str, str]) -> list[Path]:
    """Write texts to files of these names in a folder; returns the paths."""
    paths = [in_folder(folder, name) for name in files]
    for path, text in zip(paths, files.values(), strict=True):
        write_text(path, text)
    return paths


def write_subcircuit(
    setup: Prepared,
    output: str | Path,
    dialect: str = "ngspice",
    step: str | float = "default",
    realization: int = 0,
    displacement_unit: float = 1e-3,
    duration: float | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Write the sub-circuit, a symbol, a test deck and the vibration.

    Parameters
    ----------
    output : str or Path
        Folder.
    dialect : str
        One of `circuits.equivalent.block.target_dialects.DIALECTS`.
    step, realization, displacement_unit, duration
        See `block_of`.
    report : callable
        Called with a note on the time that the vibration covers.
    """
    check_dialect(dialect, DIALECTS)
    folder = folder_of(output, "subckt")
    block = block_of(setup, step, realization, displacement_unit, duration)
    report(block.covered)
    comment = "".join(f"* {line}".rstrip() + "\n" for line in block.comment)
    if dialect != "ngspice":
        # These simulators may not read multi-byte characters.
        comment = comment.encode("ascii", "replace").decode()
    name, library = block.name, f"{block.name}.lib"
    files = {library: comment + in_dialect(subcircuit(name, block.parameters), dialect)}
    files |= _vibration_file(block, dialect)
    files[f"{name}_test.cir"] = _deck(block, dialect)
    if dialect == "ngspice":
        files[f"{name}.kicad_sym"] = kicad_symbol(name, library, PINS)
    if dialect == "ltspice":
        files[f"{name}.asy"] = ltspice_symbol(name, library, PINS)
    return write_files(folder, files)


def write_verilog_a(
    setup: Prepared,
    output: str | Path,
    step: str | float = "default",
    realization: int = 0,
    displacement_unit: float = 1e-3,
    duration: float | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Write the Verilog-A module, a deck for VACASK and one for ngspice with OSDI.

    Parameters
    ----------
    setup, output, step, realization, displacement_unit, duration, report
        See `write_subcircuit`.
    """
    folder = folder_of(output, "verilog-a")
    block = block_of(setup, step, realization, displacement_unit, duration)
    report(block.covered)
    name = block.name
    files = {f"{name}.va": module(name, block.parameters), f"{name}_test.sim": _vacask_deck(block)}
    files |= _vibration_file(block, "ngspice")
    files[f"{name}_test.cir"] = _osdi_deck(block)
    return write_files(folder, files)


def _vacask_deck(block):
    """A deck for VACASK, which compiles the module itself.

    After every knot of the vibration VACASK takes a first-order step, which only its tolerance
    shortens: over 25 periods of the scene `tristable` the error was 1.3e-4 at 1e-9, 1.4e-5 at
    1e-10.
    """
    points = ", ".join(f"{float(time)!r}, {float(value)!r}" for time, value in block.vibration)
    name, step, stop = block.name, float(block.step), float(block.stop)
    return f"""{name} with its scene's vibration and a resistor
// vacask {name}_test.sim
ground 0
load "resistor.osdi"
load "{name}.va"
model resistor resistor
model vsource vsource
model {name} {name}
vbase (base 0) vsource type="pwl" wave=[{points}]
harvester (p 0 base x) {name}
rload (p 0) resistor r={block.load_resistance!r}
control
  abort always
  options reltol=1e-10 vntol=1e-12 abstol=1e-15
  analysis {name} tran stop={stop!r} step={step!r} maxstep={step!r} icmode="uic"
endc
"""


def _osdi_deck(block):
    name = block.name
    return f"""* {name} with its scene's vibration and load
* openvaf-r {name}.va -o {name}.osdi; ngspice -b -r {name}.raw {name}_test.cir
* Several threads wait for each other on a busy machine: the same run then took 0.3 to 60 s.
.control
pre_osdi {name}.osdi
set num_threads=1
.endc
.include "{name}_vibration.inc"
Nharvester p 0 base x {name}
.model {name} {name}
{load_of(block).rstrip()}
.options method=trap {_tolerances(block)}
.tran {block.step:.6g} {block.stop:.6g} 0 {block.step:.6g} uic
.end
"""


def _vibration_file(block, dialect):
    """ngspice cannot read PWL points from a file, so its file contains the whole source."""
    points = [f"{float(time)!r} {float(value)!r}" for time, value in block.vibration]
    if dialect != "ngspice":
        return {f"{block.name}_vibration.txt": "\n".join(points) + "\n"}
    lines = [
        "+ " + " ".join(points[first : first + POINTS_PER_LINE])
        for first in range(0, len(points), POINTS_PER_LINE)
    ]
    text = "* acceleration of the base, 1 V for 1 m/s2\nVbase base 0 PWL(\n"
    return {f"{block.name}_vibration.inc": text + "\n".join(lines) + "\n+ )\n"}


def _deck(block, dialect):
    """A complete deck: vibration, block, load, and an analysis with a step limit."""
    name, vibration = block.name, f"{block.name}_vibration"
    source = {
        "ngspice": f'.include "{vibration}.inc"',
        "ltspice": f'Vbase base 0 PWL file="{vibration}.txt"',
    }.get(dialect, f'Vbase base 0 PWL FILE "{vibration}.txt"')
    uic = "SKIPBP" if dialect == "pspice" else "uic"
    times = f".tran {block.step:.6g} {block.stop:.6g} 0 {block.step:.6g} {uic}"
    options = {
        "ngspice": f".options method=trap {_tolerances(block)}",
        "ltspice": f".options method=trap {_tolerances(block)} plotwinsize=0 numdgt=7",
        "pspice": f".options {TOLERANCES}",
        "xyce": ".options timeint method=trap reltol=1e-6 abstol=1e-9",
    }[dialect]
    load = load_of(block, dialect)
    lines = [
        f"* {name} with its scene's vibration and {'a resistor' if load[0] == 'R' else 'load'}",
        f'.include "{name}.lib"',
        source,
        f"Xharvester p 0 base x {name}",
        in_dialect(load, dialect).rstrip(),
        options,
        *([".print tran v(x) v(p) v(base)"] if dialect == "xyce" else []),
        *([".probe"] if dialect == "pspice" else []),
        times,
        ".end",
    ]
    return "\n".join(lines) + "\n"


def _tolerances(block):
    load, parameters = block.ready.scene.load.circuit, block.parameters
    if load is None or load.linear:
        return TOLERANCES
    charge = STRAY_SHARE * block.ready.network.reference_capacitance * block.ready.scales.voltage
    charges = f"chgtol={3.0 * charge:.3g} abstol={charge * parameters.rate:.3g}"
    return f"reltol={RECTIFIER_NEWTON!r} itl4=100 {charges}"


def load_of(block: Block, dialect: str = "ngspice") -> str:
    """The scene's load at the node p in ngspice's syntax, else a resistor."""
    load = block.ready.scene.load.circuit
    if load is None or load.resistance or dialect not in ("ngspice", "ltspice"):
        return f"Rload p 0 {block.load_resistance!r}\n"
    nodes = {"p": "p", "n": "0", "out": "out", "ref": "ref"}
    values = " ".join(f"{name}={value!r}" for name, value in load.parameters * load.is_plain)
    stray = STRAY_SHARE * block.ready.network.reference_capacitance
    strays = [f"Cstray_{pin} {pin} 0 {stray!r}\n" for pin in load.stray_pins]
    call = f"Xload {' '.join(nodes[pin] for pin in load.pins)} {load.name} {values}".rstrip()
    return "".join(strays) + f"{call}\n{load.text if load.is_plain else load.run_text}"

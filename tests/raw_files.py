"""The stand-alone ngspice and the files it writes."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harvester.base.errors import ProgramNotFound
from harvester.validation.other_programs import find_ngspice, read_raw


def ngspice_program():
    """The stand-alone program: the environment's own copy or the system's."""
    try:
        return find_ngspice()
    except ProgramNotFound as missing:
        pytest.skip(str(missing))


def program_46():
    """The program of the release that the circuit engine loads, else another's."""
    own = Path(sys.prefix) / "ngspice-osdi" / "usr" / "bin" / "ngspice"
    return str(own) if own.exists() else ngspice_program()


def run_raw(folder, netlist, program=None, **options):
    """Variables that the program computes of a netlist in a folder, as `read_raw`."""
    command = [program or ngspice_program(), "-b", "-r", "out.raw", netlist]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, **options)
    return read_raw(folder / "out.raw")


def driven(folder, text):
    """Mean square of the output's voltage in plain ngspice, the pins driven by a sine."""
    deck = (
        f"deck\n{text}\nVm pm 0 sin(0 8 25)\nRm pm p 20k\nXload p 0 out ref load\nCo out 0 1e-13\n"
        "Cr ref 0 1e-13\n.options reltol=1e-5 itl4=100\n.tran 20u 0.2 0 20u uic\n"
        ".save v(out) v(ref)\n.end\n"
    )
    (folder / "deck.cir").write_text(deck)
    (folder / "deck.raw").unlink(missing_ok=True)
    command = [program_46(), "-b", "-r", "deck.raw", "deck.cir"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert (folder / "deck.raw").exists(), (done.stdout + done.stderr)[-600:]
    raw = read_raw(folder / "deck.raw")
    return np.trapezoid((raw["v(out)"] - raw["v(ref)"]) ** 2, raw["time"]) / raw["time"][-1]

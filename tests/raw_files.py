"""The stand-alone ngspice and the files it writes."""

import subprocess
import sys
from pathlib import Path

import pytest

from harvester.errors import ProgramNotFound
from harvester.verification.known_results.simulators import find_ngspice, read_raw


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

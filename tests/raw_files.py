"""The stand-alone ngspice and the files it writes."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest


def ngspice_program():
    """The stand-alone program: the environment's own copy or the system's."""
    local = Path(sys.prefix) / "ngspice" / "usr" / "bin" / "ngspice"
    program = str(local) if local.exists() else shutil.which("ngspice")
    if program is None:
        pytest.skip("no ngspice program")
    return program


def run_raw(folder, netlist, **options):
    """Variables that the program computes of a netlist in a folder, as `read_raw`."""
    command = [ngspice_program(), "-b", "-r", "out.raw", netlist]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, **options)
    return read_raw(folder / "out.raw")


def read_raw(path):
    """Variables of a binary ngspice raw file, {name: values}."""
    header, _, data = path.read_bytes().partition(b"Binary:\n")
    lines = header.decode().splitlines()
    count = int(next(line.split(":")[1] for line in lines if line.startswith("No. Variables")))
    start = lines.index("Variables:") + 1
    names = [line.split()[1] for line in lines[start : start + count]]
    values = np.frombuffer(data, dtype=float).reshape(-1, count)
    return dict(zip(names, values.T, strict=True))

"""The lowest versions that pyproject.toml allows, and the newest, in environments made anew."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from measured_records import band_noise, scene_of, states

HERE = Path(__file__).parents[1]
PROJECT = tomllib.loads((HERE / "pyproject.toml").read_text())["project"]
# Not for Python code: pre-releases, and a notebook's and a site's programs.
LEFT_OUT = {"fast", "docs", "notebooks", "test", "all"}
SHORT = ["run.duration=20", "run.settle=5", "run.realizations=2"]
SET = [word for each in SHORT for word in ("--set", each)]
BRIDGE = ["--set", "load.netlist=bridge", *SET]
CALLS = [
    ["average", "paper", "--output", "figures"],
    ["validate", "paper", *SET, "--output", "figures"],
    ["simulate", "paper_si", *BRIDGE, "--method", "monte-carlo"],
    ["simulate", "paper_si", *BRIDGE, "--method", "circuit"],
    ["schematic", "paper_si", *BRIDGE, "--output", "bridge.svg"],
    ["identify", "made.toml", "--record", "made.csv", "--alone", "--output", "identified"],
    ["load-study", "paper", *SET, "--sweep", "load.decay_rate=0.05,0.2", "--output", "study"],
    ["completion", "bash"],
]


PIEZO = {"coupling": 1e-3, "capacitance": 5e-8}
SCENE = """units = "SI"
oscillator = {mass = 0.01, damping = 0.04, restoring_force = [0.0, 150.0]}
piezo = {coupling = 1.1e-3, capacitance = 5.2e-8}
load = {kind = "resistor", resistance = 2e5}
excitation = {kind = "white", intensity = 0.01}
run = {duration = 10.0}
"""


def requirements():
    """What is required, and by extras, as pyproject.toml has it."""
    extras = PROJECT["optional-dependencies"]
    named = [each for name, found in extras.items() if name not in LEFT_OUT for each in found]
    return [*PROJECT["dependencies"], *named]


def lowest(requirement):
    """NAME==VERSION of the lower bound, which every requirement has."""
    name, version = re.fullmatch(r"([\w.-]+)[>=]=([\w.]+)", requirement.strip()).groups()
    return f"{name}=={version}"


def python_of(version):
    """A Python of this version that starts, or None."""
    own = f"{sys.version_info.major}.{sys.version_info.minor}" == version
    candidates = [sys.executable] if own else []
    candidates += [shutil.which(f"python{version}")]
    candidates += sorted(map(str, Path.home().glob(f".pyenv/versions/{version}.*/bin/python")))
    for found in filter(None, candidates):
        if subprocess.run([found, "-c", "import venv"], capture_output=True).returncode == 0:
            return found
    return None


def test_every_requirement_has_one_lower_bound():
    assert all(lowest(each) for each in requirements())


@pytest.mark.exhaustive
@pytest.mark.parametrize(("version", "chosen"), [("3.11", lowest), ("3.13", str)])
def test_it_runs_with_what_may_be_installed(tmp_path, version, chosen):
    python = python_of(version)
    if python is None:
        pytest.skip(f"there is no Python {version}")
    subprocess.run([python, "-m", "venv", tmp_path / "venv"], check=True)
    own = tmp_path / "venv" / "bin" / "python"
    wanted = [chosen(each) for each in requirements()]
    subprocess.run([own, "-m", "pip", "install", "--quiet", *wanted], check=True)
    surroundings = {"PYTHONPATH": str(HERE), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    surroundings |= {"NGSPICE_LIBRARY_PATH": library()}
    record(tmp_path)
    for call in CALLS:
        shown = subprocess.run(
            [own, "-P", "-m", "harvester", *call],
            cwd=tmp_path,
            env=os.environ | surroundings,
            capture_output=True,
            text=True,
            timeout=1200,
        )
        assert shown.returncode == 0, f"{call}: {shown.stderr}"
        assert "Warning" not in shown.stderr
    assert (tmp_path / "figures" / "paper-validate.png").exists()


def record(folder):
    """A scene and a record of its device, of three seconds."""
    truth = scene_of(0.01, 0.03, [0.0, 158.0], {"piezo": PIEZO}, 2e5)
    acceleration = band_noise(np.random.default_rng(11), 3000, 1000.0, 4.0, 60.0, 12.0)
    columns = (np.arange(3000) / 1000.0, acceleration, states(truth, acceleration, 1000.0)[2])
    header = "time [s],acceleration [m/s^2],voltage [V]"
    made = folder / "made.csv"
    np.savetxt(made, np.column_stack(columns), delimiter=",", header=header, comments="")
    (folder / "made.toml").write_text(SCENE)


def library():
    from circuits.ngspice.library import find_library

    return find_library()

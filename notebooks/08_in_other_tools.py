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
# # Does the device move the same way in the tools of whoever designs the electronics?
#
# *For whoever designs electronics in another tool.*
#
# `harvester export` writes one device as a sub-circuit for SPICE, as a Verilog-A module and as an
# FMU. Here each of them runs in a program that shares no code with this one, on the same
# vibration, and is laid over this program's own circuit. What is not installed is left out.

# %%
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import harvester
from harvester.interop.block import block_of
from harvester.interop.formats import write
from harvester.validation.other_programs import find_ngspice, find_vacask, read_raw

plt.style.use("harvester.results.house")
folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The device
#
# A beam that strikes a stopper on its right: the contact is what other tools' steps pass over.

# %%
SECONDS = 3.0
scene = harvester.Scene.read("one_sided").replace(
    {"run.duration": SECONDS, "run.settle": 0.0, "run.realizations": 1}
)
for kind in ("subckt", "verilog-a"):
    write(scene, kind, folder / kind, duration=SECONDS)
block = block_of(scene, duration=SECONDS)
time, acceleration = block.vibration.T
print(*block.comment[:16], sep="\n")

# %% [markdown]
# ## This program's circuit

# %%
own = harvester.simulate(scene, method="circuit", step="finest", window=(0.0, SECONDS)).waveform
paths = {}


def keep(name, times, displacement):
    """The displacement in mm at the vibration's knots."""
    paths[name] = np.interp(time[1:-1], times, displacement)


keep("circuit", own.time, 1e3 * own.displacement)

# %% [markdown]
# ## ngspice and VACASK
#
# Both run the deck that was written beside the block.


# %%
def run(name, find, kind, deck, node, *options):
    """Run a deck in its folder and keep the displacement at a node; or say what is missing."""
    try:
        program = find()
    except harvester.HarvesterError as missing:
        print(f"{name} is left out: {missing}")
        return
    subprocess.run([program, *options, deck], cwd=folder / kind, check=True, capture_output=True)
    raw = read_raw(folder / kind / f"{block.name}.raw")
    keep(name, raw["time"], raw[node])


test = f"{block.name}_test"
batch = ("-b", "-r", f"{block.name}.raw")
run("ngspice", find_ngspice, "subckt", f"{test}.cir", "v(x)", *batch)
run("VACASK", find_vacask, "verilog-a", f"{test}.sim", "x", "-qp")

# %% [markdown]
# ## FMPy and PathSim
#
# The FMU has a resistor of its own for a load; its base's acceleration is exchanged every
# half millisecond, a fifth of the time between two knots. Both programs hold an input over an
# exchange; it would be half an exchange late, so they get the value in the middle.

# %%
EXCHANGE = 0.5e-3
load = {"load_resistance": block.load_resistance}


def held(start):
    """The acceleration in the middle of the exchange that starts then."""
    return np.interp(start + EXCHANGE / 2, time, acceleration)


def by_fmpy(file):
    import fmpy

    samples = np.arange(0.0, SECONDS + EXCHANGE, EXCHANGE)
    columns = [samples, held(samples), 0.0 * samples]
    table = np.rec.fromarrays(columns, names="time,base_acceleration,current")
    found = fmpy.simulate_fmu(
        str(file), stop_time=SECONDS, step_size=EXCHANGE, output_interval=EXCHANGE,
        start_values=load, input=table, output=["displacement"],
    )  # fmt: skip
    keep("FMPy", found["time"], 1e3 * found["displacement"])


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
    # A sample between two exchanges holds what the first of them came to.
    moved = scope.read()[1][0]
    keep("PathSim", EXCHANGE * np.arange(1, len(moved) + 1), 1e3 * moved)


write(scene, "fmu", folder / "fmu", report=print)
units = sorted((folder / "fmu").glob("*.fmu"))
for name, drive in (("FMPy", by_fmpy), ("PathSim", by_pathsim)):
    try:
        drive(units[0])
    except ImportError as missing:
        print(f"{name} is left out: {missing}")

# %% [markdown]
# ## Answer

# %%
scale = np.std(paths["circuit"])
off = {
    name: float(np.sqrt(np.mean((path - paths["circuit"]) ** 2)) / scale)
    for name, path in paths.items()
    if name != "circuit"
}
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7.0, 5.0))
for k, (name, path) in enumerate(paths.items()):
    # PathSim's path hides FMPy's.
    line = {"color": f"C{k}", "label": name, "ls": "--" if name == "PathSim" else "-"}
    above.plot(time[1:-1], path, lw=2.5 if name == "circuit" else 1.0, **line)
    if name in off:
        below.semilogy(time[1:-1], np.abs(path - paths["circuit"]) + 1e-9, lw=1.0, **line)
above.set(ylabel="displacement (mm)")
below.set(ylabel="from the circuit's (mm)", xlabel="time (s)")
above.legend(ncols=len(paths), loc="lower center", bbox_to_anchor=(0.5, 1.0))
plt.show()
furthest = max(off, key=off.get)
print(
    f"{len(off)} other tools follow the circuit's path over {SECONDS:g} s; furthest off is "
    f"{furthest}, by {off[furthest]:.1e} of the rms displacement: "
    + ", ".join(f"{name} {share:.1e}" for name, share in off.items())
    + "."
)

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
# # Will it run my node: does this harvester, on this recorded vibration, power this sensor?
#
# *For designers of sensor nodes.*
#
# Mean power and mean consumption do not decide this alone. A converter starts at 5 V, a radio takes
# a thousand times the sleep current for some milliseconds, and a brown-out (too low a voltage)
# resets the node. The notebook therefore simulates the whole chain, from the vibration to the
# bursts of the radio.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import harvester

plt.style.use("harvester.results.house")

# %% [markdown]
# ## A record
#
# This example generates a record: five minutes at 100 Hz, with a broad peak around 12 Hz and slow
# background noise, 0.1 g rms. The machine runs for 15 s of every minute. For your own record set
# `path` to its file.

# %%
rate, length, rms = 100.0, 300.0, 0.1
rng = np.random.default_rng(5)
frequency = np.fft.rfftfreq(int(rate * length), 1.0 / rate)
shape = np.exp(-(((frequency - 12.0) / 3.0) ** 2)) + 0.2 / (1.0 + (frequency / 2.0) ** 2)
acceleration = np.fft.irfft(shape * np.exp(2j * np.pi * rng.random(frequency.size)))
time = np.arange(acceleration.size) / rate
acceleration *= np.where(time % 60.0 < 15.0, rms / acceleration.std(), 0.0)

folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "machine.csv"
table = np.column_stack([time, acceleration])
np.savetxt(path, table, "%.6f", ",", header="time,vertical", comments="")

# %% [markdown]
# ## The chain
#
# The load `node_buck` consists of a bridge, a buffer capacitor, a buck converter with
# undervoltage lockout (LTC3588-1 class), and a node that sends a radio advertisement once a
# second (nRF52832 class). Its file in `netlists/` gives the source of each value. Its lines `*
# measure: …` define the quantities below; your own netlist may contain such lines. Each
# realization begins at another time of the record, with empty capacitors.
#
# Two buffers are compared: the data sheet's 22 µF, and 220 µF to bridge the machine's pauses. The
# larger one charges ten times as long, so that its runs settle for longer. `method="circuit"` would
# run the same chain in ngspice, in about twenty times the time.


# %%
def chain(buffer, **run):
    """The device on the record, with this buffer (F) and the node behind it."""
    load = ["load.netlist=node_buck", f"load.parameters.buffer={buffer}"]
    tables = harvester.Scene.read("device", load).to_tables()
    tables["excitation"] = {
        "kind": "record",
        "file": str(path),
        "column": "vertical",
        "time_column": "time",
        "unit": "g",
        "detrend": "mean",
        "band": [1.0, 40.0],
        "knot_spacing": 0.0025,
        "repetition": "periodic",
    }
    tables["run"] = {"settle": 60.0, "duration": 60.0, "realizations": 16, **run}
    return harvester.Scene.from_tables(tables, name="machine")


# Capacitance (F), and the time to settle (s).
BUFFERS = {"22 µF": (22e-6, 60.0), "220 µF": (220e-6, 200.0)}
results = {
    name: harvester.simulate(chain(buffer, settle=settle), method="monte-carlo")
    for name, (buffer, settle) in BUFFERS.items()
}


def said(result, name, factor=1.0, digits=0):
    """A quantity with its error bar, or why it has none."""
    found = result[name]
    error = found.standard_error
    bar = f" ± {error * factor:.{digits}f}" if error is not None else f" ({found.note})"
    return f"{found.estimate * factor:.{digits}f}{bar}"


for name, result in results.items():
    print(
        f"{name}: {said(result, 'mean_power', 1e6)} µW leave the piezo; first up after "
        f"{said(result, 'node_first_time')} s, then {said(result, 'node_time_share', 100, 1)} % of "
        f"the time; {said(result, 'burst_starts_per_hour')} bursts and "
        f"{said(result, 'node_stops_per_hour', 1, 1)} brown-outs an hour"
    )

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Share of time on, and share of the energy by stage"}}
small, large = results.values()


def shares(result):
    """Where the input's energy goes."""
    damper = result["mean_loss_power"].estimate / result["mean_input_power"].estimate
    losses = {name: result[f"{name}_loss_share"].estimate for name in ("bridge", "shunt", "buck")}
    return {"damper": damper, **losses, "node": result["node_power_share"].estimate}


parts = shares(small)
print(
    f"With 22 µF the node is up {said(small, 'node_time_share', 100)} % of the time, browns out "
    f"{said(small, 'node_stops_per_hour')} times an hour and sends "
    f"{said(small, 'burst_starts_per_hour')} bursts an hour of "
    f"{said(small, 'burst_energy', 1e6, 1)} µJ, first up after {said(small, 'node_first_time')} s: "
    f"{parts['damper']:.0%} of the input's energy stays in the damper, {parts['bridge']:.1%} in "
    f"the bridge, {parts['buck']:.1%} in the converter, and {parts['node']:.1%} gets to the node; "
    f"with 220 µF it is up {said(large, 'node_time_share', 100)} % of the time, first up after "
    f"{said(large, 'node_first_time')} s."
)
_, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.2))
places = np.arange(3)
names = {
    "node_time_share": "node up",
    "converter_time_share": "converter on",
    "burst_starts_per_hour": "bursts, of those due",
}
for k, (buffer, result) in enumerate(results.items()):
    found = [result[name] for name in names]
    factors = np.array([1.0, 1.0, 1.0 / 3600.0])
    values = factors * [each.estimate for each in found]
    errors = factors * [each.standard_error or 0.0 for each in found]
    colour = ("C1", "C0")[k]
    left.bar(places + 0.4 * k, values, 0.4, yerr=errors, color=colour, label=buffer)
    stages = shares(result)
    rows = np.arange(len(stages)) + 0.4 * k
    right.barh(rows, list(stages.values()), 0.4, color=colour)
left.set(xticks=places + 0.2, xticklabels=names.values(), ylabel="share", title="how often")
left.legend()
right.set(yticks=np.arange(len(parts)) + 0.2, yticklabels=parts, xscale="log", xlim=(1e-3, 1.0))
right.set(xlabel="share of the input's energy", title="where the energy goes")
right.invert_yaxis()
plt.show()

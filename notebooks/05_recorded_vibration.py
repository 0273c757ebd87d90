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
# # A recorded vibration: what power would this device give on my machine?
#
# *For users with a record of their machine's vibration.*
#
# A record of the base acceleration replaces the noise: a CSV, `.npy` or `.wav` file with its unit.
# Circuit and Monte Carlo use the same record.

# %%
import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import harvester

plt.style.use("harvester.results.house")

# %% [markdown]
# ## A record
#
# This example generates a record: five minutes at 100 Hz, with a broad peak around 12 Hz and slow
# background noise, in units of g. For your own record set `path` to its file.

# %%
rate, length = 100.0, 300.0
rng = np.random.default_rng(5)
frequency = np.fft.rfftfreq(int(rate * length), 1.0 / rate)
shape = np.exp(-(((frequency - 12.0) / 3.0) ** 2)) + 0.2 / (1.0 + (frequency / 2.0) ** 2)
phases = np.exp(2j * np.pi * rng.random(frequency.size))
acceleration = np.fft.irfft(shape * phases)
acceleration *= 0.5 / acceleration.std()

folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "machine.csv"
time = np.arange(acceleration.size) / rate
table = np.column_stack([time, acceleration])
np.savetxt(path, table, "%.6f", ",", header="time,vertical", comments="")

# %% [markdown]
# ## The scene
#
# `device` is a centimetre-scale harvester. Its table `[excitation]` is replaced by the record,
# which the run uses once. `knot_spacing` adds interpolated samples, since 100 Hz is a low sampling
# rate for vibration at 12 Hz. A record that is too short, unevenly sampled or clipped, or that has
# gaps, is rejected with a message; the key `mend` repairs such faults.

# %%
tables = harvester.Scene.read("device").to_tables()
tables["excitation"] = {
    "kind": "record",
    "file": str(path),
    "column": "vertical",
    "time_column": "time",
    "unit": "g",
    "detrend": "mean",
    "band": [1.0, 40.0],
    "knot_spacing": 0.0025,
}
tables["run"] = {"settle": 5.0, "duration": 294.0, "realizations": 1}
scene = harvester.Scene.from_tables(tables, name="machine")

# %% [markdown]
# ## Circuit and Monte Carlo

# %%
results = {
    engine: harvester.simulate(scene, method=engine, window=(0.0, 6.0))
    for engine in ("circuit", "monte-carlo")
}
for engine, result in results.items():
    power = result.quantity("mean_power")
    print(f"{engine:12} {power.estimate * 1e6:.2f} ± {power.standard_error * 1e6:.2f} µW")
print(*results["circuit"].notes, sep="\n")

# %% [markdown]
# ## Does averaging apply?
#
# Averaging applies only to coloured (Ornstein–Uhlenbeck) noise. `fit` fits it to the record,
# and a note reports how much their spectra differ.

# %%
try:
    fitted = harvester.average(scene, fit=True)
    print(*fitted.notes, sep="\n")
except harvester.HarvesterError as error:
    print(error)

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Spectrum of the record; piezo voltage by circuit, Monte Carlo"}}
circuit, monte_carlo = (results[engine].quantity("mean_power") for engine in results)
joint = math.hypot(circuit.standard_error, monte_carlo.standard_error)
print(
    f"On this record the device gives {circuit.estimate * 1e6:.1f} ± "
    f"{circuit.standard_error * 1e6:.1f} µW; circuit and Monte Carlo are "
    f"{abs(circuit.estimate - monte_carlo.estimate) / joint:.1f} joint standard errors apart."
)
_, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.0))
frequencies, density = welch(
    scene.excitation.samples, 1.0 / scene.excitation.interval, nperseg=1024
)
left.semilogy(frequencies[1:], density[1:])
left.set(
    xlabel="frequency [Hz]", ylabel="density [(m/s²)²/Hz]", title="the record", ylim=(1e-6, None)
)
for engine, style in (("monte-carlo", "-"), ("circuit", "--")):
    waveform = results[engine].waveform
    colour = "C0" if engine == "circuit" else "C1"
    right.plot(waveform.time, waveform.voltage, style, color=colour, label=engine)
right.set(
    xlabel="time [s]", ylabel="voltage [V]", title="the piezo's voltage: paths part, means do not"
)
right.legend(loc="upper left")
plt.show()

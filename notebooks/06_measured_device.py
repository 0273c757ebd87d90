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
# # A measured device: which load suits the harvester on my bench?
#
# *For laboratories: from a shaker record to the best load.*
#
# The mass of the device and the load resistance are known, its other coefficients are not. They are
# fitted to a shaker record of base acceleration and voltage, each with an interval. The last third
# of the record is excluded from the fit, and tests the model's prediction. The best load then
# follows from simulation.

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
# This example generates a record by simulation: the scene `device` with other coefficients, half a
# minute on a shaker, and 2 % of noise on the voltage. The coefficients are not used below. For your
# own record set `path` to its file.

# %%
true = harvester.Scene.read("device").replace(
    {"oscillator.damping": 0.042, "oscillator.linear_stiffness": -58.0, "piezo.coupling": 4.1e-4}
)
rate, length = 500.0, 30.0
rng = np.random.default_rng(6)
frequency = np.fft.rfftfreq(int(rate * length), 1.0 / rate)
spectrum = np.where((frequency > 2.0) & (frequency < 40.0), 1.0, 0.0)
acceleration = np.fft.irfft(spectrum * np.exp(2j * np.pi * rng.random(frequency.size)))
acceleration *= 5.0 / acceleration.std()

folder = tempfile.TemporaryDirectory()
base = Path(folder.name) / "base.npy"
np.save(base, acceleration)
tables = true.to_tables()
tables["excitation"] = {
    "kind": "record",
    "file": str(base),
    "unit": "m/s^2",
    "sampling_rate": rate,
}
tables["run"] = {"duration": length - 0.1, "realizations": 1}
shaken = harvester.Scene.from_tables(tables, name="shaken")
run = harvester.simulate(shaken, method="monte-carlo", window=(0.0, length), step="fine")
time = np.arange(1, int((length - 0.2) * rate)) / rate
voltage = np.interp(time, run.waveform.time, run.waveform.voltage)
voltage += 0.02 * voltage.std() * rng.standard_normal(voltage.size)

path = Path(folder.name) / "shaker.csv"
columns = np.column_stack([time, acceleration[1 : time.size + 1], voltage])
header = "time [s],acceleration [m/s^2],voltage [V]"
np.savetxt(path, columns, "%.7g", ",", header=header, comments="")

# %% [markdown]
# ## From the record to a scene
#
# The scene `device` gives the initial values. Mass and load resistance are fixed; the other values
# are fitted to the first two thirds of the record.

# %% tags=["table"]
found = harvester.identify("device", path)
header, rows = found.table()
for row in [header, *rows]:
    print(f"{row[0]:27}{row[1]:>26}{row[2]:>8}  {row[3]}")

# %%
print(found.headline(), *found.sentences(), sep="\n")

# %% [markdown]
# ## The best load
#
# The identified scene can be used like any other scene.

# %%
scene = found.scene.replace({"run.realizations": 16})
resistances = np.geomspace(5e4, 2e6, 7)
powers = []
for resistance in resistances:
    result = harvester.simulate(
        scene.replace({"load.resistance": float(resistance)}), method="monte-carlo"
    )
    powers.append(result.quantity("mean_power"))
    print(f"{resistance / 1e3:7.0f} kΩ  {powers[-1].estimate * 1e3:.3f} mW")

# %% [markdown]
# ## Answer

# %% mystnb={"image": {"alt": "Measured and predicted voltage, residuals and spectra"}}
best = int(np.argmax([each.estimate for each in powers]))
difference = found.records[0].powers()[2]
print(
    f"On data that no fit used the identified model predicts the mean power to "
    f"{100.0 * difference.estimate:+.2f} ± {100.0 * difference.standard_error:.2f} %, and among "
    f"these loads {resistances[best] / 1e3:.0f} kΩ gives most, {powers[best].estimate * 1e3:.2f} ± "
    f"{powers[best].standard_error * 1e3:.2f} mW."
)
found.figure()

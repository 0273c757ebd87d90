"""Cases of identification: small records, made by scipy, of devices that are a little otherwise."""

from pathlib import Path
from typing import Any

import numpy as np
from measured_records import band_noise, measured, scene_of

from harvester.scene.text import scene_text

RATE, SAMPLES = 1000.0, 1200
MASS, DAMPING, LOAD = 0.01, 0.03, 2e5
STIFFNESS = MASS * (2.0 * np.pi * 20.0) ** 2
HARDENING = 0.6 * STIFFNESS / 2e-3**2
PIEZO = {"piezo": {"coupling": 1e-3, "capacitance": 5e-8}}
COIL = {"coil": {"coupling": 9.0, "resistance": 300.0}}
STOPPERS = {"gap": 2e-3, "stiffness": 2e6, "restitution": 0.7, "exponent": 1.5}
# Name → transducer, load, cubic stiffness, stoppers.
DEVICES = {
    "piezo": (PIEZO, LOAD, HARDENING, None),
    "coil": (COIL, 600.0, HARDENING, None),
    "stoppers": (PIEZO, LOAD, 0.0, STOPPERS),
}
FITTED = {"stoppers": ("--free", "oscillator.damping", "piezo.coupling", "stoppers.stiffness")}
# From what is known beforehand to the truth.
OFF = 1.15


def cases(folder: Path) -> dict[str, dict[str, Any]]:
    """Name of each case → its command; scenes and records go to `folder`."""
    found = {}
    for name in DEVICES:
        (folder / f"{name}.toml").write_text(scene_text(_device(name, OFF), {}, []))
        _write_record(folder / f"{name}-record.csv", _device(name))
        found[f"identify: record of {name}"] = _command(folder, name, "record", FITTED.get(name))
    _write_response(folder / "coil-response.csv")
    found["identify: response of coil"] = _command(folder, "coil", "response", None)
    found["identify: models beside piezo"] = _command(folder, "piezo", "record", (), False)
    return found


def _command(folder, device, kind, more, alone=True):
    words = ["identify", f"{folder}/{device}.toml", "--record", f"{folder}/{device}-{kind}.csv"]
    words += [*(more or ()), *(["--alone"] if alone else [])]
    return {"arguments": [*words, "--json", "answer.json"]}


def _device(name, share=1.0):
    transducer, load, hardening, stoppers = DEVICES[name]
    (table, values), *_ = transducer.items()
    values = {**values, "coupling": values["coupling"] * share}
    force = [0.0, STIFFNESS, 0.0, hardening] if hardening else [0.0, STIFFNESS]
    return scene_of(MASS, DAMPING * share, force, {table: values}, load, stoppers)


def _write_record(file, scene, samples=SAMPLES, seed=3):
    rng = np.random.default_rng(seed)
    base = band_noise(rng, samples, RATE, 4.0, 60.0, 12.0)
    found = measured(scene, base, RATE, rng)
    times = np.arange(samples) / RATE
    _write(file, "time [s],acceleration [m/s^2],voltage [V]", times, base, found.voltage)


def _write_response(file):
    """V/a of the linear coil device at its load R: (k − Mω² + iωC + iωΦ²/(R + Rc)) x = −M a."""
    frequency = np.linspace(12.0, 32.0, 60)
    rate = 2j * np.pi * frequency
    coupling, winding = COIL["coil"]["coupling"], COIL["coil"]["resistance"]
    total = DEVICES["coil"][1] + winding
    dynamic = STIFFNESS + MASS * rate**2 + rate * (DAMPING + coupling**2 / total)
    seen = -MASS * rate * coupling * (total - winding) / total / dynamic
    _write(
        file,
        "frequency [Hz],real [V/(m/s^2)],imaginary [V/(m/s^2)]",
        frequency,
        seen.real,
        seen.imag,
    )


def _write(file, header, *columns):
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="")

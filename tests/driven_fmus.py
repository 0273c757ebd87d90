"""FMUs driven by FMPy and by PathSim, an exchange at a time."""

import ctypes

import numpy as np

from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared

ENERGIES = ("input", "stored", "damper", "contacts", "transducer", "delivered")
LENGTH = 1e-3  # s, of an exchange


def base_acceleration(scene, stop):
    """The first realization's noise as the base's acceleration: times (s) and values (m/s²)."""
    ready = prepared(scene)
    path = noise_path(ready, 0)
    count = round(stop / path.spacing) + 2
    return path.spacing * np.arange(count), -ready.excitation_unit * path.read(count)


def by_fmpy(path, acceleration, stop, length=LENGTH, interpolated=True, **settings):
    """Outputs by name at every exchange of FMI 2.0; the input held, or on in a straight line."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    description = read_model_description(path)
    unit = FMU2Slave(
        guid=description.guid, unzipDirectory=extract(path), instanceName="unit",
        modelIdentifier=description.coSimulation.modelIdentifier,
    )  # fmt: skip
    places = {each.name: each.valueReference for each in description.modelVariables}
    names = [each.name for each in description.modelVariables if each.causality == "output"]
    wanted = [places[name] for name in names]
    unit.instantiate()
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.setReal([places[name] for name in settings], list(settings.values()))
    unit.exitInitializationMode()
    base = (ctypes.c_uint * 1)(places["base_acceleration"])
    rows = [unit.getReal(wanted)]
    for k in range(round(stop / length)):
        now, then = (float(acceleration(t)) for t in (k * length, (k + 1) * length))
        unit.setReal(list(base), [now])
        if interpolated:
            slope = (ctypes.c_double * 1)((then - now) / length)
            unit.fmi2SetRealInputDerivatives(unit.component, base, 1, (ctypes.c_int * 1)(1), slope)
        unit.doStep(k * length, length)
        rows.append(unit.getReal(wanted))
    unit.terminate()
    unit.freeInstance()
    return dict(zip(names, np.array(rows).T, strict=True))


def by_pathsim(path, acceleration, stop, length=LENGTH, **settings):
    """Displacements at every exchange, the input of each held: the first at the beginning."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Scope, Source
    from pathsim_fmi import CoSimulationFMU

    unit = CoSimulationFMU(str(path), start_values=settings, dt=length)
    start = unit.outputs["displacement"]
    source, scope = Source(acceleration), Scope(sampling_period=length, t_wait=0.5 * length)
    Simulation(
        [source, unit, scope],
        [Connection(source, unit["base_acceleration"]), Connection(unit["displacement"], scope)],
        dt=length, log=False,
    ).run(stop)  # fmt: skip
    # A sample between two exchanges holds what the first of them came to.
    return np.concatenate([[start], scope.read()[1][0][: round(stop / length)]])


def imbalance(outputs):
    """Greatest part of the energy put in that is not accounted for."""
    put_in, *others = (outputs[f"energy_{name}"] for name in ENERGIES)
    return np.abs(put_in - sum(others)).max() / np.abs(put_in).max()


def deviation(values, truth):
    """RMS of the difference over that of the truth."""
    return np.sqrt(np.mean((values - truth) ** 2) / np.mean(truth**2))

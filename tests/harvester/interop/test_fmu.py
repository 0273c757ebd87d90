"""FMUs: valid, and on the path of the equations that scipy integrates."""

import numpy as np
import pytest
from device_truths import Written, written_path
from driven_fmus import base_acceleration, by_fmpy, by_pathsim, deviation, imbalance
from scipy.integrate import solve_ivp

import harvester
from harvester.base.errors import ExportError
from harvester.interop.formats import write

pytest.importorskip("fmpy")
from fmpy.validation import validate_fmu

SI = [name for name in harvester.Scene.names() if harvester.Scene.read(name).units == "SI"]


def noisy(name, spacing):
    return harvester.Scene.read(name).replace({"excitation.knot_spacing": spacing})


def noise(scene, stop):
    times, values = base_acceleration(scene, stop)
    return lambda t: np.interp(t, times, values)


@pytest.mark.slow
def test_path_and_energy_under_noise(tmp_path):
    """A one-sided stopper at an exchange every millisecond, whose noise turns every second one."""
    scene, stop = noisy("one_sided", 2e-3), 0.8
    path = write(scene, "fmu", tmp_path)[0]
    assert validate_fmu(str(path)) == []
    outputs = by_fmpy(path, noise(scene, stop), stop, load_resistance=1e6)
    truth = written_path(scene, 400)
    for k, name in enumerate(("displacement", "velocity", "voltage")):
        assert deviation(outputs[name][::2], truth[:, k]) < 1e-6
    assert outputs["energy_contacts"][-1] > 0.01 * outputs["energy_input"][-1]
    assert imbalance(outputs) < 1e-6


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SI)
def test_valid(name, tmp_path):
    for path in write(harvester.Scene.read(name), "fmu", tmp_path):
        assert validate_fmu(str(path)) == []


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "spacing", "resistance"), [("one_sided", 2e-3, 1e6), ("paper_si", 0.05, 1e5)]
)
def test_path_through_fmpy_and_pathsim(name, spacing, resistance, tmp_path):
    """PathSim holds an input over an exchange: it is given the mean over it."""
    scene, knots = noisy(name, spacing), 500
    stop, every, length = knots * spacing, round(spacing / 1e-3), 1e-3
    truth = written_path(scene, knots)
    paths = write(scene, "fmu", tmp_path)
    outputs = by_fmpy(paths[0], noise(scene, stop), stop, load_resistance=resistance)
    for k, quantity in enumerate(("displacement", "velocity", "voltage")):
        assert deviation(outputs[quantity][::every], truth[:, k]) < 1e-6
    assert imbalance(outputs) < 1e-6
    acceleration = noise(scene, stop + length)

    def mean(t):
        # The knots lie on exchanges.
        return 0.5 * (acceleration(t) + acceleration(t + length))

    for path in paths:
        displacement = by_pathsim(path, mean, stop, load_resistance=resistance)
        assert deviation(displacement[::every], truth[:, 0]) < 1e-3


def smooth(t):
    return 1.2 * np.sin(61.0 * t) + 0.8 * np.sin(97.0 * t + 1.0)


def order(run, truth, lengths):
    """Measured order of the error in the exchange's length."""
    errors = [deviation(run(length)[:: round(8e-3 / length)], truth) for length in lengths]
    return np.diff(np.log(errors)) / np.diff(np.log(lengths))


@pytest.mark.exhaustive
def test_order_in_the_exchange(tmp_path):
    """Second with inputs that go on in a straight line, first with inputs that are held."""
    scene, stop = harvester.Scene.read("device"), 0.96
    path = write(scene, "fmu", tmp_path)[0]
    device = Written(scene)
    start = harvester.coupled(scene).displacement
    truth = solve_ivp(
        lambda t, y: device.derivative(y, -smooth(t), 0.0), (0.0, stop), (start, 0.0, 0.0),
        "DOP853", np.arange(121) * 8e-3, rtol=1e-10, atol=1e-14,
    ).y[0]  # fmt: skip
    lengths = (4e-3, 2e-3, 1e-3)
    settings = {"load_resistance": scene.load.resistance}
    drawn = order(
        lambda length: by_fmpy(path, smooth, stop, length, **settings)["displacement"],
        truth, lengths,
    )  # fmt: skip
    held = order(lambda length: by_pathsim(path, smooth, stop, length, **settings), truth, lengths)
    assert drawn == pytest.approx(2.0, abs=0.15)
    assert held == pytest.approx(1.0, abs=0.15)


def test_scaled_scenes_are_refused(tmp_path):
    with pytest.raises(ExportError, match="paper_si"):
        write(harvester.Scene.read("paper"), "fmu", tmp_path)


def test_prescribed_motion_is_refused(tmp_path):
    shaken = {"kind": "prescribed_displacement", "amplitude": 1e-3, "frequency": 5.0}
    tables = {**harvester.Scene.read("one_sided").to_tables(), "excitation": shaken}
    with pytest.raises(ExportError, match="no mass moves"):
        write(harvester.Scene.from_tables(tables), "c", tmp_path)


@pytest.mark.exhaustive
def test_an_importers_mistakes_are_errors(tmp_path):
    """Steps that are no step, and a start set behind it; the device stays where it was."""
    from fmpy import extract, read_model_description
    from fmpy.fmi1 import FMICallException
    from fmpy.fmi2 import FMU2Slave

    path = write(harvester.Scene.read("one_sided"), "fmu", tmp_path)[0]
    description = read_model_description(str(path))
    places = {each.name: each.valueReference for each in description.modelVariables}
    unit = FMU2Slave(
        guid=description.guid, unzipDirectory=extract(str(path)), instanceName="unit",
        modelIdentifier=description.coSimulation.modelIdentifier,
    )  # fmt: skip
    unit.instantiate()
    unit.setupExperiment(startTime=0.0)
    start, displacement = [places["start_displacement"]], [places["displacement"]]
    unit.setReal(start, [5e-4])
    unit.doStep(0.0, 0.01)
    before = unit.getReal(displacement)
    for time, length in ((0.01, -0.01), (0.01, np.nan), (0.01, np.inf), (np.nan, 0.01)):
        with pytest.raises(FMICallException):
            unit.doStep(time, length)
    with pytest.raises(FMICallException):
        unit.setReal(start, [1e-4])
    assert unit.getReal(displacement) == before
    unit.reset()
    unit.setReal(start, [1e-4])
    assert unit.getReal(displacement) == [1e-4]
    unit.freeInstance()

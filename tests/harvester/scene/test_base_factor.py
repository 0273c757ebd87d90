"""[oscillator] base_factor: the base's acceleration counts μ times on a lumped mode."""

import numpy as np
import pytest

import harvester
from circuits.equivalent.export import stand_alone
from harvester.base.errors import HarvesterError, SceneError
from harvester.identification.measurement import Measurement
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared

pytestmark = pytest.mark.usefixtures("shared_workers")

FACTOR = 1.566
BRIEF = {"run.duration": 20.0, "run.settle": 1.0, "run.realizations": 2}


def test_it_is_written_only_where_it_is_not_one():
    scene = Scene.read("paper")
    assert "base_factor" not in scene.to_tables()["oscillator"]
    assert scene.replace({"oscillator.base_factor": 1.0}).digest() == scene.digest()
    assert scene.replace({"oscillator.base_factor": FACTOR}).digest() != scene.digest()
    with pytest.raises(SceneError, match="base_factor = 0: must be a number > 0"):
        scene.replace({"oscillator.base_factor": 0})


@pytest.mark.parametrize("name", ["paper", "device", "linear"])
def test_it_counts_as_a_base_that_moves_as_much_more(name):
    scene = Scene.read(name)
    moved = scene.replace({"excitation.intensity": FACTOR**2 * scene.excitation.intensity})
    mode = scene.replace({"oscillator.base_factor": FACTOR})
    one, other = prepared(mode), prepared(moved)
    assert one.system.noise.intensity == pytest.approx(other.system.noise.intensity, rel=1e-14)
    paths = [noise_path(each, 1).read(100) for each in (one, other)]
    assert np.allclose(*paths, rtol=1e-13, atol=0.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("method", "device"),
    [("monte-carlo", None), ("circuit", "behavioural")],
)
def test_the_power_of_a_linear_device_goes_with_its_square(method, device):
    omega, amplitude = 1.7, 0.1
    scene = Scene.read("linear").replace(
        {
            "oscillator.base_factor": FACTOR,
            "excitation": {"kind": "sine", "amplitude": amplitude, "frequency": omega / 2 / np.pi},
            "run.settle": 120.0,
            "run.duration": 60.0,
            "run.realizations": 1,
        }
    )
    chosen = {"device": device} if device else {}
    result = harvester.simulate(scene, method=method, workers=1, step="fine", **chosen)
    o, coupling, rate = scene.oscillator, scene.transducer.coupling, scene.load.decay_rate
    share = 1j * omega / (1j * omega + rate)
    stiffness = o.linear_stiffness - omega**2 + 1j * omega * o.damping + coupling * share
    voltage = abs(FACTOR * amplitude * share / stiffness)
    truth = 0.5 * coupling * rate * voltage**2
    assert result.quantities["mean_power"].estimate == pytest.approx(truth, rel=1e-3)
    # What the base puts in on the mode: η X', by force and velocity.
    force = FACTOR * amplitude
    put_in = 0.5 * (force * (1j * omega * force / stiffness).conjugate()).real
    taken = result.quantities["power_conversion_efficiency"].estimate
    assert taken == pytest.approx(truth / put_in, rel=1e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
def test_every_engine_takes_it(method):
    scene = Scene.read("paper_si").replace(BRIEF)
    moved = scene.replace({"excitation.intensity": FACTOR**2 * scene.excitation.intensity})
    mode = scene.replace({"oscillator.base_factor": FACTOR})
    powers = [
        harvester.simulate(each, method=method, workers=1).quantities["mean_power"].estimate
        for each in (mode, moved)
    ]
    assert powers[0] == pytest.approx(powers[1], rel=1e-6)


@pytest.mark.parametrize("closure", ["paper", "consistent"])
def test_closures_take_it(closure):
    scene = Scene.read("paper")
    moved = scene.replace({"excitation.intensity": FACTOR**2 * scene.excitation.intensity})
    mode = scene.replace({"oscillator.base_factor": FACTOR})
    found = [
        harvester.average(each, method=closure).quantities["mean_power"].estimate
        for each in (mode, moved)
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_an_exported_netlist_holds_what_drives_the_mass():
    scene = Scene.read("device").replace({"run.duration": 0.2, "run.settle": 0.0})
    mode = scene.replace({"oscillator.base_factor": 2.0})
    plain, doubled = (
        stand_alone(prepared(each), noise_path(prepared(each), 0)).text for each in (scene, mode)
    )
    assert "η, minus 2.0 times the base acceleration" in doubled

    def points(text):
        block = text.split("PWL(", 1)[1].split(")", 1)[0].replace("+", " ")
        return np.array(block.split(), dtype=float)[1::2]

    assert np.allclose(points(doubled), 2.0 * points(plain), rtol=1e-12, atol=0.0)


def test_records_do_not_tell_it_from_the_scale_of_the_bases_sensor():
    scene = Scene.read("device")
    rng = np.random.default_rng(1)
    record = Measurement(rng.standard_normal(4000), 1000.0, voltage=rng.standard_normal(4000))
    with pytest.raises(HarvesterError, match="records determine only their ratio"):
        harvester.identify(
            scene, record, free=["oscillator.base_factor", "sensor.acceleration_scale"]
        )

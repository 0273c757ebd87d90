"""The charge that the base moves, in netlists and behind loads: closed forms and `ngspice -b`."""

import math

import numpy as np
import pytest
from beam_voltages import of_lumped_values
from raw_files import run_raw
from scipy.signal import lfilter, lsim

import harvester
from circuits.equivalent.export import stand_alone
from harvester.device.beam.lumped import lumped
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing

pytestmark = pytest.mark.usefixtures("shared_workers")

FREQUENCY = 48.0
# Series and parallel resistance and capacitance, none of them a resistor by itself.
LOAD = """\
.subckt rcr p n
R1 p a 10k
C1 a n 20n
R2 p n 100k
.ends
"""


def bare(**changes):
    """The reference beam without its tip mass, where the charge counts most, under 1 m/s²."""
    sine = {"kind": "sine", "amplitude": 1.0, "frequency": 2.5 * FREQUENCY}
    run = {"run.settle": 2.0, "run.duration": 1.0, "run.realizations": 1}
    changes = {"beam.tip_mass": 0.0, "beam.damping_ratio": 0.00874, "excitation": sine, **changes}
    return Scene.read("bimorph").replace(run | changes)


def exact(scene, admittance):
    (voltage,) = of_lumped_values(lumped(scene.beam), [scene.excitation.frequency], admittance)
    return abs(voltage)


@pytest.mark.slow
def test_plain_ngspice_of_the_exported_netlist(tmp_path):
    brief = {"run.settle": 0.0, "run.duration": 0.4, "beam.damping_ratio": 0.05}
    scene = bare(**{"load.resistance": 470e3, **brief})
    ready = prepared(scene)
    netlist = stand_alone(ready, noise_path(ready, 0), step="fine", tolerance=1e-5)
    (tmp_path / "beam.cir").write_text(netlist.text)
    raw = run_raw(tmp_path, "beam.cir")
    late = raw["time"] > 0.35
    time, voltage = raw["time"][late], raw["v(piezo)"][late]
    omega = 2.0 * np.pi * scene.excitation.frequency
    columns = np.column_stack([np.cos(omega * time), np.sin(omega * time)])
    amplitude = np.hypot(*np.linalg.lstsq(columns, voltage, rcond=None)[0])
    assert amplitude == pytest.approx(exact(scene, 1.0 / 470e3), rel=1e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("monte-carlo", {}),
        ("circuit", {"device": "behavioural"}),
        ("circuit", {"device": "compiled"}),
    ],
)
def test_a_load_of_a_netlist(tmp_path, method, options):
    (tmp_path / "rcr.lib").write_text(LOAD)
    scene = bare(load={"netlist": str(tmp_path / "rcr.lib")})
    rate = 2j * np.pi * scene.excitation.frequency
    admittance = 1.0 / (10e3 + 1.0 / (rate * 20e-9)) + 1.0 / 100e3
    result = harvester.simulate(scene, method=method, workers=1, step="fine", **options)
    truth = 0.5 * admittance.real * exact(scene, admittance) ** 2
    assert result.quantities["mean_power"].estimate == pytest.approx(truth, rel=1e-3)
    assert abs(result.energy_balance_residual) < 1e-3


@pytest.mark.exhaustive
def test_a_bridge_by_both_engines():
    scene = bare(**{"load": {"netlist": "bridge"}, "run.settle": 1.0})
    results = [
        harvester.simulate(scene, method=method, workers=1, step="fine")
        for method in ("monte-carlo", "circuit")
    ]
    one, other = (each.quantities["mean_power"].estimate for each in results)
    assert one == pytest.approx(other, rel=2e-4)
    assert all(abs(each.energy_balance_residual) < 1e-3 for each in results)
    # By so much it counts here.
    without = scene.without_drawing().replace({"piezo.base_charge": 0.0})
    less = harvester.simulate(without, method="circuit", workers=1, step="fine")
    assert abs(less.quantities["mean_power"].estimate / other - 1.0) > 2e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", [pytest.param("monte-carlo", marks=pytest.mark.exhaustive), "circuit"]
)
def test_a_load_that_decays_within_a_step_under_noise(method):
    """The slope of the noise jumps at each sample: the circuit's power was 11 times too high.

    The voltage of one path follows exactly from the motion, which the load hardly changes.
    """
    piezo = {"piezo.base_charge": 1e-10, "piezo.coupling": 1e-5, "piezo.capacitance": 3e-10}
    run = {"run.realizations": 1, "run.duration": 0.2, "run.settle": 0.05}
    scene = Scene.read("cantilever").replace({**piezo, **run, "load.resistance": 33e3})
    result = harvester.simulate(scene, method=method, workers=1)
    ready = prepared(scene)
    system, decay = ready.system, 1.0 / (33e3 * 3e-10)
    spacing = knot_spacing(ready)
    noise = noise_path(ready, 0).read(math.ceil(0.25 / spacing) + 1)
    many = 200
    h = spacing / many
    forces = np.interp(
        np.arange(many * (noise.size - 1) + 1) * h, spacing * np.arange(noise.size), noise
    )
    matrix = np.array([[0.0, 1.0], [-system.spring.linear, -system.damper.damping]])
    motion = lsim(
        (matrix, [[0.0], [1.0]], [[0.0, 1.0]], [[0.0]]), forces, h * np.arange(forces.size)
    )[1]
    source = motion[:-1] + system.transducer.base_share * np.repeat(np.diff(noise) / spacing, many)
    keep = math.exp(-decay * h)
    state = lfilter([1.0 - keep], [1.0, -keep], source / decay)
    exact = float(np.mean(state[round(0.05 / h) :] ** 2))
    found = result.scaled_quantities["mean_square_voltage"].estimate
    assert found == pytest.approx(exact, rel=0.01)
    assert any("noise is linear between samples" in note for note in result.notes)

"""[piezo] base_charge: what modes of a beam that follow the base at once add to the terminals."""

import itertools

import numpy as np
import pytest
from beam_voltages import sum_of_modes
from scipy.linalg import expm
from truths import Keep, records_of

from circuits.equivalent import compact_model
from circuits.equivalent.assembly import assemble
from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, SceneError
from harvester.device.beam.lumped import Beam, lumped
from harvester.device.piezo import Piezo
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing

pytestmark = pytest.mark.usefixtures("shared_workers")

REFERENCE = {
    "length": 50.8e-3, "width": 31.8e-3, "thickness": 0.14e-3, "piezo_thickness": 0.26e-3,
    "piezo": "PSI-5A4E",
}  # fmt: skip
BEAMS = {
    "bare": {**REFERENCE, "damping_ratio": 0.00874},
    "tip mass": {**REFERENCE, "tip_mass": 0.012, "damping_ratio": 0.027},
    "patches in parallel": {
        "length": 80e-3, "width": 20e-3, "thickness": 0.6e-3, "material": "steel",
        "piezo": "PZT-5A", "piezo_thickness": 0.2e-3, "piezo_start": 2e-3, "piezo_length": 30e-3,
        "connection": "parallel", "tip_mass": 5e-3, "damping_ratio": 0.01,
    },
    "block": {
        "length": 60e-3, "width": 12e-3, "thickness": 0.3e-3, "material": "aluminium",
        "piezo": "PZT-5H", "piezo_thickness": 0.19e-3, "tip_material": "steel",
        "tip_length": 6e-3, "tip_height": 4e-3, "tip_offset": 3e-3, "damping_ratio": 0.012,
    },
    "unimorph": {
        "length": 40e-3, "width": 10e-3, "thickness": 0.25e-3, "material": "stainless steel",
        "piezo": "PZT-5A", "piezo_thickness": 0.2e-3, "layers": 1, "damping_ratio": 0.006,
    },
}  # fmt: skip


RESISTANCES = (1e3, 47e3, 470e3)


def shaken(name, resistance, frequency, **run):
    """A beam on a resistor under 1 m/s² at a frequency."""
    return Scene.from_tables(
        {
            "units": "SI",
            "beam": BEAMS[name],
            "load": {"resistance": resistance},
            "excitation": {"kind": "sine", "amplitude": 1.0, "frequency": float(frequency)},
            "run": {"duration": 1.0, **run},
        }
    )


@pytest.mark.parametrize("name", BEAMS)
def test_the_spectral_method_has_the_voltage_of_25_modes(name):
    beam = Beam(**BEAMS[name])
    frequencies = np.array([0.9, 1.0, 1.05, 1.15]) * lumped(beam).short_frequency
    exact = np.abs(sum_of_modes(beam, frequencies, RESISTANCES))
    for resistance, voltages in zip(RESISTANCES, exact, strict=True):
        for frequency, voltage in zip(frequencies, voltages, strict=True):
            found = average(shaken(name, resistance, frequency), method="spectral").quantities
            root = np.sqrt(2.0 * found["mean_square_voltage"].estimate)
            assert root == pytest.approx(voltage, rel=5e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
@pytest.mark.parametrize("name", BEAMS)
def test_both_engines_have_the_voltage_of_25_modes(name, method):
    import harvester

    beam = Beam(**BEAMS[name])
    found = lumped(beam)
    short, opened = found.short_frequency, found.open_frequency
    still = 16.0 / (beam.ratio * 2.0 * np.pi * short)
    cases = ((1e3, short), (47e3, 0.9 * short), (470e3, opened), (470e3, 1.15 * short))
    for resistance, frequency in cases:
        run = {"settle": np.ceil(still * frequency) / frequency, "duration": 100.0 / frequency}
        scene = shaken(name, resistance, frequency, realizations=1, **run)
        result = harvester.simulate(scene, method=method, workers=1)
        voltage = np.sqrt(2.0 * result.quantities["mean_square_voltage"].estimate)
        (exact,) = np.abs(sum_of_modes(beam, [frequency], resistance))
        assert voltage == pytest.approx(exact, rel=5e-3)
        # As without the charge: a sine that is straight between its knots.
        assert abs(result.energy_balance_residual) < 3e-3


def test_a_scene_without_it_is_as_it_was():
    scene = Scene.read("device")
    assert "base_charge" not in scene.to_tables()["piezo"]
    assert scene.replace({"piezo.base_charge": 0.0}).digest() == scene.digest()
    ready = prepared(scene)
    assert type(ready.system.transducer) is Piezo
    assert "base" not in assemble(ready).text
    assert "base" not in compact_model.module_of(ready.system)[1].split("`include")[1]
    assert Scene.read("bimorph").transducer.base_charge != 0.0


def test_scaled_and_si_scenes_mean_the_same():
    scene = Scene.read("bimorph").without_drawing()
    system, unit = prepared(scene).system, prepared(scene).excitation_unit
    share = scene.transducer.base_charge / (
        scene.oscillator.base_factor * scene.transducer.coupling
    )
    assert system.transducer.base_share == pytest.approx(share, rel=1e-12)
    # The charge of 1 m/s² on the capacitance alone, in volts.
    volts = share / unit * prepared(scene).scales.voltage
    assert volts == pytest.approx(scene.transducer.base_charge / scene.transducer.capacitance)
    scaled = Scene.read("paper").replace({"piezo.base_charge": 0.02, "oscillator.base_factor": 2.0})
    assert prepared(scaled).system.transducer.base_share == pytest.approx(0.01)


def test_a_base_that_rests_moves_no_charge():
    moved = {"kind": "prescribed_displacement", "amplitude": 1e-3, "frequency": 40.0}
    scene = Scene.read("bimorph").replace({"excitation": moved})
    assert type(prepared(scene).system.transducer) is Piezo


@pytest.mark.slow
def test_closures_say_that_they_leave_it_out():
    scene = Scene.read("bimorph").replace({"excitation.intensity": 1e-4})
    notes = " ".join(average(scene, method="consistent").notes)
    assert "consistent leaves out the charge that the base moves (piezo.base_charge)" in notes
    assert not average(scene, method="spectral").notes


def test_refusals():
    scene = Scene.read("bimorph").without_drawing()
    white = scene.replace({"excitation": {"kind": "white", "intensity": 1e-3}})
    with pytest.raises(AveragingError, match="white at all frequencies"):
        average(white, method="spectral")
    with pytest.raises(SceneError, match=r"piezo.base_charge follows from \[beam\]"):
        Scene.read("bimorph").replace({"piezo.base_charge": 1e-9})


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("scheme", "decay_rate", "error"),
    [("runge-kutta", 0.4, 1e-6), ("heun", 0.4, 1e-3), ("runge-kutta", 300.0, 1e-4)],
)
def test_monte_carlos_schemes_against_the_matrix_exponential(scheme, decay_rate, error):
    """The third is the scheme with the decay exact: z = (X, X', W, η, η') between two knots."""
    changes = {"piezo.base_charge": 0.3, "piezo.leakage_rate": 0.1, "load.decay_rate": decay_rate}
    run = {"run.duration": 10.0, "run.settle": 0.0, "start": {"displacement": 0.2, "voltage": 0.1}}
    scene = Scene.read("linear").replace(changes | run)
    ready = prepared(scene)
    spacing, part = knot_spacing(ready), ready.system.transducer
    stiffness, damping = scene.oscillator.linear_stiffness, scene.oscillator.damping
    beta, decay, share = part.coupling, decay_rate + 0.1, 0.3
    matrix = np.zeros((5, 5))
    matrix[0, 1] = matrix[3, 4] = 1.0
    matrix[1, :4] = -stiffness, -damping, -beta, 1.0 - beta * share
    matrix[2, 1:4] = 1.0, -decay, -decay * share
    over = expm(matrix * spacing)
    keep = Keep()
    for record in records_of(scene, 10.0, scheme=scheme, steps_per_sample=4):
        keep.add(record)
    found = keep.at_knots(spacing)
    noise = noise_path(ready, 0).read(len(found) + 1)
    state, expected = np.array([0.2, 0.0, 0.1]), []
    for before, after in itertools.pairwise(noise):
        state = (over @ [*state, before, (after - before) / spacing])[:3]
        expected.append([state[0], state[1], state[2] + share * after])
    assert found == pytest.approx(np.array(expected), abs=error)

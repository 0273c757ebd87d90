"""Coils: closed forms in white noise, and a bridge on their terminals."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from truths import assert_near

from harvester.base.errors import SimulatorAborted
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

MASS, DAMPING, STIFFNESS = 0.01, 0.02, 20.0
CONSTANT, WINDING, LOAD, INTENSITY = 8.0, 300.0, 500.0, 0.01


def coil_scene(inductance, load, **run):
    return Scene.from_tables(
        {
            "units": "SI",
            "length_scale": 1e-3,
            "oscillator": {"mass": MASS, "damping": DAMPING, "linear_stiffness": STIFFNESS},
            "coil": {"coupling": CONSTANT, "resistance": WINDING, "inductance": inductance},
            "load": load,
            "excitation": {"kind": "white", "intensity": INTENSITY},
            "run": {"settle": 3.0, "seed": 5, **run},
        },
        name="coil",
    )


def means(inductance):
    """E[x²], E[x'²] and E[i²] in white noise."""
    resistance = WINDING + LOAD
    if inductance == 0.0:
        rate = (DAMPING + CONSTANT**2 / resistance) / MASS
        square = INTENSITY / rate
        return square * MASS / STIFFNESS, square, (CONSTANT / resistance) ** 2 * square
    drift = [
        [0.0, 1.0, 0.0],
        [-STIFFNESS / MASS, -DAMPING / MASS, -CONSTANT / MASS],
        [0.0, CONSTANT / inductance, -resistance / inductance],
    ]
    noise = np.diag([0.0, 2.0 * INTENSITY, 0.0])
    return np.diag(solve_continuous_lyapunov(np.array(drift), -noise))


@pytest.mark.parametrize(
    ("engine", "inductance"),
    [
        pytest.param("monte-carlo", 0.0, marks=pytest.mark.exhaustive),
        pytest.param("monte-carlo", 0.5, marks=pytest.mark.slow),
        pytest.param("monte-carlo", 20.0, marks=pytest.mark.exhaustive),
        pytest.param("circuit", 0.0, marks=pytest.mark.exhaustive),
        pytest.param("circuit", 0.5, marks=pytest.mark.exhaustive),
        pytest.param("circuit", 20.0, marks=pytest.mark.exhaustive),
    ],
)
def test_a_coils_means_in_white_noise(pool, engine, inductance):
    """False alarm in under 2 % of seeds; this one is fixed."""
    scene = coil_scene(inductance, {"resistance": LOAD}, duration=150.0, realizations=16)
    result = simulate(scene, method=engine, runner=pool)
    displacement, velocity, current = means(inductance)
    truths = {
        "mean_square_displacement": displacement,
        "mean_square_velocity": velocity,
        "mean_power": LOAD * current,
        "mean_transducer_loss": WINDING * current,
        "mean_input_power": MASS * INTENSITY,
    }
    assert_near(result, truths, 0.015)
    assert abs(result.energy_balance_residual) < 0.01


@pytest.mark.parametrize("inductance", [0.0, 0.5, 20.0])
def test_a_bridge_on_a_coil_closes_its_balance(pool, inductance):
    scene = coil_scene(inductance, {"netlist": "bridge"}, duration=4.0, realizations=2)
    result = simulate(scene, runner=pool, time_limit=60.0)
    assert abs(result.energy_balance_residual) < 0.01
    power, loss = result.quantity("mean_power").estimate, result.quantity("mean_transducer_loss")
    output = sum(
        result.quantity(name).estimate
        for name in ("mean_output_power", "mean_storage_power", "mean_converter_loss")
    )
    assert power == pytest.approx(output)
    # The winding carries the load's current and its loss lies apart, within all that is lost.
    assert 0.0 < loss.estimate < result.quantity("mean_loss_power").estimate
    assert result.steps * result.step < 3.0 * result.simulated_time


def test_the_efficiency_of_a_coil_without_inductance_is_the_devices_own(pool):
    scene = coil_scene(0.0, {"resistance": LOAD}, duration=10.0, realizations=2)
    for engine in ("monte-carlo", "circuit"):
        found = simulate(scene, method=engine, runner=pool).quantity("power_conversion_efficiency")
        used = DAMPING + CONSTANT**2 / (WINDING + LOAD)
        share = CONSTANT**2 * LOAD / (WINDING + LOAD) ** 2 / used
        assert found.estimate == pytest.approx(share, rel=1e-9)
        assert found.standard_error == 0.0
        assert found.effective_sample_size is None


@pytest.mark.slow
def test_a_load_that_cuts_off_the_inductances_current_is_told_so(pool):
    scene = Scene.read(
        "electromagnetic",
        [
            "coil.inductance=0.3",
            "load.netlist=sece",
            "run.duration=0.4",
            "run.settle=0.1",
            "run.realizations=2",
        ],
    )
    with pytest.raises(SimulatorAborted, match=r"set coil\.inductance = 0, which changes little"):
        simulate(scene, runner=pool, time_limit=60.0)
    advised = simulate(scene.replace({"coil.inductance": 0.0}), runner=pool)
    assert abs(advised.energy_balance_residual) < 0.01

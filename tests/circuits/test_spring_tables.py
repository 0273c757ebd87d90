"""A table of force in the circuit: plain ngspice on an exported netlist, and the sampled cubic."""

import numpy as np
import pytest
from device_scenes import MAGNETS, device
from device_truths import written_path
from raw_files import run_raw

from circuits.equivalent.export import for_ltspice, stand_alone
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing, stop_time
from harvester.statistics.paired import paired_difference


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "table, stoppers",
        pytest.param("table", marks=pytest.mark.exhaustive),
        pytest.param("softening in a range", marks=pytest.mark.exhaustive),
    ],
)
def test_plain_ngspice_follows_scipys_path_on_an_exported_netlist(tmp_path, name):
    scene = device(name)
    ready = prepared(scene)
    spacing = knot_spacing(ready)
    netlist = stand_alone(ready, noise_path(ready, 0), step=spacing / 100.0, tolerance=1e-7)
    (tmp_path / "table.cir").write_text(netlist.text + ".end\n")
    raw = run_raw(tmp_path, "table.cir")
    knots = round(stop_time(ready) / spacing)
    truth = written_path(scene, knots)[:, 0]
    found = np.interp(np.arange(knots + 1) * spacing, raw["time"], raw["v(displacement)"])
    assert np.abs(found - truth).max() < 1e-3 * np.abs(truth).max()


def test_ltspice_reads_nested_conditions():
    scene = device("table, stoppers")
    text, _ = for_ltspice(prepared(scene), noise_path(prepared(scene), 0), "noise.txt")
    line = next(each for each in text.splitlines() if each.startswith("Bnonlinear_spring"))
    assert line.count("if(") == 11


def sampled(scene, points, reach):
    """The scene with its cubic as a table."""
    linear, cubic = scene.oscillator.linear_stiffness, scene.oscillator.cubic_stiffness
    x = np.linspace(-reach, reach, points)
    table = [[float(each), float(linear * each + cubic * each**3)] for each in x]
    return scene.replace({"oscillator.force_table": table})


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", ["monte-carlo", "circuit"])
def test_a_cubic_sampled_finely_gives_the_cubics_path(pool, method):
    """Within a well; 33 points a fortieth of the well's distance apart."""
    scene = Scene.read("duffing").replace(
        {"run.duration": 40.0, "run.settle": 0.0, "run.realizations": 1}
    )
    # The well alone: a straight line leads back from beyond, and no motion gets there.
    well = prepared(scene).system
    table = sampled(scene, 33, 1.25)
    paths = [
        simulate(
            each, method=method, step="fine", window=(0.0, 40.0), workers=1, runner=pool
        ).waveform
        for each in (scene, table)
    ]
    assert well.symmetric
    times = np.linspace(0.1, 40.0, 800)
    cubic, found = (np.interp(times, path.time, path.displacement) for path in paths)
    assert np.abs(found - cubic).max() < 1e-3 * np.abs(cubic).max()


@pytest.mark.exhaustive
@pytest.mark.parametrize("load", [None, "bridge"])
def test_the_energy_balance_closes_and_engines_agree_on_a_table(pool, load):
    if load:
        scene = Scene.read("device").replace(
            {
                "oscillator.force_table": [[0.01 * x, 0.1 * force] for x, force in MAGNETS],
                "oscillator.damping": 0.2,
                "load": {"netlist": load},
                "run.duration": 8.0,
                "run.settle": 2.0,
            }
        )
    else:
        scene = device("table, stoppers").replace({"run.duration": 60.0, "run.settle": 10.0})
    scene = scene.replace({"run.realizations": 16})
    results = [
        simulate(scene, method=method, step="fine", runner=pool)
        for method in ("circuit", "monte-carlo")
    ]
    assert all(abs(each.energy_balance_residual) < 5e-3 for each in results)
    differences = paired_difference(*results)
    for name in ("mean_power", "mean_square_displacement", "mean_loss_power"):
        each = differences[name]
        assert abs(each.estimate) < 3.0 * each.standard_error + 1e-3, name

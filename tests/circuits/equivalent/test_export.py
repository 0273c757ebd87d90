import ctypes
import subprocess

import numpy as np
import pytest
from raw_files import ngspice_program, run_raw
from truths import contact_force, flat

from circuits.equivalent.export import stand_alone
from circuits.ngspice.library import candidates
from harvester.base.errors import NetlistError
from harvester.base.worker_pool import WorkerPool
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation.other_programs import read_raw


@pytest.fixture(scope="module")
def plain_pool():
    """Workers with the library of the program's release, not the one that has OSDI.

    Under control by the local error two releases take other steps.
    """
    own = next(name for name in candidates() if "ngspice-osdi" not in name and loads(name))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NGSPICE_LIBRARY_PATH", own)
        with WorkerPool(workers=2) as running:
            yield running


def loads(name):
    try:
        return ctypes.CDLL(name)
    except OSError:
        return None


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "paper",
        "device",
        "one_sided",
        "electromagnetic",
        pytest.param("asymmetric", marks=pytest.mark.exhaustive),
        pytest.param("tristable", marks=pytest.mark.exhaustive),
    ],
)
def test_plain_ngspice_runs_the_export_and_agrees_with_the_process(tmp_path, plain_pool, name):
    spacing = knot_spacing(prepared(Scene.read(name)))
    scene = Scene.read(
        name, [f"run.duration={400 * spacing}", "run.settle=0", "run.realizations=1"]
    )
    ready = prepared(scene)
    # Its contact is too short for the default step.
    step = spacing / 4 if name == "one_sided" else "default"
    netlist = stand_alone(prepared(scene), noise_path(ready, 0), step=step)
    (tmp_path / "scene.cir").write_text(netlist.text + ".end\n")
    raw = run_raw(tmp_path, "scene.cir")
    result = simulate(
        scene, method="circuit", step=step, source="pwl", window=(0.0, 1e9), runner=plain_pool
    )
    record = result.waveform.record
    assert raw["time"][-1] == pytest.approx(400 * spacing)
    inside = np.interp(record.time, raw["time"], raw["v(displacement)"])
    np.testing.assert_allclose(record.displacement, inside, atol=1e-6)
    # Against the external source: two step controls, one path.
    external = simulate(
        scene, method="circuit", step="finest", window=(0.0, 1e9), runner=plain_pool
    ).waveform.record
    at = np.interp(external.time, raw["time"], raw["v(displacement)"])
    np.testing.assert_allclose(external.displacement, at, atol=0.05)
    # ngspice's own first point lies behind the first two of the engine.
    inside = external.time[external.time >= raw["time"][0]]
    noise = np.interp(inside, raw["time"], raw["i(@inoise[current])"]) * netlist.rate**2
    path = noise_path(ready, 0).read(401)
    expected = np.interp(inside, spacing * np.arange(401), path)
    np.testing.assert_allclose(noise, expected, atol=1e-6 * np.abs(path).max())


def test_a_step_that_passes_over_the_contact_is_refused():
    scene = Scene.read(
        "paper", ["stoppers.stiffness=1e6", "run.realizations=2", "run.duration=1", "run.settle=0"]
    )
    ready = prepared(scene)
    with pytest.raises(NetlistError, match=r"choose step = 0\.0014 or less"):
        stand_alone(prepared(scene), noise_path(ready, 0))
    assert stand_alone(prepared(scene), noise_path(ready, 0), step=0.0014).step <= 0.0014


def test_the_export_tells_how_to_run_and_read_it():
    text = stand_alone(
        prepared(Scene.read("paper_si", ["run.realizations=2", "run.duration=1", "run.settle=0"])),
        noise_path(prepared(Scene.read("paper_si")), 0),
    ).text
    assert "ngspice -b -r paper_si.raw paper_si.cir" in text
    assert "units of 0.001 m" in text
    assert ".save v(displacement)" in text


def test_the_netlist_for_reading_runs_by_hand_and_solves_the_papers_equations(tmp_path):
    """Against DOP853 with the same sine, until the two tolerances let the paths separate."""
    from importlib import resources

    from scipy.integrate import solve_ivp

    folder = str(resources.files("netlists"))
    raw_file = tmp_path / "paper.raw"
    subprocess.run(
        [ngspice_program(), "-b", "-r", str(raw_file), "paper.cir"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    raw = read_raw(raw_file)
    p = flat(Scene.read("paper"))

    def derivative(time, state):
        x, v, voltage = state
        force = 0.35 * np.sin(2 * np.pi * 0.35 * time)
        force -= p.damping * v + p.coupling * voltage
        force -= (p.linear_stiffness + p.cubic_stiffness * x * x) * x
        if abs(x) > p.gap:
            force -= contact_force(p, x, v)
        return [v, force, v - p.decay_rate * voltage]

    times = np.linspace(0.0, 20.0, 201)
    start = [p.rest, 0.0, 0.0]
    reference = solve_ivp(derivative, (0, 20), start, "DOP853", times, rtol=1e-10, atol=1e-11)
    found = np.interp(times, raw["time"], raw["v(displacement)"])
    assert np.abs(raw["v(displacement)"]).max() > p.gap
    np.testing.assert_allclose(found, reference.y[0], atol=5e-3)


def test_a_netlist_of_too_many_points_is_refused_before_any_work():
    scene = Scene.read("paper", ["run.duration=1e9"])
    with pytest.raises(NetlistError, match=r"2e\+10 points .* at most 1000000"):
        stand_alone(prepared(scene), noise_path(prepared(scene), 0))

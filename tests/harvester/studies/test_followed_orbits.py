"""Studies of a deterministic device: the orbit that they follow, against scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import harvester
from harvester.base.errors import SceneError
from harvester.scene.model import Scene
from harvester.statistics.estimate import TOO_SHORT

pytestmark = pytest.mark.usefixtures("shared_workers")

AMPLITUDE = "excitation.amplitude"
# A bistable device of which the two wells lead to different orbits at an amplitude of 2.1.
BISTABLE = Scene.read("duffing").replace(
    {
        "oscillator.damping": 0.3,
        "oscillator.linear_stiffness": -9.0,
        "oscillator.cubic_stiffness": 25.0,
        "piezo.coupling": 1.1,
        "load.decay_rate": 0.9,
        "excitation": {"kind": "sine", "amplitude": 2.1, "frequency": 0.4},
        "run": {"duration": 100.0, "settle": 100.0, "realizations": 2, "seed": 1},
    }
)


def power_from(displacement, amplitude=2.1):
    """Mean power on the orbit that a start at rest reaches, by scipy."""
    omega, periods = 2.0 * np.pi * 0.4, 40

    def rates(time, state):
        x, v, volts, _ = state
        force = -0.3 * v + 9.0 * x - 25.0 * x**3 - 1.1 * volts + amplitude * np.sin(omega * time)
        return v, force, v - 0.9 * volts, volts**2

    ends = np.array([periods, periods + 10]) / 0.4
    found = solve_ivp(
        rates, (0.0, ends[1]), [displacement, 0.0, 0.0, 0.0], "DOP853", ends, rtol=1e-9, atol=1e-11
    )
    return 1.1 * 0.9 * float(np.diff(found.y[3])[0] / np.diff(ends)[0])


@pytest.fixture(scope="module")
def wells():
    """Powers from rest in the right-hand well and in the left-hand one."""
    return power_from(0.6), power_from(-0.6)


def test_an_orbit_between_stoppers_has_the_power_of_the_run():
    """Steps are shorter in contact; trapezoids alone would be 0.1 % too large here."""
    stopper = {"gap": 0.8, "stiffness": 1e3, "restitution": 0.6}
    changes = {"excitation.amplitude": 4.0, "run.settle": 300.0, "run.duration": 100.0}
    scene = BISTABLE.replace({**changes, "run.starts": 2, "run.realizations": 1})
    result = harvester.simulate(scene.replace(stoppers=stopper), method="monte-carlo", workers=1)
    assert result["impact_rate"].estimate > 0.0
    motion = result.attractors[0]
    assert motion.share == 1.0
    assert motion.quantities["mean_power"].estimate == pytest.approx(
        result["mean_power"].estimate, rel=1e-4
    )


def test_a_sweep_prints_the_orbit_from_rest_and_names_the_other(wells):
    found = harvester.sweep(BISTABLE, {AMPLITUDE: [1.9, 2.1]})
    cell = found.cells[1, 0]
    power = cell.estimates["mean_power"]
    assert power.estimate == pytest.approx(wells[0], rel=1e-3)
    # The mean over both wells is some twelve times as much.
    assert power.standard_error < 1e-4 * power.estimate
    assert [each.quantities["mean_power"].estimate for each in cell.orbits] == pytest.approx(
        wells, rel=1e-3
    )
    told = [line for line in found.sentences() if line.startswith("at 2.1: ")]
    assert len(told) == 1
    assert "the orbit from rest is followed (period 1, 50.0% of the starts)" in told[0]
    assert "mean power 0.3336" in told[0]
    assert "pass between the wells" not in "".join(found.sentences())
    places = found.to_dict()["cells"]
    assert [len(each["orbits"]) for each in places] == [2, 2]


def test_mirror_images_are_one_line_for_all_places():
    found = harvester.sweep(BISTABLE, {AMPLITUDE: [1.7, 1.8]})
    words = (
        "the orbit from rest is followed: other starts at rest (run.starts = 100 draws random "
        "starts) reach orbits of the same power"
    )
    assert found.sentences().count(words) == 1


def test_a_load_study_follows_one_orbit(wells):
    study = harvester.load_study(BISTABLE, method="monte-carlo")
    assert study.evaluations[0].power == pytest.approx(wells[0], rel=1e-3)
    assert any("mean power 0.3336" in each for each in study.sentences())


@pytest.mark.slow
def test_the_judge_compares_one_orbit_within_what_the_steps_cost():
    """The engines differ by 3e-4; batches of a periodic motion scatter by 1e-9 and tell nothing."""
    proof = harvester.load_study(BISTABLE).proofs[0]
    assert abs(proof.difference) < 3.0 * proof.standard_error < 3e-3
    assert not proof.disagrees


@pytest.mark.parametrize(("orbit", "place"), [("rest", 0), ("best", 1)])
def test_the_chosen_orbit_of_drawn_starts(wells, orbit, place):
    scene = BISTABLE.replace({"run.starts": 12, "run.orbit": orbit})
    cell = harvester.sweep(scene, {AMPLITUDE: [2.1]}).cells[0, 0]
    assert cell.estimates["mean_power"].estimate == pytest.approx(wells[place], rel=1e-3)
    assert sum(each.share for each in cell.orbits) == pytest.approx(1.0)


def test_weighted_by_starts_is_the_mean_of_the_orbits_by_their_shares():
    scene = BISTABLE.replace({"run.starts": 12, "run.orbit": "weighted"})
    found = harvester.sweep(scene, {AMPLITUDE: [2.1]})
    cell = found.cells[0, 0]
    mean = sum(each.share * each.quantities["mean_power"].estimate for each in cell.orbits)
    assert cell.estimates["mean_power"].estimate == pytest.approx(mean, rel=1e-9)
    assert any(each.startswith("means over all starts: orbit A") for each in found.sentences())


@pytest.mark.parametrize("orbit", ["best", "weighted"])
def test_a_choice_among_starts_needs_starts(orbit):
    with pytest.raises(SceneError, match=r"run.orbit = .* needs random starts: set run.starts"):
        BISTABLE.replace({"run.orbit": orbit})


def test_a_single_start_says_that_there_may_be_others():
    scene = BISTABLE.replace({"run.realizations": 1})
    found = harvester.sweep(scene, {AMPLITUDE: [2.1]})
    assert any("other motions with other powers" in each for each in found.sentences())


@pytest.mark.parametrize(("starts", "told"), [(None, True), (12, False)])
def test_starts_at_rest_alone_are_not_all_starts(starts, told):
    scene = BISTABLE.replace({"run.starts": starts} if starts else {})
    found = harvester.sweep(scene, {AMPLITUDE: [0.2]})
    assert ("run.starts = 100 draws random starts" in "".join(found.sentences())) == told


def test_a_linear_device_has_no_other_orbit():
    scene = Scene.read("linear").replace(
        {"excitation": {"kind": "sine", "amplitude": 1.0, "frequency": 0.16}, "run.duration": 100.0}
    )
    found = harvester.sweep(scene, {AMPLITUDE: [1.0]})
    assert "orbit" not in "".join(found.sentences())
    # Realizations that would repeat the one that was run are named.
    repeats = f"run.realizations = {scene.run.realizations}: the excitation is deterministic"
    assert any(line.startswith(repeats) for line in found.sentences())
    once = harvester.sweep(scene.replace({"run.realizations": 1}), {AMPLITUDE: [1.0]})
    assert "run.realizations" not in "".join(once.sentences())


@pytest.mark.slow
def test_an_optimum_names_the_orbits_at_its_place():
    """A hardening device whose high orbit has some thousand times the power of that from rest."""
    scene = BISTABLE.replace(
        {
            "oscillator.damping": 0.06,
            "oscillator.linear_stiffness": 9.0,
            "piezo.coupling": 0.4,
            "excitation.amplitude": 0.8,
            "excitation.frequency": 0.9,
            "run.realizations": 1,
            "run.settle": 200.0,
        }
    )
    found = harvester.optimum(scene, {"load.decay_rate": (2.0, 12.0)})
    low, high = (each.quantities["mean_power"].estimate for each in found.orbits)
    assert low == pytest.approx(found.value.estimate, rel=1e-3)
    assert high > 900.0 * low
    best = scene.replace({"run.starts": 16, "run.orbit": "best"})
    higher = harvester.optimum(best, {"load.decay_rate": (2.0, 12.0)})
    assert higher.value.estimate > 900.0 * found.value.estimate
    assert "the orbit with the most power is followed" in "".join(higher.sentences())


def test_a_missing_error_bar_names_no_shorter_duration():
    scene = BISTABLE.replace(
        {
            "oscillator.damping": 0.24,
            "oscillator.linear_stiffness": -7.0,
            "oscillator.cubic_stiffness": 20.0,
            "excitation": {"kind": "sine", "amplitude": 1.5, "frequency": 0.52},
            "run": {"duration": 60.0, "settle": 60.0, "realizations": 2, "seed": 1},
        }
    )
    found = harvester.simulate(scene, method="monte-carlo")
    notes = {each.note for each in found.quantities.values() if each.standard_error is None}
    assert notes == {TOO_SHORT}

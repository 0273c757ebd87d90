"""ngspice itself: accuracy against scipy, and each way in which it fails."""

import numpy as np
import pytest
import worker_calls
from truths import reference_path

from harvester.base.errors import SimulatorAborted, SimulatorTimeout
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.steps import STEPS_PER_CONTACT


def knots_of(pool, scene, step, index=0):
    """(X, X', V) at the knots from the circuit, shape (knots, 3)."""
    result = simulate(scene, method="circuit", step=step, window=(0.0, 1e9), runner=pool)
    waveform = np.array(result.waveform.record)
    knots = np.round(waveform[0] / 0.05)
    on_knot = np.abs(waveform[0] - knots * 0.05) < 1e-7
    return waveform[1:4, on_knot].T


def short(name, *overrides):
    run = ["run.duration=50", "run.settle=0", "run.realizations=1", "excitation.knot_spacing=0.05"]
    return Scene.read(name, [*run, *overrides])


@pytest.mark.slow
@pytest.mark.parametrize("overrides", [[], ["excitation.intensity=0.06", "run.seed=4"]])
def test_the_trapezoidal_rule_has_order_two_and_the_finest_step_its_accuracy(pool, overrides):
    scene = short("paper", *overrides)
    reference = reference_path(scene, 1000)[1:]

    def error(step):
        states = knots_of(pool, scene, step)
        return np.sqrt(np.mean((states[:, 0] - reference[:, 0]) ** 2))

    steps = np.array([0.05 / 3, 0.01, 0.005, 0.0025])
    errors = np.array([error(step) for step in steps])
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.3)
    assert error("finest") < 2e-4


@pytest.mark.parametrize(
    "overrides",
    [
        ["stoppers.restitution=0"],
        ["stoppers.restitution=1"],
        ["stoppers.gap=0.95"],
        ["stoppers.gap=0.5", "excitation.intensity=0.1"],
        ["oscillator.linear_stiffness=0"],
        ["load.decay_rate=10"],
    ],
)
def test_other_scenes_follow_scipys_path_too(pool, overrides):
    scene = short("paper", "run.duration=20", *overrides)
    reference = reference_path(scene, 400)[1:]
    states = knots_of(pool, scene, 0.0025)
    np.testing.assert_allclose(states, reference, atol=3e-3)


@pytest.mark.slow
def test_the_held_impact_speed_follows_monte_carlo(pool):
    scene = short("paper", "stoppers.impact_velocity=event", "run.duration=30")
    states = knots_of(pool, scene, 0.001)
    reference = simulate(scene, method="monte-carlo", step="finest", window=(0.0, 1e9), runner=pool)
    record = np.array(reference.waveform.record)
    at = np.interp(0.05 * np.arange(1, 601), record[0], record[1])
    np.testing.assert_allclose(states[:, 0], at, atol=2e-3)
    energy = knots_of(pool, short("paper", "run.duration=30"), 0.001)
    assert np.abs(energy[:, 0] - at).max() > 2 * np.abs(states[:, 0] - at).max()


def test_a_stiff_contact_is_resolved_by_shorter_steps(pool):
    scene = short("paper", "stoppers.stiffness=1e6", "run.duration=10")
    reference = reference_path(scene, 200)[1:]
    result = simulate(scene, method="circuit", runner=pool)
    # One impact, and the approach to it.
    assert result.steps >= 200 + STEPS_PER_CONTACT
    states = knots_of(pool, scene, 0.0025)
    np.testing.assert_allclose(states[:, 0], reference[:, 0], atol=5e-3)


def test_a_shorter_step_is_shorter_in_a_contact_too(pool):
    """Where contacts take nearly all steps, a quarter of the step is four times as many."""
    scene = short("paper", "stoppers.stiffness=1e6", "run.duration=10")
    usual, fine = (
        simulate(scene, method="circuit", step=s, runner=pool) for s in ("default", "fine")
    )
    assert fine.steps > 3.5 * usual.steps


def test_only_two_tiny_steps_are_of_first_order(pool):
    """By the trapezoidal rule the displacement grows by the mean of the speeds at both ends."""
    scene = short("paper", "start.velocity=2", "run.duration=1")
    result = simulate(scene, method="circuit", window=(0.0, 1.0), runner=pool)
    time, x, v = np.array(result.waveform.record)[:3]
    length = np.diff(time)
    assert (length > 0.5 * length.max()).sum() >= 20
    # The first of the two ends where the waveform begins.
    assert time[1] < 1e-2 * length.max()
    mean_speed = np.diff(x) / length
    np.testing.assert_allclose(mean_speed[1:], ((v[1:] + v[:-1]) / 2)[1:], atol=1e-9)


TITLE = ".title test\nInoise 0 noise external\nRnoise noise 0 1\n"
END = ".options trtol=1e9\n.tran 0.05 {stop} 0 0.05 uic\n"


def run_text(worker, text, stop, time_limit=60.0):
    arguments = {"text": TITLE + text + END.format(stop=stop), "stop": stop}
    return worker.call(worker_calls.run_text, arguments, time_limit)


def test_a_singular_circuit_is_reported_in_ngspices_words(worker):
    with pytest.raises(SimulatorAborted, match=r"(?i)singular|too small"):
        run_text(worker, "Vone x 0 1\nVtwo x 0 2\n", 1.0)
    steps, _ = run_text(worker, "R1 displacement 0 1\n", 1.0)
    assert steps >= 20


def test_an_unknown_element_is_reported_in_ngspices_words(worker):
    with pytest.raises(SimulatorAborted, match=r"(?i)unknown|nosuch|model"):
        run_text(worker, "D1 x 0 nosuch\nR1 x 0 1\n", 1.0)


@pytest.mark.slow
def test_a_blow_up_is_no_result(worker):
    """x' = x³ from 1 leaves all bounds at t = ½; ngspice goes on as if nothing were."""
    text = "Cx displacement 0 1 ic=1\nBx 0 displacement i=v(displacement)^3\n"
    with pytest.raises(SimulatorAborted, match=r"stopped at t = 0\.4.*Timestep too small"):
        run_text(worker, text, 5.0)


@pytest.mark.slow
def test_a_run_without_end_is_killed_at_the_time_limit(worker):
    with pytest.raises(SimulatorTimeout, match="2 s"):
        run_text(worker, "Cx displacement 0 1 ic=1\nRx displacement 0 1\n", 1e12, time_limit=2.0)
    steps, _ = run_text(worker, "R1 displacement 0 1\n", 1.0)
    assert steps >= 20


@pytest.mark.slow
def test_two_hundred_runs_in_one_process_do_not_grow_it(worker):
    scene = short("paper", "run.duration=5")
    after_fifty, after_all = worker.call(worker_calls.run_many, {"scene": scene, "times": 200})
    assert after_all - after_fifty < 10.0


@pytest.mark.exhaustive
def test_a_long_run_does_not_grow_its_process(worker):
    scene = short("paper", "run.duration=12000")
    assert worker.call(worker_calls.run_long, {"scene": scene}) < 1.0


@pytest.mark.slow
def test_values_that_are_not_finite_are_no_result(worker):
    with pytest.raises(SimulatorAborted, match="Timestep too small"):
        run_text(
            worker,
            "Cx displacement 0 1 ic=1\nBx 0 displacement i=exp(min(v(displacement),1e3))*1e200\n",
            1.0,
        )


INSIDE = ("stoppers.impact_velocity=event", "stoppers.gap=0.9", "stoppers.restitution=0.1")


def test_contacts_inside_the_wells_finish_with_the_held_impact_speed(pool):
    """The mass rests on a stopper: held at zero, its impact speed would make friction of it."""
    scene = short("paper", *INSIDE, "run.duration=30")
    circuit = simulate(scene, method="circuit", runner=pool, step=0.0025, window=(0.0, 1e9))
    reference = simulate(scene, method="monte-carlo", runner=pool, step="finest", window=(0.0, 1e9))
    states, other = np.array(circuit.waveform.record), np.array(reference.waveform.record)
    at = np.interp(states[0], other[0], other[1])
    assert np.abs(states[1] - at).max() < 0.02


@pytest.mark.slow
def test_a_run_that_gets_nowhere_is_given_up(worker):
    """Dry friction holds the mass: its force jumps, and ngspice's steps shrink without end."""
    with pytest.raises(SimulatorAborted, match=r"it stalls.*friction"):
        worker.call(worker_calls.stick, {"scene": short("paper", *INSIDE)}, time_limit=600.0)


def test_steps_do_not_shrink_towards_where_a_source_bends(pool, tmp_path):
    """Four bends in each of 50 periods; a thousand of the steps were shorter than a picosecond."""
    path = tmp_path / "clocked.lib"
    path.write_text(
        ".subckt clocked p n\nR1 p a 1k\nL1 a n 22\nV1 x n pulse(0 1 0.61m 1.9u 1.9u 0.25m 2m)\n"
        "R2 x n 1k\n.ends\n"
    )
    scene = Scene.read(
        "device", [f"load.netlist={path}", "run.duration=0.1", "run.settle=0", "run.realizations=1"]
    )
    result = simulate(scene, method="circuit", window=(0.0, 1e9), runner=pool)
    time = np.array(result.waveform.record)[0]
    steps = np.diff(time)[time[:-1] > 0.6e-3]
    assert np.count_nonzero(steps < 1e-10) < 50
    # Its own resolution of the edges, in steps of at most 0.16 ms.
    assert steps.size < 50 * 60

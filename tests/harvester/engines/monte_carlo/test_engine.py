from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from truths import Keep, drop_scene, flat, records_of, reference_path

from harvester.base.errors import SolutionDiverged
from harvester.engines.monte_carlo.engine import integrate, record_of
from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.statistics.moments import Moments
from harvester.validation.formulas import rebound_speed

pytestmark = pytest.mark.usefixtures("shared_workers")


def simulated(scene, knots, steps_per_sample=1, index=0):
    keep, stop = Keep(), knots * noise_path(prepared(scene), index).spacing
    for record in records_of(scene, stop, index, steps_per_sample=steps_per_sample):
        keep.add(record)
    return keep


@pytest.mark.parametrize("name", ["paper", "duffing"])
def test_the_order_is_four_against_scipy_on_the_same_path(name):
    scene = Scene.read(name, ["run.realizations=3", "excitation.intensity=0.05"])
    knots = 600
    errors = []
    for steps in (1, 2):
        squares = []
        for index in range(3):
            reference = reference_path(scene, knots, index)[1:]
            states = simulated(scene, knots, steps, index).at_knots(0.05)
            squares.append(np.mean((states - reference) ** 2))
        errors.append(np.sqrt(np.mean(squares)))
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.6)


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.7, 0.9, 1.0])
def test_a_drop_on_a_stiff_stopper_rebounds_as_the_exact_law_says(restitution):
    """At K = 10 drops are rows of `verify`."""
    scene = drop_scene(restitution, 1e6)
    for record in records_of(scene, 3.0, start=(0.0, 1.0, 0.0), steps_per_sample=4):
        velocity = record.velocity[-1]
    assert -velocity == pytest.approx(rebound_speed(restitution), abs=1e-3)


@pytest.mark.slow
def test_white_noise_without_coupling_follows_gibbs_and_rice():
    """Mean-square velocity D/c, and the rate of crossings of the Rice formula.

    False-alarm rate 0.3 % each: three of the result's own standard errors, fixed seed.
    """
    from harvester.engines.simulate import simulate

    scene = Scene.read(
        "linear",
        [
            "piezo.coupling=0",
            "stoppers={gap=0.3, stiffness=10.0, restitution=1.0}",
            "excitation.correlation_time=1e-3",
            "excitation.knot_spacing=1e-3",
            "run.duration=3000",
            "run.realizations=1",
        ],
    )
    result = simulate(scene, method="monte-carlo")
    p = flat(scene)
    square = result.scaled_quantities["mean_square_velocity"]
    assert abs(square.estimate - p.intensity / p.damping) < 3 * square.standard_error + 2e-3
    from scipy.integrate import quad

    def weight(x):
        stopper = 0.4 * p.contact_stiffness * max(abs(x) - p.gap, 0.0) ** 2.5
        energy = 0.5 * p.linear_stiffness * x * x + stopper
        return np.exp(-p.damping / p.intensity * energy)

    total = 2 * quad(weight, 0, 3)[0]
    speed = np.sqrt(p.intensity / p.damping)
    impacts = 2 * weight(p.gap) / total * speed / np.sqrt(2 * np.pi)
    rate = result.scaled_quantities["impact_rate"]
    assert abs(rate.estimate - impacts) < 3 * rate.standard_error + 0.01 * impacts


def test_chunks_do_not_change_the_numbers_and_a_stiff_contact_is_resolved():
    scene = Scene.read("paper", ["stoppers.stiffness=1e6", "excitation.intensity=0.1"])
    record = simulated(scene, 8000).record()
    depth = np.abs(record[1]).max() - 1.1
    assert 0.0 < depth < 1e-2
    assert np.all(np.diff(record[0]) > 0.0)
    system = prepared(scene).system
    moments = Moments.empty(0.0, 400.0, (-1.1, 1.1), (0.0,), False, 4, 1, 0.2)
    for chunk in records_of(scene, 400.0):
        moments.add(chunk)
    from harvester.statistics.balance import energy_balance_residual

    assert abs(energy_balance_residual([moments], system)) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        "stoppers.stiffness=10",
        "stoppers.stiffness=1e6",
        pytest.param("stoppers.exponent=2.2", marks=pytest.mark.exhaustive),
        "stoppers.impact_velocity=event",
    ],
)
def test_a_realization_is_the_same_beside_any_others(change):
    """Bit for bit, alone and in step with others, which cut the record into other chunks."""
    scene = Scene.read("paper", ["excitation.intensity=0.1", change])
    ready = prepared(scene)
    system = ready.system
    indices, knots = range(21), 5000
    starts = [start_state(ready, k) for k in indices]
    alone = [simulated(scene, knots, index=k).record() for k in indices]
    for kept in (len(indices), 1):
        paths, keeps = [noise_path(ready, k) for k in indices], [Keep() for _ in indices]
        stop = knots * paths[0].spacing
        for columns, points in integrate(system, paths, starts, stop, keep=kept):
            for k in indices:
                keeps[k].add(record_of(columns, points, k))
        for k in indices[:kept]:
            np.testing.assert_array_equal(keeps[k].record(), alone[k])
        assert all(keeps[k].record().size == 0 for k in indices[kept:])


def test_more_points_than_there_is_room_for_are_handed_over_in_chunks():
    """A mass that bounces and comes to rest on a stiff stopper within a few knots."""
    scene = drop_scene(0.3, 1e8)
    room = Keep()
    chunks = 0
    for record in records_of(scene, 3.0, start=(0.0, 1.0, 0.0), steps_per_contact=300_000):
        room.add(record)
        chunks += 1
    time = room.record()[0]
    assert chunks > 2
    assert np.all(np.diff(time) > 0.0)
    for record in records_of(scene, 3.0, start=(0.0, 1.0, 0.0), steps_per_contact=1000):
        velocity = record.velocity[-1]
    assert room.record()[2, -1] == pytest.approx(velocity, abs=1e-6)


def test_a_path_of_no_noise_leaves_the_mass_at_rest():
    scene = Scene.read("paper", ["stoppers.gap=0.95"])
    path = OrnsteinUhlenbeck(1e-300, 1.0).path(0.05, 1.0, np.random.SeedSequence(1))
    for record in records_of(scene, 50.0, 1, path):
        np.testing.assert_allclose(record.displacement, -flat(scene).rest, atol=1e-9)


def exact_linear_path(scene, knots):
    """States at the knots of a linear scene from rest, by the exact map of one segment."""
    p = flat(scene)
    path = noise_path(prepared(scene), 0)
    noise = path.read(knots + 1)
    drift = np.zeros((5, 5))
    drift[0, 1] = drift[2, 1] = drift[1, 3] = drift[3, 4] = 1.0
    drift[1, :3] = -p.linear_stiffness, -p.damping, -p.coupling
    drift[2, 2] = -p.decay_rate
    flow = expm(drift * path.spacing)[:3]
    states, state = [], np.zeros(3)
    for start, end in pairwise(noise):
        state = flow @ [*state, start, (end - start) / path.spacing]
        states.append(state)
    return np.array(states)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping", "decay_rate"), [(0.2, 1e2), (0.2, 1e9), (60.0, 50.0), (1e3, 2.0), (1e5, 1e9)]
)
def test_a_damper_or_a_load_faster_than_the_step_follows_the_exact_path(damping, decay_rate):
    """The decay itself costs no accuracy and no time, however fast it is."""
    scene = Scene.read("linear", [f"oscillator.damping={damping}", f"load.decay_rate={decay_rate}"])
    exact = exact_linear_path(scene, 2000)
    scatter = np.sqrt(np.mean(exact**2, axis=0))
    found = simulated(scene, 2000).at_knots(noise_path(prepared(scene), 0).spacing)
    error = np.sqrt(np.mean((found - exact) ** 2, axis=0)) / scatter
    # X' and V; X remembers how the velocity sprang up at the very beginning.
    assert np.all(error[1:] < 1e-3)
    assert error[0] < 2e-3


def test_exact_decay_is_of_third_order():
    scene = Scene.read("linear", ["load.decay_rate=1e6"])
    exact = exact_linear_path(scene, 1000)
    errors = [
        np.sqrt(np.mean((simulated(scene, 1000, steps).at_knots(0.025) - exact) ** 2))
        for steps in (1, 2)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(3.0, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", ["10", "1e6"])
def test_a_load_that_shorts_the_piezo_leaves_the_open_mechanics_and_v_follows(stiffness):
    """λ → ∞: V = X'/λ, and X moves as without the piezo; stoppers included."""
    changes = [f"stoppers.stiffness={stiffness}", "excitation.intensity=0.05"]
    short = Scene.read("paper", [*changes, "load.decay_rate=1e9"])
    bare = Scene.read("paper", [*changes, "piezo.coupling=1e-9", "load.decay_rate=1e-9"])
    found, expected = (simulated(scene, 400, 2).at_knots(0.05) for scene in (short, bare))
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=2e-2)
    np.testing.assert_allclose(1e9 * found[:, 2], found[:, 1], rtol=1e-5, atol=1e-6)


def test_a_motion_that_leaves_the_finite_numbers_is_named():
    """A spring far too stiff for the step: some leave them in flight, some in contact."""
    for change in ({"oscillator.cubic_stiffness": 1e9}, {"stoppers.stiffness": 1e30}):
        scene = Scene.read("paper").replace({"run.realizations": 9, **change})
        system = prepared(scene).system
        paths = [noise_path(prepared(scene), k) for k in range(9)]
        starts = [(1.2, 1e150, 0.0)] * 9
        with pytest.raises(SolutionDiverged, match=r"not finite\) before t = .*shorter step"):
            for _ in integrate(system, paths, starts, 100.0, keep=0):
                pass

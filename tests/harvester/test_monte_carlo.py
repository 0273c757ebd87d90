import numpy as np
import pytest
from truths import Keep, drop_scene, flat, rebound_speed, reference_path

from harvester.excitation import NoisePath
from harvester.moments import Moments
from harvester.monte_carlo import VELOCITY, initial_state, integrate
from harvester.realization import noise_path
from harvester.scene import Scene


def simulated(scene, knots, steps_per_knot=1, index=0):
    p = flat(scene)
    keep = Keep()
    state = initial_state(p, index % 2 == 0)
    path = noise_path(scene, index)
    for record in integrate(p, path, state, knots * path.spacing, steps_per_knot):
        keep.add(record)
    return keep


@pytest.mark.parametrize("name", ["paper", "duffing"])
def test_the_order_is_four_against_scipy_on_the_same_path(name):
    scene = Scene.load(name, ["run.realizations=3", "excitation.intensity=0.05"])
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
@pytest.mark.parametrize("stiffness", [10.0, 1e6])
def test_a_drop_on_one_stopper_rebounds_as_the_exact_law_says(restitution, stiffness):
    scene = drop_scene(restitution, stiffness)
    p = flat(scene)
    state = initial_state(p, right=True)
    state[VELOCITY] = 1.0
    for _record in integrate(p, noise_path(scene, 0), state, 3.0, steps_per_knot=4):
        pass
    assert -state[VELOCITY] == pytest.approx(rebound_speed(restitution), abs=1e-3)


def test_white_noise_without_coupling_follows_gibbs_and_rice():
    """Mean-square velocity D/c, and the rate of crossings of the Rice formula.

    False-alarm rate 0.3 % each: three of the result's own standard errors, fixed seed.
    """
    from harvester.simulation import simulate

    scene = Scene.load(
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
    result = simulate(scene, "monte-carlo")
    p = flat(scene)
    square = result.scaled_quantities["mean_square_velocity"]
    assert abs(square.estimate - p.intensity / p.damping) < 3 * square.standard_error + 2e-3
    from scipy.integrate import quad

    from harvester import forces

    def weight(x):
        return np.exp(-p.damping / p.intensity * forces.potential(p, x))

    total = 2 * quad(weight, 0, 3)[0]
    speed = np.sqrt(p.intensity / p.damping)
    impacts = 2 * weight(p.gap) / total * speed / np.sqrt(2 * np.pi)
    rate = result.scaled_quantities["impact_rate"]
    assert abs(rate.estimate - impacts) < 3 * rate.standard_error + 0.01 * impacts


def test_chunks_do_not_change_the_numbers_and_a_stiff_contact_is_resolved():
    scene = Scene.load("paper", ["stoppers.stiffness=1e6", "excitation.intensity=0.1"])
    record = simulated(scene, 8000).record()
    depth = np.abs(record[1]).max() - 1.1
    assert 0.0 < depth < 1e-2
    assert np.all(np.diff(record[0]) > 0.0)
    p = flat(scene)
    moments = Moments.empty(0.0, 400.0, p.gap, 4, 1, 0.2)
    for chunk in integrate(p, noise_path(scene, 0), initial_state(p, True), 400.0):
        moments.add(chunk)
    from harvester.estimators import energy_balance_residual

    assert abs(energy_balance_residual([moments], p)) < 0.01


def test_a_path_of_no_noise_leaves_the_mass_at_rest():
    p = flat(Scene.load("paper", ["stoppers.gap=0.95"]))
    state = initial_state(p, right=False)
    path = NoisePath(1e-300, 1.0, 0.05, np.random.SeedSequence(1))
    for record in integrate(p, path, state, 50.0):
        np.testing.assert_allclose(record.displacement, -p.rest, atol=1e-9)

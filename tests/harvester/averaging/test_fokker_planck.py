"""The closure `fokker_planck`: exact limits, its error and its refusals."""

import math
from itertools import pairwise

import numpy as np
import pytest
from truths import averaged, flat, interpolated_linear_means, well

from harvester.averaging import fokker_planck, solution
from harvester.averaging.closures import average
from harvester.averaging.fokker_planck import REGION_LEVEL
from harvester.averaging.of_scene import average as average_scene
from harvester.averaging.propagator import Propagator
from harvester.averaging.region import Region
from harvester.base.errors import AveragingError
from harvester.device import system as systems
from harvester.device import timescales
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

PAPER = flat(Scene.read("paper"))
LINEAR = flat(Scene.read("linear"))
DUFFING = flat(Scene.read("duffing"))
WHITE = {"correlation_time": 1e-6, "coupling": 0.0, "restitution": 1.0, "damping": 0.2}
NAMES = ("mean_square_voltage", "mean_square_velocity", "mean_square_displacement")


def within(result, name, truth, floor=2e-3):
    """Whether a mean is off by its own numerical error at most, or by the floor."""
    error = max(result.numerical_error[name], floor * truth)
    return getattr(result, name) == pytest.approx(truth, abs=error)


@pytest.mark.parametrize(
    "p",
    [
        PAPER._replace(**WHITE, intensity=0.2),
        LINEAR._replace(**WHITE, cubic_stiffness=3.0, gap=0.2, contact_stiffness=10.0),
        # The motion is three times as fast as small oscillations.
        DUFFING._replace(**WHITE, intensity=50.0),
        pytest.param(
            PAPER._replace(**WHITE, gap=0.95, intensity=0.02), marks=pytest.mark.exhaustive
        ),
    ],
    ids=["wells", "stoppers", "hardening", "preloaded"],
)
def test_gibbs(p):
    """White noise, no coupling, elastic stoppers: p(X) ∝ exp(−(c/D) U), Hertz energy in U."""
    result = averaged(p, "fokker_planck")
    reach = well(p) + 8.0 * math.sqrt(p.intensity / p.damping)
    x = np.linspace(-reach, reach, 8001)
    shape = np.exp(
        -p.damping
        / p.intensity
        * (systems.potential(p.system, x) - systems.potential(p.system, p.rest))
    )
    expected = shape / np.trapezoid(shape, x)
    assert within(result, "mean_square_velocity", p.intensity / p.damping)
    assert within(result, "mean_square_displacement", np.trapezoid(expected * x * x, x))
    density = result.density.displacement(x)
    assert np.trapezoid(abs(density - expected), x) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"damping": 1.5, "correlation_time": 0.3},
        {"damping": 0.1, "correlation_time": 3.0, "decay_rate": 0.2},
        pytest.param(
            {"damping": 0.5, "correlation_time": 0.3, "decay_rate": 1e-6},
            marks=pytest.mark.exhaustive,
        ),
        pytest.param(
            {"damping": 0.05, "correlation_time": 0.05, "decay_rate": 4.0},
            marks=pytest.mark.exhaustive,
        ),
    ],
    ids=["damped", "slow noise", "slow load", "fast load"],
)
def test_linear_device(changes):
    """Covariances of the linear equations: any damping, memory of the noise, rate of the load."""
    p = LINEAR._replace(coupling=0.5, **changes)
    result, exact = averaged(p, "fokker_planck"), interpolated_linear_means(p, 1e-3)
    for name in (*NAMES, "mean_power", "power_conversion_efficiency"):
        assert within(result, name, exact[name])
    # All is linear and driven by normal noise: so is V.
    voltage, density = result.density.tabulated("voltage")
    variance = result.mean_square_voltage
    normal = np.exp(-0.5 * voltage**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    assert np.trapezoid(abs(density - normal), voltage) < 0.01


@pytest.mark.exhaustive
@pytest.mark.parametrize("rate", [1e-3, 1e-6])
def test_a_slow_load_leaves_the_charge_at_its_mean(rate):
    """λ → 0: Z = 0, V = X, in a spring stiffer by the coupling: a device that has no charge."""
    p = flat(Scene.read("duffing", ["excitation.intensity=0.5"]))
    slow = averaged(p._replace(decay_rate=rate), "fokker_planck")
    stiff = p._replace(coupling=1e-9, linear_stiffness=p.linear_stiffness + p.coupling)
    limit = averaged(stiff, "fokker_planck")
    error = slow.numerical_error["mean_square_voltage"]
    error += limit.numerical_error["mean_square_displacement"] + 3.0 * rate
    assert slow.mean_square_voltage == pytest.approx(limit.mean_square_displacement, abs=error)
    assert error < 0.01 * slow.mean_square_voltage


@pytest.mark.slow
def test_a_load_as_slow_as_jumps_is_refused():
    with pytest.raises(AveragingError, match="jumps between the wells are as slow"):
        averaged(PAPER._replace(decay_rate=1e-4), "fokker_planck")


@pytest.mark.slow
def test_white_noise_gives_its_power_whatever_takes_it():
    p = PAPER._replace(correlation_time=1e-6, intensity=0.1, decay_rate=0.5)
    result = averaged(p, "fokker_planck")
    assert result.mechanical_loss + result.mean_power == pytest.approx(p.intensity, rel=3e-3)


@pytest.mark.slow
def test_densities():
    """Nowhere negative, symmetric, of integral 1, and with the means of the result."""
    p = PAPER._replace(intensity=0.005)
    result = averaged(p, "fokker_planck")
    x, v = np.linspace(-1.6, 1.6, 1601), np.linspace(-2.0, 2.0, 801)
    for place, function, name in (
        (x, result.density.displacement, "mean_square_displacement"),
        (v, result.density.velocity, "mean_square_velocity"),
    ):
        density = function(place)
        assert density.min() >= 0.0
        assert density == pytest.approx(function(-place), abs=1e-12)
        assert np.trapezoid(density, place) == pytest.approx(1.0, abs=1e-3)
        assert np.trapezoid(density * place**2, place) == pytest.approx(getattr(result, name), 0.02)
    joint = result.density.joint(x[:, None], v)
    assert joint.min() >= 0.0
    assert np.trapezoid(joint, v, axis=1) == pytest.approx(result.density.displacement(x), abs=0.01)


@pytest.mark.exhaustive
def test_numerical_error_covers_a_finer_grid():
    p = PAPER._replace(intensity=0.1)
    rough, fine = (averaged(p, "fokker_planck", tolerance) for tolerance in (2e-2, 1e-3))
    for name in NAMES:
        error = rough.numerical_error[name]
        assert getattr(rough, name) == pytest.approx(getattr(fine, name), abs=2.0 * error)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"held_impact_velocity": True}, "impact_velocity"),
        ({"decay_rate": 100.0}, "charge decays at 100 /s"),
        ({"contact_stiffness": 1e9}, "stoppers.stiffness: "),
    ],
)
def test_refusals(changes, words):
    with pytest.raises(AveragingError) as caught:
        averaged(PAPER._replace(**changes, intensity=0.1), "fokker_planck")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_tolerance_out_of_reach_is_refused(monkeypatch):
    monkeypatch.setattr(solution, "MOST_WORK", 1e7)
    with pytest.raises(AveragingError, match="tolerance of 1e-09"):
        averaged(LINEAR._replace(damping=1.5), "fokker_planck", 1e-9)


def test_work_is_bounded(monkeypatch):
    """What all grids together may take is refused before it is exceeded."""
    monkeypatch.setattr(solution, "MOST_WORK", 1e6)
    task = solution.StationaryProblem(PAPER.system, 0.01)
    task.take(9e5)
    for more, ahead in ((2e5, 0.0), (0.0, 2e5)):
        with pytest.raises(AveragingError, match=r"tolerance of 0\.01"):
            task.take(more, ahead)
    assert task.left == pytest.approx(1e5)
    with pytest.raises(AveragingError, match="nodes and steps"):
        averaged(PAPER._replace(intensity=0.02), "fokker_planck")


def test_a_slow_load_is_told_beyond_single_precision():
    """What a period changes is below what the load moves in it, by the tolerance's share."""
    device = PAPER._replace(decay_rate=2e-3).system
    region = Region.guessed(device)
    level = REGION_LEVEL._replace(tolerance=0.002)
    found = solution.Solution(solution.StationaryProblem(device, 0.002), region, level)
    later = Propagator(device, found.grid).repeated(found.state, found.steps)
    rest = np.linalg.norm(later - found.state) / np.linalg.norm(found.state)
    assert rest < 2e-2 * 0.002 * 2e-3 * solution.period(device)


SKEW = (-0.15, -2.0, 0.5, 2.2)
TRISTABLE = (0.05, 1.3, 0.0, -3.0, 0.0, 1.2)


def of_uneven_wells(force, loss, intensity):
    """White noise and no coupling."""
    scene = Scene.from_tables(
        {
            "units": "scaled",
            "oscillator": {"damping": loss, "restoring_force": list(force)},
            "piezo": {"coupling": 1e-9},
            "load": {"decay_rate": 1.0},
            "excitation": {"kind": "white", "intensity": intensity},
            "run": {"duration": 10.0, "seed": 1},
        }
    )
    return prepared(scene).system


def gibbs(s, temperature):
    """Displacements and their Gibbs density."""
    x = np.linspace(-4.0, 4.0, 16001)
    energy = systems.potential(s, x)
    weight = np.exp((energy.min() - energy) / temperature)
    return x, weight / np.trapezoid(weight, x)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "loss"), [(SKEW, 0.2), (TRISTABLE, 0.25)], ids=["skew", "tristable"]
)
def test_gibbs_of_uneven_wells(force, loss):
    """White noise and no coupling: shares of time and rate of crossings by quadrature."""
    s = of_uneven_wells(force, loss, intensity=0.1)
    result = average(s)
    x, weight = gibbs(s, 0.1 / loss)
    saddles = sorted(timescales.saddles(s))
    edges = [-4.0, *saddles, 4.0]
    for number, (low, high) in enumerate(pairwise(edges), start=1):
        inside = (x >= low) & (x <= high)
        share = np.trapezoid(weight[inside], x[inside])
        found = result.between_wells[f"share_of_time_in_well_{number}"]
        assert found == pytest.approx(share, abs=3e-3)
    speed = math.sqrt(2.0 * 0.1 / loss / math.pi)
    crossings = speed * sum(np.interp(place, x, weight) for place in saddles)
    assert result.between_wells["well_crossing_rate"] == pytest.approx(crossings, rel=0.01)
    assert np.trapezoid(abs(result.density.displacement(x) - weight), x) < 0.01


@pytest.mark.exhaustive
@pytest.mark.parametrize("intensity", [0.05, 0.012])
@pytest.mark.parametrize(("force", "loss"), [(SKEW, 0.2), (TRISTABLE, 0.25)])
def test_wells_are_not_left_as_they_began(force, loss, intensity, monkeypatch):
    """From shares of time that are wrong, however rare the jumps: right or refused."""
    s = of_uneven_wells(force, loss, intensity)

    def wrong(device, region, grid):
        start = (
            begun(device, region, grid) * np.where(abs(grid.x) > 0.8, 3.0, 1.0)[:, None, None, None]
        )
        return start / start[:, :, 0].sum()

    begun = solution._gibbs
    monkeypatch.setattr(solution, "_gibbs", wrong)
    try:
        result = average(s)
    except AveragingError:
        assert intensity < 0.02
        return
    x, weight = gibbs(s, intensity / loss)
    assert within(result, "mean_square_displacement", np.trapezoid(weight * x * x, x))


@pytest.mark.exhaustive
def test_many_nodes_of_charge_and_a_fast_load():
    """What the load moves beyond the nodes of Z is not magnified: the answer of few nodes."""
    changes = {
        "oscillator.damping": 0.02004,
        "stoppers": {"gap": 1.17336, "stiffness": 2.61347, "restitution": 0.91450},
        "piezo.coupling": 0.75840,
        "load.decay_rate": 0.67053,
        "excitation.intensity": 0.067168,
        "excitation.correlation_time": 0.70118,
        "excitation.knot_spacing": None,
    }
    device = prepared(Scene.read("paper").replace(changes)).system
    few, many = (average(device, tolerance=tolerance) for tolerance in (0.01, 0.002))
    for name in ("mean_square_voltage", "power_conversion_efficiency"):
        assert within(few, name, getattr(many, name))


@pytest.mark.slow
def test_kramers():
    """Rate out of a well of a damped, weakly shaken device: within 15 % of the formula."""
    damping, intensity = 0.8, 0.16
    p = PAPER._replace(
        **WHITE | {"damping": damping, "intensity": intensity, "contact_stiffness": 0.0},
        decay_rate=3.0,
    )
    s = p.system
    found = average(s, memory=True).between_wells["slowest_decay_rate"]
    barrier = math.sqrt(-p.linear_stiffness)
    slowed = math.sqrt(0.25 * damping**2 + barrier**2) - 0.5 * damping
    attempt = timescales.stiffness(s, p.rest) ** 0.5 / (2.0 * math.pi)
    height = timescales.barrier(s, p.rest) * damping / intensity
    expected = slowed / barrier * attempt * math.exp(-height)
    # From either well into the other: twice the rate out of one.
    assert found == pytest.approx(2.0 * expected, rel=0.15)


@pytest.mark.exhaustive
def test_more_nodes_of_the_charge_change_nothing(monkeypatch):
    """A strongly coupled, slow load tilts the wells by several E[X'²] as its charge moves."""
    changes = {
        "piezo.coupling": 1.17,
        "load.decay_rate": 0.019,
        "oscillator.damping": 0.04,
        "excitation.intensity": 0.0145,
        "excitation.correlation_time": 0.205,
    }
    scene = Scene.read("paper").replace(changes)
    usual = average_scene(scene)["mean_square_voltage"]
    monkeypatch.setattr(fokker_planck, "NODES_PER_DECADE", 5.0)
    more = average_scene(scene)["mean_square_voltage"]
    error = usual.standard_error + more.standard_error
    assert more.estimate == pytest.approx(usual.estimate, abs=error)


@pytest.mark.exhaustive
def test_a_coil_without_inductance():
    """Linear spring, white noise: E[P] = Φ²R/(R_coil + R)² · D/c."""
    scene = Scene.read("electromagnetic", ["oscillator.restoring_force=[0, 15.393]"])
    s = prepared(scene).system
    s = s._replace(noise=s.noise._replace(correlation_time=0.0))
    result = average(s)
    total = s.damper.damping + s.transducer.damping()
    share = s.transducer.winding_damping * s.transducer.current_share
    expected = share * (1.0 - s.transducer.current_share) * s.noise.intensity / total
    assert result.mean_power == pytest.approx(expected, rel=5e-3)


def test_a_rate_that_comes_out_negative_is_none_within_its_error():
    grids, means, error = fokker_planck._refined(solution.StationaryProblem(PAPER.system, 0.05))
    means |= {"well_crossing_rate": -1e-4}
    error |= {"well_crossing_rate": 2e-4}
    answer = fokker_planck._answer((grids, means, error))
    assert answer.between_wells["well_crossing_rate"] == 0.0
    assert answer.numerical_error["well_crossing_rate"] == pytest.approx(3e-4)

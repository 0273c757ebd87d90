"""Coexisting motions: against the same equations integrated by scipy, and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import harvester
from harvester.base.errors import HarvesterError, UnknownQuantity
from harvester.cli.command_line import main
from harvester.engines.following import follow, forced
from harvester.results.orbit import Attractor
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.starts import drawn_start, energy_range
from harvester.statistics.attractors import (
    CONVERGED,
    QUANTITIES,
    divergence,
    groups_of,
    means_of,
    repeats_in_noise,
    repetition,
    transients,
)
from harvester.studies import frequency_response
from harvester.studies.orbits.basins import Basins, orbit_sentences
from harvester.studies.orbits.following import Orbit
from harvester.studies.orbits.residence import Residence, kramers_time, stays_of

pytestmark = pytest.mark.usefixtures("shared_workers")

PERIODS = 150


def duffing(damping, amplitude, frequency, **run):
    """x'' + δ x' − x + x³ = F cos ωt, nothing behind the piezo."""
    return Scene.from_tables(
        {
            "units": "scaled",
            "oscillator": {
                "damping": damping,
                "linear_stiffness": -1.0,
                "cubic_stiffness": 1.0,
            },
            "piezo": {"coupling": 0.0},
            "load": {"kind": "resistor", "decay_rate": 1.0},
            "excitation": {
                "kind": "sine",
                "amplitude": amplitude,
                "frequency": frequency / (2.0 * math.pi),
                "phase": math.pi / 2.0,
            },
            "run": {"duration": 100.0, **run},
        },
        name="duffing",
    )


def ends_by_scipy(damping, amplitude, frequency, x, v, periods):
    """(x, v) of all starts after some periods, at tight tolerance."""

    def rates(t, y):
        x, v = y.reshape(2, -1)
        force = amplitude * math.cos(frequency * t)
        return np.concatenate([v, force - damping * v + x - x**3])

    end = 2.0 * math.pi / frequency * periods
    found = solve_ivp(
        rates, (0.0, end), np.concatenate([x, v]), method="DOP853", rtol=1e-9, atol=1e-10
    )
    return found.y[:, -1].reshape(2, -1)


@pytest.mark.slow
def test_basins_of_two_wells():
    device = (0.25, 0.2, 1.0)
    line = np.linspace(-2.0, 2.0, 15)
    found = harvester.basins(
        duffing(*device), displacement=line, velocity=line, periods=PERIODS, workers=1
    )
    assert [each.kind for each in found.orbits] == ["period 1", "period 1"]
    x, v = (each.ravel() for each in np.meshgrid(line, line))
    ends, _ = ends_by_scipy(*device, x, v, 60)
    right = found.orbits[0].points[0, 0] > 0.0
    share = np.mean(ends > 0.0) if right else np.mean(ends < 0.0)
    assert found.orbits[0].share == pytest.approx(share, abs=0.02)
    # Start by start but for those next to a fractal border, where scipy's tolerance decides too.
    assert np.mean((found.orbit.ravel() == 0) == ((ends > 0.0) == right)) > 0.93


@pytest.mark.exhaustive
def test_basins_of_three_wells():
    """x'' + 0.15 x' + x − 1.4 x³ + 0.4 x⁵ = 0.15 cos 0.9 t: three motions."""
    damping, amplitude, frequency, periods = 0.15, 0.15, 0.9, 200
    tables = duffing(damping, amplitude, frequency).to_tables()
    tables["oscillator"] = {"damping": damping, "restoring_force": [0.0, 1.0, 0.0, -1.4, 0.0, 0.4]}
    x, v = np.linspace(-2.2, 2.2, 15), np.linspace(-1.5, 1.5, 15)
    found = harvester.basins(
        Scene.from_tables(tables), displacement=x, velocity=v, periods=periods, workers=1
    )

    def rates(t, y):
        x, v = y.reshape(2, -1)
        force = amplitude * math.cos(frequency * t) - x + 1.4 * x**3 - 0.4 * x**5
        return np.concatenate([v, force - damping * v])

    times = 2.0 * math.pi / frequency * np.arange(periods - 64, periods + 1)
    start = np.concatenate([each.ravel() for each in np.meshgrid(x, v)])
    path = solve_ivp(
        rates, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-9, atol=1e-10
    ).y.reshape(2, 225, 65)
    own = groups_of(np.stack([*path, np.zeros((225, 65))], axis=2))
    assert len(own) == len(found.orbits) == 3
    for orbit, group in zip(found.orbits, own, strict=True):
        assert orbit.period == group.period == 1
        assert orbit.points[0] == pytest.approx(group.points[0, :2], abs=1e-3)
        assert orbit.share == pytest.approx(group.members.size / 225, abs=0.02)


@pytest.mark.exhaustive
def test_chaos_has_the_exponent_of_its_variational_equation():
    damping, amplitude, frequency = 0.3, 0.5, 1.2
    found = harvester.basins(
        duffing(damping, amplitude, frequency), points=6, periods=100, workers=1
    )
    run = duffing(damping, amplitude, frequency, settle=200.0, starts=8)
    attractors = harvester.simulate(run, method="monte-carlo", workers=1).attractors
    orbits = [*found.orbits, *attractors]
    assert [each.kind for each in orbits] == ["chaotic", "chaotic"]
    assert "largest Lyapunov exponent" in attractors[0].sentence("W")

    def rates(t, y):
        x, v, dx, dv = y
        force = amplitude * math.cos(frequency * t)
        return [v, force - damping * v + x - x**3, dv, (1.0 - 3.0 * x * x) * dx - damping * dv]

    period, y, logs = 2.0 * math.pi / frequency, np.array([0.1, 0.0, 1.0, 0.0]), []
    for k in range(400):
        span = (k * period, (k + 1) * period)
        y = solve_ivp(rates, span, y, method="DOP853", rtol=1e-8, atol=1e-9).y[:, -1]
        size = math.hypot(*y[2:])
        logs.append(math.log(size))
        y[2:] /= size
    growth = np.array(logs[50:]) / period
    for orbit in orbits:
        error = math.hypot(orbit.lyapunov.standard_error, growth.std() / math.sqrt(growth.size))
        assert abs(orbit.lyapunov.exponent - growth.mean()) < 3.5 * error


@pytest.mark.exhaustive
def test_bifurcation_finds_the_hysteresis_of_a_hardening_spring():
    scene = duffing(0.1, 0.1, 1.0).replace(
        {"oscillator.linear_stiffness": 1.0, "oscillator.cubic_stiffness": 1.0}
    )
    values = np.linspace(0.16, 0.24, 41)
    found = harvester.bifurcation(
        scene, over={"excitation.frequency": values}, periods=60, workers=1
    )
    up, down = found.branches
    for branch, order in ((up, values), (down, values[::-1])):
        y = [0.0, 0.0]
        largest = []
        for frequency in order:
            omega = 2.0 * math.pi * frequency

            def rates(t, y, omega=omega):
                force = 0.1 * math.cos(omega * t)
                return [y[1], force - 0.1 * y[1] - y[0] - y[0] ** 3]

            span = np.linspace(0.0, 124 / frequency, 124 * 32 + 1)
            path = solve_ivp(rates, (0.0, span[-1]), y, t_eval=span, rtol=1e-7, atol=1e-9).y
            y = path[:, -1]
            largest.append(math.sqrt(np.mean(path[0, -64 * 32 :] ** 2)))
        expected = np.array(largest if branch.direction == "up" else largest[::-1])
        # Next to a fold a transient lasts for ever.
        off = np.abs(branch.rms_displacement / expected - 1.0)
        assert np.sort(off)[-3] < 0.01
    assert {each.direction for each in found.jumps} == {"up", "down"}
    assert np.all(up.period == 1)
    jump = {each.direction: each.before for each in found.jumps}
    assert jump["up"] > jump["down"]
    assert any("harvester basins lists them" in line for line in found.sentences())


@pytest.mark.slow
def test_starts_of_simulate_tell_of_both_wells():
    scene = duffing(0.25, 0.2, 1.0, settle=160.0, starts=12)
    found = harvester.simulate(scene, method="monte-carlo", workers=1, stroboscope=True)
    assert scene.run.realizations == 12
    assert [each.kind for each in found.attractors] == ["period 1", "period 1"]
    assert sum(each.share for each in found.attractors) == pytest.approx(1.0)
    assert found.section().shape == (12, 16, 2)
    assert any("orbit A (period 1)" in line for line in found.sentences())
    alone = harvester.simulate(scene.replace({"run.starts": 1}), method="monte-carlo", workers=1)
    assert any(line.startswith("one start") for line in alone.sentences())
    assert found.figure() is not None
    assert len(found.to_dict()["attractors"]) == 2


def test_starts_lie_in_the_energy_range():
    ready = prepared(duffing(0.25, 0.2, 1.0))
    span = energy_range(ready)
    starts = np.array([drawn_start(ready, k)[:2] for k in range(300)])
    energy = 0.5 * starts[:, 1] ** 2 - 0.5 * starts[:, 0] ** 2 + 0.25 * starts[:, 0] ** 4
    assert energy.max() <= span.highest
    assert energy.max() > 0.9 * span.highest
    assert abs(starts[:, 0].mean()) < 0.25


def test_refusals():
    with pytest.raises(HarvesterError, match="needs a periodic deterministic excitation"):
        harvester.basins("duffing")
    with pytest.raises(
        HarvesterError, match="bifurcation needs a periodic deterministic excitation"
    ):
        harvester.bifurcation("duffing", over={"excitation.amplitude": [0.1, 0.2]})
    with pytest.raises(HarvesterError, match="residence times need noise"):
        harvester.residence(duffing(0.25, 0.2, 1.0))
    with pytest.raises(HarvesterError, match=r"run\.starts"):
        Scene.read("duffing", ["run.starts=10"])
    for wrong in ({"points": 1001}, {"periods": 1}, {"periods": 10**12}):
        with pytest.raises(HarvesterError, match=next(iter(wrong))):
            harvester.basins(duffing(0.25, 0.2, 1.0), **wrong)
    with pytest.raises(HarvesterError, match=r"leave out the table \[start\]"):
        duffing(0.25, 0.2, 1.0, starts=2).replace({"start.velocity": 1.0})
    with pytest.raises(HarvesterError, match="two different numbers"):
        harvester.bifurcation(duffing(0.25, 0.2, 1.0), over={"excitation.amplitude": [0.1]})
    with pytest.raises(HarvesterError, match=r"so \[run\] has no effect"):
        harvester.bifurcation(duffing(0.25, 0.2, 1.0), over={"run.duration": [1.0, 2.0]})


def test_periods_and_cycles():
    k = np.arange(64)
    three = np.stack([np.cos(2.0 * np.pi * k / 3.0 + 0.3), np.sin(k * 0.0), 0.0 * k], axis=1)
    turned = np.roll(three, 1, axis=0)
    wild = np.random.default_rng(1).uniform(-1.0, 1.0, (64, 3)) * [1.0, 1.0, 0.0]
    spiral = 1.0 + 2e-3 * np.exp(-0.05 * k)[:, None] * np.cos(2.0 * np.pi * k / 3.0)[:, None]
    samples = np.stack([three, turned, wild, spiral * [1.0, 0.0, 0.0]])
    assert repetition(samples).tolist() == [3, 3, 0, 1]
    assert [each.members.tolist() for each in groups_of(samples)] == [[0, 1], [2], [3]]


def test_a_start_that_still_settles_is_on_the_cycle_that_it_comes_to():
    k = np.arange(64)
    three = np.stack([np.cos(2.0 * np.pi * k / 3.0), np.sin(2.0 * np.pi * k / 3.0), 0.0 * k]).T
    late = np.roll(three, 1, axis=0) + 0.2 * np.exp(-0.06 * k)[:, None] * [1.0, 0.0, 0.0]
    later = np.roll(three, 1, axis=0) + 0.2 * np.exp(-0.03 * k)[:, None] * [1.0, 0.0, 0.0]
    samples = np.stack([three, late, later])
    assert repetition(samples).tolist() == [3, 0, 0]
    assert [each.members.tolist() for each in groups_of(samples)] == [[0, 1], [2]]


def test_what_is_not_settled_is_no_steady_motion():
    errors = dict.fromkeys(QUANTITIES, 1e-3)
    orbit = Orbit("A", "period 1", 1, None, 3, 0.75, 0.1, 2.0, 1.0, 1.0, errors, np.zeros((1, 2)))
    other = replace(orbit, name="not settled", kind="not settled", period=None, mean_power=math.nan)
    first, best, _, last = orbit_sentences([orbit, other], {"power": "W"}.get)
    assert first == "1 steady motion: period 1"
    assert best.startswith("largest power on orbit A, 2.0000 ± 0.0010 W")
    assert last.startswith("3 starts: not settled, ")


def test_a_transient_tells_where_it_ends():
    k, rates = np.arange(65), np.array([0.0, 0.02, 0.2])
    samples = np.ones((3, 65, 3)) + 1e-3 * np.exp(-rates[:, None] * k)[:, :, None]
    samples[0] += 1e-5 * k[:, None]
    periods, _, remains = transients(samples, 0.0)
    assert periods.tolist() == [1, 1, 1]
    # A steady drift has no end; a decay has what its last stretch of 24 samples leaves.
    assert remains[0] > 1.0
    assert remains[1] == pytest.approx(1e-3 * math.exp(-0.02 * 48), rel=0.01)
    assert remains[2] < CONVERGED
    # Of a store with a memory of 1e6 periods all that is still to come counts.
    assert transients(samples, 1e6)[2][2] > 1e-3


BISTABLE = {
    "oscillator.damping": 0.3, "oscillator.linear_stiffness": -9.0, "load.decay_rate": 0.9,
    "oscillator.cubic_stiffness": 25.0, "piezo.coupling": 1.1, "excitation.phase": 0.0,
}  # fmt: skip


def bistable(frequency, amplitude):
    """A scaled device with an energy barrier of 0.81."""
    changes = {**BISTABLE, "excitation.frequency": frequency, "excitation.amplitude": amplitude}
    return duffing(0.3, 1.0, 1.0).replace(changes)


@pytest.mark.slow
def test_powers_hold_no_transient():
    """Late arrivals raised the wells' powers by some percent, each by another."""
    scene = bistable(0.4, 1.6)
    found = harvester.basins(scene, points=6, workers=1)
    period = scene.excitation.period

    def rates(t, y):
        x, v, voltage = y[:3]
        force = 1.6 * math.sin(2.0 * math.pi * t / period) + 9.0 * x - 25.0 * x**3
        return [v, force - 0.3 * v - 1.1 * voltage, v - 0.9 * voltage, 0.99 * voltage**2]

    assert len(found.orbits) == 3
    for orbit in found.orbits:
        start, ends = [*orbit.points[0], 0.0, 0.0], [80.0 * period, 90.0 * period]
        path = solve_ivp(rates, (0.0, ends[1]), start, "DOP853", ends, rtol=1e-10, atol=1e-12).y
        assert path[:2, 1] == pytest.approx(orbit.points[0], abs=1e-5)
        power = (path[3, 1] - path[3, 0]) / (10.0 * period)
        assert orbit.mean_power == pytest.approx(power, rel=1e-6)
        assert orbit.errors["mean_power"] < 1e-6 * power
    assert found.orbits[1].mean_power == pytest.approx(found.orbits[2].mean_power, rel=1e-8)


@pytest.mark.slow
def test_mirror_orbits_and_no_orbit_of_a_start_that_settles():
    """Two orbits of period 5: a third and one "not settled" were starts on the way to them."""
    found = harvester.basins(bistable(0.5, 1.0), points=16, workers=1)
    assert [each.kind for each in found.orbits] == 2 * ["period 1"] + 2 * ["period 5"]
    powers = np.array([each.mean_power for each in found.orbits]).reshape(2, 2)
    assert powers[:, 0] == pytest.approx(powers[:, 1], rel=1e-7)


def escaping(amplitude):
    """x'' + 0.1 x' + x − x² within ±1.5: beyond 1 it runs away."""
    tables = duffing(0.1, amplitude, 0.85).to_tables()
    spring = {"restoring_force": [0.0, 1.0, -1.0], "restoring_force_range": [-1.5, 1.5]}
    tables["oscillator"] = {"damping": 0.1, **spring}
    return Scene.from_tables(tables)


@pytest.mark.slow
def test_a_start_that_leaves_the_range_escapes():
    line = np.linspace(-0.9, 1.2, 6)
    found = harvester.basins(
        escaping(0.02), displacement=line, velocity=[-0.3, 0.0, 0.3], periods=120, workers=1
    )
    x, v = (each.ravel() for each in np.meshgrid(line, [-0.3, 0.0, 0.3]))

    def rates(t, y):
        force = 0.02 * math.cos(0.85 * t)
        return [y[1], force - 0.1 * y[1] - y[0] + y[0] ** 2]

    def outside(t, y):
        return abs(y[0]) - 1.5

    outside.terminal = True
    left = [
        solve_ivp(rates, (0.0, 400.0), each, rtol=1e-8, events=outside).status == 1
        for each in zip(x, v, strict=True)
    ]
    assert 0 < sum(left) < len(left)
    names = [found.orbits[k].name for k in found.orbit.ravel()]
    assert [name == "escapes" for name in names] == left
    assert "—" in found.table()[1][-1]
    assert found.to_dict()["orbits"][-1]["mean_power"] is None
    assert any("escapes, the mass leaves" in line for line in found.sentences())


@pytest.mark.slow
def test_orbits_of_a_run_hold_no_transient_and_whole_cycles():
    """140 periods are no whole number of the cycles of five; basins has them converged."""
    run = {"run.starts": 24, "run.settle": 100.0, "run.duration": 200.0}
    scene = bistable(0.7, 2.2)
    found = harvester.simulate(scene.replace(run), method="monte-carlo", workers=1).attractors
    expected = harvester.basins(scene, points=6, workers=1).orbits
    kinds = ["period 1", "period 5", "period 4", "period 4"]
    assert [each.kind for each in found] == [*kinds, "not settled"]
    powers = {each.kind: each.mean_power for each in expected}
    for orbit in found[:4]:
        power = orbit.quantities["mean_power"]
        assert abs(power.estimate - powers[orbit.kind]) < 3.0 * power.standard_error
        assert power.standard_error < 1e-4 * power.estimate
    assert found[-1].quantities == {}


@pytest.mark.slow
def test_starts_of_simulate_escape():
    run = {"run.starts": 8, "run.settle": 250.0, "run.duration": 100.0, "piezo.coupling": 1e-3}
    found = harvester.simulate(escaping(0.06).replace(run), method="monte-carlo", workers=1)
    *orbits, escapes = found.attractors
    assert escapes.name == escapes.kind == "escapes"
    assert orbits
    assert all(each.quantities["mean_power"].estimate > 0.0 for each in orbits)
    assert sum(each.starts for each in found.attractors) == 8
    assert sum(each.share for each in found.attractors) == pytest.approx(1.0)
    assert not found.failures
    assert any(line.startswith("escapes: ") for line in found.sentences())


def test_a_bifurcation_goes_on_beside_an_escape():
    found = harvester.bifurcation(
        escaping(0.02), over={"excitation.amplitude": [0.02, 0.04, 0.4]}, periods=60, workers=1
    )
    assert [each.motion for each in found.branches] == 2 * [["period 1", "period 1", "escapes"]]
    assert np.isnan(found.branches[0].mean_power).tolist() == [False, False, True]
    assert not found.failures


def test_down_begins_where_up_ended():
    """A range that ends between the folds of a hardening spring: down keeps to the branch of up."""
    scene = duffing(0.1, 0.1, 1.0).replace(
        {"oscillator.linear_stiffness": 1.0, "oscillator.cubic_stiffness": 1.0}
    )
    up, down = harvester.bifurcation(
        scene, over={"excitation.frequency": np.linspace(0.15, 0.19, 5)}, periods=40, workers=1
    ).branches
    # From rest it comes to the lower branch there, with an rms displacement of 0.18.
    assert up.rms_displacement[-1] > 0.5
    assert down.rms_displacement == pytest.approx(up.rms_displacement, rel=1e-4)


@pytest.mark.slow
def test_error_bars_of_chaotic_values_hold_the_mean():
    """64 periods of each of 60 chaotic paths: 95 % intervals hold the mean of all; 88 % or fewer
    would be chance once in 100 times."""
    driven = forced(duffing(0.15, 0.3, 1.0), "a test")
    starts = np.c_[np.random.default_rng(3).uniform(-1.0, 1.0, (60, 2)), np.zeros(60)].tolist()
    samples = follow(driven, "monte-carlo", "default", starts, 164, 64, lambda *_: None)
    samples = samples[transients(samples[:, :, :3], 0.0)[0] == 0]
    assert len(samples) > 50
    period = driven.scene.excitation.period
    means, errors = np.array([means_of(each[None], period, 0.0, 0.0) for each in samples]).swapaxes(
        0, 1
    )
    apart = np.abs(means - means_of(samples, period, 0.0, 0.0)[0])[:, 2]
    assert np.mean(apart < 1.96 * errors[:, 2]) > 0.88


def test_steps_cost_a_small_part_of_the_apparent_power_more():
    """Of a motion of period 1 with the power 1 at the mean-square voltage 4."""
    samples = np.zeros((1, 64, 6))
    samples[0, :, 3:] = np.outer(np.arange(64.0), [1.0, 4.0, 1.0])
    usual, faint = (means_of(samples, 1.0, 1e-4, 0.0, reactive)[1] for reactive in (1.25, 125.0))
    assert usual[0] == pytest.approx(1e-4)
    # A hundredth of a fifth of the apparent power: ten times.
    assert faint == pytest.approx(usual * [10.0, 1.0, 1.0])


@pytest.fixture
def slow_store(tmp_path):
    """A bridge on 100 mF and 200 kΩ: five hours, and 480 µW at first instead of 1.39 mW."""
    path = tmp_path / "slow.lib"
    path.write_text(
        "* bridge\n.subckt slow p n out ref\n.model dx d(is=4.352n n=1.906 rs=0.6458 cjo=0.7p)\n"
        "D1 p out dx\nD2 ref p dx\nD3 n out dx\nD4 ref n dx\nCstray ref n 10p\n"
        "Cout out ref 100m\nRload out ref 200k\n.ends\n"
    )
    oscillator = {"mass": 14.04e-3, "frequency": 45.7, "damping_ratio": 0.027}
    return Scene.from_tables(
        {
            "units": "SI",
            "oscillator": {**oscillator, "base_factor": 1.0854},
            "piezo": {"coupling": 2.327e-3, "capacitance": 41.26e-9},
            "load": {"netlist": str(path)},
            "excitation": {"kind": "sine", "amplitude": 4.0, "frequency": 46.0},
            "run": {"duration": 2.0},
        }
    )


@pytest.mark.slow
def test_a_store_that_still_charges_has_no_power(slow_store, monkeypatch):
    found = harvester.basins(slow_store, displacement=[0.0], velocity=[0.0], periods=100, workers=1)
    assert [each.kind for each in found.orbits] == ["still charging"]
    assert math.isnan(found.orbits[0].mean_power)
    over = harvester.bifurcation(
        slow_store, over={"excitation.amplitude": [3.0, 4.0]}, periods=80, workers=1
    )
    assert over.branches[1].motion == 2 * ["still charging"]
    assert np.isnan(over.branches[1].mean_power).all()
    monkeypatch.setattr(frequency_response, "MOST_PERIODS", 50)
    response = harvester.frequency_response(slow_store, [45.0, 46.0], workers=1)
    assert np.isnan(response.sweeps[0].mean_power).all()
    assert (response.sweeps[0].residual > 1.0).all()
    assert any("still charging at 2 frequencies" in line for line in response.sentences())


def test_exponent_of_a_growth_that_is_known():
    steps = 0.7 * np.arange(40)
    apart = 1e-9 * np.exp(0.3 * steps)
    pairs = np.zeros((4, 2, 40, 3))
    pairs[:, 1, :, 0] = apart
    found = divergence(pairs, np.ones(3), 0.7)
    assert found.exponent == pytest.approx(0.3)
    assert found.chaotic


def test_the_error_of_an_exponent_is_how_far_it_lies_off():
    """Neighbours part at random about a mean rate: 300 times twelve pairs.

    The mean square of deviations over errors is 12/(12 − 3) of a ratio of twelve normal values,
    here known to 10 %.
    """
    draws, rate, period = np.random.default_rng(1), 0.1, 0.7
    off = []
    for _ in range(300):
        growth = np.cumsum(draws.normal(rate * period, 0.2, (12, 40)), axis=1)
        pairs = np.zeros((12, 2, 40, 3))
        pairs[:, 1, :, 0] = 1e-9 * np.exp(growth)
        found = divergence(pairs, np.ones(3), period)
        off.append((found.exponent - rate) / found.standard_error)
    assert np.mean(np.square(off)) == pytest.approx(12.0 / 9.0, rel=0.3)


def test_kramers_at_strong_damping():
    scene = Scene.read(
        "duffing",
        [
            "oscillator.damping=3.0", "oscillator.linear_stiffness=-1", "piezo.coupling=0",
            "oscillator.cubic_stiffness=1",
            'excitation={kind="white", intensity=0.15, knot_spacing=0.02}',
        ],
    )  # fmt: skip
    time, reason = kramers_time(prepared(scene), 1.0)
    slowing = math.sqrt(9.0 / 4.0 + 1.0) - 1.5
    expected = 2.0 * math.pi / (math.sqrt(2.0) * slowing) * math.exp(0.25 / 0.05)
    assert reason == ""
    # Losing 9 temperatures of energy a round, a few in a thousand turn back over the saddle.
    assert time == pytest.approx(expected, rel=0.02)


def three_temperatures(intensity, **excitation):
    """A barrier of 1 over 2 D: √8 rad/s in each well."""
    return Scene.from_tables(
        {
            "units": "scaled",
            "oscillator": {"damping": 0.5, "restoring_force": [0.0, -4.0, 0.0, 4.0]},
            "piezo": {"coupling": 0.01},
            "load": {"decay_rate": 1.0},
            "excitation": {"kind": "white", "intensity": intensity, **excitation},
            "run": {"duration": 2000.0, "settle": 50.0, "seed": 1, "realizations": 64},
        }
    )


def test_a_barrier_of_three_temperatures_but_for_rounding_has_kramers_time():
    # D = 1/6 in seven digits: 2.9999994 temperatures.
    assert kramers_time(prepared(three_temperatures(0.1666667)), 1.0)[1] == ""
    reason = kramers_time(prepared(three_temperatures(0.1672)), 1.0)[1]
    assert reason == "the barrier is 2.99 temperatures: must be 3 or more"


@pytest.mark.parametrize(("rate", "holds"), [(1e4, True), (1.0, False), (1e-4, False)])
def test_kramers_formula_needs_little_stiffness_and_damping_at_the_load(rate, holds):
    """Of a coupling of 1/s² and 8/s² of the well a short circuit leaves nothing."""
    coupled = {"piezo.coupling": 1.0, "load.decay_rate": rate}
    time, reason = kramers_time(prepared(three_temperatures(0.1).replace(coupled)), 1.0)
    assert (reason == "") == (time is not None) == holds
    if holds:
        alone = kramers_time(prepared(three_temperatures(0.1)), 1.0)[0]
        assert time == pytest.approx(alone, rel=1e-9)


def test_what_the_knots_of_white_noise_lengthen_is_noted():
    """1 − sinc⁴(ω h/2) = ω²h²/6 of the density times three temperatures; not at close knots."""
    times, exits = np.full((4, 4, 2), 100.0), np.full((4, 4, 2), 2.0)
    for spacing, noted in ((0.0555, True), (0.01, False)):
        scene = three_temperatures(1.0 / 6.0, knot_spacing=spacing)
        found = stays_of(prepared(scene), None, times, exits)
        assert found[0].longer_by_knots == pytest.approx(3.0 * 8.0 * spacing**2 / 6.0, rel=0.01)
        lines = Residence(scene, None, found, "monte-carlo", "", 0.0).sentences()
        assert any("about 1.2% to 2.5% longer" in line for line in lines) == noted


def test_a_missing_kramers_time_is_told_with_its_value():
    times, exits = np.full((4, 4, 2), 100.0), np.full((4, 4, 2), 2.0)
    scene = three_temperatures(1.0 / 6.0)
    found = [
        stay
        for value in (0.1, 0.3)
        for stay in stays_of(
            prepared(scene.replace({"excitation.intensity": value})), value, times, exits
        )
    ]
    residence = Residence(scene, "excitation.intensity", found, "monte-carlo", "", 0.0)
    assert any("is asymptotic" in line for line in residence.sentences())
    (line,) = [line for line in residence.sentences() if "Kramers' formula is not valid" in line]
    assert line.startswith("Kramers' formula is not valid at excitation.intensity = 0.3: ")
    header, rows = residence.table()
    assert header[2] == "residence time ± standard error [s]"

    assert rows[0][2] == "50"


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("intensity", "method", "precision"),
    [
        *((each, "monte-carlo", 0.03) for each in (0.02, 0.026, 0.034, 0.044, 0.06)),
        (0.06, "circuit", None),
    ],
)
def test_residence_against_plain_euler(intensity, method, precision):
    """Langevin's equation by a scheme of our own, counted by the wells' cores."""
    duration = 4000 if precision else 400
    scene = Scene.read(
        "duffing",
        [
            "oscillator.damping=0.25", "oscillator.linear_stiffness=-1", "piezo.coupling=0",
            "oscillator.cubic_stiffness=1", f"run.duration={duration}", "run.realizations=16",
            f'excitation={{kind="white", intensity={intensity}, knot_spacing=0.02}}',
        ],
    )  # fmt: skip
    (stay,) = harvester.residence(scene, method=method, precision=precision).stays
    time, error = plain_residence(intensity, 0.25)
    assert abs(stay.time - time) < 3.0 * math.hypot(stay.standard_error, error)


def plain_residence(intensity, damping, copies=2000, total=1000.0, step=0.01):
    """Mean time from core to core and its error; leapfrog with a kick of noise each step."""
    random = np.random.default_rng(7)
    x, v = np.where(np.arange(copies) % 2, 1.0, -1.0), np.zeros(copies)
    well, jumps = np.sign(x), 0
    kick = math.sqrt(2.0 * intensity * step)
    for _ in range(int(total / step)):
        x += 0.5 * step * v
        v += step * (x - x**3 - damping * v) + kick * random.standard_normal(copies)
        x += 0.5 * step * v
        energy = 0.5 * v * v - 0.5 * x * x + 0.25 * x**4
        reached = (energy <= -0.25 + 0.0625) & (np.sign(x) != well)
        jumps += int(reached.sum())
        well = np.where(reached, np.sign(x), well)
    time = copies * total / jumps
    return time, time / math.sqrt(jumps)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("amplitude", "expected"), [(0.2, 1), (0.28, 2), (0.29, 4), (0.37, 5), (0.5, 0), (0.65, 2)]
)
def test_a_measured_path_repeats_as_its_section_does(amplitude, expected):
    """Two wells by scipy, δ = 0.3, ω = 1.2: the periods that are known of this example."""
    frequency, points = 1.2, 40

    def rates(t, y):
        return [y[1], amplitude * math.cos(frequency * t) - 0.3 * y[1] + y[0] - y[0] ** 3]

    times = 2.0 * math.pi / frequency * (100.0 + np.arange(64 * points + 1) / points)
    path = solve_ivp(
        rates, (0.0, times[-1]), [1.0, 0.0], method="DOP853", t_eval=times, rtol=1e-8, atol=1e-9
    ).y
    section = np.stack([*path[:, ::points], np.zeros(65)], axis=1)
    assert repetition(section[None])[0] == expected
    noise = 0.02 * np.random.default_rng(3).standard_normal(times.size)
    assert repeats_in_noise(path[0] + noise, points) == (expected > 0)


def test_a_chaotic_transient_is_followed_to_its_orbit():
    """The device at 10 Hz and 8 m/s² wanders for some 200 periods; scipy ends on one orbit."""
    scene = Scene.read(
        "device", ['excitation={kind="sine",amplitude=7.0,frequency=10.0}', "run.seed=1"]
    )
    found = harvester.bifurcation(
        scene, over={"excitation.amplitude": [7.0, 8.0]}, workers=1, down=False
    )
    (up,) = found.branches
    assert up.period[1] == 1
    assert up.mean_power[1] == pytest.approx(0.0149569, rel=1e-4)
    # What has no error bar says why.
    missing = np.isnan(up.errors["mean_power"])
    assert missing.any() == any("no error bar" in each for each in found.sentences())
    power, error = (found.to_xarray()[f"mean_power{end}"] for end in ("", "_standard_error"))
    assert power.attrs == error.attrs == {"unit": "W"}
    np.testing.assert_array_equal(error[0], up.errors["mean_power"])
    assert found.data()[0][1] == "excitation.amplitude [m/s²]"
    estimate = found["mean_power"]["up", 8.0]
    assert (estimate.estimate, estimate.unit) == (up.mean_power[1], "W")
    assert estimate.standard_error == pytest.approx(up.errors["mean_power"][1])
    assert "error_of_the_mean_power" not in list(found)


def test_basins_say_the_plane_of_their_starts():
    scene, x, v = Scene.read("device"), np.linspace(-0.02, 0.02, 5), np.array([0.1])
    found = Basins(scene, "m", "v", x, v, np.zeros((1, 5), dtype=int), [], 10, 0.0)
    (line,) = (line for line in found.sentences() if line.startswith("plane of the starts"))
    assert "5 values of the displacement from -20 mm to 20 mm, velocity 100 mm/s, with an" in line


@pytest.mark.parametrize(
    ("over", "values"),
    [
        ({"excitation.amplitude": [0.1, 0.2], "run.seed": [1, 2]}, None),
        ({"excitation.amplitude": [0.1, 0.2]}, [0.1, 0.2]),
        ("excitation.amplitude", None),
        (["excitation.amplitude"], [0.1, 0.2]),
    ],
)
def test_a_grid_along_one_key_has_one_form(over, values):
    with pytest.raises(HarvesterError, match=r"^over .*: give one key with its values, over="):
        harvester.bifurcation(duffing(0.25, 0.2, 1.0), over=over, values=values)


def test_a_grid_along_one_key_is_written_as_in_a_sweep(capsys):
    for words, message in (
        (["k=0.05,abc"], "--over k=0.05,abc: must be written as TABLE.KEY=LIST"),
        (["load.resistance"], "--over 'load.resistance': give one key with its values, --over "),
        (["load.resistence=1,2"], "did you mean"),
    ):
        assert main(["residence", "device", "--over", *words]) == 2
        assert message in capsys.readouterr().err


def test_a_start_that_diverges_is_an_outcome_of_its_own(pool):
    """A start far out overflows; the other ones go on."""
    sine = {"kind": "sine", "amplitude": 0.3, "frequency": 0.2}
    scene = Scene.read("duffing").replace({"excitation": sine})
    found = harvester.basins(
        scene, displacement=[0.5, 1e9], velocity=[0.0], periods=20, executor=pool
    )
    assert [orbit.kind for orbit in found.orbits][-1] == "diverges"
    assert found.orbit[0, 1] == len(found.orbits) - 1
    assert any("values overflow" in line for line in found.sentences())
    with pytest.raises(HarvesterError, match=r"must be ascending numbers, such as numpy.linspace"):
        harvester.basins(scene, displacement=[0.0, -1.0], executor=pool)


def test_means_of_a_motion_are_estimates_with_units_and_missing_ones_are_named():
    errors = dict.fromkeys(QUANTITIES, 1e-3)
    units = {"power": "W", "voltage": "V", "displacement": "m"}
    share = 3, 0.75, 0.1
    args = *share, 2.0, 1.0, 1.0, errors, np.zeros((1, 2)), units
    orbit = Orbit("A", "period 1", 1, None, *args)
    assert str(orbit.quantities["mean_power"]) == "2.0000 ± 0.0010 W"
    assert float(orbit.quantities["mean_power"]) == orbit.mean_power
    unsteady = replace(orbit, name="not settled", kind="not settled", period=None)
    attractor = Attractor("not settled", None, True, *share, {}, np.zeros((0, 2)))
    for motion in (unsteady, attractor):
        with pytest.raises(
            UnknownQuantity, match=r"motion not settled .*raise periods.*mean_power"
        ):
            motion.quantities["mean_power"]

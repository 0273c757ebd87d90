from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from truths import flat, records_of

from harvester import average
from harvester.device.record import Record
from harvester.engines.methods import MonteCarlo
from harvester.engines.realization import empty_moments, run
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.balance import energy_balance_residual
from harvester.statistics.batch_means import (
    complete_batches,
    ratio_of_sums,
    standard_error,
    standard_error_of_drift,
)
from harvester.statistics.densities import densities
from harvester.statistics.estimate import TOO_SHORT, Estimate
from harvester.statistics.moments import Moments
from harvester.statistics.paired import deviations, paired_difference
from harvester.statistics.run_estimates import correlation_time, run_estimates
from harvester.statistics.run_quantities import estimate_all


def autoregressive(seed, memory, rows, length):
    """Stationary AR(1) rows of unit variance."""
    random = np.random.default_rng(seed)
    white = random.standard_normal((rows, length)) * np.sqrt(1 - memory**2)
    white[:, 0] /= np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], white, axis=1)


def exact_error(memory, size):
    return np.sqrt((1 + memory) / (1 - memory) / size)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9, 0.98])
def test_the_error_bar_agrees_with_emcee_and_with_the_closed_form(memory):
    from emcee.autocorr import integrated_time

    series = autoregressive(3, memory, 4, 40_000)
    batches = series.reshape(4, 200, 200).mean(axis=2)
    ours = standard_error(batches)
    time = integrated_time(series.T[:, :, None], quiet=True, has_walkers=True)[0]
    theirs = np.sqrt(series.var() * time / series.size)
    assert ours == pytest.approx(theirs, rel=0.2)
    assert ours == pytest.approx(exact_error(memory, series.size), rel=0.2)


@pytest.mark.parametrize(
    ("error_of", "length", "white"),
    [
        (standard_error, 10, 2.0),
        (standard_error, 25, 0.0),
        (standard_error, 50, 0.0),
        (standard_error_of_drift, 25, 0.0),
        (standard_error_of_drift, 50, 0.0),
    ],
)
def test_in_the_mean_the_error_bar_is_exact(error_of, length, white):
    """Of 100 runs it is known to 1 %: short batches are joined, longer ones still correlated."""
    memory, errors = 0.9, []
    for seed in range(100):
        series = autoregressive(seed, memory, 1, 12_800)
        series += white * np.random.default_rng(1000 + seed).standard_normal(series.shape)
        errors.append(error_of(series.reshape(1, -1, length).mean(axis=2)))
    exact = np.hypot(exact_error(memory, 12_800), white / np.sqrt(12_800))
    assert np.mean(errors) == pytest.approx(exact, rel=0.05)


def test_three_error_bars_cover_the_truth_as_often_as_they_should():
    """400 short runs: a normal estimate is outside in 0.3 %, an error bar from some 30 batches
    in about 0.6 %; more than 8 outside has a false-alarm rate below 0.2 %."""
    outside = 0
    for seed in range(400):
        series = autoregressive(seed, 0.9, 1, 12_800).reshape(1, 256, 50).mean(axis=2)
        outside += abs(series.mean()) > 3 * standard_error(series)
    assert outside <= 8


def energies(seed, rows, times, batches):
    """Batch means of |z|² over that many correlation times, z complex with memory exp(−t/2)."""
    steps = 16 * batches
    memory = np.exp(-0.5 * times / steps)
    real, imaginary = np.split(autoregressive(seed, memory, 2 * rows, steps), 2)
    return (0.5 * (real**2 + imaginary**2)).reshape(rows, batches, 16).mean(axis=2)


@pytest.mark.parametrize(
    ("error_of", "rows", "times"),
    [
        (standard_error, 1, 22.0),
        (standard_error, 2, 12.0),
        (standard_error, 2, 30.0),
        (standard_error, 4, 50.0),
        (standard_error_of_drift, 1, 30.0),
        (standard_error_of_drift, 1, 60.0),
    ],
)
def test_short_runs_are_covered_where_their_correlation_time_is_known(error_of, rows, times):
    """Of 400 seeds 95 % are inside: fewer than 91 or more than 98 % have a false-alarm rate of
    0.1 %. From their own correlations alone half of the shortest have an error, and some 70 % of
    these are inside."""
    batches = -(-256 // rows)
    inside = []
    for seed in range(400):
        series = energies(seed, rows, times, batches)
        error = error_of(series, memory=batches / times)
        if error is not None:
            inside.append(abs(series.mean() - 1.0) < 1.96 * error)
    assert len(inside) > 0.9 * 400
    assert 0.91 < np.mean(inside) < 0.98


@pytest.mark.parametrize(
    ("change", "memory", "widest"), [(0.0, 3.0, 1.4), (1.0, 0.0, 1.8), (1.0, 3.0, 1.8)]
)
def test_uncorrelated_batches_and_those_that_take_back_have_no_wider_error(change, memory, widest):
    """Input power under white noise has no correlation time; efficiencies hold a rate of change.

    Mean errors of 200 seeds are known to 2 %. With the correlation time, or with neighbours taken
    for independent, they are 1.6 to 5 times the scatter.
    """
    errors = []
    for seed in range(200):
        random = np.random.default_rng(seed)
        series = 0.3 * random.standard_normal((1, 256))
        series += change * np.diff(random.standard_normal((1, 257)), axis=1)
        errors.append(standard_error(series, memory=memory))
    exact = np.hypot(0.3 / 16.0, change * np.sqrt(2.0) / 256.0)
    assert 0.95 * exact < np.mean(errors) < widest * exact


def test_uncorrelated_batches_have_no_much_wider_error_where_the_excitation_drifts():
    """Mean errors of 200 seeds are known to 2 %; with all of the correlation time 2.6 times."""
    series = np.random.default_rng(2).standard_normal((200, 1, 256))
    errors = [standard_error_of_drift(row, memory=2.0) for row in series]
    assert 0.95 / 16.0 < np.mean(errors) < 1.8 / 16.0


def test_below_ten_correlation_times_there_is_no_error():
    """Ten of mean squares, which are twenty of exp(−t) on both sides of its middle."""
    for seed in range(20):
        for error_of in (standard_error, standard_error_of_drift):
            assert error_of(energies(seed, 1, 12.0, 256), memory=256 / 12.0) is None


def linear_device(excitation, duration, realizations, **more):
    tables = {
        "units": "SI",
        "oscillator": {"mass": 0.01, "frequency": 40.0, "quality_factor": 40.0},
        "piezo": {"coupling": 1e-3, "capacitance": 50e-9},
        "load": {"resistance": 80e3},
        "excitation": excitation,
        "run": {"duration": duration, "settle": 2.0, "seed": 1, "realizations": realizations},
    }
    return Scene.from_tables(tables | more)


WHITE = {"kind": "white", "intensity": 0.25}
FLAT = {"kind": "spectrum", "unit": "(m/s^2)^2/Hz", "breakpoints": [[40.4, 1.0], [40.7, 1.0]]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("excitation", "expected"),
    # The rate of loss is that of the damper, 2π 40/40, over 1 − 38.7 %, the efficiency. A band
    # narrower than the resonance forgets in 1/(2 · 0.3 Hz).
    [(WHITE, (1.0 - 0.387) / (2.0 * np.pi)), (FLAT, 1.0 / 0.6)],
)
def test_the_correlation_time_is_that_of_damping_and_band(excitation, expected):
    scene = linear_device(excitation, 3.0, 2)
    time = correlation_time(prepared(scene), moments_by_monte_carlo(scene, 2))
    assert time == pytest.approx(expected, rel=0.03)


def moments_by_monte_carlo(scene, count):
    found = run(prepared(scene), MonteCarlo(), list(range(count)), None, lambda _: None)
    return [each.moments for each in found]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("excitation", "duration", "realizations"),
    [
        (WHITE, 1.1, 2),
        (WHITE, 3.0, 2),
        (WHITE, 20.0, 2),
        (FLAT | {"breakpoints": [[38.0, 0.001], [39.5, 1.0], [40.5, 1.0], [42.0, 0.001]]}, 10.0, 4),
    ],
)
def test_the_power_of_short_runs_is_covered(excitation, duration, realizations):
    """The exact power of the linear device, of 200 seeds; 95 ± 1.5 % is the chance of them."""
    scene = linear_device(excitation, duration, realizations)
    moments = moments_by_monte_carlo(scene, 200 * realizations)
    exact = average(scene, method="spectral").quantities["mean_power"].estimate
    power, inside = prepared(scene).scales.of("power"), []
    for first in range(0, len(moments), realizations):
        group = moments[first : first + realizations]
        found = run_estimates(prepared(scene), group).scaled["mean_power"]
        if found.standard_error is not None:
            off = found.estimate - exact / power
            inside.append(abs(off) < 1.96 * found.standard_error)
    assert len(inside) > 180
    assert 0.90 < np.mean(inside) < 0.985


def test_a_run_too_short_has_no_error_bar_but_its_estimate():
    assert standard_error(np.zeros((1, 8)) + np.arange(8)) is None
    slow = np.cumsum(np.random.default_rng(1).standard_normal((1, 256)), axis=1)
    assert standard_error(slow) is None


def test_independent_realizations_of_one_batch_each_give_an_error_bar():
    values = np.random.default_rng(2).standard_normal((400, 1))
    assert standard_error(values) == pytest.approx(values.std() / 20, rel=0.01)


def moments_of(scene, chunk=None):
    stop = scene.run.settle + scene.run.duration
    found = []
    for index in range(scene.run.realizations):
        m = empty_moments(prepared(scene))
        for record in records_of(scene, stop, index):
            for part in _split(record, chunk):
                m.add(part)
        found.append(m)
    return found


def _split(record, chunk):
    if chunk is None:
        yield record
        return
    for start in range(0, record.time.size, chunk):
        yield type(record)(*(column[start : start + chunk] for column in record))


SHORT = ["run.duration=400", "run.settle=20", "run.realizations=2"]


@pytest.mark.parametrize("chunk", [1, 2, 3, 37])
def test_moments_do_not_depend_on_the_chunks(chunk):
    scene = Scene.read("paper", SHORT)
    for one, other in zip(moments_of(scene), moments_of(scene, chunk), strict=True):
        np.testing.assert_allclose(one.integrals, other.integrals, rtol=1e-11, atol=1e-15)
        np.testing.assert_array_equal(one.histograms, other.histograms)


def test_moments_are_the_integrals_of_the_record():
    scene = Scene.read("paper", [*SHORT, "run.settle=0", "run.realizations=1"])
    p = flat(scene)
    chunks = [np.array(record) for record in records_of(scene, 400.0)]
    time, x, v, voltage = np.concatenate(chunks, axis=1)[:4]
    total = moments_of(scene)[0].integrals.sum(axis=0)
    assert total[0] == pytest.approx(time[-1] - time[0])
    assert total[1] == pytest.approx(np.trapezoid(voltage**2, time), rel=1e-12)
    assert total[3] == pytest.approx(np.trapezoid(v**2, time), rel=1e-12)
    assert total[7] == np.sum(x[1:] * x[:-1] < 0)
    assert total[8] == np.sum((np.abs(x[:-1]) <= p.gap) & (np.abs(x[1:]) > p.gap))


def test_densities_integrate_to_one_and_have_the_records_spread():
    scene = Scene.read("paper", ["run.realizations=2", "run.duration=2000", "run.settle=20"])
    moments = moments_of(scene)
    p = flat(scene)
    estimates = estimate_all(moments, prepared(scene).system)
    density = densities(moments)["displacement"]
    width = density.centre[1] - density.centre[0]
    assert np.sum(density.density) * width == pytest.approx(1.0, rel=1e-12)
    square = np.sum(density.density * density.centre**2) * width
    assert square == pytest.approx(estimates["mean_square_displacement"].estimate, rel=3e-3)
    # No spike where contact begins and every engine puts a point.
    near = density.density[np.abs(np.abs(density.centre) - p.gap) < 0.05]
    assert np.all(np.abs(np.diff(near)) < 0.3 * near.max())
    assert np.all(density.standard_error >= 0.0)
    np.testing.assert_array_equal(density.density, density.density[::-1])


def test_both_efficiencies_agree_and_rms_is_the_root():
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=4000"])
    estimates = estimate_all(moments_of(scene), prepared(scene).system)
    one = estimates["power_conversion_efficiency"]
    other = estimates["power_conversion_efficiency_of_input"]
    assert abs(one.estimate - other.estimate) < 4 * other.standard_error
    square = estimates["mean_square_voltage"]
    root = estimates["rms_voltage"]
    assert root.estimate**2 == pytest.approx(square.estimate)
    assert root.standard_error == pytest.approx(square.standard_error / 2 / root.estimate)
    assert square.effective_sample_size > 100
    assert "impact_rate" not in estimates


def powers(seed, points=12_800, batches=128):
    """Moments of a load's power and a loss that are drawn anew at each point."""
    random = np.random.default_rng(seed)
    load, loss = 1.0 + 0.3 * random.standard_normal(points), 2.0 + random.standard_normal(points)
    one = np.ones(points)
    moments = Moments.empty(0.0, float(points), (-np.inf, np.inf), (), False, batches, 1, 1.0)
    time = np.arange(1.0, points + 1.0)
    moments.add(Record(time, one, one, one, load, load + loss, loss, 0.0 * one, one))
    return moments


def test_effective_samples_are_the_points_where_each_is_drawn_anew():
    """An error bar from 128 batches is known to 6 %, its square to 13 %: three times that."""
    moments = powers(1)
    found = estimate_all([moments], prepared(Scene.read("linear")).system)
    for name in (
        "mean_power",
        "mean_loss_power",
        "power_conversion_efficiency",
        "power_conversion_efficiency_of_input",
    ):
        assert found[name].effective_sample_size == pytest.approx(moments.points, rel=0.4), name


def test_what_two_results_have_in_common_cancels_from_their_difference():
    one, same, other = ([powers(seed)] for seed in (1, 1, 2))
    scene = Scene.read("linear")
    system = prepared(scene).system

    def difference(name, left, right):
        results = (
            SimpleNamespace(scene=scene, prepared_scene=prepared(scene), moments=each)
            for each in (left, right)
        )
        return paired_difference(*results)[name]

    for name in ("mean_power", "power_conversion_efficiency"):
        nothing = difference(name, one, same)
        assert abs(nothing.estimate) < 1e-12
        assert nothing.standard_error < 1e-12
        errors = [estimate_all(each, system)[name] for each in (one, other)]
        apart = np.hypot(*(each.standard_error / each.estimate for each in errors))
        assert difference(name, one, other).standard_error == pytest.approx(apart, rel=0.2)


def test_a_batch_that_was_not_completed_is_left_out():
    moments = Moments.empty(1.0, 9.0, (-np.inf, np.inf), (), False, 8, 1, 1.0)
    for stop, complete in ((1.5, 1), (3.9, 2), (4.0, 3), (9.0, 8)):
        time = np.arange(moments.last[0] if moments.points else 0.0, stop, 0.1)[1:]
        time = np.append(time, stop)
        moments.add(Record(time, *[np.ones_like(time)] * (len(Record._fields) - 1)))
        assert complete_batches([moments]).shape[1] == complete


def test_an_error_bar_has_the_unit_of_its_estimate():
    assert Estimate(2.0, 0.5, 9.0, "power").times(10.0) == Estimate(20.0, 5.0, 9.0, "power")


def test_short_runs_say_so_in_the_estimate():
    scene = Scene.read("paper", ["run.realizations=2", "run.duration=10", "run.settle=0"])
    estimate = estimate_all(moments_of(scene), prepared(scene).system)["mean_square_voltage"]
    assert estimate.standard_error is None
    assert estimate.note == TOO_SHORT
    assert np.isfinite(estimate.estimate)


def test_the_residual_sees_a_wrong_coefficient():
    scene = Scene.read("paper", SHORT)
    system = prepared(scene).system
    moments = moments_of(scene)
    assert abs(energy_balance_residual(moments, system)) < 0.01
    for m in moments:
        m.integrals[:, 6] *= 1.1
    assert abs(energy_balance_residual(moments, system)) > 0.03


def test_the_error_of_a_drifting_record_is_the_scatter_among_records_that_drift_alike():
    """Of 400 series: their scatter is known to 3.5 %, the mean error to a few; 4 % and more."""
    rng = np.random.default_rng(5)
    envelope = 0.2 + np.exp(-(np.linspace(-2.0, 2.0, 256) ** 2))
    filtered = rng.standard_normal((400, 256 + 1))
    correlated = 0.8 * filtered[:, 1:] + 0.6 * filtered[:, :-1]
    series = envelope * (3.0 + correlated)
    errors = [standard_error_of_drift(row[None]) for row in series]
    # Now and then a short series seems correlated at every length.
    assert errors.count(None) < 20
    errors = [error for error in errors if error is not None]
    scatter = series.mean(axis=1).std(ddof=1)
    assert np.mean(errors) == pytest.approx(scatter, rel=0.15)
    # Batch means take the envelope for correlation: no error bar, or one that is far too large.
    plain = [standard_error(row[None]) for row in series]
    assert all(error is None or error > 2.0 * scatter for error in plain)
    assert standard_error_of_drift(series[:1, :10]) is None


@pytest.mark.parametrize(
    "name", ["mean_square_voltage", "mean_power", "power_conversion_efficiency"]
)
def test_deviations_have_the_estimate_s_own_error_and_no_mean(pool, name):
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=2000", "run.settle=20"])
    result = simulate(scene, method="monte-carlo", runner=pool)
    series = deviations(result.moments, name)
    estimate = result.scaled_quantities[name]
    assert series.mean() == pytest.approx(0.0, abs=1e-12 * estimate.estimate)
    memory = correlation_time(prepared(scene), result.moments) / result.moments[0].batch_length
    error = standard_error(series, memory=memory)
    assert error == pytest.approx(estimate.standard_error, rel=1e-9)


def test_a_ratio_that_never_varies_has_no_error():
    lower = np.random.default_rng(1).uniform(0.5, 1.5, (4, 64)) * 1e-7
    ratio, error = ratio_of_sums(0.57 * lower, lower)
    assert ratio == pytest.approx(0.57)
    assert error == 0.0
    assert ratio_of_sums(0.57 * lower + 1e-9 * lower**0.5, lower)[1] > 0.0


@pytest.mark.slow
def test_what_the_device_stores_while_it_rings_up_is_a_row():
    """From rest, the energy of its last point by hand: of the mass, the spring and the piezo."""
    duration = 0.4
    scene = linear_device({"kind": "sine", "amplitude": 1.0, "frequency": 40.0}, duration, 1)
    scene = scene.replace({"run.settle": 0.0})
    result = simulate(scene, method="monte-carlo", workers=1, window=(0.0, duration))
    last = {name: values[-1] for name, values in result.waveform.columns.items()}
    stored = 0.5 * 0.01 * last["velocity"] ** 2
    stored += 0.5 * 0.01 * (2.0 * np.pi * 40.0 * last["displacement"]) ** 2
    stored += 0.5 * 50e-9 * last["voltage"] ** 2
    row = result["mean_device_storage_power"].estimate
    put_in, lost, load = (result[f"mean_{name}power"].estimate for name in ("input_", "loss_", ""))
    assert row * duration == pytest.approx(stored, rel=2e-3)
    assert row > 0.2 * put_in
    residual = result.energy_balance_residual * put_in
    assert put_in - lost - load - row == pytest.approx(residual, abs=1e-6 * put_in)


def test_a_settled_sine_has_no_such_row():
    scene = linear_device({"kind": "sine", "amplitude": 1.0, "frequency": 40.0}, 0.5, 1)
    assert "mean_device_storage_power" not in simulate(scene, method="monte-carlo", workers=1)


def test_a_batch_with_much_of_the_denominator_counts_by_what_the_ratio_is_without_it():
    """Sixteen independent batches: the error is the jackknife's."""
    rng = np.random.default_rng(4)
    lower = rng.exponential(size=(16, 1))
    upper = lower * (1.0 - 0.05 * lower) + 0.01 * rng.standard_normal((16, 1))
    _, error = ratio_of_sums(upper, lower)
    without = (upper.sum() - upper) / (lower.sum() - lower)
    jackknife = np.sqrt(15.0 / 16.0 * np.sum((without - without.mean()) ** 2))
    # `standard_error` raises all errors of 16 batches by 2.5/16.
    assert error == pytest.approx(jackknife * (1.0 + 2.5 / 16.0), rel=0.005)

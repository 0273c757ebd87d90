import math

import numpy as np
import pytest

from harvester.studies.loads.curves import EDGE, error_of_sum, optimum_of, rank

PLACES = np.geomspace(1.0, 1e4, 9)
TOP = 150.0


def curve(noise, seed=1, own=0.0):
    """sech over ln of the place, the same relative noise at every place, and some of its own."""
    generator = np.random.default_rng(seed)
    common = generator.standard_normal((32, 2))
    means = 1.0 / np.cosh(0.7 * np.log(PLACES / TOP))
    series = [
        mean * (1.0 + noise * common + own * generator.standard_normal((32, 2))) for mean in means
    ]
    return [each.mean() for each in series], series


def test_the_place_of_the_maximum_lies_in_its_interval():
    powers, series = curve(noise=0.3)
    found = optimum_of(PLACES, powers, series)
    assert found.low < TOP < found.high
    assert found.high / found.low < 1.5


def test_common_noise_costs_nothing_and_own_noise_widens():
    quiet = optimum_of(PLACES, *curve(noise=0.0))
    common = optimum_of(PLACES, *curve(noise=0.3))
    own = optimum_of(PLACES, *curve(noise=0.0, own=0.3))
    assert common.high / common.low == pytest.approx(quiet.high / quiet.low)
    assert own.high / own.low > 1.2 * common.high / common.low


def test_the_interval_holds_as_often_as_it_says():
    inside = 0
    for seed in range(200):
        found = optimum_of(PLACES, *curve(noise=0.1, seed=seed, own=0.1))
        inside += found.low <= TOP <= found.high
    # 95 % for a two-sigma interval, more with its width for the shape; false alarm under 1e-4.
    assert inside >= 180


def test_an_optimum_at_the_edge_has_no_interval():
    powers, series = curve(noise=0.1)
    for some in (slice(0, 4), slice(6, 9)):
        found = optimum_of(PLACES[some], powers[some], series[some])
        assert found.note == EDGE
        assert math.isnan(found.low)


def test_a_flat_curve_is_said_to_be_flat():
    generator = np.random.default_rng(3)
    series = [1.0 + 0.1 * generator.standard_normal((32, 2)) for _ in PLACES]
    series[4] = series[4] + 0.02
    found = optimum_of(PLACES, [each.mean() for each in series], series)
    assert found.note.startswith("flat within the noise")


def test_a_point_without_a_value_is_passed_over():
    powers, series = curve(noise=0.1)
    powers[0], series[0] = math.nan, None
    assert optimum_of(PLACES, powers, series).low < TOP
    assert optimum_of(PLACES, [math.nan] * 9, [None] * 9).best is None


def test_differences_on_common_noise_are_paired():
    common = np.random.default_rng(1).standard_normal((32, 2))
    own = np.random.default_rng(2).standard_normal((2, 32, 2))
    series = {
        "low": 1.0 + 0.3 * common + 0.01 * own[0],
        "high": 1.1 * (1.0 + 0.3 * common + 0.01 * own[1]),
        "failed": None,
    }
    powers = {name: math.nan if s is None else s.mean() for name, s in series.items()}
    order, (difference,) = rank(powers, series)
    assert order == ["high", "low"]
    # Of 64 samples each, 0.01·√2·1.1/8 = 0.002, not the 0.05 of independent ones; 4 of them: 6e-5.
    assert difference.standard_error == pytest.approx(0.002, rel=0.35)
    assert abs(difference.estimate - 0.1) < 4.0 * difference.standard_error
    assert difference.differs
    # Too few values for an error bar leave open which load is better.
    few = {name: s[:1, :1] for name, s in series.items() if s is not None}
    (difference,) = rank({name: s.mean() for name, s in few.items()}, few)[1]
    assert math.isnan(difference.standard_error)
    assert not difference.differs
    # Without errors round-off alone is no lead.
    assert not rank({"a": 1.0 + 1e-12, "b": 1.0}, {"a": None, "b": None})[1][0].differs


def test_the_error_of_a_sum_knows_what_unequal_series_share():
    generator = np.random.default_rng(4)
    sums, errors = [], []
    for _ in range(400):
        common = generator.standard_normal((40, 2))
        own = 0.5 * generator.standard_normal((2, 40, 2))
        series = (common + own[0])[:20], common + own[1]
        sums.append(series[0].mean() - series[1].mean())
        errors.append(error_of_sum((1.0, -1.0), series))
    # The scatter of 400 is good to 3.5 %; four of that.
    assert np.mean(errors) == pytest.approx(np.std(sums), rel=0.15)

"""Quantities of a load's measures, of values whose integrals and events are known."""

import math

import numpy as np
import pytest

from circuits.netlist.kinds import LOSS, OUTPUT, STATE, STORE, TAKEN
from circuits.netlist.measurement import Measurement
from harvester.device.record import Record
from harvester.statistics.estimate import NO_VALUE
from harvester.statistics.measures import INTEGRAL, without_value
from harvester.statistics.moments import Moments
from harvester.statistics.output_moments import OutputMoments
from harvester.statistics.output_side import estimate_output

ROWS = (
    (OUTPUT, "node"), (LOSS, "bridge"), (STORE, "buffer"), (STATE, "up"), (TAKEN, "up"),
    (STATE, "never"),
)  # fmt: skip
LENGTH, PERIOD = 64.0, 2.0


def measured(chunk=1000, late=0.5, settle=0.0, period=PERIOD):
    """The node takes 3, the bridge 1, of an input of 10; up for a quarter of every period of 2 s.

    While it is up it takes 8; the buffer's energy grows by 0.25 a second.
    """
    moments = Moments.empty(settle, LENGTH, (-np.inf, np.inf), (), False, 32, 1, 0.1)
    moments.output = OutputMoments.beside(moments, ROWS)
    moments.output.conductance = 0.0
    time = np.arange(1, int(LENGTH * 1000) + 1) / 1000
    phase = (time - late) % period
    up = ((phase >= 0.0) & (phase < 0.25 * period) & (time >= late)).astype(float)
    one = np.ones_like(time)
    values = np.array([3.0 * one, one, 0.25 * time, up, 8.0 * up, 0.0 * one])
    record = np.array([time, one, one, one, 5.0 * one, 10.0 * one, one, 0.0 * one, one])
    for start in range(0, time.size, chunk):
        place = slice(start, start + chunk)
        moments.add(Record(*record[:, place]))
        moments.output.add(time[place], one[place], values[:, place])
    return moments


@pytest.mark.parametrize("chunk", [1, 777, 100_000])
def test_powers_shares_and_events(chunk):
    found = {name: e.estimate for name, e in estimate_output([measured(chunk)]).items()}
    assert found["node_power"] == pytest.approx(3.0, rel=1e-9)
    assert found["node_power_share"] == pytest.approx(0.3, rel=1e-9)
    assert found["bridge_loss"] == pytest.approx(1.0, rel=1e-9)
    assert found["bridge_loss_share"] == pytest.approx(0.1, rel=1e-9)
    assert found["buffer_storage_power"] == pytest.approx(0.25, rel=1e-3)
    # What is measured as an output is harvested, as what a resistor across it would take.
    assert found["mean_output_power"] == pytest.approx(3.0, rel=1e-9)
    assert found["converter_efficiency"] == pytest.approx(0.6, rel=1e-9)
    assert found["up_time_share"] == pytest.approx(0.25, abs=2e-3)
    assert found["up_first_time"] == pytest.approx(0.5, abs=1e-9)
    assert found["up_starts_per_hour"] == pytest.approx(1800.0, rel=1e-3)
    assert found["up_stops_per_hour"] == pytest.approx(1800.0, rel=1e-3)
    assert found["up_energy"] == pytest.approx(8.0 * 0.25 * PERIOD, rel=5e-3)


def test_the_beginning_counts_settling_and_the_rest_does_not():
    found = estimate_output([measured(settle=32.0)])
    assert found["up_first_time"].estimate == pytest.approx(0.5, abs=1e-9)
    assert found["up_starts_per_hour"].estimate == pytest.approx(1800.0, rel=1e-3)


def test_what_never_happens_has_no_certain_error_bar():
    found = estimate_output([measured()])
    assert found["never_time_share"].estimate == 0.0
    assert found["never_time_share"].standard_error is None
    assert math.isnan(found["never_first_time"].estimate)
    # None in 64 s: one more or less.
    assert found["never_stops_per_hour"].estimate == 0.0
    assert found["never_stops_per_hour"].standard_error == pytest.approx(3600.0 / 64.0, rel=1e-3)


def test_few_events_are_known_no_better_than_independent_ones():
    found = estimate_output([measured(period=16.0)])["up_starts_per_hour"]
    assert found.estimate == pytest.approx(4.0 * 3600.0 / LENGTH, rel=1e-3)
    # √4 of four, or that of the batches where it is larger.
    assert 0.999 < found.standard_error / (2.0 * 3600.0 / LENGTH) < 1.05


def test_the_first_time_has_the_spread_of_the_realizations():
    lates = np.linspace(0.25, 1.0, 16)
    first = estimate_output([measured(late=late) for late in lates])["up_first_time"]
    assert first.estimate == pytest.approx(lates.mean(), abs=1e-3)
    assert first.standard_error == pytest.approx(lates.std(ddof=1) / 4.0, rel=1e-2)


def test_the_first_time_tells_who_never_got_there():
    found = estimate_output([measured(), measured(late=1000.0)])["up_first_time"]
    assert found.estimate == pytest.approx(0.5)
    assert found.standard_error is None
    assert "over 1 of 2 realizations" in found.note


def test_what_has_no_value_at_some_time_says_so_and_not_that_the_run_is_short():
    moments = measured()
    for row in (0, 3):
        moments.output.measured[3, row, INTEGRAL] = math.nan
    assert without_value([moments]) == [(OUTPUT, "node"), (STATE, "up")]
    assert without_value([measured()]) == []
    found = estimate_output([moments])
    of_node = ("node_power", "node_power_share", "mean_output_power")
    of_state = ("up_time_share", "up_first_time", "up_starts_per_hour", "up_energy")
    for name in (*of_node, *of_state):
        assert math.isnan(found[name].estimate), name
        assert found[name].note == NO_VALUE, name
    assert found["bridge_loss"].note == ""


V = ("v", "a", "0")
ROOT = ("sqrt", V)


@pytest.mark.parametrize(
    ("tree", "wanted"),
    [
        (ROOT, [math.nan, 1.0, 0.0]),
        (("<", ("number", 1.0), ROOT), [math.nan, 1.0, 0.0]),
        (("not", ("<", ROOT, ("number", 1.0))), [math.nan, 1.0, 0.0]),
        # u(0) is ½, which holds.
        (("u", ROOT), [math.nan, 1.0, 1.0]),
        (("if", ("<", ("number", 0.0), V), ROOT, ("number", 0.0)), [0.0, 1.0, 0.0]),
        (("if", ("<", ("number", 0.0), ROOT), V, ("number", 5.0)), [math.nan, 1.0, 1.0]),
    ],
)
def test_a_state_without_a_value_is_neither_true_nor_false(tree, wanted):
    made = Measurement(((STATE, "s"),), (tree,), ("a",))
    found = made.values(np.arange(3.0), np.array([[-4.0, 4.0, 0.0]]), 1.0)
    np.testing.assert_array_equal(found, [wanted])

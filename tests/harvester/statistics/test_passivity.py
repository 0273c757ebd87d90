import math

import pytest

from harvester.statistics.estimate import Estimate
from harvester.statistics.passivity import (
    efficiency_notes,
    fed_by_stores,
    store_notes,
    supply_notes,
)


def notes(**values):
    return efficiency_notes({k: Estimate(v, None, None, "1") for k, v in values.items()}, 2.0, "W")


def test_nothing_is_said_of_a_passive_load():
    assert notes(mean_power=1.0, mean_converter_loss=0.2, converter_efficiency=0.8) == ()
    assert notes(mean_power=1.0, power_conversion_efficiency=0.3) == ()
    assert notes(mean_power=0.0, converter_efficiency=math.nan) == ()
    assert notes() == ()


def test_the_energy_delivered_is_in_the_scenes_unit():
    (note,) = notes(mean_power=1.0, mean_converter_loss=-3.0, converter_efficiency=4.0)
    assert note.startswith("the load is not passive: it delivers 6 W more than it takes")
    (note,) = notes(mean_power=-1.0, power_conversion_efficiency=-0.1)
    assert "it delivers 2 W more" in note


@pytest.mark.parametrize("efficiency", [1.0004, 1.001, 1.2, 202.0, -352.0])
def test_no_efficiency_outside_its_range_goes_without_a_note(efficiency):
    loss = 1.0 - efficiency
    assert (
        len(notes(mean_power=1.0, mean_converter_loss=loss, converter_efficiency=efficiency)) == 1
    )
    assert len(notes(mean_power=1.0, end_to_end_efficiency=efficiency)) == 1


def test_an_excess_that_may_be_the_steps_own_says_so():
    (note,) = notes(mean_power=1.0, mean_converter_loss=-0.001, converter_efficiency=1.001)
    assert "or the step too long" in note
    (note,) = notes(mean_power=1.0, mean_converter_loss=-4e-4, converter_efficiency=1.0004)
    assert note.startswith("the load delivers 0.0004 of its power more than it takes: this is")


def test_a_source_that_feeds_the_output_is_no_stored_energy():
    """A sink of constant power that has collapsed, and a store that is emptied."""
    outside = {"mean_power": 1.0, "mean_converter_loss": 4.0, "end_to_end_efficiency": -3.0}
    (note,) = notes(**outside, mean_output_power=-3.0, mean_storage_power=-1e-6)
    assert "a source in the load feeds 6 W into its output" in note
    (note,) = notes(**outside, mean_output_power=-3.0, mean_storage_power=-2.9)
    assert "energy stored before the measured time" in note


def test_a_source_at_a_collapsed_output_is_no_converter():
    """A constant current behind a doubler: it pulls the output to -1.2 V."""
    values = {"supplied_by_b1": 1.2e-3, "output_voltage": -1.2}
    for sign, advice in (
        (1.0, "since the load demands too much"),
        (-1.0, "0 V source in series with b1"),
    ):
        found = {k: Estimate(sign * v, None, None, "1") for k, v in values.items()}
        (note,) = supply_notes(found, 1.0, "W")
        assert advice in note


@pytest.mark.parametrize(
    ("given", "stored", "error", "said"),
    [
        (1.0, -0.005, 0.0, ""),
        (1.0, -0.05, 0.06, ""),
        (
            1.0,
            -0.05,
            0.04,
            "5 % of the output power comes from the load's stores, not from the device",
        ),
        # Emptied once, the scatter of batches is large.
        (
            1.0,
            -0.3,
            0.9,
            "30 % of the output power comes from the load's stores, not from the device",
        ),
        (1.0, None, None, "20 % of the output power comes from within the load"),
        (1.25, 0.1, 0.0, ""),
    ],
)
def test_an_output_that_stores_feed_says_what_share(given, stored, error, said):
    found = {
        "mean_power": Estimate(given, None, None, "power"),
        "mean_output_power": Estimate(1.25 if stored is None else 1.0, None, None, "power"),
        "mean_storage_power": Estimate(stored or 0.0, error, None, "power"),
    }
    assert fed_by_stores(found).startswith(said)
    assert bool(fed_by_stores(found)) == bool(said) == bool(store_notes(found))
    advice = "raise run.settle, or start the stores at" if stored else "; check its sources, "
    assert all(advice in note for note in store_notes(found))
    assert store_notes({"mean_power": found["mean_power"]}) == ()

"""A junction's numbers from its model, as ngspice's manual has them, worked out here."""

import math

import pytest

from circuits.kernel import junction

# kT/q at 27 °C.
THERMAL = 0.0258649
MODEL = {"is": 2e-9, "n": 1.4, "rs": 3.0, "cjo": 20e-12, "vj": 0.7, "m": 0.4, "fc": 0.6,
         "tt": 5e-9, "bv": 6.0, "ibv": 1e-3}  # fmt: skip


def test_area_and_number_scale_what_they_should():
    """An area of 2 and three of them: six times the current and charge, of 6 the resistance."""
    row = junction.table_row(MODEL, 2.0, 3.0)
    assert row[junction.SATURATION] == pytest.approx(12e-9)
    assert row[junction.SWING] == pytest.approx(1.4 * THERMAL, rel=1e-5)
    assert row[junction.PER_SWING] * row[junction.SWING] == pytest.approx(1.0)
    assert row[junction.RESISTANCE] == pytest.approx(0.5)
    assert row[junction.CAPACITANCE] == pytest.approx(120e-12)
    assert row[junction.TRANSIT] == 5e-9
    assert (row[junction.POTENTIAL], row[junction.GRADING]) == (0.7, 0.4)
    assert row[junction.EDGE] == pytest.approx(0.42)


def test_at_the_breakdown_voltage_flows_the_breakdown_current():
    """In ngspice with what the saturation current takes of it: is · bv/Vt."""
    row = junction.table_row(MODEL, 2.0, 3.0)
    assert row[junction.BREAKDOWN] == 6.0
    assert row[junction.BREAKDOWN_SWING] == pytest.approx(1.4 * THERMAL, rel=1e-5)
    taken = 4e-9 * 6.0 / THERMAL
    assert row[junction.BREAKDOWN_CURRENT] == pytest.approx(3.0 * (4e-9 + 1e-3 - taken), rel=1e-5)
    own = junction.table_row({**MODEL, "nbv": 2.0}, 1.0)
    assert own[junction.BREAKDOWN_SWING] == pytest.approx(2.0 * THERMAL, rel=1e-5)
    assert own[junction.PER_BREAKDOWN_SWING] * own[junction.BREAKDOWN_SWING] == pytest.approx(1.0)


def test_what_a_model_leaves_out_is_ngspices():
    row = junction.table_row({}, 1.0)
    assert row[junction.SATURATION] == 1e-14
    assert row[junction.SWING] == pytest.approx(THERMAL, rel=1e-5)
    assert math.isinf(row[junction.BREAKDOWN])
    assert (row[junction.RESISTANCE], row[junction.TRANSIT], row[junction.CAPACITANCE]) == (0, 0, 0)
    assert not any(junction.traits(row))
    assert all(junction.traits(junction.table_row(MODEL, 1.0)))


def test_the_exponentials_end_at_the_largest_current():
    row = junction.table_row(MODEL, 1.0)
    assert 2e-9 * math.exp(row[junction.HIGHEST] / (1.4 * THERMAL)) == pytest.approx(
        100.0, rel=1e-3
    )
    rise = math.exp(row[junction.LOWEST] / (1.4 * THERMAL))
    assert row[junction.BREAKDOWN_CURRENT] * rise == pytest.approx(100.0, rel=1e-3)

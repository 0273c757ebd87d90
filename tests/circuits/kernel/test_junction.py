"""A junction's numbers from its model, as ngspice's manual has them, worked out here."""

import math

import numpy as np
import pytest
from llvmlite import ir
from raw_files import program_46, run_raw

from circuits.kernel import junction
from circuits.kernel.emitter import Emitter, call_once, compile_module

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
    onset = 6.0 - 1.4 * THERMAL * math.log(1e-3 / 4e-9)
    taken = 4e-9 * onset / THERMAL
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
    assert all(junction.traits(junction.table_row({**MODEL, "ikf": 1.0, "isr": 1e-9}, 1.0)))


def test_the_exponentials_end_at_the_largest_current():
    row = junction.table_row(MODEL, 1.0)
    assert 2e-9 * math.exp(row[junction.HIGHEST] / (1.4 * THERMAL)) == pytest.approx(
        100.0, rel=1e-3
    )
    rise = math.exp(row[junction.LOWEST] / (1.4 * THERMAL))
    assert row[junction.BREAKDOWN_CURRENT] * rise == pytest.approx(100.0, rel=1e-3)


VENDOR = {"is": 26e-9, "n": 1.75, "ikf": 0.044, "isr": 1.2e-6, "nr": 4.9, "eg": 0.69, "xti": 2.0,
          "cjo": 12e-12, "m": 0.33, "vj": 0.5, "bv": 30.0, "ibv": 1e-5, "tt": 5e-9,
          "trs1": 1e-3, "tcv": 0.002, "tm1": 1e-3, "ttt1": 2e-3}  # fmt: skip


def law_of(model, celsius, volts):
    """Currents (A) and charges (C) of the law that is compiled."""
    row = junction.table_row(model, 2.0, 1.0, celsius)
    module = ir.Module()
    e = Emitter(module, "law")
    law = junction.Law(e, 0, 1, 1, junction.traits(row))
    v = e.load(junction.COLUMNS, count=1)
    through, slope = law._current(v)
    for place, each in enumerate((through, slope, law.charge(v))):
        e.store(junction.COLUMNS + 1 + place, each)
    e.give(e.constant(0.0))
    engine, addresses = compile_module(module)
    found = []
    for value in volts:
        memory = np.concatenate([row, [value, 0.0, 0.0, 0.0]])
        call_once(addresses["law"], memory.ctypes.data, 0)
        found.append(memory[-3:])
    del engine
    return np.array(found).T


@pytest.mark.parametrize("celsius", [27.0, 85.0, -20.0])
@pytest.mark.parametrize(
    "model",
    [VENDOR, {**VENDOR, "tnom": 25.0, "tlev": 1.0, "tlevc": 1.0, "tpb": 1e-3, "cta": 2e-3}],
)
def test_vendors_models_are_plain_ngspices_at_any_temperature(tmp_path, model, celsius):
    """Current and slope; a charge grows with the voltage."""
    said = " ".join(f"{key}={value!r}" for key, value in model.items())
    (tmp_path / "deck.cir").write_text(
        f"deck\nvx x 0 0\nd1 x 0 dm area=2 temp={celsius}\n.model dm d({said})\n"
        ".dc vx -29.5 0.9 0.01\n.save i(vx) @d1[gd]\n.options reltol=1e-6 abstol=1e-15\n.end\n"
    )
    raw = run_raw(tmp_path, "deck.cir", program_46())
    volts, theirs = raw["v(v-sweep)"], -raw["i(vx)"]
    ours, slopes, charges = law_of(model, celsius, volts)
    # Where it breaks down ngspice leaves the saturation current out.
    blocked = np.abs(theirs[np.argmin(np.abs(volts + 5.0))])
    small = np.abs(theirs) < 50.0
    np.testing.assert_allclose(ours[small], theirs[small], rtol=2e-4, atol=0.2 * blocked)
    unbroken = small & (volts > -15.0)
    np.testing.assert_allclose(ours[unbroken], theirs[unbroken], rtol=1e-4)
    corner = junction.table_row(model, 2.0, 1.0, celsius)[junction.SWING] * -3.0
    straight = small & (np.abs(volts - corner) > 0.02)
    straight[[0, -1]] = False
    steps = np.gradient(ours, volts)[straight]
    np.testing.assert_allclose(steps, slopes[straight], rtol=0.08, atol=1e-9)
    assert np.all(np.diff(charges) > 0.0)


@pytest.mark.parametrize("celsius", [27.0, 85.0, -20.0])
@pytest.mark.parametrize("more", [{}, {"tnom": 40.0}, {"tlevc": 1.0, "tpb": 1e-3, "cta": 2e-3}])
def test_depletion_is_plain_ngspices_at_any_temperature(tmp_path, more, celsius):
    """The current of a voltage that rises evenly is its rate times the capacitance."""
    model = {"is": 1e-24, "cjo": 12e-12, "m": 0.33, "vj": 0.5, "tm1": 1e-3, **more}
    said = " ".join(f"{key}={value!r}" for key, value in model.items())
    (tmp_path / "deck.cir").write_text(
        f"deck\nvx x 0 pwl(0 -5 1m 0.4)\nd1 x 0 dm area=2 temp={celsius}\n.model dm d({said})\n"
        ".tran 2u 1m 0 2u\n.save i(vx) v(x)\n.options reltol=1e-6 abstol=1e-15\n.end\n"
    )
    raw = run_raw(tmp_path, "deck.cir", program_46())
    volts, theirs = raw["v(x)"][20:], -raw["i(vx)"][20:]
    _, _, charges = law_of(model, celsius, volts)
    np.testing.assert_allclose(np.gradient(charges, volts)[5:-5] * 5400.0, theirs[5:-5], rtol=5e-3)

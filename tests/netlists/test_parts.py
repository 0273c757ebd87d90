"""Converters, supercapacitor and node on the bench, by ngspice alone, against their data sheets."""

from importlib import resources

import pytest
from by_hand import ngspice

NETLISTS = resources.files("netlists")


def bench(folder, part, cards, stop, measures, step=None):
    """Measurements of a part in a circuit; {name: "avg i(v) from=0 to=1"}."""
    asked = "\n".join(f".measure tran {name} {what}" for name, what in measures.items())
    text = f""".title {part}
.include {NETLISTS}/{part}.lib
{cards}
.options method=gear reltol=1e-4 abstol=1e-12
.tran {step or stop / 500} {stop} 0 {step or stop / 500} uic
{asked}
.end
"""
    return ngspice(text, folder)


# LTC3588-1 at 3.3 V, typical column.


def test_the_buck_starts_and_stops_at_the_thresholds_of_the_sheet(tmp_path):
    """5.05 V rising and 3.67 V falling; at 0.5 V/s the reading is good to 10 mV."""
    cards = """Vin in 0 pwl(0 0 12 6 24 0)
Xbuck in out 0 nano_buck
Cout out 0 47u ic=0
Rload out 0 10k"""
    measures = {
        "rising": "find v(in) when v(xbuck.enable)=0.5 rise=1",
        "falling": "find v(in) when v(xbuck.enable)=0.5 fall=1",
    }
    found = bench(tmp_path, "buck_converters", cards, 24, measures, step=5e-3)
    assert found["rising"] == pytest.approx(5.05, abs=0.01)
    assert found["falling"] == pytest.approx(3.67, abs=0.01)


@pytest.mark.parametrize(("volts", "start", "current"), [(5.05, 6.0, 0.95e-6), (5.0, 0.0, 0.45e-6)])
def test_the_buck_takes_what_the_sheet_says_at_no_load(tmp_path, volts, start, current):
    """950 nA in regulation, 450 nA in lockout: the input has been above the threshold or not."""
    cards = f"""Vin in 0 pwl(0 {start} 1 {start} 2 {volts})
Xbuck in out 0 nano_buck
Cout out 0 47u ic=0"""
    found = bench(tmp_path, "buck_converters", cards, 40, {"mean": "avg i(vin) from=30 to=40"})
    # What keeps the output up is none of the part's own: with nothing across it, it stays.
    assert -found["mean"] == pytest.approx(current, rel=0.02)


@pytest.mark.parametrize("volts", [0.0, 4.9])
def test_the_buck_gives_nothing_while_it_is_locked_out(tmp_path, volts):
    """Not even what leaks through its open lockout: a nanoampere would be 10 V by then."""
    cards = f"""Vin in 0 {volts}
Xbuck in out 0 nano_buck
Cout out 0 1n ic=0"""
    found = bench(tmp_path, "buck_converters", cards, 10, {"last": "find v(out) at=9.9"})
    assert found["last"] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("load", [1e-4, 1e-3, 1e-2, 9e-2])
def test_the_buck_regulates_and_loses_what_its_efficiency_says(tmp_path, load):
    """3.3 V within 4 % up to 90 mA of its 100, at 85 %."""
    cards = f"""Vin in 0 5.5
Xbuck in out 0 nano_buck
Cout out 0 47u ic=0
Iload out 0 pulse(0 {load} 0.2 1u 1u 10 20)"""
    measures = {"volts": "avg v(out) from=1 to=2", "taken": "avg i(vin) from=1 to=2"}
    found = bench(tmp_path, "buck_converters", cards, 2, measures)
    assert found["volts"] == pytest.approx(3.3, rel=0.04)
    given = found["volts"] * load
    own = 5.5 * 0.95e-6 * 5.5 / 5.05
    assert -5.5 * found["taken"] == pytest.approx(given / 0.85 + own, rel=5e-3)


def test_the_shunt_holds_20_volts(tmp_path):
    cards = """Iin 0 in 10m
Cin in 0 22u ic=0
Xbuck in out 0 nano_buck
Cout out 0 47u ic=0"""
    found = bench(tmp_path, "buck_converters", cards, 1, {"volts": "avg v(in) from=0.9 to=1"})
    assert 20.0 < found["volts"] < 20.5


# GB230 of CAP-XX.


def test_the_supercapacitor_has_the_capacitance_series_resistance_and_leakage_of_the_sheet(
    tmp_path,
):
    """Discharged by 0.5 A: the step is its series resistance, the slope its capacitance."""
    cards = """Xcell plus 0 supercapacitor initial=4.5
Iload plus 0 pwl(0 0 0.1 0 0.1001 0.5)
Vheld held 0 4.5
Xleaking held 0 supercapacitor initial=4.5"""
    measures = {
        "before": "find v(plus) at=0.09",
        "early": "find v(plus) at=0.2",
        "late": "find v(plus) at=1.0",
        "leak": "avg i(vheld) from=0.5 to=1",
    }
    found = bench(tmp_path, "supercapacitors", cards, 1, measures)
    slope = (found["early"] - found["late"]) / 0.8
    assert 0.5 / slope == pytest.approx(0.35, rel=2e-3)
    step = found["before"] - (found["early"] + 0.1 * slope)
    assert step / 0.5 == pytest.approx(60e-3, rel=0.01)
    assert -found["leak"] == pytest.approx(1e-6, rel=0.01)


# bq25570, SLUSBH2C.

CHARGER = """Vsource source 0 {volts}
Rsource source in {ohms}
Cin in 0 4.7u ic=0
Xcharger in store 0 boost_charger fraction={fraction}
Cstore store 0 {farads} ic={initial}"""


def charger(volts, ohms, fraction=0.5, farads=100e-6, initial=0.0):
    values = {"volts": volts, "ohms": ohms, "fraction": fraction, "farads": farads}
    return CHARGER.format(**values, initial=initial)


def test_the_cold_start_needs_330_mv_and_ends_at_1730(tmp_path):
    """Below it nothing; above, 5 % of the input's power until the store has 1.73 V."""
    stores = {"end": "max v(store)"}
    assert bench(tmp_path, "boost_chargers", charger(0.32, 10), 2, stores)["end"] < 1e-3
    measures = {
        "held": "avg v(in) from=0.5 to=1",
        "early": "find v(store) at=0.5",
        "late": "find v(store) at=1.5",
        "taken": "avg i(vsource) from=0.5 to=1.5",
        "handover": "find v(store) when v(xcharger.main)=0.5 rise=1",
    }
    cards = charger(1.0, 200)
    found = bench(tmp_path, "boost_chargers", cards, 3, measures, step=1e-3)
    assert 0.33 < found["held"] < 0.8
    energy = 50e-6 * (found["late"] ** 2 - found["early"] ** 2)
    put_in = -found["taken"] * (1.0 + 200 * found["taken"])
    assert energy == pytest.approx(0.05 * put_in, rel=0.01)
    assert found["handover"] == pytest.approx(1.73, abs=0.005)


@pytest.mark.parametrize("fraction", [0.5, 0.8])
def test_the_charger_holds_its_source_at_the_fraction_of_its_open_voltage(tmp_path, fraction):
    """From the second sample on, at 16.26 s; and keeps 83 % of what it takes."""
    measures = {
        "open": "find v(in) at=16.25",
        "held": "avg v(in) from=17 to=30",
        "taken": "avg i(vsource) from=17 to=30",
        "early": "find v(store) at=17",
        "late": "find v(store) at=30",
    }
    cards = charger(2.0, 1e4, fraction, 2e-3, 2.0)
    found = bench(tmp_path, "boost_chargers", cards, 31, measures, step=5e-3)
    assert found["open"] == pytest.approx(2.0, rel=0.01)
    # 0.1 mA takes 10 mV above the set value.
    assert found["held"] == pytest.approx(2.0 * fraction, abs=0.02)
    put_in = -13 * found["taken"] * found["held"]
    own = 13 * 0.488e-6 / 2.1 * (0.5 * (found["early"] + found["late"])) ** 2
    kept = 1e-3 * (found["late"] ** 2 - found["early"] ** 2)
    assert kept == pytest.approx(0.83 * put_in - own, rel=0.01)


def test_the_charger_takes_488_na_and_stops_when_the_store_is_full(tmp_path):
    cards = """Vstore store 0 2.1
Rin in 0 1meg
Xcharger in store 0 boost_charger"""
    found = bench(tmp_path, "boost_chargers", cards, 1, {"own": "avg i(vstore) from=0.5 to=1"})
    assert -found["own"] == pytest.approx(488e-9, rel=0.01)
    cards = charger(3.0, 1e3, farads=10e-6, initial=4.0)
    found = bench(tmp_path, "boost_chargers", cards, 5, {"top": "max v(store)"}, step=1e-3)
    assert found["top"] == pytest.approx(4.2, abs=0.01)


# BL652 of Laird.


def test_the_node_draws_the_charge_of_the_manual_in_every_period(tmp_path):
    """10.64 µC a burst and 2.0 µA between: 12.64 µA at one burst a second, within 1 %."""
    cards = """Vsupply supply 0 3.3
Xnode supply 0 sensor_node"""
    measures = {
        "mean": "avg i(vsupply) from=2.5 to=7.5",
        "sleep": "avg i(vsupply) from=2.2 to=2.8",
        "begin": "when v(xnode.busy)=0.5 rise=2",
        "end": "when v(xnode.busy)=0.5 fall=2",
        "next": "when v(xnode.busy)=0.5 rise=3",
    }
    found = bench(tmp_path, "sensor_nodes", cards, 8, measures, step=2e-4)
    assert -found["sleep"] == pytest.approx(2e-6, rel=0.01)
    assert -found["mean"] == pytest.approx(12.64e-6, rel=0.01)
    assert found["end"] - found["begin"] == pytest.approx(4.377e-3, rel=0.01)
    assert found["next"] - found["begin"] == pytest.approx(1.0, rel=0.001)


def test_the_node_comes_up_goes_down_and_waits_for_energy(tmp_path):
    """Up from 2.5 V until 1.7 V; a burst only from 3 V on."""
    cards = """Vsupply supply 0 pwl(0 0 4 4 8 0)
Xnode supply 0 sensor_node start=2.5 ready=3 period=0.1"""
    measures = {
        "up": "find v(supply) when v(xnode.up)=0.5 rise=1",
        "down": "find v(supply) when v(xnode.up)=0.5 fall=1",
        "burst": "find v(supply) when v(xnode.busy)=0.5 rise=1",
    }
    found = bench(tmp_path, "sensor_nodes", cards, 8, measures, step=5e-4)
    assert found["up"] == pytest.approx(2.5, abs=0.005)
    assert found["down"] == pytest.approx(1.7, abs=0.005)
    assert found["burst"] == pytest.approx(3.0, abs=0.005)

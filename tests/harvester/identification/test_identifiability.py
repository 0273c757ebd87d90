"""What data leave open, of a linear device whose impedances are closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from measured_records import (
    CAPACITANCE,
    COUPLING,
    LOAD,
    MASS,
    STIFFNESS,
    linear_device,
    linear_record,
)

from harvester.identification import fitting, identifiability
from harvester.identification.identifiability import assumptions, to_keep
from harvester.identification.identify import _determined, identify
from harvester.identification.intervals import undetermined
from harvester.identification.unknowns import Unknown

DAMPING, GAIN = 0.03, 1.05
GAINS = ["sensor.voltage_scale", "sensor.acceleration_scale", "oscillator.mass"]


def fitted(loads, gain=1.0):
    """A fit to records at these loads whose voltage is too large by a factor."""
    records = [
        linear_record(DAMPING, seed, 3.0, samples=2400, load=load)
        for seed, load in enumerate(loads)
    ]
    records = [replace(record, voltage=gain * record.voltage) for record in records]
    return identify(linear_device(0.04), records, compare=False)


@pytest.mark.slow
def test_a_gain_is_not_separable_at_one_load_and_names_what_it_mixes():
    """V/a of one load has four ratios; a gain or the mass is the fifth unknown."""
    found = fitted([LOAD])
    table = {entry.key: entry for entry in assumptions(found.fitted)}
    assert set(table) == {*GAINS, "load.resistance"}
    assert not any(entry.is_separable for entry in table.values())
    # V/a = g θ/Cp s / [(s² + C/M s + k/M)(s + λ) + κ s], κ = θ²/(Cp M), λ = 1/(R Cp): moves of the
    # values that leave all four coefficients as they are.
    decay, kappa = 1.0 / (LOAD * CAPACITANCE), COUPLING**2 / (CAPACITANCE * MASS)
    whole = STIFFNESS / MASS + decay**2 - DAMPING * decay / MASS
    capacitance = 2.0 * kappa / (whole + kappa)
    gain, _, mass, load = (table[key].moves for key in [*GAINS, "load.resistance"])
    near = {"rel": 0.1}
    assert gain["piezo.coupling"] == pytest.approx(capacitance - 1.0, **near)
    assert gain["oscillator.damping"] == pytest.approx(MASS * decay / DAMPING * capacitance, **near)
    stiffness = "oscillator.restoring_force[1]"
    assert mass[stiffness] == pytest.approx(1.0 + kappa / (whole + kappa), **near)
    assert load["piezo.capacitance"] == pytest.approx(-whole / (whole + kappa), **near)
    assert set(table[GAINS[0]].dependent) == set(found.keys)
    assert "do not reveal its error" in str(table[GAINS[0]])


@pytest.mark.exhaustive
def test_two_loads_show_an_error_of_a_gain_and_its_size():
    right, wrong = fitted([LOAD, 0.2 * LOAD]), fitted([LOAD, 0.2 * LOAD], GAIN)
    for found, off in ((right, 0.0), (wrong, GAIN - 1.0)):
        listed = [entry for entry in assumptions(found.fitted) if entry.key in GAINS]
        voltage, *others = listed
        assert [voltage.key, *(entry.key for entry in others)] == GAINS
        assert voltage.is_separable
        # Four standard errors: one false alarm in 16 000; the step is that of a linear problem.
        assert abs(voltage.change - off) < 4.0 * voltage.error + 0.1 * off
    assert voltage.significance > 10.0
    # The coupling took the gain over as its move says.
    off_by = found.values["piezo.coupling"] / COUPLING - 1.0
    assert off_by == pytest.approx(-voltage.moves["piezo.coupling"] * (GAIN - 1.0), rel=0.2)
    # Of two resistors one may be wrong.
    loads = [entry for entry in assumptions(found.fitted) if entry.key == "load.resistance"]
    assert [entry.records for entry in loads] == [("record0.csv",), ("record1.csv",)]


def test_a_value_that_cannot_be_zero_counts_relative_to_itself():
    """A capacitance at its lower bound with an error of 244 times itself is not identified."""
    capacitance = Unknown("piezo.capacitance", CAPACITANCE, 1e-3 * CAPACITANCE, np.inf, CAPACITANCE)
    damping = Unknown("oscillator.damping", DAMPING, 0.0, np.inf, DAMPING)
    # A damping of 5 ± 10 % of the first one is known to be small.
    values = np.array([1.1e-3 * CAPACITANCE, 0.05 * DAMPING])
    errors = np.array([244.0 * values[0], 0.1 * DAMPING])
    (direction,) = undetermined([capacitance, damping], values, np.diag(errors**2))
    assert direction.keys == ("piezo.capacitance",)
    assert str(direction) == "capacitance is not determined"


def test_keys_are_left_out_until_the_others_are_determined():
    """Of a product of three values and a value without effect: three of the four are kept."""
    names = ["oscillator.damping", "piezo.coupling", "piezo.capacitance", "oscillator.mass"]
    values = np.array([0.03, 1e-3, 5e-8, 0.01])
    free = [
        Unknown(key, value, -np.inf, np.inf, value)
        for key, value in zip(names, values, strict=True)
    ]
    product = np.array([1.0, 1.0, 1.0, 0.0])
    precision = 1e4 * np.outer(product, product) + np.diag([1e-2, 2e-2, 3e-2, 4e-2])
    matrix = np.linalg.inv(precision) * np.outer(values, values)
    model = SimpleNamespace(
        shooting=SimpleNamespace(unknowns=free), values=values, covariance=matrix
    )
    kept = to_keep(model)
    assert [key for key, _ in kept] == ["piezo.capacitance", "oscillator.damping", names[3]]
    assert kept[-1][1].keys == (names[3],)


@pytest.mark.parametrize("follows", [True, False])
def test_only_a_model_that_follows_the_records_is_fitted_without_what_they_leave_open(
    monkeypatch, follows
):
    calls = []

    def fit(scene, records, keys, follow):
        calls.append(keys)
        return SimpleNamespace(keys=keys, follows=follows)

    monkeypatch.setattr(fitting, "fitted", fit)
    unclear = [("mass", "mass is not determined")]
    monkeypatch.setattr(
        identifiability, "to_keep", lambda model: unclear if "mass" in model.keys else []
    )
    model, kept = _determined(None, [], ["mass", "damping"], True, None)
    assert calls == [["mass", "damping"], ["damping"]][: 1 + follows]
    assert model.keys == calls[-1]
    assert kept == unclear * follows

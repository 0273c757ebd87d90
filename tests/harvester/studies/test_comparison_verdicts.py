from types import SimpleNamespace

import pytest

from harvester.scene.model import Scene
from harvester.statistics.estimate import Estimate
from harvester.studies.comparison.comparison import Comparison, verdicts

LINEAR = Scene.read("linear")
NAMES = {
    "mean_square_voltage": 1.0,
    "rms_voltage": 1.0,
    "mean_power": 1.0,
    "power_conversion_efficiency": 1.0,
    "mean_square_displacement": 1.0,
    "mean_square_velocity": 1.0,
}


def result(voltage=1.0, error=0.01, notes=(), **more):
    values = {**NAMES, "mean_square_voltage": voltage, **more}
    note = "" if error else "too short for an error bar"
    return SimpleNamespace(
        scaled_quantities={name: Estimate(v, error, None, "1", note) for name, v in values.items()},
        notes=notes,
        energy_balance_residual=0.001,
        scene=LINEAR,
    )


def texts(circuit, closures=None, refused=None, paired=None, reference=None):
    compared = Comparison(
        circuit, reference or result(), closures or {}, refused or {}, paired or {}
    )
    return [verdict.text for verdict in verdicts(compared)], verdicts(compared)


def test_agreement_is_stated_with_the_largest_difference():
    said, judged = texts(result(1.0 + 1.2 * 0.01 * 2**0.5))
    assert said[0] == "Circuit and Monte Carlo agree within 1.2 standard errors of every quantity."
    assert judged[0].good


def test_disagreement_names_the_quantity():
    said, judged = texts(result(1.0 + 4.0 * 0.01 * 2**0.5))
    assert "disagree: the mean-square voltage differs by 5.66%, 4.0 standard errors" in said[0]
    assert judged[0].good is False


def test_what_is_significant_and_small_is_named_and_agrees():
    said, judged = texts(result(1.004, 1e-4), reference=result(error=1e-4))
    assert "agree within 1% in mean-square voltage, mean power, " in said[0]
    assert ": the mean-square voltage differs by 0.40%" in said[0]
    assert judged[0].good


def test_the_output_of_a_load_is_judged_too():
    output = {"mean_output_power": 1.1}
    reference = result(mean_output_power=1.0)
    said, judged = texts(result(**output), reference=reference)
    assert "disagree: the mean output power differs by 10.00%" in said[0]
    assert judged[0].good is False


def test_without_error_bars_nothing_is_judged():
    said, judged = texts(result(error=None), {"paper": result(2.0)}, reference=result(error=None))
    assert "too short" in said[0]
    assert said[-1] == "The method paper cannot be judged: Monte Carlo has no error bar."
    assert judged[0].good is False


@pytest.mark.parametrize(("value", "side"), [(0.94, "6.0% low"), (1.06, "6.0% high")])
def test_a_closure_that_lies_off_gives_only_the_reasons_it_has(value, side):
    closure = result(value, notes=("the load is fast",), share_in_wells=0.8)
    said, _ = texts(result(), {"consistent": closure})
    assert f"The method consistent is {side} in mean-square voltage, 6 standard" in said[-1]
    assert "Known limits: the load is fast; it assumes motion in one well" in said[-1]
    assert "20% of the time outside the wells" in said[-1]
    said, _ = texts(result(), {"fokker_planck": result(value)})
    assert said[-1].endswith("No known limit explains this.")


def test_a_bistable_closures_limit_is_not_told_of_a_single_well():
    said, _ = texts(result(), {"consistent": result(0.9)})
    assert "inside a well" not in said[-1]


def test_the_paired_difference_and_a_refusal_are_told():
    paired = {"mean_square_voltage": Estimate(-0.05, 0.01, None, "1")}
    said, judged = texts(result(), refused={"paper": "paper: β is too large"}, paired=paired)
    assert "disagree: on the same noise the mean-square voltage differs by -5.0 ± 1.0 %" in said[0]
    assert judged[0].good is False
    assert said[-1] == "Stationary methods that are not valid: paper: β is too large."


def test_a_small_paired_difference_is_negligible_against_the_limit_in_the_one_verdict():
    paired = {"mean_square_voltage": Estimate(-0.0015, 1e-6, None, "1")}
    said, judged = texts(result(), paired=paired, reference=result())
    assert ": on the same noise the mean-square voltage differs by -0.1500" in said[0]
    assert "below that limit" in said[0]
    assert judged[0].good
    assert sum("differs" in each for each in said) == 1
    assert not any("0.0 standard errors" in each for each in said)


def test_agreement_in_the_voltage_alone_is_not_called_agreement():
    said, judged = texts(result(), {"fokker_planck": result(1.01, mean_square_velocity=1.4)})
    assert "agrees with Monte Carlo's mean-square voltage" in said[-1]
    assert "but its mean-square velocity deviates by +40.0%, +40 standard errors" in said[-1]
    assert judged[-1].good is False
    _, judged = texts(result(), {"fokker_planck": result(1.01)})
    assert judged[-1].good


def test_engines_whose_difference_is_not_sharp_do_not_check_each_other():
    said, judged = texts(result(error=0.75), reference=result(error=0.75))
    assert "cannot be cross-checked: every difference is uncertain by more than ± 10%" in said[0]
    assert judged[0].good is None
    paired = {"mean_power": Estimate(0.0, 0.02, None, "1")}
    said, judged = texts(result(error=0.75), reference=result(error=0.75), paired=paired)
    assert "on the same noise the mean power differs most" in said[0]
    assert "standard errors of mean power; on" in said[0]
    assert "not checked, as uncertain by more than ± 10%: mean-square voltage" in said[0]
    assert judged[0].good

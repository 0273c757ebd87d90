"""`make drawn`: its cases come again, its truths agree where there are two, and it sees errors."""

import math

import numpy as np
import pytest
from maintenance import drawn as tool
from maintenance import drawn_truth as truth
from maintenance.drawn_scenes import COMMANDS, TAKEN, drawn
from truths import flat, oscillator_power

from harvester import Scene

DEVICE = truth.Device(
    mass=0.01, damping=0.02, spring=np.array([0.0, 400.0, 0.0, 0.0]), contacts=np.zeros((0, 3)),
    coil=False, coupling=1e-3, storage=4e-8, winding=0.0, resistance=1e5, base_factor=1.2,
    base_charge=-2e-10,
)  # fmt: skip
OWN = math.sqrt(400.0 / 0.01) / (2.0 * math.pi)
COIL = DEVICE._replace(coil=True, coupling=3.0, storage=0.4, winding=200.0, resistance=300.0)


def test_a_case_follows_from_its_seed_and_number(tmp_path):
    first, again, other = (drawn(*each, tmp_path) for each in ((3, 5), (3, 5), (4, 5)))
    assert first.tables == again.tables != other.tables
    assert first.words == again.words


def test_every_command_is_drawn_with_what_it_takes(tmp_path):
    cases = [drawn(1, number, tmp_path) for number in range(2 * len(COMMANDS))]
    assert [case.command for case in cases] == [*COMMANDS, *COMMANDS]
    for case in cases:
        case.scene()
        for taken, word in zip(
            TAKEN.get(case.command, ()), (case.device, case.load, case.excitation), strict=False
        ):
            assert word in taken


def test_only_chooses_by_numbers_or_words(tmp_path):
    assert [case.number for case in tool.chosen(1, 3, "7,40", tmp_path)] == [7, 40]
    assert {case.command for case in tool.chosen(1, 22, "sweep", tmp_path)} == {"sweep"}


def test_power_under_coloured_noise_is_that_of_the_closed_form():
    scene = Scene.read("linear")
    p = flat(scene)
    device = DEVICE._replace(
        mass=1.0, damping=p.damping, spring=np.array([0.0, p.linear_stiffness]),
        coupling=p.coupling, storage=p.coupling, resistance=1.0 / (p.coupling * p.decay_rate),
        base_factor=1.0, base_charge=0.0,
    )  # fmt: skip
    noise = {
        "kind": "ornstein-uhlenbeck", "intensity": p.intensity,
        "correlation_time": p.correlation_time,
    }  # fmt: skip
    found, error = truth.linear_power(device, truth.motion_of(noise))
    assert error < 1e-5 * found
    assert found == pytest.approx(oscillator_power(p), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("device", [DEVICE, COIL, COIL._replace(storage=0.0)])
def test_integration_and_phasors_agree(device):
    sines = ((2.0, 0.97 * OWN, 0.3), (1.0, 1.455 * OWN, 1.0))
    (power, error), _ = truth.periodic(device, sines, (0.0, 0.0, 0.0), OWN, 400, 80)
    assert power == pytest.approx(truth.linear_power(device, truth.Motion(sines))[0], rel=1e-6)
    assert error < 1e-5 * power


@pytest.mark.slow
def test_integration_under_noise_agrees_with_its_density():
    # False alarm of one of 370 seeds.
    points = np.array([[0.5 * OWN, 0.5], [OWN, 1.0], [3.0 * OWN, 0.2]])
    motion = truth.specified(points)
    rest, draws = [(0.0, 0.0, 0.0)], np.random.default_rng(1)
    (power, error), *_ = truth.under_noise(
        DEVICE, motion, rest, OWN, 3.0 * OWN, 40.0 / OWN, 300.0 / OWN, draws
    )
    assert error < 0.05 * power
    assert abs(power - truth.linear_power(DEVICE, motion)[0]) < 3.0 * error


def test_a_record_pushes_with_minus_the_acceleration_of_the_base(tmp_path):
    file = tmp_path / "steps.csv"
    file.write_text("time [s],acceleration [m/s^2]\n0,1\n0.1,2\n0.2,6\n")
    motion = truth.motion_of({"kind": "record", "file": str(file)})
    assert motion.record == pytest.approx([2.0, 1.0, -3.0])


def test_a_coil_that_decays_within_a_step_is_resolved():
    motion = truth.Motion(record=np.sin(np.arange(100) * 0.3), spacing=1e-3)
    power = truth.on_record(COIL._replace(storage=1e-3), motion, (0.0, 0.0, 0.0), OWN, 0.0, 0.09)
    without = truth.on_record(COIL._replace(storage=0.0), motion, (0.0, 0.0, 0.0), OWN, 0.0, 0.09)
    assert power == pytest.approx(without, rel=1e-3)


def test_a_well_is_reached_with_a_quarter_of_the_energy_that_leads_out_of_it():
    # U = x⁴/4 − x²/2: wells of −1/4 at ±1 on either side of 0.
    wells = truth.wells_of(DEVICE._replace(spring=np.array([0.0, -1.0, 0.0, 1.0])))
    assert wells == pytest.approx(
        np.array([[-math.inf, 0.0, -0.1875], [0.0, math.inf, -0.1875]]), abs=1e-9
    )


def check(value=1.0, bar=None, truths=((1.0, 0.0),), reason=""):
    return tool.Check("power", value, bar, list(truths), reason)


def test_verdicts():
    assert check(1.004).verdict == tool.RIGHT
    assert check(1.006).verdict == tool.WRONG
    assert check(1.006, bar=0.004).verdict == tool.RIGHT
    assert check(1.004, bar=0.001).verdict == tool.WRONG
    assert check(2.0, truths=[(1.0, 0.0), (2.0, 0.0)]).verdict == tool.RIGHT
    assert check(1.5, reason="too short for an error bar").verdict == tool.WITHHELD
    assert check(math.nan).verdict == tool.WRONG
    verdict, words = tool.judged([check(), check(1.1), check(1.2)])
    assert verdict == tool.WRONG
    assert words.startswith("2 of 3: power 1.2, truth 1 (+20 %)")


def answered(checks):
    def ask(*_):
        if isinstance(checks, Exception):
            raise checks
        return checks

    return ask


@pytest.mark.parametrize(
    ("checks", "verdict"),
    [
        ([check()], tool.RIGHT),
        ([check(2.0)], tool.WRONG),
        (tool.harvester.HarvesterError("no such key"), tool.REFUSED),
        (ZeroDivisionError("division by zero"), tool.BROKEN),
        (tool.TooSlow(), tool.SLOW),
    ],
)
def test_the_exit_code_says_whether_a_case_fails(checks, verdict, monkeypatch, capsys):
    monkeypatch.setitem(tool.ASKED, "average", answered(checks))
    code = tool.main(["--seed", "1", "--only", "2"])
    assert code == (0 if verdict in tool.PASSES else 1)
    assert f"1   2 {verdict}" in capsys.readouterr().out

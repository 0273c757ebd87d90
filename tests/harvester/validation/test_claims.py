"""Verdicts on synthetic answers with a known truth, and on a device whose means are known."""

import json
import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from truths import flat, interpolated_linear_means

from harvester.cli.command_line import main
from harvester.engines.opening import open_runner
from harvester.engines.request import Answer, Request
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.statistics.estimate import Density, Estimate
from harvester.validation import claims as module
from harvester.validation import paper_figures as runs
from harvester.validation import reproduce as figures
from harvester.validation.claims import (
    FAILS,
    HOLDS,
    IN_PART,
    UNDECIDED,
    UNTESTED,
    claims,
    disagreements,
    opinion_of,
)
from harvester.validation.paper_figures import FIGURES
from harvester.validation.reproduce import Effort
from harvester.validation.statements import (
    BEYOND,
    CLAIMS,
    Bimodal,
    Changed,
    Claim,
    Finding,
    InteriorMaximum,
    LargerEffect,
    OppositeTrends,
    SingleHump,
    Trend,
    Unchanged,
    peak_of,
    reach_of,
    relative_change,
)

D, E = "excitation.intensity", "stoppers.restitution"
SCENE = Scene.read("paper")


def answers(function, error=0.01, noise=None):
    """A `read` whose quantities are functions of the changes, with a standard error."""

    def read(changes):
        value = function(dict(changes))
        if value is None:
            return None
        shift = noise.normal() * error if noise else 0.0
        estimates = {
            name: Estimate(sign * (value + shift) + offset, error, None, "1")
            for name, sign, offset in (("mean_power", 1.0, 0.0), ("other", -1.0, 100.0))
        }
        return Answer(SCENE, "monte-carlo", estimates, 0.0)

    return read


def verdict(test, function, conditions=((),), **options):
    read = answers(function, **options)
    return opinion_of([f for c in conditions for f in test.findings(c, read)]).word


RISE = Trend("mean_power", D, (1.0, 2.0, 3.0))
FALL = Trend("mean_power", D, (1.0, 2.0, 3.0), rises=False)
TWO = (((E, 0.1),), ((E, 0.9),))


@pytest.mark.parametrize(
    ("function", "rising", "falling"),
    [
        (lambda c: c[D], HOLDS, FAILS),
        (lambda c: 5.0 - c[D], FAILS, HOLDS),
        (lambda c: 5.0 + 0.001 * c[D], UNDECIDED, UNDECIDED),
        (lambda c: c[D] if c[E] < 0.5 else 5.0 - c[D], IN_PART, IN_PART),
        (lambda c: c[D] if c[E] < 0.5 else 5.0, IN_PART, FAILS),
        (lambda c: 5.0 - (c[D] - 2.2) ** 2, IN_PART, IN_PART),
        (lambda c: None, UNTESTED, UNTESTED),
        (lambda c: c[D] if c[E] < 0.5 else None, HOLDS, FAILS),
    ],
)
def test_trends(function, rising, falling):
    assert verdict(RISE, function, TWO) == rising
    assert verdict(FALL, function, TWO) == falling


def test_a_flat_line_is_seldom_called_a_trend():
    """Three comparisons of 2 standard errors each at 3 σ: one in 180 by chance, seed fixed."""
    noise = np.random.default_rng(5)
    words = [verdict(RISE, lambda c: 5.0, error=0.05, noise=noise) for _ in range(1000)]
    assert set(words) <= {UNDECIDED, HOLDS, IN_PART, FAILS}
    assert 0 < 1000 - words.count(UNDECIDED) <= 20


@pytest.mark.parametrize(
    ("function", "maximum", "hump"),
    [
        (lambda c: 9.0 - (c[D] - 2.0) ** 2, HOLDS, HOLDS),
        (lambda c: c[D], IN_PART, IN_PART),
        # A dip first: a maximum inside, and no single hump.
        (lambda c: {1.0: 3.0, 2.0: 2.0, 3.0: 6.0, 4.0: 4.0}[c[D]], HOLDS, IN_PART),
        (lambda c: 1.0 + (c[D] - 2.4) ** 2, FAILS, IN_PART),
    ],
)
def test_maxima(function, maximum, hump):
    values = (1.0, 2.0, 3.0, 4.0)
    assert verdict(InteriorMaximum("mean_power", D, values), function) == maximum
    assert verdict(SingleHump("mean_power", D, values), function) == hump


def test_comparisons_of_two_parameters():
    def function(c):
        return 5.0 + 3.0 * c.get(D, 1.0) + c.get(E, 0.0)

    of_d, of_e = ((D, (1.0, 2.0)),), ((E, (1.0, 2.0)),)

    def word(test, **values):
        return verdict(test("mean_power", **values), function)

    assert word(LargerEffect, ranges=of_d, weak=of_e) == HOLDS
    assert word(LargerEffect, ranges=of_e, weak=of_d) == FAILS
    assert word(Unchanged, ranges=of_e, limit=0.2) == HOLDS
    assert word(Unchanged, ranges=(*of_e, *of_d), limit=0.2) == IN_PART
    assert word(Changed, ranges=of_d, limit=0.2) == HOLDS
    assert word(Changed, ranges=of_e, limit=0.2) == FAILS
    assert word(OppositeTrends, ranges=of_d, other="other") == HOLDS
    assert word(OppositeTrends, ranges=of_d, other="mean_power") == FAILS


def test_a_change_below_a_limit_is_told_as_it_is_and_judged_by_what_is_left():
    (finding,) = Unchanged("mean_power", ranges=((D, (1.0, 2.0)),), limit=0.2).findings(
        (), answers(lambda c: 9.0 + c[D], error=0.1)
    )
    assert finding.effect == pytest.approx(0.1)
    assert finding.margin == pytest.approx(0.1)
    assert finding.sigmas == pytest.approx(0.1 / (math.hypot(0.1, 0.11) / 10.0))


def test_what_is_undecided_is_told_in_the_verdict():
    read = answers(lambda c: c[D] if c[E] < 0.5 else 5.0)
    verdict_ = opinion_of([f for c in TWO for f in RISE.findings(c, read)])
    assert verdict_.word == IN_PART
    assert "1 of 2 undecided" in verdict_.text()
    against = opinion_of([Finding("a", 1.0, 0.1), Finding("b", -1.0, 0.1)])
    assert against.word == IN_PART
    assert "undecided" not in against.text()


def test_closure_and_simulation_disagree_where_both_are_sure_of_opposite_signs():
    def parted(printed, found):
        verdicts = {"paper": opinion_of([printed]), "monte-carlo": opinion_of([found])}
        return disagreements(verdicts)

    rise, fall = Finding("β", 0.5, 0.01), Finding("β", -0.4, 0.01)
    assert parted(rise, fall) == [("β", 0.5, -0.4)]
    assert parted(rise, rise) == []
    assert parted(rise, Finding("β", -0.02, 0.01)) == []
    assert parted(rise, Finding("K", -0.4, 0.01)) == []


def test_peaks_of_a_density():
    """A sum of two normal densities of width 0.3 about ±1."""
    centre = np.linspace(-4.0, 4.0, 801)

    def density(half):
        values = sum(np.exp(-0.5 * ((centre - s) / 0.3) ** 2) for s in (-half, half))
        values = values / (2 * 0.3 * math.sqrt(2 * math.pi))
        return Density(centre, values, np.full_like(values, 1e-3), "displacement")

    peak, error = peak_of(density(1.0))
    # Averaging over 0.1 takes (0.1/0.3)²/24 off.
    exact = (1 + math.exp(-0.5 * (2 / 0.3) ** 2)) / (2 * 0.3 * math.sqrt(2 * math.pi))
    assert peak == pytest.approx(exact * (1 - (0.1 / 0.3) ** 2 / 24), rel=2e-3)
    assert error == pytest.approx(1e-3)
    for half, word in ((1.0, HOLDS), (0.1, UNDECIDED)):
        answer = Answer(SCENE, "monte-carlo", {}, 0.0, density=density(half))
        assert opinion_of(Bimodal().findings((), lambda c, a=answer: a)).word == word


def test_the_reach_of_a_density_is_its_quantile():
    """Of a normal density on bins of 0.02, whose errors are all equal."""
    centre = np.linspace(-4.99, 4.99, 500)
    values = np.exp(-0.5 * centre**2) / math.sqrt(2.0 * math.pi)
    reach, error = reach_of(Density(centre, values, np.full_like(values, 1e-4), "displacement"))
    exact = NormalDist().inv_cdf(1.0 - BEYOND / 2.0)
    assert reach == pytest.approx(exact, abs=0.01)
    # The tail's probability is off by 1e-4 times its width, at a slope of 2 p(reach).
    tail = 1e-4 * 2.0 * (5.0 - exact)
    assert error == pytest.approx(tail / (2.0 * NormalDist().pdf(exact)), rel=0.05)
    assert reach_of(Density(centre, values, None, "displacement"))[1] == 0.0


def test_differences_on_common_noise_are_right_and_surer(pool):
    """The linear device's power at two loads; four standard errors: one false alarm in 16 000."""
    scene = Scene.read("linear", ["run.realizations=2", "run.duration=20000"])
    loads = [scene.replace({"load.decay_rate": rate}) for rate in (1.5, 2.0)]
    requests = [Request(load, "monte-carlo", moments=True) for load in loads]
    with open_runner(executor=pool) as runner:
        outcomes = runner.answer(requests)
    change, error = relative_change(*outcomes, "mean_power")
    exact = [
        interpolated_linear_means(flat(load), knot_spacing(prepared(load)))["mean_power"]
        for load in loads
    ]
    assert abs(change - (exact[1] / exact[0] - 1.0)) < 4.0 * error
    estimate = outcomes[0].quantities["mean_power"]
    assert error < 0.3 * estimate.standard_error / estimate.estimate


def test_significance_has_the_sign_of_the_statement():
    assert Finding("", -0.2, 0.1, favours=-1).sigmas == pytest.approx(2.0)
    assert Finding("", 0.2, 0.0, favours=-1).sigmas == -math.inf


@pytest.mark.parametrize("claim", CLAIMS, ids=[claim.says for claim in CLAIMS])
def test_every_statement_is_quoted_and_asks_for_devices_that_there_are(claim):
    assert claim.sentence.startswith("“")
    assert claim.sentence.endswith("”")
    assert claim.section in ("2", "4", "5", "4, 5")
    for condition in claim.conditions:
        for changes in claim.test.scenes(condition):
            SCENE.replace(dict(changes))


RISING = Claim("4", "“quoted”", "E[V²] rises with D", Trend("mean_square_voltage", D, (0.02, 0.1)))


@pytest.fixture
def brief(monkeypatch):
    """One statement by the quick methods, on a few short realizations."""
    monkeypatch.setattr(module, "METHODS", ("monte-carlo", "circuit", "paper", "consistent"))
    monkeypatch.setattr(runs, "DURATIONS", {"monte-carlo": 1000.0, "circuit": 50.0})
    monkeypatch.setattr(module, "REALIZATIONS", {"monte-carlo": 8, "circuit": 8})
    monkeypatch.setattr(
        module, "claims", lambda scene, **options: claims(scene, chosen=[RISING], **options)
    )


@pytest.mark.slow
def test_the_command_judges_and_writes(tmp_path, capsys, brief):
    assert main(["reproduce", "claims", "--output", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    for word in ("statement", "E[V²] rises with D", "monte-carlo", "circuit", "consistent"):
        assert word in shown
    (told,) = json.loads((tmp_path / "claims.json").read_text())["claims"]
    assert told["verdicts"]["monte-carlo"]["verdict"] == HOLDS
    assert "| 4 | “quoted” | E[V²] rises with D | holds" in (tmp_path / "claims.md").read_text()


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_it_finds_what_a_figure_left_in_the_folder(tmp_path, brief, pool, monkeypatch):
    """Fig. 9's ends are among the points of the statement, and not computed again."""
    efforts = {"monte-carlo": Effort(8, 0.5, 8), "circuit": Effort(8, 0.5, 8)}
    monkeypatch.setattr(figures, "QUICK", efforts)
    panel = FIGURES["fig7"].panels[0]
    panel = replace(panel, first=0.02, last=0.1, quick=2, curves=panel.curves[:1])
    monkeypatch.setitem(figures.FIGURES, "fig7", replace(FIGURES["fig7"], panels=(panel,)))
    with open_runner(tmp_path, executor=pool) as runner:
        figures.reproduce(SCENE, ["fig7"], quick=True, runner=runner)
    with open_runner(tmp_path, executor=pool) as runner:
        found = claims(SCENE, chosen=[RISING], runner=runner)
    # Each method at two places, of which the figure had one by the circuit.
    assert (runner.computed, runner.reused) == (1, 2 * 4 - 1)
    alone = claims(SCENE, chosen=[RISING], executor=pool)
    assert told_of(found) == told_of(alone)


def told_of(statements):
    """What it says, without how long it took."""
    told = statements.to_dict()
    for each in (told, *told["points"]):
        each.pop("wall_seconds", None)
        each.pop("seconds", None)
    return told

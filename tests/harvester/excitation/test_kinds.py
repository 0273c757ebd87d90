import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from toy_excitation import Steps
from truths import flat

from harvester.averaging.of_scene import average
from harvester.base.errors import AveragingError, HarvesterError, SceneError
from harvester.engines.simulate import simulate
from harvester.excitation import KINDS
from harvester.excitation.base import kernel_loss, realization_seed
from harvester.excitation.white import White
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing

OU = {"kind": "ornstein-uhlenbeck", "intensity": 0.02, "correlation_time": 0.4}
WHITE = {"kind": "white", "intensity": 0.02}
SINE = {"kind": "sine", "amplitude": 0.3, "frequency": 0.35, "phase": 0.2}
SUM = {"kind": "sum", "parts": [SINE, WHITE, OU, WHITE]}


def with_excitation(name, table, **run):
    """A built-in scene with another excitation."""
    tables = Scene.read(name).to_tables()
    tables["excitation"] = table
    tables["run"].update({"realizations": 2, **run})
    return Scene.from_tables(tables, name=name)


@pytest.fixture
def record(tmp_path):
    rng = np.random.default_rng(1)
    np.save(tmp_path / "motion.npy", rng.standard_normal(500))
    return {
        "kind": "record",
        "file": str(tmp_path / "motion.npy"),
        "unit": "scaled",
        "sampling_rate": 20.0,
        "repetition": "periodic",
    }


@pytest.mark.parametrize("kind", ["white", "sine", "sum", "record"])
def test_blocks_of_any_size_give_the_same_bytes(kind, record):
    table = {"white": WHITE, "sine": SINE, "sum": SUM, "record": record}[kind]
    scene = with_excitation("paper", table)
    ready = prepared(scene)
    whole = noise_path(ready, 0).read(1000)
    stream = noise_path(ready, 0)
    parts = np.concatenate([stream.read(n) for n in (1, 0, 7, 500, 492)])
    assert whole.tobytes() == parts.tobytes()
    if kind != "sine":
        assert noise_path(ready, 1).read(1000).tobytes() != whole.tobytes()


@pytest.mark.slow
def test_the_number_of_workers_does_not_change_the_numbers(pool, record):
    scene = with_excitation(
        "paper",
        {"kind": "sum", "parts": [record, WHITE]},
        duration=100.0,
        settle=0.0,
        realizations=3,
    )
    two = simulate(scene, method="monte-carlo", runner=pool).to_dict()["quantities"]
    with ThreadPoolExecutor(1) as executor:
        one = simulate(scene, method="monte-carlo", executor=executor).to_dict()["quantities"]
    assert one == two


def test_white_noise_puts_in_d_whatever_the_spring(pool):
    """E[ηX'] = D per unit mass, less 0.46 c spacing of it; 3 standard errors: 0.3 % each."""
    for name in ("linear", "paper"):
        scene = with_excitation(name, {**WHITE, "intensity": 0.05}, duration=100000.0)
        power = simulate(scene, method="monte-carlo", runner=pool).scaled_quantities[
            "mean_input_power"
        ]
        share = 0.46 * scene.oscillator.damping * knot_spacing(prepared(scene))
        expected = 0.05 * (1.0 - share)
        assert power.standard_error < 0.015 * 0.05
        assert abs(power.estimate - expected) < 3 * power.standard_error


def test_white_noise_has_its_density_at_low_frequency():
    """(∫η dt)²/T averages to 2 D; three standard errors of independent paths, 0.3 %."""
    noise = White(0.02)
    seeds = [realization_seed(1, index) for index in range(2000)]
    sums = np.array([noise.path(0.05, 1.0, seed).read(200).sum() for seed in seeds])
    squares = (0.05 * sums) ** 2 / (200 * 0.05)
    assert abs(squares.mean() - 2 * 0.02) < 3 * squares.std() / np.sqrt(squares.size)


def test_the_share_that_lines_take_is_that_of_a_triangle():
    """With two knots a period the power gain is (2/π)⁴."""
    assert kernel_loss(1.0, math.pi) == pytest.approx(1.0 - (2.0 / math.pi) ** 4, rel=1e-12)


def test_the_sine_has_its_amplitude_between_the_knots_too():
    scene = with_excitation("paper", SINE)
    ready = prepared(scene)
    spacing = knot_spacing(ready)
    knots = round(1 / (0.35 * spacing))
    assert knots * spacing == pytest.approx(1 / 0.35)
    samples = noise_path(ready, 0).read(knots + 1)
    time = np.linspace(0, 1 / 0.35, 200 * knots + 1)
    between = np.interp(time, spacing * np.arange(knots + 1), samples)
    turn = np.exp(-2j * np.pi * 0.35 * time)
    component = 2 * 0.35 * np.trapezoid(between * turn, time)
    assert component == pytest.approx(0.3 * np.exp(1j * (0.2 - np.pi / 2)), rel=1e-4)


def test_a_sum_is_the_sum_of_its_parts():
    scene = with_excitation("paper", {**SUM, "knot_spacing": 0.04})
    only_sine = with_excitation("paper", {**SINE, "knot_spacing": 0.04})
    no_noise = {**SUM, "knot_spacing": 0.04, "parts": [SINE, {**WHITE, "intensity": 1e-30}]}
    quiet = noise_path(prepared(with_excitation("paper", no_noise)), 0).read(100)
    np.testing.assert_allclose(quiet, noise_path(prepared(only_sine), 0).read(100), atol=1e-12)
    # Two white parts have numbers of their own: variances add (15 standard deviations apart).
    parts = [WHITE, WHITE]
    double = with_excitation("paper", {"kind": "sum", "parts": parts, "knot_spacing": 0.04})
    variance = noise_path(prepared(double), 0).read(20000).var()
    assert variance == pytest.approx(2 * 2 * 0.02 / 0.04, rel=0.05)
    assert flat(scene).intensity > 2 * 0.02 + 0.02


@pytest.mark.slow
def test_white_noise_averages_as_the_limit_of_short_correlation():
    white = average(with_excitation("paper", WHITE)).scaled_quantities
    short = average(with_excitation("paper", {**OU, "correlation_time": 1e-3})).scaled_quantities
    for name, estimate in short.items():
        assert white[name].estimate == pytest.approx(estimate.estimate, rel=0.02), name


def test_kinds_that_make_no_sense_are_refused_in_one_line():
    from harvester.validation.public import accuracy, stability

    scene = with_excitation("paper", SINE)
    for call, word in ((stability, "stability"), (accuracy, "accuracy")):
        with pytest.raises(HarvesterError, match=rf'"sine": {word}'):
            call(scene)
    for fit in (False, True):
        with pytest.raises(AveragingError, match='"sine"'):
            average(scene, fit=fit)
    with pytest.raises(AveragingError, match="fit needs a recorded excitation"):
        average(Scene.read("paper"), fit=True)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({**SINE, "intensity": 1.0}, ["excitation.intensity", "unknown"]),
        ({**SINE, "amplitude": -1.0}, ["excitation.amplitude", "≥ 0"]),
        ({**SINE, "knot_spacing": 1.0}, ["knot_spacing", "eighth"]),
        ({"kind": "sin"}, ["did you mean sine"]),
        ({"kind": "sum"}, ["excitation.parts", "missing"]),
        ({"kind": "sum", "parts": []}, ["excitation.parts", "list of 1 to 100"]),
        ({"kind": "sum", "parts": [1.0]}, ["excitation.parts[0]", "a table"]),
        ({"kind": "sum", "parts": [WHITE, {"kind": "wite"}]}, ["parts[1].kind", "white"]),
        ({"kind": "sum", "parts": [{**SINE, "frequncy": 1}]}, ["parts[0].frequncy", "frequency"]),
        ({"kind": "sum", "parts": [SINE], "knot_spacing": 1.0}, ["parts[0]", "eighth"]),
    ],
)
def test_a_mistake_is_refused_in_one_line_that_names_it(table, words):
    with pytest.raises(SceneError) as caught:
        with_excitation("paper", table)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({**WHITE, "knot_spacing": 1e6}, ["run.duration", "1e+06"]),
        ({"kind": "sum", "parts": [WHITE, OU], "knot_spacing": 0.5}, ["knot_spacing", "0.4"]),
        ({"kind": "sum", "parts": [{**OU, "knot_spacing": 0.5}, WHITE]}, ["knot_spacing", "0.4"]),
    ],
)
def test_knots_that_do_not_fit_are_refused_where_they_are_needed(table, words):
    with pytest.raises(SceneError) as caught:
        knot_spacing(prepared(with_excitation("paper", table)))
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_a_sum_survives_its_tables():
    scene = with_excitation("paper", SUM)
    assert Scene.from_tables(scene.to_tables(), name="paper") == scene
    other = with_excitation("paper", {**SUM, "parts": [SINE, WHITE, OU]})
    assert other.digest() != scene.digest()


def test_a_new_kind_is_one_class_and_one_entry(monkeypatch):
    monkeypatch.setitem(KINDS, "steps", Steps)
    scene = with_excitation("paper", {"kind": "steps", "height": 0.3})
    parts = [{"kind": "steps", "height": 0.3}, SINE]
    assert noise_path(prepared(scene), 0).read(4000).std() == pytest.approx(0.3, rel=0.05)
    both = with_excitation("paper", {"kind": "sum", "parts": parts})
    assert noise_path(prepared(both), 0).read(3).size == 3
    with pytest.raises(SceneError, match="did you mean height"):
        with_excitation("paper", {"kind": "steps", "heigth": 0.3})


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ([SINE, SINE], True),
        ([SINE, {**SINE, "frequency": 0.7}], True),
        ([SINE, {**SINE, "frequency": 0.35 * 2.0**0.5}], False),
        ([SINE, WHITE], False),
        ([OU, SINE], False),
    ],
)
def test_only_a_periodic_sum_without_noise_is_told_as_one(parts, told):
    scene = with_excitation("linear", {"kind": "sum", "parts": parts})
    notes = scene.excitation.notes(0.05, 1.0, scene.run)
    assert any("periodic and deterministic" in each for each in notes) is told

"""`harvester new`, and the bare command that names it."""

import io
import math
import re
import sys
from pathlib import Path

import pytest

from harvester.cli import new
from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.source import BUILT_IN


@pytest.fixture
def answers(monkeypatch, tmp_path):
    """What is typed at a terminal; the folder is one's own."""
    monkeypatch.chdir(tmp_path)

    def type_in(text):
        stream = io.StringIO(text)
        stream.isatty = lambda: True
        monkeypatch.setattr(sys, "stdin", stream)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)

    return type_in


@pytest.mark.parametrize("name", Scene.names())
def test_each_built_in_scene_is_copied_with_its_comments(name, tmp_path, capsys):
    path = tmp_path / "mine.toml"
    assert main(["new", str(path), "--from", name]) == 0
    assert Scene.read(path).digest() == Scene.read(name).digest()
    assert path.read_text("utf-8").count("#") > (BUILT_IN / f"{name}.toml").read_text(
        "utf-8"
    ).count("#")
    assert f"harvester average {path}" in capsys.readouterr().err


@pytest.mark.slow
def test_the_new_scene_runs(tmp_path, capsys):
    path = tmp_path / "beam.toml"
    assert main(["new", str(path), "--from", "asymmetric"]) == 0
    brief = ["--set", "run.realizations=2", "--set", "run.duration=4", "--set", "run.settle=1"]
    assert main(["simulate", str(path), "--method", "monte-carlo", *brief]) == 0
    assert "mean power" in capsys.readouterr().out


def test_without_a_terminal_nothing_is_asked(capsys):
    assert main(["new", "-"]) == 0
    shown = capsys.readouterr()
    assert "built-in scene `cantilever`" in shown.out
    assert shown.err == ""


@pytest.mark.parametrize(
    ("file", "scene", "word"),
    [
        ("there.toml", "paper", "exists"),
        ("link.toml", "paper", "exists"),
        ("paper", "paper", "give paper.toml"),
        ("free.toml", "asymetric", "did you mean asymmetric"),
    ],
)
def test_what_is_there_stays_and_mistakes_are_one_line(
    file, scene, word, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("mine")
    (tmp_path / "link.toml").symlink_to("nowhere")
    assert main(["new", file, "--from", scene]) == 2
    said = capsys.readouterr().err
    assert word in said
    assert said.count("\n") == 1
    assert (tmp_path / "there.toml").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"there.toml", "link.toml"}


def test_answers_take_the_place_of_values_and_the_others_stay(answers, capsys):
    # Scene at the second try, mass, damping kept, a coupling after three that are
    # none; input ends.
    answers("asymetric\nasymmetric\n30 g\n\nmuch\n-1\ncoupling=-1\n4e-4\n")
    assert main(["new", "beam.toml"]) == 0
    changes = {"oscillator.mass": 0.03, "piezo.coupling": 4e-4}
    expected = Scene.read("asymmetric").replace(changes)
    assert Scene.read("beam.toml").digest() == expected.digest()
    asked = capsys.readouterr().err
    assert "asymetric: no built-in scene (did you mean asymmetric?)" in asked
    assert "'much': write a number" in asked
    assert "'-1': the usual range is 1e-08 to 1" in asked
    assert "piezo.coupling = -1.0: must be" in asked
    with open("beam.toml", encoding="utf-8") as file:
        text = file.read()
    assert re.search(r"^mass = 0.03 +# kg  mass$", text, re.MULTILINE)
    for other_device in ("Norenberg", "STONEHENGE", "0.022", "√(χ κ Cp", "126.9"):
        assert other_device not in text


@pytest.mark.parametrize("name", Scene.names())
def test_what_is_asked_for_is_found_in_the_scene_it_belongs_to(name, answers, capsys):
    answers(f"{name}\n")
    assert main(["new", "mine.toml"]) == 0
    assert Scene.read("mine.toml").digest() == Scene.read(name).digest()
    asked = capsys.readouterr().err.split("]: ")[1:]
    questions = [question.words for question in new.questions(Scene.read(name))]
    assert all(any(words in text for words in questions) for text in asked if "[" in text)
    assert len(questions) >= 4


def test_no_answer_is_taken_for_another_question(answers, capsys):
    """Mass, frequency, Q, capacitance and k² as makers know them; 42 and 46 Hz are no coupling."""
    answers("cantilever\n14 g\n25\n120\n1\n42\n46 Hz\nk2=0.2\n60n\n200k\n\n0.5 g\n")
    assert main(["new", "mine.toml"]) == 0
    said = capsys.readouterr().err
    assert "'42': the usual range is" in said
    assert "'46 Hz': write 46, without the unit Hz" in said
    stiffness = 0.014 * (2 * math.pi * 120) ** 2
    scene = Scene.read("mine.toml")
    assert scene.oscillator.linear_stiffness == pytest.approx(stiffness)
    assert scene.oscillator.damping == pytest.approx(math.sqrt(stiffness * 0.014) / 25)
    assert scene.transducer.coupling == pytest.approx(math.sqrt(0.2 * stiffness * 60e-9))
    assert scene.oscillator.base_factor == 1.0
    assert scene.load.resistance == 200e3
    assert scene.excitation.intensity == pytest.approx((0.5 * 9.80665) ** 2 * 2e-3)
    # The scene keeps the keys that were answered.
    assert scene.transducer.k2 == 0.2
    assert scene.excitation.rms == pytest.approx(0.5 * 9.80665)
    heavier = scene.replace({"oscillator.mass": 0.028})
    assert heavier.transducer.coupling == pytest.approx(math.sqrt(0.2 * 2 * stiffness * 60e-9))
    text = Path("mine.toml").read_text("utf-8")
    assert "k2 = 0.2" in text
    assert "\ncoupling" not in text
    assert "120 Hz at rest" in said
    assert "Q = 25" in said
    assert f"matched load about {1e-3 / (2 * math.pi * 120 * 60e-9):.1f} kΩ" in said


def test_a_drawing_is_asked_for(answers, capsys):
    said = "40 mm\n8 mm\n0.3 mm\n0.2 mm\nsteal\nstainless steel\nAPC 850\nparallel\n5 g\n40\n"
    answers(f"bimorph\n{said}")
    assert main(["new", "mine.toml"]) == 0
    assert "steal" in capsys.readouterr().err
    beam = Scene.read("mine.toml").beam
    assert (beam.length, beam.width, beam.thickness) == pytest.approx((0.04, 0.008, 0.3e-3))
    assert (beam.material, beam.piezo, beam.connection) == (
        "stainless steel",
        "APC 850",
        "parallel",
    )
    assert (beam.piezo_thickness, beam.tip_mass, beam.ratio) == pytest.approx((2e-4, 5e-3, 1 / 80))


def test_the_bare_command_says_what_to_try(capsys):
    assert main([]) == 0
    shown = capsys.readouterr().out
    commands = re.findall(r"^  harvester (\S+) ", shown, re.MULTILINE)
    assert commands == [
        "average", "validate", "new", "simulate", "load-study", "optimum", "schematic", "identify",
    ]  # fmt: skip
    assert len(shown.splitlines()) < 15

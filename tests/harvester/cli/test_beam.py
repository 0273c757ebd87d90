"""`harvester beam` shows and writes what a drawing comes to."""

import json

import pytest

from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers

MAGNETS = "magnets={distance=0.008,reach=0.006,tip_moment=0.2,frame_moment=0.2}"


def test_values_notes_and_figure(tmp_path, capsys):
    call = ["beam", "bimorph", "--set", MAGNETS, "--output", str(tmp_path)]
    assert main(call) == 0
    shown = capsys.readouterr().out
    assert "short-circuit frequency" in shown
    assert "wrong by up to" in shown
    assert "width/length" in shown
    written = json.loads((tmp_path / "bimorph-beam.json").read_text())
    values = {row["quantity"]: row["value"] for row in written["values"]}
    assert values["mass M"] == pytest.approx(14.04e-3, rel=1e-3)
    assert (tmp_path / "bimorph-beam.png").stat().st_size > 10_000


def test_calibrated_values_are_shown(capsys):
    changes = ["beam.measured_frequency=44", "beam.measured_capacitance=5e-8"]
    assert main(["beam", "bimorph", *(w for each in changes for w in ("--set", each))]) == 0
    shown = capsys.readouterr().out
    assert "clamp's compliance" in shown
    assert "factor on the permittivity" in shown


def test_a_scene_without_a_drawing_is_refused(capsys):
    assert main(["beam", "paper"]) == 2
    assert "no table [beam]" in capsys.readouterr().err


def test_studies_vary_the_drawing():
    scene = Scene.read("bimorph")
    keys = numbers(scene)
    assert {"beam.thickness", "beam.modulus", "beam.piezo_d31"} <= {*keys}
    assert not any(key.startswith(("oscillator.mass", "piezo.coupling")) for key in keys)
    thicker = scene.replace({"beam.thickness": 1.05 * scene.beam.thickness})
    assert thicker.oscillator.linear_stiffness > scene.oscillator.linear_stiffness
    stiffer = scene.replace({"beam.modulus": 2.1 * keys["beam.modulus"][0]})
    assert stiffer.oscillator.linear_stiffness > scene.oscillator.linear_stiffness

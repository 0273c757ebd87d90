"""Scenes that nobody would write by hand: one line and exit code 2 each."""

import datetime
import fractions
import os

import effort
import numpy as np
import pytest

from harvester.base.errors import SceneError
from harvester.base.plain_text import named, shown
from harvester.cli.command_line import MOST_ARGUMENTS, main
from harvester.scene.model import Scene
from harvester.scene.source import BUILT_IN
from harvester.scene.toml import DEEPEST, MOST_VALUES

# Each of these takes at most 431,202 calls. A look at every pair of 5000 parts takes 25 million.
MOST_CALLS = 2_000_000
PAPER = (BUILT_IN / "paper.toml").read_text(encoding="utf-8")


def message_of(call, *arguments, **tables):
    with effort.at_most(MOST_CALLS), pytest.raises(SceneError) as caught:
        call(*arguments, **tables)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 800
    return message


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("seed = 1" + "0" * 400, ["run.seed", "401 digits"]),
        ("seed = 1" + "0" * 5000, ["too many digits"]),
        ("seed = 0x" + "f" * 4000, ["run.seed", "digits"]),
        ("seed = 1e999", ["run.seed", "inf"]),
        ("settle = 1" + "0" * 400, ["run.settle", "digits"]),
        ("settle = 1e999", ["run.settle", "inf"]),
        ("settle = nan", ["run.settle", "nan"]),
        ("settle = 1e300", ["run.settle", "1e+30"]),
        ("settle = 1979-05-27", ["run.settle", "date"]),
        ("settle = true", ["run.settle", "True"]),
        ("x = " + "[" * 5000 + "]" * 5000, ["nested too deeply"]),
        ("x = " + "{a=" * 5000 + "1" + "}" * 5000, ["nested too deeply"]),
        ("x = " + "[" * 30 + "]" * 30, ["nested too deeply"]),
        ("x = [" + "1," * 20_000 + "]", [f"more than {MOST_VALUES}"]),
        ("a." * 60_000 + "b = 1", ["too many dots"]),
        ("[" + "a." * 500 + "b]", ["nested too deeply"]),
        ('"a\\nharvester: fake" = 1', ["run", "not a name"]),
        ('"\\u001b[31m" = 1', ["run", "not a name"]),
        (f"{'x' * 9999} = 1", ["run", "not a name"]),
        ('settle = "a\\u0000b"', ["run.settle", "NUL"]),
        (f"settle = '{'x' * 9999}'", ["run.settle", "4096"]),
        ("realizations = -3", ["run.realizations"]),
        ("[excitation.parts]", ["excitation.parts"]),
    ],
)
def test_a_line_that_no_scene_holds(tmp_path, line, words):
    lines = [each for each in PAPER.splitlines() if line.split(" ")[0] != each.split(" ")[0]]
    path = tmp_path / "scene.toml"
    path.write_text("\n".join([*lines, line]), encoding="utf-8")
    message = message_of(Scene.read, path)
    assert "scene.toml" in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\0" * 999, b"a = \x80", b"\x1b", b"= 1"])
def test_bytes_that_are_no_toml(tmp_path, content):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    assert "not a TOML file" in message_of(Scene.read, path)


def test_only_plain_files_of_a_scenes_size_are_read(tmp_path):
    path = tmp_path / "scene.toml"
    os.mkfifo(path)
    assert "a pipe" in message_of(Scene.read, path)
    path.unlink()
    path.mkdir()
    assert "a folder" in message_of(Scene.read, path)
    path.rmdir()
    path.symlink_to(path)
    assert "no such scene" in message_of(Scene.read, path)
    path.unlink()
    path.symlink_to("/dev/zero")
    assert "a device" in message_of(Scene.read, path)
    path.unlink()
    with path.open("wb") as stream:
        stream.truncate(500 * 10**6)
    assert "too large" in message_of(Scene.read, path)
    for name in ("a" * 5000, "a\0b.toml", "a\ud800.toml", "\x1b[31m\n.toml"):
        assert "no such scene" in message_of(Scene.read, name)


def test_a_file_of_a_built_in_scenes_name_does_not_hide_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper").mkdir()
    (tmp_path / "linear").write_text(PAPER, encoding="utf-8")
    assert Scene.read("paper").stoppers
    assert Scene.read("linear").stoppers == ()
    assert Scene.read(tmp_path / "linear").stoppers


LOOP = []
LOOP.append(LOOP)
WITHIN = {}
WITHIN["run"] = WITHIN
BRANCHES = {"kind": "white", "intensity": 1.0}
for _ in range(6):
    BRANCHES = {"kind": "sum", "parts": [BRANCHES] * 100}
NO_NUMBERS = [
    None,
    {1},
    b"1",
    object(),
    1j,
    [1],
    {"a": 1},
    np.arange(2.0),
    datetime.date(2020, 1, 1),
]
NO_NUMBERS += [10**400, -(10**5000), np.longdouble("1e4000"), np.datetime64("2020"), LOOP, WITHIN]
NO_NUMBERS += [
    float("nan"),
    float("inf"),
    1e300,
    5e-324,
    True,
    np.True_,
    "1",
    "x" * 10**6,
    "\ud800",
]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: type(value).__name__)
def test_what_is_no_number_is_refused_by_its_key(value):
    scene = Scene.read("paper")
    keys = ("run.seed", "run.settle", "stoppers.gap", "excitation.intensity", "length_scale")
    for key in keys if value is not None else ():
        assert key.split(".")[0] in message_of(scene.replace, {key: value})
    tables = scene.to_tables()
    tables["run"]["settle"] = value
    assert "run.settle" in message_of(Scene.from_tables, tables)
    for key in ("units", "excitation.kind", "stoppers.impact_velocity", "load.netlist"):
        if value is not None and not (key == "load.netlist" and isinstance(value, str)):
            message_of(scene.replace, {key: value})


def test_numbers_of_numpy_are_numbers():
    changes = {"run.seed": np.int64(7), "run.settle": np.float32(0.5), "stoppers.gap": np.uint8(2)}
    scene = Scene.read("paper").replace({**changes, "run.duration": fractions.Fraction(5, 2)})
    assert scene == Scene.read("paper").replace(
        {"run.seed": 7, "run.settle": 0.5, "stoppers.gap": 2.0, "run.duration": 2.5}
    )
    for value in (scene.run.seed, scene.run.settle, scene.run.duration, scene.stoppers[0].gap):
        assert type(value) in (int, float)
    assert len(scene.digest()) == 64


@pytest.mark.parametrize("thing", [None, 1, b"paper", ["paper"], {"run": 1}, object(), LOOP])
def test_what_is_no_scene_is_refused(thing):
    message_of(Scene.read, thing)
    message_of(Scene.read, "paper", [thing])
    if not isinstance(thing, dict):
        message_of(Scene.from_tables, thing)
    if thing is not None:
        message_of(Scene.read("paper").replace, thing if thing != {"run": 1} else {1: thing})


def test_keys_that_are_no_names_are_refused():
    scene = Scene.read("paper")
    for key in (None, 1, b"run", 10**5000, (), "", "a\nb", "x" * 999, "\x1b[31m"):
        assert "not a name" in message_of(Scene.from_tables, {**scene.to_tables(), key: 1})
        message_of(scene.replace, {key: 1})
        message_of(scene.replace, run={key: 1})
        message_of(scene.replace, load={"netlist": "bridge", "parameters": {key: 1}})


def test_a_sum_that_repeats_itself_ends():
    message = message_of(Scene.read("paper").replace, excitation=BRANCHES)
    assert f"more than {MOST_VALUES}" in message
    deep = {"kind": "white", "intensity": 1.0}
    for _ in range(DEEPEST):
        deep = {"kind": "sum", "parts": [deep]}
    assert "nested too deeply" in message_of(Scene.read("paper").replace, excitation=deep)


def test_a_sum_takes_no_prescribed_displacement():
    moved = {"kind": "prescribed_displacement", "amplitude": 0.5, "frequency": 1.0}
    noise = {"kind": "white", "intensity": 0.1}
    scene = Scene.read("linear")
    assert scene.replace({"excitation": moved}).excitation.prescribes_displacement
    for parts in ([moved, noise], [noise, moved], [moved], [{"kind": "sum", "parts": [moved]}]):
        message = message_of(scene.replace, {"excitation": {"kind": "sum", "parts": parts}})
        assert "prescribed_displacement" in message
        assert f"parts[{parts.index(moved) if moved in parts else 0}]" in message


@pytest.mark.parametrize(
    "text",
    [
        "run.seed=" + "9" * 5000,
        "run.seed=" + "9" * 400,
        "run.seed=1\nrun.duration=2",
        "run.settle=" + "[" * 50_000,
        "run.settle={" + "a." * 20_000 + "b=1}",
        "run.settle=nan",
        "run.settle=1979-05-27",
        "run.settle=" + "x" * 100_000,
        "x" * 100_000 + "=1",
        "x" * 100_000,
        "\x1b[31m\n=1",
        "a\udcff=1",
        "=",
        "excitation.kind=['a']",
        "load.netlist=a\udcff\n",
    ],
)
def test_an_override_that_no_scene_takes(text, capsys):
    assert main(["simulate", "paper", "--set", text]) == 2
    said = capsys.readouterr().err
    assert said.startswith("harvester: ")
    assert said.count("\n") == 1
    assert len(said) < 800


def test_too_many_arguments_are_refused(capsys):
    assert main(["simulate", "paper", *["--set", "run.seed=1"] * MOST_ARGUMENTS]) == 2
    assert "arguments" in capsys.readouterr().err
    assert main(["load-study", "linear", "--sweep", "load.decay_rate=0.1:1:log:999999999999"]) == 2


def test_values_and_names_are_shown_on_one_printable_line():
    class Odd:
        def __repr__(self):
            raise RuntimeError

    things = [LOOP, WITHIN, 10**5000, [10**5000], "x" * 10**6, b"x" * 10**6, Odd(), "\ud800\x1b"]
    for thing in [*things, np.zeros((50, 50)), {Odd(): LOOP}, {1, "a"}, range(10**9)]:
        assert shown(thing).isprintable()
        assert len(shown(thing)) < 500
    assert named("run.seed") == "run.seed"
    assert named("Größe μ") == "Größe μ"
    assert named("a\x1b") == "'a\\x1b'"

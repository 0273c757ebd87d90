"""Wheel and source distribution, installed where there is no checkout."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import entry_points
import pytest

import harvester
from circuits.ngspice.library import find_library

pytest.importorskip("build", reason="needs the extra `test`")
ROOT = Path(__file__).parents[1]
SHIPPED = ("pyproject.toml", "README.md", "LICENSE", "harvester", "circuits", "netlists")


def run(*words, folder, **environment):
    """Standard output of a program that ends well."""
    surroundings = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        env={**surroundings, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """Folder with the source distribution, and the wheel that was built from it."""
    source = tmp_path_factory.mktemp("source")
    for name in SHIPPED:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
            shutil.copytree(ROOT / name, source / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, source)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", "dist", folder=source)
    return source / "dist"


@pytest.fixture(scope="module")
def environment(distributions, tmp_path_factory):
    """The bin folder of an environment with the wheel, and the libraries that are here."""
    folder = tmp_path_factory.mktemp("environment")
    (wheel,) = distributions.glob("*.whl")
    run(sys.executable, "-m", "venv", "--without-pip", folder / "venv", folder=folder)
    python = folder / "venv" / "bin" / "python"
    install = ["pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel]
    run(sys.executable, "-m", *install, folder=folder)
    # Plain folders on the path: an editable installation there is not taken up.
    (packages,) = (folder / "venv").glob("lib/python*/site-packages")
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    return folder / "venv" / "bin"


@pytest.mark.slow
def test_both_distributions_hold_all_files(distributions):
    (archive,) = distributions.glob(f"vibration_harvester-{harvester.__version__}.tar.gz")
    with tarfile.open(archive) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    (wheel,) = distributions.glob("*.whl")
    kept = {
        path.relative_to(ROOT).as_posix()
        for top in ("harvester", "circuits", "netlists")
        for path in (ROOT / top).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert len(kept) > 250
    assert not kept - names
    assert not kept - set(zipfile.ZipFile(wheel).namelist())
    assert {"README.md", "LICENSE", "pyproject.toml"} <= names


@pytest.mark.exhaustive
def test_the_wheel_runs_away_from_the_checkout(environment, tmp_path):
    said = run(
        environment / "python", "-c", "import harvester; print(harvester.__file__)", folder=tmp_path
    )
    assert Path(said).is_relative_to(environment.parent)
    command = environment / "harvester"
    assert run(command, "--version", folder=tmp_path).split()[1] == harvester.__version__
    # A netlist and ngspice in workers of its own; the scenes, the figures' style and the page.
    where = {"NGSPICE_LIBRARY_PATH": find_library()}
    brief = ["run.realizations=2", "run.duration=1", "run.settle=0.2"]
    sets = [word for value in brief for word in ("--set", value)]
    run(command, "new", "mine.toml", folder=tmp_path)
    loaded = [*sets, "--set", "load.netlist=bridge"]
    shown = run(command, "simulate", "mine.toml", *loaded, folder=tmp_path, **where)
    assert "mean output power" in shown
    outputs = ["--output", "results", "--report", "page.html"]
    run(command, "validate", "linear", *sets, *outputs, folder=tmp_path, **where)
    assert (tmp_path / "results" / "linear-validate.png").exists()
    assert "</html>" in (tmp_path / "page.html").read_text("utf-8")


def test_the_version_stands_in_one_place():
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    assert "harvester.version.__version__" in text
    assert harvester.__version__ not in text


@pytest.mark.exhaustive
def test_another_package_adds_parts_that_workers_find(environment, tmp_path):
    (packages,) = environment.parent.glob("lib/python*/site-packages")
    entry_points.install(packages)
    (tmp_path / "scene.toml").write_text(entry_points.SCENE)
    command = environment / "harvester"
    for words in (
        ("simulate", "scene.toml", "--method", "monte-carlo"),
        ("average", "linear", "--method", "toy"),
    ):
        assert "mean power" in run(command, *words, folder=tmp_path), words

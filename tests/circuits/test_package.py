"""A package `circuits` of another project is refused before anything is computed with it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REFUSED = "belongs to another project: install harvester into an environment of its own"


@pytest.fixture
def foreign(tmp_path):
    """A folder of packages in which `circuits` is not ours."""
    (tmp_path / "circuits").mkdir()
    (tmp_path / "circuits" / "__init__.py").write_text("class Component: pass\n")
    shutil.copytree(
        ROOT / "harvester", tmp_path / "harvester", ignore=shutil.ignore_patterns("*.nb*")
    )
    return tmp_path


def python(*words):
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True)


def test_the_import_is_refused(foreign):
    done = python("-c", f"import sys; sys.path.insert(0, {str(foreign)!r}); import harvester")
    assert done.stderr.splitlines()[-1].startswith("ImportError: the package circuits in ")
    assert REFUSED in done.stderr


def test_the_command_ends_in_one_line(foreign):
    command = foreign / "harvester_command" / "harvester"
    command.parent.mkdir()
    command.write_text(
        f"import sys\nsys.path.insert(0, {str(foreign)!r})\nimport harvester.__main__\n"
    )
    done = python(command, "--help")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert REFUSED in done.stderr

"""Commands that install an extra name this distribution, whatever others are called."""

import importlib.metadata
import tomllib
from pathlib import Path

from harvester.base.libraries import install_command

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]


class Command:
    """A console script of one distribution."""

    def __init__(self, value, name):
        self.value = value
        self.dist = type("Distribution", (), {"name": name})


def installed(monkeypatch, *commands):
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **selected: commands)


def test_the_extra_is_one_of_the_distribution_that_holds_this_package(monkeypatch):
    foreign = Command("harvester.cli:main", "harvester")
    ours = Command(PROJECT["scripts"]["harvester"], PROJECT["name"])
    installed(monkeypatch, foreign, ours)
    assert install_command("fast") == "pip install 'vibration-harvester[fast]'"


def test_without_metadata_the_extra_is_the_clones(monkeypatch):
    installed(monkeypatch)
    assert install_command("fast") == "pip install '.[fast]'"

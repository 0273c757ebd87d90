"""The progress bar of long calls in a notebook."""

import sys
from types import SimpleNamespace

import pytest

import harvester
from harvester.base import notebook

DEVICE = {"run.duration": 20.0, "run.settle": 5.0, "run.realizations": 2}


@pytest.fixture
def shown(monkeypatch):
    """What a notebook displays: each bar, and its updates."""
    shown = []

    def display(bar, display_id):
        shown.append(bar)
        return SimpleNamespace(update=shown.append)

    shell = SimpleNamespace(kernel=True)
    ipython = SimpleNamespace(get_ipython=lambda: shell)
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(HTML=str, display=display))
    monkeypatch.setattr(notebook, "SHOW_AFTER_SECONDS", 0.0)
    return shown


def test_a_bar_follows_a_call_and_goes(shown):
    scene = harvester.Scene.read("linear").replace(DEVICE)
    harvester.simulate(scene, method="monte-carlo", workers=1)
    assert "simulate: 100%" in shown[-2]
    assert shown[-1] == ""


def test_false_switches_it_off(shown):
    scene = harvester.Scene.read("linear").replace(DEVICE)
    harvester.simulate(scene, method="monte-carlo", workers=1, progress=False)
    assert shown == []


def test_a_call_within_a_call_has_no_bar_of_its_own(shown):
    with notebook.progress_bar("outer") as outer:
        outer(0.5)
        with notebook.progress_bar("inner") as inner:
            assert inner is None
    assert shown == ['<progress value="0.500" max="1"></progress> outer: 50% ', ""]


def test_outside_a_notebook_there_is_none():
    with notebook.progress_bar("simulate") as bar:
        assert bar is None

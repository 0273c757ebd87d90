"""The progress bar of long calls in a notebook."""

import sys
from types import SimpleNamespace

import pytest

from harvester.base import notebook
from harvester.scene.calling import takes_scene


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


@takes_scene
def watched(scene, *, progress=None):
    """A call that reports its progress, as studies do."""
    if progress:
        progress(0.5, "half")
    return progress


def test_a_bar_follows_a_call_and_goes(shown):
    assert watched("linear") is not None
    assert shown == ['<progress value="0.500" max="1"></progress> watched: 50% half', ""]


def test_a_bar_is_not_drawn_at_each_report(shown, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(notebook, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    with notebook.progress_bar("many") as bar:
        for report in range(1000):
            clock[0] = 100.0 + 0.001 * report
            bar(report / 1000.0)
    assert len(shown) == 1 + round(1.0 / notebook.UPDATE_SECONDS)


def test_false_switches_it_off(shown):
    assert watched("linear", progress=False) is None
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

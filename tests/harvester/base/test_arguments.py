"""What is given from Python: taken in every form that is meant, else refused in one line."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import harvester
from harvester.base.arguments import Named, checked_progress, listed
from harvester.base.worker_pool import ExecutorPool, WorkerPool
from harvester.scene.calling import takes_scene
from harvester.studies.grid import make_grid

SCENE = harvester.Scene.read("paper")
KEY = "load.decay_rate"


@pytest.mark.parametrize(
    "values",
    [(value for value in (0.1, 0.2)), np.array([0.1, 0.2]), {0.1: None, 0.2: None}.keys()],
    ids=["generator", "array", "keys"],
)
def test_swept_values_come_in_any_form(values):
    assert make_grid(SCENE, (), {KEY: values}).sweeps == {KEY: (0.1, 0.2)}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"over": f"{KEY}=0.1"}, "over = .*must be a dictionary; write over="),
        ({"over": (each for each in [KEY])}, "over = .*must be a dictionary"),
        ({"over": {KEY: "0.1"}}, r"over\['load.decay_rate'\] = '0.1': must be a list"),
        ({"over": {KEY: ["0.1"]}}, "over load.decay_rate: '0.1': must be a number"),
        ({"over": {KEY: [float("nan")]}}, "nan: must be a number"),
        ({"over": {"load.resistance": [0.0]}}, "over load.resistance: 0: must be"),
        ({"loads": "bridge"}, "loads = 'bridge': must be a list"),
        ({"workers": 1.5}, r"workers 1\.5: must be a whole number"),
        ({"workers": -1}, "workers -1"),
        ({"time_limit": float("nan")}, "time_limit nan"),
        ({"time_budget": "soon"}, "time_budget 'soon'"),
        ({"executor": 4}, "executor = 4: give a concurrent.futures.Executor"),
        ({"progress": "bar"}, "progress = 'bar': must be a function of two arguments, or omitted"),
        ({"precision": 1}, r"precision 1: must be a number in \(0, 1\), 0\.01 for 1 %"),
        ({"precision": "1%"}, r"precision '1%': must be .* 0\.01 for 1 %"),
    ],
)
def test_a_call_that_cannot_be_meant_is_refused_in_one_line(options, words):
    with pytest.raises(harvester.HarvesterError, match=words) as raised:
        harvester.load_study(SCENE, **options)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: harvester.frequency_response("linear", "12", amplitude=1.0), "frequencies = '12'"),
        (
            lambda: harvester.frequency_response("linear", ["x"], amplitude=1.0),
            "frequencies: 'x': must",
        ),
        (lambda: harvester.sensitivity("linear", "load"), "vary = 'load': must be a dictionary"),
        (lambda: harvester.sensitivity("linear", {KEY: 0.1}), "0.1: is not a text; write"),
        (lambda: harvester.optimum("paper", [KEY]), "over = .* must be a dictionary"),
        (lambda: harvester.optimum("paper", {KEY: (1, 2, 3)}), "has 3 numbers"),
        (lambda: harvester.spectrum("linear", duration=-1.0), r"duration -1\.0: must be a number"),
        (lambda: harvester.spectrum("linear", durations=1.0), "no option durations .*duration"),
        (lambda: harvester.verify(chosen=[], workers=0), "workers 0: must be a whole number"),
        (lambda: harvester.identify("device", [3]), "records: 3: must be a file"),
        (lambda: harvester.reproduce("paper", "fig4"), "names = 'fig4': must be a list"),
        (lambda: harvester.reproduce("paper", ["fig99"]), "unknown figure fig99"),
    ],
)
def test_other_lists_and_tables_are_refused_alike(call, words):
    with pytest.raises(harvester.HarvesterError, match=words):
        call()


def test_a_list_without_end_is_refused():
    with pytest.raises(harvester.HarvesterError, match="more than 100000 values"):
        listed(iter(int, 1), "frequencies", "[1.0]")


def test_what_the_progress_function_raises_is_named():
    def broken(share, words):
        raise ZeroDivisionError("by my own fault")

    progress = checked_progress(broken)
    with pytest.raises(harvester.HarvesterError, match=r"progress: .*ZeroDivisionError: by my own"):
        progress(0.5, "half")


def test_closed_processes_are_named():
    executor, pool = ThreadPoolExecutor(1), WorkerPool(workers=1)
    executor.shutdown()
    pool.close()
    for closed, words in (
        (ExecutorPool(executor), "executor: accepts no calls"),
        (pool, "runner:"),
    ):
        with pytest.raises(harvester.HarvesterError, match=words):
            closed.map(print, [{}])
        with pytest.raises(harvester.HarvesterError, match=words):
            closed.submit(print, {})


def test_an_executor_that_loses_a_call_is_named():
    class Losing(ThreadPoolExecutor):
        def submit(self, function, *arguments):
            return super().submit(int, "no number")

    with (
        Losing(1) as executor,
        pytest.raises(harvester.HarvesterError, match="lost a task: ValueError"),
    ):
        ExecutorPool(executor).map(print, [{}])


def test_the_arithmetic_of_a_caller_is_not_ours():
    def underflows(scene):
        return float(np.exp(np.array(-1000.0)))

    with np.errstate(all="ignore"):
        assert takes_scene(lambda scene: np.geterr()["over"])(SCENE) == "ignore"
    with np.errstate(all="raise"):
        assert takes_scene(underflows)(SCENE) == 0.0
        assert harvester.average(SCENE, method="consistent")["mean_power"].estimate > 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"window": (0.0, 1.0, 2.0)}, "window = .*must be two times"),
        ({"window": ("a", "b")}, "window = .*must be two times"),
        ({"step": np.array([0.1, 0.2])}, "step .*must be default, fine, finest or"),
        ({"step": [0.1]}, "step"),
        ({"runner": object()}, "runner = .*give a WorkerPool or a Runner"),
        ({"runner": 5}, "runner = 5"),
    ],
)
def test_values_of_another_form_are_refused_by_name(options, words):
    with pytest.raises(harvester.HarvesterError, match=words):
        harvester.simulate(SCENE, method="monte-carlo", workers=1, **options)


@pytest.mark.parametrize("content", [None, 5, []])
def test_what_is_no_scene_is_refused(content):
    with pytest.raises(
        harvester.SceneError, match=r"not a scene: pass the return value of Scene\.to_dict"
    ):
        harvester.Scene.from_dict(content)


def test_numbers_in_keys_match_within_rounding_and_messages_name_the_nearest():
    rows = {("circuit", 0.1 + 0.2): 1, ("circuit", 0.5): 2, ("circuit", 1e5 / 3): 3}
    named = Named("power: no", rows, 'result["power"]')
    assert (named["circuit", 0.3], named["circuit", 33333.3333333]) == (1, 3)
    with pytest.raises(harvester.UnknownQuantity, match=r"write .*'circuit', 0\.5\] or "):
        named["circuit", 0.51]
    with pytest.raises(harvester.UnknownQuantity, match=r"write .*'circuit', 0\.5\] or "):
        named[0.51]
    assert Named("power: no", {0.1 + 0.2: 1})[0.3] == 1


def test_a_message_on_a_wrong_argument_is_one_short_line(tmp_path):
    scene = harvester.Scene.read("paper")
    many = [[0.1] * 50] * 50
    for call in (
        lambda: harvester.paired_difference(many, many),
        lambda: harvester.save(many, tmp_path / "x.json"),
    ):
        with pytest.raises(harvester.HarvesterError) as caught:
            call()
        assert len(str(caught.value)) < 300
        assert "\n" not in str(caught.value)
    with pytest.raises(harvester.HarvesterError, match=r"a scene's file ends in \.toml"):
        harvester.save(scene, tmp_path / "x.json")

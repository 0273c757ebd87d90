import concurrent.futures
import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import toy_study
import worker_calls
from toy_study import study

from harvester.base.errors import AveragingError, FolderInUse, HarvesterError, SimulatorCrashed
from harvester.base.worker_pool import WorkerPool
from harvester.engines.opening import open_runner
from harvester.engines.progress import Progress
from harvester.engines.runner import Runner
from harvester.engines.task import Task, Wanted
from harvester.scene.model import Scene

TESTS = Path(toy_study.__file__).parent


def said(text):
    return Task(worker_calls.say, {"text": text})


def test_results_are_in_order_equal_tasks_are_computed_once_and_errors_stand_in_place(pool):
    tasks = [said("a"), Task(toy_study.draw, {"seed": 13, "part": 0, "seconds": 0.0}), said("b")]
    with open_runner(executor=pool) as runner:
        found = runner.run([*tasks, said("a")])
        assert runner.run([said("b")]) == ["B"]
    assert [found[0], *found[2:]] == ["A", "B", "A"]
    assert isinstance(found[1], AveragingError)
    assert (runner.computed, runner.reused, runner.out_of_time) == (3, 0, False)


def test_a_second_study_takes_what_the_first_left(tmp_path, pool):
    first, one = study(tmp_path, executor=pool)
    again, two = study(tmp_path, executor=pool)
    assert again == first
    assert (one.reused, two.computed) == (0, 0)
    assert two.reused == one.computed
    assert first[3] == "thirteen is not drawn"
    # Nothing of it depends on where it is kept, nor on what else is asked.
    assert study(seeds=[12], executor=pool)[0] == first[2:3]


@pytest.mark.parametrize("kind", ["threads", "one worker"])
def test_any_processes_give_the_same_numbers(pool, kind):
    expected, _ = study(executor=pool)
    if kind == "threads":
        with (
            concurrent.futures.ThreadPoolExecutor(3) as executor,
            pytest.MonkeyPatch.context() as p,
        ):
            # Its own workers do not know the tests' modules.
            p.setenv("PYTHONPATH", str(TESTS))
            p.setattr("harvester.base.worker_pool.call_here", call_directly)
            assert study(executor=executor)[0] == expected
    else:
        with WorkerPool(workers=1, folders=[TESTS]) as one:
            assert study(executor=one)[0] == expected


def call_directly(function, arguments, time_limit, keep_going):
    return function(report=None, **arguments)


def test_a_damaged_answer_is_named_and_computed_again(tmp_path, pool):
    first, _ = study(tmp_path, executor=pool)
    victims = sorted((tmp_path / "points").iterdir())[:2]
    victims[0].write_bytes(victims[0].read_bytes()[:100])
    victims[1].write_bytes(b"")
    again, runner = study(tmp_path, executor=pool)
    assert again == first
    assert runner.computed == 2
    named = {line.partition(": not a whole answer")[0] for line in runner.warnings}
    assert named == {str(path) for path in victims}


@pytest.mark.slow
def test_once_the_time_is_spent_what_has_not_begun_is_left_out(tmp_path, pool, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(Runner, "_is_time_spent", lambda runner, *_: runner.computed >= 2)
        found, runner = study(tmp_path, seconds=0.05, executor=pool)
    assert None in found
    assert runner.out_of_time
    assert runner.computed > 0
    whole, resumed = study(tmp_path, seconds=0.05, executor=pool)
    assert resumed.reused >= runner.computed
    assert whole == study(seconds=0.05, executor=pool)[0]


@pytest.mark.slow
def test_what_runs_beyond_the_time_budget_is_ended(monkeypatch):
    """By a clock of whole seconds: a task of a minute within a budget of three."""
    clock = itertools.count()
    fake = SimpleNamespace(monotonic=lambda: float(next(clock)))
    monkeypatch.setattr("harvester.engines.runner.time", fake)
    waits = Task(worker_calls.wait_silently, {"seconds": 60.0})
    monkeypatch.setattr(Progress, "longest_task", lambda progress: 61.0)
    with WorkerPool(workers=1, folders=[TESTS]) as one:
        process = one._workers[0]
        runner = Runner(one, deadline=3.0)
        assert runner.run([waits, said("a")]) == [None, None]
        assert (runner.computed, runner.out_of_time, process.process_id) == (0, True, None)
        assert runner.remedy == (
            "no task was finished within 3 s; one takes about 61 s: try a time budget of 122 s"
        )
        runner._longest_task = 0.0
        assert runner.remedy.endswith("one takes longer: try a time budget of 30 s")
        # The pool and the study go on.
        assert Runner(one).run([said("a")]) == ["A"]


@pytest.mark.slow
def test_a_task_whose_process_dies_is_tried_again_and_then_told(tmp_path, pool):
    once = Task(worker_calls.die_once, {"marker": str(tmp_path / "marker")})
    never = Task(worker_calls.die, {"status": 3})
    with open_runner(tmp_path / "study", executor=pool) as runner:
        found = runner.run([once, never])
        assert found[0] == "alive"
        assert isinstance(found[1], SimulatorCrashed)
        assert "to compute them again" in runner.warnings[-1]
    assert len(list((tmp_path / "study" / "points").iterdir())) == 1


def test_one_folder_one_runner(tmp_path, pool):
    with open_runner(tmp_path, executor=pool) as runner:
        with pytest.raises(FolderInUse, match=str(tmp_path)), open_runner(tmp_path, executor=pool):
            pass
        with open_runner(runner=runner) as same:
            assert same is runner


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"workers": 0}, "^workers 0: must be"),
        ({"time_budget": -1.0}, "^time_budget -1.0: must be"),
        ({"time_limit": 0.0}, "^time_limit 0.0: must be"),
    ],
)
def test_numbers_out_of_range_are_refused(options, said):
    with pytest.raises(HarvesterError, match=said), open_runner(**options):
        pass


def test_arguments_name_their_task():
    scene = Scene.read("linear")
    keys = {
        Task(worker_calls.say, {"text": value}).key
        for value in ("a", 1, 1.0, None, (1, 2), (1, (2,)), {"a": 1}, scene, scene.digest())
    }
    assert len(keys) == 9
    assert (
        Task(worker_calls.say, {"text": (1, 2)}).key == Task(worker_calls.say, {"text": [1, 2]}).key
    )
    assert said("a").key != Task(worker_calls.wait, {"text": "a"}).key
    assert said("a").key != Task(worker_calls.say, {"text": "a"}, version="2").key
    with pytest.raises(TypeError):
        _ = Task(worker_calls.say, {"text": object()}).key


def test_progress_never_falls_and_ends_at_one():
    shares = []
    progress = Progress(lambda share, words: shares.append((share, words)))
    progress.begin(2)
    progress.ask(0, "quick", 3.0)
    progress.wait("quick")
    progress.wait("slow")
    # Before any task has ended, all five count the same.
    progress.reach("quick", "a", 0.5)
    progress.say()
    assert shares[-1][0] == pytest.approx(0.5 / 5.0)
    progress.done("quick", "a", 1.0)
    # One slow and three quick ones are left, as far as is known of a second each.
    assert shares[-1][0] == pytest.approx(1.0 / 5.0)
    progress.reach("slow", "b", 0.5)
    progress.say()
    assert shares[-1][0] == pytest.approx(1.5 / 5.0)
    progress.done("slow", "b", 10.0)
    assert shares[-1][0] == pytest.approx(11.0 / 14.0)
    progress.ask(0, "quick", 30.0)
    progress.end(1)
    assert shares[-1] == (pytest.approx(11.0 / 14.0), "1 of 2")
    progress.end(0)
    assert shares[-1] == (1.0, "2 of 2")
    # What comes after the end is a list of its own, and a label's speed stays known.
    progress.begin(1)
    progress.wait("quick")
    progress.wait("slow")
    progress.done("quick", "a", 1.0)
    assert shares[-1] == (pytest.approx(1.0 / 11.0), "0 of 1")


def test_progress_takes_no_longer_than_the_time_budget(monkeypatch):
    shares, clock = [], [100.0]
    monkeypatch.setattr("harvester.engines.progress.time.monotonic", lambda: clock[0])
    progress = Progress(lambda share, words: shares.append(share))
    progress.begin(1, deadline=250.0)
    for _ in range(100):
        progress.wait("slow")
    clock[0] = 160.0
    progress.done("slow", "a", 60.0)
    assert shares[-1] == pytest.approx(0.4)
    clock[0] = 300.0
    progress.say()
    assert shares[-1] < 1.0
    # After 200 s, a quarter of the longest task is done.
    progress.reach("slow", "b", 0.25)
    progress.reach("slow", "c", 0.5)
    assert progress.longest_task() == pytest.approx(800.0)
    progress.end(0)


@pytest.mark.slow
def test_a_plan_is_told_of_every_result_it_asked_for(pool):
    def plan():
        found = yield Wanted([said("a"), said("b"), said("a")])
        none = yield Wanted([])
        return found, none

    with open_runner(executor=pool) as runner:
        assert runner.follow([plan()]) == [(["A", "B", "A"], [])]


def test_arrays_are_the_same_in_memory_and_on_disk(tmp_path, pool):
    task = Task(toy_study.draw, {"seed": 1, "part": 2, "seconds": 0.0})
    found = []
    for output in (None, tmp_path, tmp_path):
        with open_runner(output, executor=pool) as runner:
            found += runner.run([task])
    np.testing.assert_array_equal(found[0]["drawn"], found[1]["drawn"])
    np.testing.assert_array_equal(found[0]["drawn"], found[2]["drawn"])


def test_reports_go_back_to_where_they_went_before_a_block():
    def plan():
        return "nothing to compute"
        yield

    reports = []
    runner = Runner(None, progress=lambda share, words: reports.append((share, words)))
    with runner.in_stages() as stages:
        stages.begin(0.0, 0.8, "points")
        runner.follow([plan()])
        stages.begin(0.8, 1.0, "cross-check")
        runner.follow([plan()])
    runner.follow([plan()])
    shares = [share for share, _ in reports]
    assert shares == sorted(shares)
    assert {0.0, 0.8, 1.0} == {*shares}
    assert reports[-2:] == [(1.0, "cross-check"), (1.0, "1 of 1")]

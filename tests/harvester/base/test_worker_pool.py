import time
from concurrent.futures import Future

import effort
import pytest
import worker_calls

from harvester.base.errors import SimulatorCrashed
from harvester.base.worker_pool import WorkerPool, gather


@pytest.mark.slow
def test_results_of_a_pool_keep_their_order(pool):
    calls = [{"text": text} for text in "abcdef"]
    assert pool.map(worker_calls.say, calls) == list("ABCDEF")


def test_the_processes_of_a_pool_start_before_its_first_call():
    with WorkerPool(workers=2) as pool:
        deadline = time.monotonic() + 30.0
        while any(worker.process_id is None for worker in pool._workers):
            assert time.monotonic() < deadline
            time.sleep(0.01)


@pytest.mark.slow
def test_a_call_that_crashes_once_is_made_again(pool, tmp_path):
    calls = [{"marker": str(tmp_path / name)} for name in "ab"]
    assert pool.map(worker_calls.die_once, calls, keep_going=True) == ["alive", "alive"]


def test_a_call_that_keeps_crashing_is_a_named_failure_beside_the_others(pool, tmp_path):
    good = str(tmp_path / "done")
    with open(good, "w"):
        pass
    calls = [{"marker": good}, {"marker": "/nowhere"}]
    outcomes = pool.map(worker_calls.die_unless, calls, keep_going=True)
    assert outcomes[0] == "alive"
    assert isinstance(outcomes[1], SimulatorCrashed)
    assert "status 4" in str(outcomes[1])


def test_a_pool_can_be_used_after_a_call_that_failed(pool):
    with pytest.raises(SimulatorCrashed, match="status 3"):
        pool.map(worker_calls.die, [{"status": 3}] * 4)
    assert pool.map(worker_calls.say, [{"text": "a"}]) == ["A"]


def test_the_outcomes_of_many_calls_are_gathered_with_work_that_grows_as_their_number():
    """No outcome asks all that are left: of 2000 that would be millions of calls."""
    futures = [Future() for _ in range(2000)]
    for future in futures:
        future.set_result(1)
    with effort.at_most(40 * len(futures)):
        assert sum(gather(futures)) == len(futures)

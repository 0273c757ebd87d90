import os
import re
import signal
import subprocess
import sys
import threading
import time

import pytest
import worker_calls

from harvester.base.errors import HarvesterError, SimulatorCrashed, SimulatorTimeout


def test_a_call_returns_its_result_and_reports_progress(worker):
    assert worker.call(worker_calls.say, {"text": "hello"}) == "HELLO"
    seen = []
    worker.call(worker_calls.wait, {"seconds": 0.0}, on_progress=seen.append)
    assert seen == ["waiting", "waited"]


def test_an_unexpected_error_comes_back_as_one_line(worker):
    with pytest.raises(HarvesterError, match="TypeError"):
        worker.call(worker_calls.say, {"words": 1})
    assert worker.call(worker_calls.say, {"text": "on"}) == "ON"


@pytest.mark.slow
def test_a_process_that_ends_is_named_and_started_again(worker):
    with pytest.raises(SimulatorCrashed, match="status 3"):
        worker.call(worker_calls.die, {"status": 3})
    assert worker.call(worker_calls.say, {"text": "again"}) == "AGAIN"


@pytest.mark.slow
def test_the_time_limit_ends_a_call_and_keeps_its_last_report(worker):
    worker.call(worker_calls.say, {"text": "up"})
    with pytest.raises(SimulatorTimeout, match=r"0\.5 s") as caught:
        worker.call(worker_calls.wait, {"seconds": 60.0}, time_limit=0.5)
    # Not only once the call has ended: its last report would be "waited".
    assert caught.value.partial == "waiting"


@pytest.mark.slow
def test_compilation_does_not_count_towards_the_time_limit(worker):
    worker.call(worker_calls.say, {"text": "up"})
    asked = {"seconds": 2.0}
    assert worker.call(worker_calls.compile_slowly, asked, time_limit=1.5) == "compiled"


@pytest.mark.parametrize("limit", [float("inf"), 1e300])
def test_a_time_limit_may_be_longer_than_the_system_can_wait(worker, limit):
    assert worker.call(worker_calls.say, {"text": "up"}, time_limit=limit) == "UP"


@pytest.mark.slow
def test_killing_the_process_is_noticed(worker):
    worker.call(worker_calls.say, {"text": "up"})
    process = worker.process_id
    threading.Timer(0.3, os.kill, (process, signal.SIGKILL)).start()
    with pytest.raises(SimulatorCrashed, match="signal 9"):
        worker.call(worker_calls.wait, {"seconds": 60.0})


def test_a_worker_closed_while_its_process_starts_leaves_nothing_open(worker, monkeypatch):
    """Another call's failure ends all workers, whatever they are about."""
    started, closing = [], []

    def start_slowly(*arguments, **options):
        closing.append(threading.Thread(target=worker.close))
        closing[0].start()
        time.sleep(0.3)
        started.append(subprocess_popen(*arguments, **options))
        return started[0]

    subprocess_popen = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", start_slowly)
    with pytest.raises(SimulatorCrashed):
        worker.call(worker_calls.die, {"status": 3})
    closing[0].join()
    assert started[0].returncode is not None
    assert started[0].stdin.closed
    assert started[0].stdout.closed


@pytest.mark.slow
@pytest.mark.parametrize("limit", ["-n 14", "-v 450000", "-d 200000"])
def test_too_few_files_or_too_little_memory_is_one_line(limit):
    call = f"ulimit {limit}; exec {sys.executable} -m harvester simulate paper --workers 4"
    call += " --set run.duration=50 --quiet"
    shown = subprocess.run(["sh", "-c", call], capture_output=True, text=True, timeout=60)
    assert shown.returncode == 1
    assert len(shown.stderr.splitlines()) == 1
    # Which strikes first is the machine's: a thread of ours, the worker, or the libraries.
    assert re.search("cannot be started|the limit is (439|195) MB; raise it", shown.stderr)

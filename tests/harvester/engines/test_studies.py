"""What holds of every study that the runner carries out."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import small_studies
from small_studies import STUDIES

TESTS = Path(small_studies.__file__).parent


@pytest.fixture(scope="module")
def undisturbed():
    """What each study says and how many pieces it keeps, in a process that nobody disturbs."""
    found = {}

    def of(kind, folder):
        if kind not in found:
            found[kind] = start(kind, folder).communicate()[0], kept(folder)
        return found[kind]

    return of


def start(kind, folder):
    # This folder behind all others: it has a folder of the package's name.
    program = f"import sys; sys.path.append({str(TESTS)!r}); import small_studies as s; s.main()"
    command = [sys.executable, "-c", program, kind, str(folder)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def workers_of(process):
    threads = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(word) for thread in threads for word in thread.read_text().split()]


def kept(folder):
    return len(list(folder.glob("points/[!.]*")))


@pytest.mark.exhaustive
@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="finds workers in /proc")
@pytest.mark.parametrize("kind", ["load-study", "optimum", "accuracy"])
def test_killed_at_random_it_says_the_same_in_the_end(kind, tmp_path, undisturbed):
    """Workers, and three times the study itself, at times that chance chooses.

    Of studies whose tasks follow from those before, or whose times are part of what they say; all
    others hand one list of tasks to the same runner.
    """
    expected, whole = undisturbed(kind, tmp_path / "undisturbed")
    folder, chance = tmp_path / "disturbed", random.Random(7)
    for _ in range(3):
        process, begun = start(kind, folder), kept(folder)
        aim = begun + chance.randrange(1, max(2, (whole - begun) // 3))
        # Long enough for a busy machine, on which the start alone may take a minute.
        deadline = time.monotonic() + 600.0
        while kept(folder) < aim and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.005)
        for worker in workers_of(process)[:1]:
            os.kill(worker, signal.SIGKILL)
        time.sleep(chance.uniform(0.0, 0.3))
        process.kill()
        process.communicate()
        assert kept(folder) > begun
    assert kept(folder) < whole
    damaged = min((folder / "points").glob("[!.]*"))
    damaged.write_bytes(damaged.read_bytes()[:500])
    last = start(kind, folder)
    assert last.communicate()[0] == expected != ""
    assert kept(folder) == whole


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Address of a Dask scheduler with two workers, all started by hand."""
    pytest.importorskip("distributed")
    place = tmp_path_factory.mktemp("dask")
    dask = [sys.executable, "-m", "distributed.cli"]
    processes, said = [], open(place / "said", "w+")  # noqa: SIM115 - closed below

    def begin(what, *options):
        module = f"{dask[2]}.dask_{what}"
        command = [sys.executable, "-m", module, *options, "--no-dashboard"]
        processes.append(subprocess.Popen(command, stdout=said, stderr=said, cwd=place))

    try:
        begin("scheduler", "--host", "127.0.0.1", "--port", "0")
        address, deadline = None, time.monotonic() + 60.0
        while not address and time.monotonic() < deadline:
            time.sleep(0.1)
            address = re.search(r"tcp://127\.0\.0\.1:\d+", (place / "said").read_text())
        for _ in range(2):
            begin("worker", address[0], "--nthreads", "1", "--no-nanny")
        yield address[0]
    finally:
        for process in processes[::-1]:
            process.terminate()
            process.wait(30.0)
        said.close()


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", STUDIES)
def test_a_cluster_says_what_one_machine_says(kind, cluster, tmp_path, undisturbed):
    expected, _ = undisturbed(kind, tmp_path)
    # In a process of its own: the study in little changes what others declare.
    program = f"import sys; sys.path.append({str(TESTS)!r}); import small_studies as s; "
    program += f"print(s.told({kind!r}, scheduler={cluster!r}))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert found.stdout == expected != "", found.stderr

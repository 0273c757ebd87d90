import os
import shutil
import tempfile
from pathlib import Path

import kept
import pytest
from hypothesis import HealthCheck, settings

from harvester.base.worker_pool import WorkerPool
from harvester.base.worker_process import Worker

HERE = Path(__file__).parent
# Fuzz tests: the same few seconds every time, or `--hypothesis-profile=long` by hand.
UNHURRIED = {"database": None, "deadline": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("short", max_examples=150, derandomize=True, **UNHURRIED)
settings.register_profile("long", max_examples=20_000, **UNHURRIED)
settings.load_profile("short")


# Tests look for whole rows and texts; `results/test_terminal.py` tests the widths.
os.environ["COLUMNS"] = "300"


def pytest_configure(config):
    if kept.FOLDER not in os.environ:
        os.environ[kept.FOLDER] = config.truths = tempfile.mkdtemp(prefix="truths-")


def pytest_unconfigure(config):
    """Only the process that made the folder removes it."""
    if folder := getattr(config, "truths", None):
        os.environ.pop(kept.FOLDER)
        shutil.rmtree(folder)


def pytest_collection_modifyitems(items):
    """Modules with slow tests go first: side by side, none is left alone with one at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def pool():
    """Two worker processes for the whole session."""
    with WorkerPool(workers=2, folders=[HERE]) as running:
        yield running


@pytest.fixture
def shared_workers(pool, monkeypatch):
    """A call that would start workers of its own takes those of the session.

    To start one takes a second of processor time. That calls start their own and end them has
    tests in `harvester/base`, and of the command line in `test_command_line`.
    """
    monkeypatch.setattr(WorkerPool, "__enter__", lambda unused: pool)


@pytest.fixture
def worker():
    """One worker process that can import this folder's modules."""
    one = Worker(folders=[HERE])
    yield one
    one.close()


@pytest.fixture
def dask_executor():
    """Dask's executor of two local workers.

    Its page takes whichever port is free: the usual one may be another program's, or the
    other test's that runs beside this one.
    """
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()

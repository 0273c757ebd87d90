from pathlib import Path

import pytest

from harvester.workers import Worker, WorkerPool


@pytest.fixture(scope="session")
def pool():
    """Two worker processes for the whole session."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
        with WorkerPool(workers=2) as running:
            yield running


@pytest.fixture
def worker(monkeypatch):
    """One worker process that can import this folder's modules."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    one = Worker()
    yield one
    one.close()

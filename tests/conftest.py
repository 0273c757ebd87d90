from pathlib import Path

import pytest

from harvester.workers import Worker, WorkerPool

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def pool():
    """Two worker processes for the whole session."""
    with WorkerPool(workers=2, folders=[HERE]) as running:
        yield running


@pytest.fixture
def worker():
    """One worker process that can import this folder's modules."""
    one = Worker(folders=[HERE])
    yield one
    one.close()

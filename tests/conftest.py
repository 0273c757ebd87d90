from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from harvester.workers import Worker, WorkerPool

# Fuzz tests: the same few seconds every time, or `--hypothesis-profile=long` by hand.
UNHURRIED = {"database": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile(
    "short", max_examples=150, derandomize=True, deadline=timedelta(seconds=10), **UNHURRIED
)
settings.register_profile("long", max_examples=20_000, deadline=timedelta(seconds=1), **UNHURRIED)
settings.load_profile("short")


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

"""A study that simulates nothing: means of random numbers, drawn until they are precise enough."""

import time

import numpy as np

from harvester.base.errors import AveragingError
from harvester.engines.opening import open_runner
from harvester.engines.task import Task, Wanted

PRECISION, DRAWN = 0.05, 50


def draw(report, seed, part, seconds):
    if seed == 13:
        raise AveragingError("thirteen is not drawn")
    time.sleep(seconds)
    return {"drawn": np.random.default_rng([seed, part]).exponential(1.0 + seed, DRAWN)}


def mean(seed, seconds):
    """A plan: (mean, its error, parts)."""
    parts, count = [], 2
    while True:
        wanted = [Task(draw, {"seed": seed, "part": k, "seconds": seconds}) for k in range(count)]
        found = yield Wanted(wanted[len(parts) :])
        if None in found:
            return None
        if isinstance(found[0], AveragingError):
            return str(found[0])
        parts += found
        drawn = np.concatenate([each["drawn"] for each in parts])
        error = drawn.std() / drawn.size**0.5
        if error < PRECISION * drawn.mean():
            return [float(drawn.mean()), float(error), count]
        count *= 2


def study(output=None, seconds=0.0, seeds=range(10, 16), **options):
    """Means of some seeds, and the runner."""
    with open_runner(output, **options) as runner:
        return runner.follow([mean(seed, seconds) for seed in seeds]), runner

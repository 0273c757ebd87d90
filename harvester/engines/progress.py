"""Progress of a list of tasks, from the times of finished tasks by label."""

import math
import time
from collections import Counter, defaultdict
from collections.abc import Callable

# Largest progress reported by the time budget: at its end running tasks still have to finish.
MOST_OF_BUDGET = 0.99


class Stages:
    """Progress of a study whose stages are lists of tasks.

    `report` is called with the finished share of all stages, 0 … 1 and never falling, and the
    description of the present stage.
    """

    def __init__(self, report: Callable[[float, str], object]):
        self._report = report
        self._low, self._high, self._words, self.share = 0.0, 1.0, "", 0.0

    def begin(self, low: float, high: float, words: str) -> None:
        """Begin a stage in which the finished share rises from `low` to `high`."""
        self._low, self._high, self._words = low, high, words
        self(0.0)

    def __call__(self, share: float, words: str = "") -> None:
        """Report the finished share of the present stage."""
        self.share = max(self.share, self._low + share * (self._high - self._low))
        self._report(self.share, self._words or words)


class Progress:
    """Sum of finished and remaining work, in seconds of one core.

    `report` is called with the finished share of one list of tasks, 0 … 1, never falling, and a
    short description; with the elapsed share of the time budget if that is larger.
    """

    def __init__(self, report: Callable[[float, str], object]):
        self.report = report
        self._seconds: dict[str, float] = defaultdict(float)
        self._count: Counter[str] = Counter()
        self._waiting: Counter[str] = Counter()
        self._running: dict[str, tuple[str, float]] = {}
        self._ahead: dict[object, tuple[str, float]] = {}
        self._plans, self._ended = 0, 0
        self._share, self._spent = 0.0, 0.0
        self._began, self._deadline = 0.0, math.inf

    def begin(self, plans: int, deadline: float = math.inf) -> None:
        """Add a number of plans; if no other plan is active, the share restarts from zero."""
        if self._ended == self._plans:
            self._plans, self._ended = 0, 0
            self._share, self._spent = 0.0, 0.0
            self._began, self._deadline = time.monotonic(), deadline
        self._plans += plans

    def ask(self, plan: object, label: str, ahead: float) -> None:
        """Announce the approximate number of further tasks of a plan."""
        self._ahead[plan] = label, ahead

    def wait(self, label: str) -> None:
        """Note that one more task is to be computed."""
        self._waiting[label] += 1

    def reach(self, label: str, key: str, share: float) -> None:
        """Note how much of a task is done; called in any thread."""
        self._running[key] = label, share

    def done(self, label: str, key: str, seconds: float) -> None:
        """Note that a task has been computed."""
        self._running.pop(key, None)
        self._waiting[label] -= 1
        self._seconds[label] += seconds
        self._spent += seconds
        self._count[label] += 1
        self.say()

    def end(self, plan: object) -> None:
        """Note that a plan has ended."""
        self._ahead.pop(plan, None)
        self._ended += 1
        self.say()

    def say(self) -> None:
        """Report the progress, also before any task has ended."""
        left = sum(count * self._mean(label) for label, count in self._waiting.items())
        left += sum(count * self._mean(label) for label, count in self._ahead.values())
        begun = sum(share * self._mean(label) for label, share in [*self._running.values()])
        if self._spent + left > 0.0:
            self._share = max(self._share, (self._spent + begun) / (self._spent + left))
        elif not self._waiting.total():
            self._share = 1.0
        budget = max(self._deadline - self._began, 0.0) or math.inf
        of_budget = min((time.monotonic() - self._began) / budget, MOST_OF_BUDGET)
        self.report(max(self._share, of_budget), f"{self._ended} of {self._plans}")

    def longest_task(self) -> float:
        """Expected seconds of the slowest running task, counted from the list's beginning."""
        least = min((share for _, share in [*self._running.values()] if share), default=math.inf)
        return (time.monotonic() - self._began) / least

    def _mean(self, label):
        """Mean seconds of a task with this label; over all labels if it is new."""
        if self._count[label]:
            return self._seconds[label] / self._count[label]
        return sum(self._seconds.values()) / self._count.total() if self._count else 1.0

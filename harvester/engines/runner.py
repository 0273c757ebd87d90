"""The loop over tasks: answers are reused from a store, else computed by processes and stored."""

import contextlib
import heapq
import itertools
import math
import queue
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from functools import partial

from harvester.base.errors import HarvesterError
from harvester.base.formatting import number
from harvester.base.worker_pool import LOOK_AROUND, ExecutorPool, WorkerPool, lost
from harvester.engines.folder import StudyFolder
from harvester.engines.progress import Progress, Stages
from harvester.engines.request import OUT_OF_TIME, Answer, Request, answering
from harvester.engines.simulate import TIME_LIMIT
from harvester.engines.store import MISSING, AnswerStore
from harvester.engines.task import Task, Wanted, compute

# Largest number of damaged answers that are named.
MOST_NAMED = 10
# If no task was finished, this multiple of the time budget is advised.
LONGER_BUDGET = 10.0
# Share of the time budget by which running tasks may exceed it before they are terminated.
OVERRUN = 0.05

Plan = Generator[Wanted, list, object]


class Runner:
    """Computes tasks or reuses stored answers; `open_runner` creates one.

    The next tasks of a plan depend only on earlier answers, and a task's answer only on its
    arguments: an interrupted study therefore gives the same numbers when resumed, on any number of
    processes.

    Attributes
    ----------
    folder
        Folder of stored answers; None: in memory only.
    out_of_time
        Whether tasks were skipped because the time budget was spent.
    computed, reused
        Numbers of tasks that were computed, and of tasks whose answers came from the store.
    """

    def __init__(
        self,
        pool: WorkerPool | ExecutorPool,
        folder: StudyFolder | None = None,
        deadline: float = math.inf,
        time_limit: float = TIME_LIMIT,
        progress: Callable[[float, str], object] | None = None,
    ):
        self.pool, self.folder, self.time_limit = pool, folder, time_limit
        self.out_of_time = False
        self._store, self._deadline = AnswerStore(folder), deadline
        self._budget = max(deadline - time.monotonic(), 0.0)
        self._longest_task = 0.0
        self._progress = Progress(progress or (lambda share, words: None))
        self._computed: set[str] = set()
        self._reused: set[str] = set()
        self._circuit = ""

    @contextlib.contextmanager
    def in_stages(self) -> Iterator[Stages]:
        """Yield `Stages`: within the block, its `begin` starts a stage for each list of tasks."""
        former = self._progress.report
        self._progress.report = stages = Stages(former)
        try:
            yield stages
        finally:
            self._progress.report = former

    @property
    def computed(self) -> int:
        return len(self._computed)

    @property
    def reused(self) -> int:
        return len(self._reused)

    @property
    def warnings(self) -> list[str]:
        """Warnings on invalid stored answers, on results that were not stored, on a folder that
        cannot be locked, and on a time budget that was spent."""
        lines = list(self._store.refused.values())
        if len(lines) > MOST_NAMED:
            lines[MOST_NAMED:] = [f"and {len(lines) - MOST_NAMED} more of this kind"]
        if self._store.passing and self._store.on_disk:
            lines.append(
                f"{self._store.passing} tasks gave no result to store (because of a limit, the "
                "machine, a missing program or file): run the same command to compute them again"
            )
        if self.out_of_time:
            lines.append(f"{OUT_OF_TIME}: {self.remedy}")
        return [*(self.folder.notes if self.folder else ()), *lines]

    @property
    def remedy(self) -> str:
        """What to do if the time budget was spent."""
        if not self.computed:
            seconds = self._longest_task
            takes = f"about {number(seconds, 2)} s" if seconds else "longer"
            needs = max(math.ceil(max(LONGER_BUDGET * self._budget, 2.0 * seconds)), 1)
            return (
                f"no task was finished within {number(self._budget, 2)} s; one takes {takes}: "
                f"try a time budget of {needs} s"
            )
        if self.folder:
            return "repeat the same command or call to continue"
        return "give a longer one, or an output folder from which the next call continues"

    @contextlib.contextmanager
    def reserving(self, share: float) -> Iterator[None]:
        """Within the block, reserve this share of the remaining time for later work."""
        deadline, now = self._deadline, time.monotonic()
        self._deadline = now + (1.0 - share) * (deadline - now)
        try:
            yield
        finally:
            self._deadline = deadline

    def run(self, tasks: Sequence[Task]) -> list:
        """Answers of some tasks, in their order; tasks begin in that order, equal tasks once.

        A failed task's answer is its HarvesterError; a task skipped for lack of time has None.
        """
        return self.follow([_alone(task) for task in tasks])

    def answer(
        self,
        requests: Sequence[Request],
        on_answer: Callable[[int, object], None] | None = None,
        in_turn: bool = False,
    ) -> list[Answer | HarvesterError | None]:
        """Answers to requests, in their order; see `harvester.engines.request.answering`.

        Requests begin in that order, equal requests once. `on_answer` is called with (index,
        answer) for each answer; `in_turn` as for `follow`.
        """
        # Requests with the same tasks share them: a density requested by one is computed for all.
        shapes = {_cut(request) for request in requests if request.density}
        plans = [
            answering(request, self.version(request.method.name), _cut(request) in shapes)
            for request in requests
        ]
        return self.follow(plans, on_answer, in_turn)

    def version(self, method: str) -> str:
        """Version of the other program that an engine or stationary method uses."""
        if method != "circuit":
            return ""
        if not self._circuit:
            from circuits.ngspice.engine import describe

            program = self.pool.map(describe, [{}])[0]
            device = "behavioural" if program["compiled_device_off"] else "compiled"
            self._circuit = f"{program['version']}, {device} device"
        return self._circuit

    def follow(
        self,
        plans: Iterable[Plan],
        on_end: Callable[[int, object], None] | None = None,
        in_turn: bool = False,
    ) -> list:
        """Execute several plans concurrently; returns the list of their return values.

        Parameters
        ----------
        plans : iterable of generator
            Each yields `Wanted` and is sent the results of its tasks, in the form of `run`, when
            all are complete. If a result is None, the time is spent: the plan should return a
            partial result.
        on_end : callable or None
            Called with (index, returned value).
        in_turn : bool
            Whether an earlier plan's later tasks precede a later plan's first ones: plans then end
            one after another, else all plans advance together.
        """
        return _Following(self, list(plans), on_end, in_turn).to_the_end()

    def _is_time_spent(self, overrun=0.0):
        return time.monotonic() > self._deadline + overrun


class _Following:
    """State of one call of `Runner.follow`."""

    def __init__(self, runner, plans, on_end, in_turn):
        self._runner, self._plans, self._on_end = runner, plans, on_end
        self._in_turn = in_turn
        self._store, self._progress = runner._store, runner._progress
        self._returned = [None] * len(plans)
        # Tasks and results of each plan; by the key of a task, the plans that wait for this task.
        self._wanted, self._results, self._waiting = {}, {}, {}
        # Tasks that have not been submitted yet, with their priorities.
        self._ready, self._number = [], itertools.count()
        self._futures: dict = {}
        self._done: queue.SimpleQueue = queue.SimpleQueue()

    def to_the_end(self):
        self._progress.begin(len(self._plans), self._runner._deadline)
        try:
            for plan in range(len(self._plans)):
                self._advance(plan, None)
            while self._waiting:
                if self._runner._is_time_spent():
                    self._leave_out()
                if self._runner._is_time_spent(OVERRUN * self._runner._budget):
                    self._end_running()
                self._hand_over()
                self._collect()
        except BaseException:
            for future in self._futures:
                future.cancel()
            raise
        return self._returned

    def _advance(self, plan, results):
        """Advance a plan while all answers that it asks for are available."""
        while True:
            try:
                request = self._plans[plan].send(results)
            except StopIteration as end:
                self._returned[plan] = end.value
                self._progress.end(plan)
                if self._on_end:
                    self._on_end(plan, end.value)
                return
            label = request.tasks[0].label if request.tasks else ""
            self._progress.ask(plan, label, request.ahead)
            self._wanted[plan] = [task.key for task in request.tasks]
            self._results[plan] = {}
            for task in request.tasks:
                self._ask(plan, task)
            if len(self._results[plan]) < len(set(self._wanted[plan])):
                return
            results = self._of(plan)

    def _of(self, plan):
        results = self._results.pop(plan)
        return [results[key] for key in self._wanted.pop(plan)]

    def _ask(self, plan, task):
        """Use the stored answer of a task, or wait for it."""
        runner, key = self._runner, task.key
        if key in self._waiting:
            self._waiting[key].add(plan)
            return
        answer = self._store.get(task)
        if answer is not MISSING:
            runner._reused |= {key} - runner._computed
        elif runner._is_time_spent():
            runner.out_of_time = True
            answer = None
        else:
            self._waiting[key] = {plan}
            self._progress.wait(task.label)
            priority = plan if self._in_turn else 0
            heapq.heappush(self._ready, (priority, next(self._number), task))
            return
        self._results[plan][key] = answer

    def _hand_over(self):
        """Submit two tasks per process, so that no process waits for this one."""
        pool = self._runner.pool
        while self._ready and len(self._futures) < 2 * pool.size:
            *_, task = heapq.heappop(self._ready)
            limit = self._runner.time_limit * task.time_limits
            arguments = {"function": task.function, "arguments": task.arguments}
            report = partial(self._progress.reach, task.label, task.key)
            future = pool.submit(compute, arguments, limit, report)
            self._futures[future] = task
            future.add_done_callback(self._done.put)

    def _leave_out(self):
        """Set the answers of all tasks that have not begun to None."""
        for future in self._futures:
            future.cancel()
        left_out, self._ready = self._ready, []
        for *_, task in left_out:
            self._runner.out_of_time = True
            self._settle(task, None, 0.0)

    def _end_running(self):
        """Terminate the running tasks and set their answers to None."""
        running, self._futures = self._futures, {}
        if running:
            self._runner.out_of_time = True
            longest = self._progress.longest_task()
            self._runner._longest_task = max(self._runner._longest_task, longest)
            self._runner.pool.interrupt()
        for task in running.values():
            self._settle(task, None, 0.0)

    def _collect(self):
        """Wait for one task and keep its answer, unless it was ended."""
        try:
            future = self._done.get(timeout=LOOK_AROUND if self._futures else 0.0)
        except queue.Empty:
            self._progress.say()
            return
        task = self._futures.pop(future, None)
        if task is None:
            return
        outcome, seconds = _outcome(future)
        if future.cancelled():
            self._runner.out_of_time = True
        else:
            self._store.put(task, outcome)
            self._runner._computed.add(task.key)
        self._settle(task, outcome, seconds)

    def _settle(self, task, outcome, seconds):
        """Advance the plans that waited for a task."""
        self._progress.done(task.label, task.key, seconds)
        for plan in sorted(self._waiting.pop(task.key)):
            self._results[plan][task.key] = outcome
            if len(self._results[plan]) == len(set(self._wanted[plan])):
                self._advance(plan, self._of(plan))


def _outcome(future):
    """(answer or error, seconds) of a task that has ended; (None, 0) of one that never began."""
    if future.cancelled():
        return None, 0.0
    try:
        outcome = future.result()
    except HarvesterError:
        raise
    except (Exception, CancelledError) as error:
        raise lost(error) from error
    # If the worker process died, the outcome is an error without a computing time.
    return outcome if isinstance(outcome, tuple) else (outcome, 0.0)


def _cut(request):
    """The key by which requests share realizations."""
    return request.cut_from, request.method


def _alone(task):
    """A plan that asks for a single task and returns its answer."""
    (result,) = yield Wanted([task])
    return result

"""One runner for all studies: tasks on any processes, answers kept, the same end after a kill."""

from harvester.running.opening import RunnerOptions, open_runner
from harvester.running.request import Answer, Request
from harvester.running.runner import Runner
from harvester.running.task import Task, Wanted

__all__ = ["Answer", "Request", "Runner", "RunnerOptions", "Task", "Wanted", "open_runner"]

"""Store of answers (results of tasks), in memory or in a folder's `points/` on disk."""

import os
import stat
from pathlib import Path

from harvester.base.writing import whole_file
from harvester.engines.codec import NotAnAnswer, is_lasting, packed, read
from harvester.engines.task import Task

# Marks a missing answer, since None may be an answer.
MISSING = object()


class AnswerStore:
    """Answers by the keys of their tasks.

    A file is written under a temporary name and renamed, so that it is never incomplete.

    Attributes
    ----------
    refused : dict of str to str
        Messages on invalid files, by the keys of their tasks.
    passing : int
        Number of results that are not stored, since a repeated run may not reproduce them.
    """

    def __init__(self, folder: os.PathLike | None = None):
        self._folder = Path(folder) / "points" if folder else None
        self._held: dict[str, object] = {}
        self._unbelieved: set[str] = set()
        self.refused: dict[str, str] = {}
        self.passing = 0

    @property
    def on_disk(self) -> bool:
        """Whether answers are stored on disk."""
        return self._folder is not None

    def get(self, task: Task) -> object:
        """The stored answer, or `MISSING` if there is no valid one."""
        if task.key in self._held:
            return self._held[task.key]
        if self._folder is None or task.key in self._unbelieved:
            return MISSING
        path = self._path(task)
        try:
            answer = read(path, task.key)
            _check(task, answer)
        except FileNotFoundError:
            return MISSING
        except NotAnAnswer as reason:
            self._unbelieved.add(task.key)
            self.refused[task.key] = f"{path}: {reason}: computed again"
            return MISSING
        return answer

    def put(self, task: Task, answer: object) -> None:
        """Store an answer; on disk only if a repeated run would reproduce it."""
        is_error = isinstance(answer, BaseException)
        final = not is_error or is_lasting(type(answer).__name__, str(answer))
        self.passing += not final
        if not (self.on_disk and final and self._is_free(task)):
            self._held[task.key] = answer
            return
        try:
            content = packed(task.key, answer)
        except NotAnAnswer as reason:
            self._held[task.key] = answer
            self.refused[task.key] = f"{self._path(task)}: {reason}: was not stored"
            return
        with whole_file(self._path(task)) as file:
            file.write(content)
        self._unbelieved.discard(task.key)

    def _path(self, task):
        assert self._folder is not None
        return self._folder / f"{task.key}.npz"

    def _is_free(self, task):
        """Return whether an answer may be written: only a plain file is replaced."""
        try:
            if stat.S_ISREG(os.lstat(self._path(task)).st_mode):
                return True
        except OSError:
            return True
        self.refused[task.key] = (
            f"{self._path(task)}: is not a file: remove it; the answer was not stored"
        )
        return False


def _check(task, answer):
    """Raise NotAnAnswer if the content cannot be an answer to this task."""
    if task.misfit is None or isinstance(answer, BaseException):
        return
    try:
        wrong = task.misfit(answer)
    # Data of unknown origin may raise any exception.
    except Exception as error:
        raise NotAnAnswer("does not have the form of this task's answer") from error
    if wrong:
        raise NotAnAnswer(wrong)

"""Guards standard output and error: a run continues if they are full, closed or ASCII only."""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, TextIO

OUTPUT_LOST = 2
# Replacements for a terminal without these characters. Other characters are shown as escapes.
PLAIN = {
    "±": "+-", "×": "x", "·": "*", "−": "-", "–": "-", "—": "-", "…": "...", "≥": ">=", "≤": "<=",
    "≈": "~", "⟨": "<", "⟩": ">", "→": "->", "²": "^2", "³": "^3", "Ω": "Ohm", "µ": "u",
    "β": "beta", "δ": "delta", "η": "eta", "θ": "theta", "κ": "kappa", "λ": "lambda",
    "σ": "sigma", "τ": "tau", "ω": "omega",
}  # fmt: skip


def _plain(error):
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters = error.object[error.start : error.end]
    plain = (PLAIN.get(letter, letter.encode("unicode_escape").decode()) for letter in letters)
    return "".join(plain), error.end


codecs.register_error("harvester.plain", _plain)


class GuardedStream:
    """A text stream that remembers its first failure and discards all later output.

    `stream`: None if it was closed when the process began.

    Attributes
    ----------
    failure : OSError or None
    """

    def __init__(self, stream: TextIO) -> None:
        self.failure: OSError | None = None
        self._stream = stream or _Closed()
        if hasattr(self._stream, "reconfigure"):
            self._stream.reconfigure(errors="harvester.plain")

    def __getattr__(self, name):
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, unless the stream is closed or full."""
        self.attempt(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush, unless the stream is closed or full."""
        self.attempt(self._stream.flush)

    @property
    def buffer(self) -> Any:
        """The underlying binary stream, guarded too."""
        return _GuardedBuffer(self, self._stream.buffer)

    def attempt(self, action: Callable) -> None:
        """Call a function unless the stream has failed; its error counts as the failure."""
        if self.failure is None:
            try:
                action()
            except OSError as error:
                self.failure = error
                # Discard the stream's buffer, or Python would fail on it at exit.
                with contextlib.suppress(OSError):
                    _open_nowhere(self._stream.fileno())
                    self._stream.flush()


class _GuardedBuffer:
    def __init__(self, guarded, binary):
        self._guarded, self._binary = guarded, binary

    def write(self, content):
        self._guarded.attempt(lambda: self._binary.write(content))
        return len(content)

    def flush(self):
        self._guarded.attempt(self._binary.flush)


class _Closed(io.TextIOBase):
    """Replacement of a stream that was closed when the process began."""

    encoding = "utf-8"

    def write(self, content):
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    @property
    def buffer(self):
        return self


@contextlib.contextmanager
def guarded_streams() -> Iterator[Callable]:
    """Guard standard output and error within the block.

    Yields
    ------
    callable
        Function of an exit code that returns the final one: if standard output could not be
        written, it reports this on standard error. A closed pipe (`| head`) is not a failure.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Otherwise the next opened file would become standard output.
            _open_nowhere(number)
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = output, errors = GuardedStream(sys.stdout), GuardedStream(sys.stderr)

    def exit_code(code):
        output.flush()
        if output.failure and not isinstance(output.failure, BrokenPipeError):
            reason = output.failure.strerror or output.failure
            errors.write(f"harvester: standard output: cannot be written: {reason}\n")
            code = code or OUTPUT_LOST
        errors.flush()
        return code

    try:
        yield exit_code
    finally:
        sys.stdout, sys.stderr = before


def _open_nowhere(number):
    """Redirect a file descriptor to the null device, also for child processes."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere != number:
        os.dup2(nowhere, number)
        os.close(nowhere)
    os.set_inheritable(number, True)

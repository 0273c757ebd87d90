"""Waveforms of V and I sources, with ngspice's defaults for omitted numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from circuits.netlist.expression import ExpressionError

# Waveforms, and the accepted numbers of their parameters.
KINDS = {"pulse": (7,), "sin": range(3, 7), "exp": (6,), "sffm": (5,), "pwl": range(2, 10_000)}
SAME = {"sine": "sin"}
# A time (s) that no run reaches.
FOREVER = 1e30
# Duration (s) of a rise or fall of 0; ngspice would use its printing step.
SHORTEST_RISE = 1e-9
_FORMS = {
    "pulse": "pulse(low high delay rise fall width period): if one is omitted, ngspice 39 and 46 "
    "differ",
    "sin": "sin(offset amplitude frequency delay damping phase): without a frequency ngspice uses "
    "the reciprocal of the run's duration",
    "exp": "exp(low high delay1 rise delay2 fall): if one is omitted, ngspice uses its printing "
    "step",
    "sffm": "sffm(offset amplitude carrier index signal)",
    "pwl": "pwl(time value time value …), with ascending times",
}


class Waveform(NamedTuple):
    """A time-varying source: its kind and all numbers; for "pwl" times and values."""

    kind: str
    numbers: tuple[float, ...]

    @property
    def period(self) -> float | None:
        """Period (s); None for non-periodic waveforms, or rarely repeating ones such as "sffm"."""
        if self.kind == "pulse" and self.numbers[6] < FOREVER:
            return self.numbers[6]
        if self.kind == "sin" and not self.numbers[4]:
            return 1.0 / self.numbers[2]
        return None

    @property
    def start(self) -> float:
        """The initial value."""
        first = self.numbers
        if self.kind == "pwl":
            late = [k for k in range(0, len(first), 2) if first[k] <= 0.0]
            if not late or late[-1] + 2 >= len(first):
                return first[late[-1] + 1] if late else first[1]
            t, a, then, b = first[late[-1] : late[-1] + 4]
            return a - (b - a) * t / (then - t)
        if self.kind == "sin" and first[3] >= 0.0:
            return first[0] + first[1] * math.sin(math.radians(first[5]))
        return first[0]


def waveform(kind: str, values: Sequence[float], delay: float = 0.0) -> Waveform:
    """A waveform of these numbers; `delay` shifts a "pwl".

    Raises
    ------
    ExpressionError
        Its value would depend on ngspice's release or printing step.
    """
    kind = SAME.get(kind, kind)
    if kind == "am":
        raise ExpressionError("am differs between ngspice 39 and 46: write a B source")
    fits = len(values) in KINDS[kind] and (kind != "pwl" or len(values) % 2 == 0)
    if not fits:
        raise ExpressionError(f"{kind} with {len(values)} numbers: write {_FORMS[kind]}")
    numbers = [*map(float, values)]
    check = {"pulse": _pulse, "sin": _sine, "exp": _exponential, "pwl": _lines}.get(kind)
    if check and not check(numbers, delay):
        raise ExpressionError(
            f"{kind}({' '.join(f'{value:g}' for value in values[:8])}): the effect of a time "
            f"≤ 0 or out of order depends on ngspice's release: write {_FORMS[kind]}"
        )
    return Waveform(kind, tuple(numbers))


def _pulse(n, _):
    for k in (3, 4):
        n[k] = n[k] or SHORTEST_RISE
    return min(n[3:7]) > 0.0 and n[3] + n[4] + n[5] <= n[6] * (1.0 + 1e-9)


def _sine(n, _):
    n += [0.0] * (6 - len(n))
    if n[2] < 0.0:
        n[1], n[2], n[5] = -n[1], -n[2], -n[5]
    return n[2] > 0.0


def _exponential(n, _):
    return n[3] > 0.0 and n[5] > 0.0 and n[4] >= n[2]


def _lines(n, delay):
    n[::2] = [time + delay for time in n[::2]]
    return all(late >= early for early, late in zip(n[::2], n[2::2], strict=False))

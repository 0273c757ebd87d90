"""Rounds of a study: every point is run for longer until its error bar is small enough."""

import math
import time

from harvester.averaging import CLOSURES
from harvester.errors import SimulationError
from harvester.estimates.batch_means import standard_error
from harvester.estimates.control_variate import significant_correlation
from harvester.scene.units import scale
from harvester.studies.evaluation import evaluate, power_series
from harvester.studies.pieces import compute, failed
from harvester.studies.runs import CONTROL_REALIZATIONS, control_of, long_control, make_source

# Realizations of a point's first round.
FIRST = 8
# Most realizations of a point: four batches in each, and no more rounds beyond.
MOST = 80
# A round asks for what the error bar needs and a little more, at most this much longer.
MARGIN, GROWTH = 1.1, 2.0


class Runner:
    """Gets pieces: from the store, else computed and stored at once."""

    def __init__(self, pool, store, deadline, time_limit):
        self._pool, self._store = pool, store
        self._deadline, self._time_limit = deadline, time_limit
        self.computed, self._seen = 0, set()

    @property
    def reused(self):
        """Pieces that were there already."""
        return len(self._seen) - self.computed

    def out_of_time(self):
        """Whether nothing more is to be begun."""
        return time.monotonic() > self._deadline

    def passing(self):
        """Pieces of this run that ended by a limit or by the machine, and are not kept."""
        return sum(not self._store.get(key).final for key in self._seen)

    def _get(self, source, start):
        return self._store.get(source.key(start), lambda piece: source.misfit(start, piece))

    def pieces(self, source, count):
        """Those of the first realizations that are there without a gap, at most so many."""
        found = []
        for start in range(0, count, source.size):
            piece = self._get(source, start)
            if piece is None:
                break
            found.append(piece)
            if piece.failure:
                break
        return found

    def get(self, wanted, on_piece):
        """Compute what of the (source, start) wanted is not there; True when nothing is missing."""
        keys = {source.key(start): (source, start) for source, start in wanted}
        self._seen |= {*keys}
        missing = [key for key, wanted in keys.items() if self._get(*wanted) is None]
        calls = [keys[key][0].call(keys[key][1]) for key in missing]

        def keep(index, outcome):
            if isinstance(outcome, SimulationError):
                outcome = failed(outcome)
            self._store.put(missing[index], outcome)
            self.computed += 1
            on_piece()

        if calls and not self.out_of_time():
            limit = self._time_limit * max(len(call["indices"]) for call in calls)
            self._pool.map(
                compute,
                calls,
                limit,
                keep_going=True,
                on_result=keep,
                stop=self.out_of_time,
            )
        done = all(self._store.get(key) is not None for key in missing)
        self._seen &= {key for key in self._seen if self._store.get(key) is not None}
        return done


class Rounds:
    """Runs every point for longer until its error bar is small enough.

    What a round holds follows from the results of the ones before alone, so that a study that was
    interrupted comes to the same end.
    """

    def __init__(self, grid, method, step, version, precision, runner):
        self._grid, self._precision, self._runner = grid, precision, runner
        self._sources = [make_source(p.scene, method, step, version) for p in grid.points]
        self._controls = [None] * len(grid.points)
        if precision and method == "circuit":
            self._controls = [control_of(p.scene) for p in grid.points]
        first = FIRST if precision else grid.scene.run.realizations
        self._targets = [_whole(first, source.size) for source in self._sources]
        if method in CLOSURES:
            self._targets = [1] * len(grid.points)
        self.evaluations = []

    def run(self, progress):
        """Rounds to the end, or to that of the time; (evaluations, whether out of time)."""
        while True:
            wanted = self._wanted()
            state = {"done": 0}
            left = len(wanted)

            def on_piece(state=state, left=left):
                state["done"] += 1
                progress(*self._progress(state["done"] / left))

            complete = self._runner.get(wanted, on_piece)
            complete = self._runner.get(self._wanted_means(), lambda: None) and complete
            self.evaluations = [self._evaluate(k) for k in range(len(self._sources))]
            progress(*self._progress(0.0))
            if not complete:
                return self.evaluations, True
            if not self._lengthen():
                return self.evaluations, False

    def _wanted(self):
        """Pieces of this round, the first realizations of all points before the next ones."""
        wanted = {}
        for source, control, target in zip(
            self._sources, self._controls, self._targets, strict=True
        ):
            for each in (source, control):
                for start in range(0, target, each.size) if each else ():
                    wanted[each.key(start)] = (each, start)
        return sorted(wanted.values(), key=lambda item: item[1])

    def _wanted_means(self):
        """Long runs of the controls that go along with any of their points."""
        wanted = {}
        for k, control in enumerate(self._controls):
            if control and self._correlates(k):
                long = long_control(control)
                for start in range(0, CONTROL_REALIZATIONS, long.size):
                    wanted[long.key(start)] = (long, start)
        return list(wanted.values())

    def _correlates(self, k):
        point = self._series(self._sources[k], self._targets[k])
        control = self._series(self._controls[k], self._targets[k])
        if point is None or control is None:
            return False
        return significant_correlation(point, control[: len(point)]) is not None

    def _series(self, source, target):
        """Output power of what there is, in the scene's units, or None."""
        moments = [m for piece in self._runner.pieces(source, target) for m in piece.moments]
        return power_series(moments, scale(source.scene)[1].power) if moments else None

    def _evaluate(self, k):
        pieces = self._runner.pieces(self._sources[k], self._targets[k])
        control = None
        if self._controls[k] and self._correlates(k):
            long = self._series(long_control(self._controls[k]), CONTROL_REALIZATIONS)
            series = self._series(self._controls[k], self._targets[k])
            if long is not None:
                error = standard_error(long)
                if error is not None:
                    control = series, float(long.mean()), error
        return evaluate(self._grid.points[k].scene, pieces, control)

    def _lengthen(self):
        """Set the next round's targets; False when no point needs or may have more."""
        more = False
        for k, evaluation in enumerate(self.evaluations):
            reached = evaluation.relative_error
            had = self._targets[k]
            if self._settled(k):
                continue
            needed = had * min(MARGIN * (reached / self._precision) ** 2, GROWTH)
            size = self._sources[k].size
            self._targets[k] = min(max(_whole(math.ceil(needed), size), had + size), MOST)
            more = True
        return more

    def _settled(self, k):
        """Whether a point is done: precise enough, as long as can be, or failed."""
        if not self._precision or self._targets[k] >= MOST:
            return True
        evaluation = self.evaluations[k]
        failed = evaluation.realizations < self._targets[k]
        return failed or evaluation.relative_error <= self._precision

    def _progress(self, share):
        """(share done, points done) with so much of this round done."""
        count = len(self._sources)
        if not self._precision or not self.evaluations:
            return share / (3.0 if self._precision else 1.0), "first round"
        done = sum(self._settled(k) for k in range(count))
        needed = [
            min(self._targets[k] * max((e.relative_error / self._precision) ** 2, 1.0), MOST)
            for k, e in enumerate(self.evaluations)
        ]
        have = [e.realizations for e in self.evaluations]
        coming = [target - had for target, had in zip(self._targets, have, strict=True)]
        reached = sum(had + share * new for had, new in zip(have, coming, strict=True))
        return min(reached / max(sum(needed), 1.0), 1.0), f"{done} of {count} points"


def _whole(count, size):
    """The smallest multiple of a size that holds a count."""
    return -(-count // size) * size

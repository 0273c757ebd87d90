"""`make drawn SEED=1`: random cases of every command against truths that are independent of it.

A truth is a closed form, an integration of its own (`drawn_truth`), or, behind a netlist, the same
scene at the finest step and for longer. A case is right if every number lies within two of its
printed error bars, with the truth's own error, or within 0.5 % where none is printed. It also
passes if the program refuses it, or withholds a number or its bar, with a reason. Of numbers under
noise 4.6 % lie beyond two errors by chance.
"""

import argparse
import json
import math
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from maintenance import drawn_truth as truth
from maintenance.drawn_scenes import (
    COMMANDS,
    LINEAR,
    NOISES,
    RECORDS,
    SINES,
    Case,
    drawn,
)

import harvester
from harvester.base.worker_pool import WorkerPool
from harvester.device import timescales
from harvester.scene.prepared import prepared

RIGHT, WRONG, REFUSED, WITHHELD = "right", "WRONG", "refused", "withheld"
SLOW, BROKEN = "SLOW", "BROKEN"
PASSES = (RIGHT, REFUSED, WITHHELD)
# Errors within which a number is right, and the share of it where no bar is printed.
ERRORS, SHARE = 2.0, 0.005
# A specification keeps a device's power within this share.
PROFILE_SHARE = 0.05
# Wall-clock of one case on an idle machine (s).
LONGEST = 180.0
# Truths under noise are of so many times the run's own length.
LONGER, LONGER_IN_CONTACT = 8.0, 3.0
# Averaging has no chance of its own: its truths are longer by this, so that they are as sharp.
LONGER_THAN_AVERAGES = 4.0
SWEPT = (0.5, 1.0, 2.0)
# Starts beside the given one behind netlists, as shares of it; see `truth.BESIDE`.
BESIDE_NETLISTS = (1e-5, -1e-5, 1e-4, -1e-4, 3e-4, -3e-4, 1e-3, -1e-3)
# Voltages of starts on an orbit, over its rms.
STARTING_VOLTAGES = np.linspace(-2.0, 2.0, 9)
# Points of a motion without a period from which a sweep goes on, and most states that it follows.
WITHOUT_PERIOD, MOST_STATES = 8, 24


class Check(NamedTuple):
    """A printed number and what is true.

    Attributes
    ----------
    what : str
    value : float
    bar : float or None
        Its printed standard error.
    truths : list of (float, float)
        Any of which is right, with its own error: of several motions one is reached.
    reason : str
        Why no bar, or no number, is printed.
    share : float
        Deviation that passes without a bar.
    """

    what: str
    value: float
    bar: float | None
    truths: list
    reason: str = ""
    share: float = SHARE

    @property
    def distance(self):
        """Deviation over what is allowed, from the nearest truth."""
        return min(self._over(*each) for each in self.truths)

    @property
    def nearest(self):
        return min(self.truths, key=lambda each: self._over(*each))

    def _over(self, value, error):
        allowed = ERRORS * math.hypot(self.bar or 0.0, error)
        if self.bar is None:
            allowed += self.share * abs(value)
        off = abs(self.value - value)
        return off / allowed if allowed > 0.0 else (math.inf if off else 0.0)

    @property
    def verdict(self):
        if not math.isfinite(self.value):
            return WITHHELD if self.reason else WRONG
        if self.bar is None and self.reason:
            return WITHHELD
        return RIGHT if self.distance <= 1.0 else WRONG

    def __str__(self):
        bar = "" if self.bar is None else f" ± {self.bar:.2g}"
        right, error = self.nearest
        own = f" ± {error:.1g}" if error else ""
        off = f" ({100.0 * (self.value / right - 1.0):+.2g} %)" if right else ""
        why = f"; {self.reason}" if self.reason else ""
        return f"{self.what} {self.value:.6g}{bar}, truth {right:.6g}{own}{off}{why}"


class Outcome(NamedTuple):
    """What became of one case."""

    case: Case
    verdict: str
    words: str
    seconds: float


# --- truths ------------------------------------------------------------------------------------


def powers(case, scene, tables=None, start=None, pool=None, generator=None):
    """Mean powers of a scene that are right, each with its error."""
    motion = truth.motion_of(tables or case.tables["excitation"])
    if not scene.load.is_resistor:
        return _finest(case, scene, pool)
    device, own, run = truth.device_of(scene), case.frequency, scene.run
    if motion.record is not None:
        first = start or _rest(scene)
        return [(truth.on_record(device, motion, first, own, run.settle, run.duration), 0.0)]
    if device.linear:
        return [truth.linear_power(device, motion)]
    first = start or _rest(scene)
    if not motion.densities:
        return _beside(case, device, motion.sines, first)
    longer = LONGER_IN_CONTACT if len(device.contacts) else LONGER
    if case.command == "average":
        longer *= LONGER_THAN_AVERAGES
    duration = longer * run.duration * run.realizations / truth.PATHS
    settle = max(run.settle, 20.0 / own)
    draws = generator or np.random.default_rng([case.seed, case.number, 1])
    found, *_ = truth.under_noise(
        device, motion, _wells(scene), own, _highest(scene), settle, duration, draws
    )
    return [found]


def _highest(scene):
    """Highest frequency of a spectrum that moves the device (Hz)."""
    points = getattr(scene.excitation, "breakpoints", None)
    return 0.0 if points is None else float(np.max(np.array(points)[:, 0]))


def _rest(scene):
    """Displacement, velocity and transducer's state at the beginning."""
    if scene.start:
        return (scene.start.displacement or 0.0, scene.start.velocity or 0.0, 0.0)
    return _wells(scene)[-1]


def _wells(scene):
    """The states at rest, in which realizations begin in turn."""
    ready = prepared(scene)
    wells = sorted(timescales.wells(ready.system))
    return [(each * ready.scales.displacement, 0.0, 0.0) for each in wells]


def _beside(case, device, sines, start, settle=10.0):
    """Powers of the motions that a start and its closest neighbours reach."""
    periods = math.ceil(settle * case.quality)
    return [
        truth.periodic(device, sines, (x, *start[1:]), case.frequency, periods)[0]
        for x in _displacements(case, start[0], truth.BESIDE)
    ]


def _displacements(case, start, shifts):
    """Displacements beside a start, by shares of it."""
    size = max(abs(start), 1e-3 * case.level / (2.0 * math.pi * case.frequency) ** 2)
    return [start + shift * size for shift in shifts]


def _finest(case, scene, pool):
    """Powers by the finest step: of the same time where a store charges, else of a longer one.

    The noise is of another seed, so that both errors are independent. Under sines a device that is
    not linear also begins beside its start: a transient without a period may end on any motion.
    """
    found = [_by_longer_run(case, scene, pool, "finest")]
    if case.excitation in SINES and case.device not in LINEAR:
        for x in _displacements(case, _rest(scene)[0], BESIDE_NETLISTS):
            beside = scene.replace({"start.displacement": x})
            found.append(_by_longer_run(case, beside, pool, "fine"))
    return found


def _by_longer_run(case, scene, pool, step):
    tables = scene.to_tables()
    run = dict(tables["run"])
    if case.excitation in SINES and case.load != "store":
        run["settle"] = 4.0 * run.get("settle", 0.0)
    elif case.excitation in NOISES:
        run |= {"seed": run["seed"] + 7919, "realizations": 2 * run["realizations"]}
    longer = harvester.Scene.from_tables({**tables, "run": run}, name="longer")
    # Under noise chance outweighs what the finest step would add at several times the cost.
    step = "fine" if case.excitation in NOISES else step
    found = harvester.simulate(longer, method="monte-carlo", step=step, runner=pool)
    power = found["mean_output_power"]
    # The error under a record is that of other records of its kind.
    error = 0.0 if case.excitation in RECORDS else power.standard_error
    return power.estimate, error or 0.0


def _steady(case, scene, pool):
    """Power at the terminals of a linear device's only motion, once its store is charged."""
    tables = scene.to_tables()
    parameters = case.tables["load"].get("parameters", {})
    charging = 8.0 * parameters.get("resistance", 0.0) * parameters.get("storage", 0.0)
    settle = max(10.0 * case.quality / case.frequency, charging)
    run = {**tables["run"], "settle": settle, "duration": 64.0 / case.frequency}
    longer = harvester.Scene.from_tables({**tables, "run": run}, name="longer")
    found = harvester.simulate(longer, method="monte-carlo", step="finest", runner=pool)
    return found["mean_power"].estimate, 0.0


# --- commands ----------------------------------------------------------------------------------


def _check(what, estimate, truths):
    return Check(what, estimate.estimate, estimate.standard_error, truths, estimate.note)


def _simulated(case, scene, pool, method):
    result = harvester.simulate(scene, method=method, runner=pool)
    name = "mean_power" if scene.load.is_resistor else "mean_output_power"
    return [_check(name, result[name], powers(case, scene, pool=pool))]


def _average(case, scene, pool):
    linear = case.device in LINEAR
    method = "spectral" if linear else "fokker_planck"
    result = harvester.average(scene, method=method, tolerance=1e-6 if linear else 0.03)
    return [_check("mean_power", result["mean_power"], powers(case, scene))]


def _sweep(case, scene, pool):
    key, value = "load.resistance", case.tables["load"].get("resistance")
    if value is None:
        key, value = (
            "load.parameters.resistance",
            case.tables["load"]["parameters"]["resistance"],
        )
    values = [share * value for share in SWEPT]
    name = "mean_power" if scene.load.is_resistor else "mean_output_power"
    method = ("monte-carlo", "circuit")[int(case.draws.integers(2))]
    found = harvester.sweep(
        scene, {key: values}, methods=[method], quantities=[name], executor=pool
    )
    checks = []
    for place, cell in found.places():
        what = f"{method} at {place[0]:.4g}:"
        if name not in cell.estimates:
            checks.append(Check(what, math.nan, None, [(math.nan, 0.0)], cell.outcome))
            continue
        there = scene.replace({key: place[0]})
        checks.append(_check(what, cell.estimates[name], powers(case, there, pool=pool)))
    return checks


def _basins(case, scene, pool):
    found = harvester.basins(scene, points=6, executor=pool)
    checks = []
    for number, orbit in enumerate(found.orbits):
        what = f"orbit {orbit.name} ({orbit.kind})"
        if not math.isfinite(orbit.mean_power) or orbit.kind == "not settled":
            checks.append(Check(what, orbit.mean_power, None, [(1.0, 0.0)], orbit.kind))
            continue
        rows, columns = np.nonzero(found.orbit == number)
        truths = []
        for row, column in list(zip(rows, columns, strict=True))[:3]:
            start = (float(found.displacements[column]), float(found.velocities[row]), 0.0)
            if scene.load.is_resistor:
                truths += powers(case, scene, start=start)
            else:
                truths.append(_steady(case, scene, pool))
                break
        off = min(abs(power - orbit.mean_power) for power, _ in truths)
        if off > SHARE * orbit.mean_power and scene.load.is_resistor:
            # The starts may end on another motion: the orbit is right if one begun on it stays, at
            # one of the voltages that it has.
            x, v = map(float, orbit.points[0])
            for volts in orbit.rms_voltage * STARTING_VOLTAGES:
                truths += powers(case, scene, start=(x, v, float(volts)))
        checks.append(Check(what, orbit.mean_power, _bar(orbit.errors["mean_power"]), truths))
    return checks


def _bar(error):
    """The printed error, where there is one."""
    return float(error) if math.isfinite(error) else None


def _attractors(case, scene, sine, states, pool, averaged=240):
    """Powers of the motions that states of the value before and the scene's start lead to."""
    if not scene.load.is_resistor:
        return [_steady(case, scene, pool)], states
    device, motion = truth.device_of(scene), truth.motion_of(sine)
    if device.linear:
        return [truth.linear_power(device, motion)], states
    settle = math.ceil(5.0 * case.quality)
    found = [
        truth.periodic(device, motion.sines, each, case.frequency, settle, averaged)
        for each in states
    ]
    ends = [state for _, state in found]
    for (power, error), state in found:
        if error > SHARE * power:
            # A sweep leaves a motion without a period at any of its points.
            for periods in range(1, WITHOUT_PERIOD):
                state = truth.periodic(device, motion.sines, state, case.frequency, 0, periods)[1]
                ends.append(state)
    return [power for power, _ in found], ends[:MOST_STATES]


def _starts(case, scene):
    rest = _rest(scene)
    size = max(abs(rest[0]), case.level / (2.0 * math.pi * case.frequency) ** 2)
    speed = size * 2.0 * math.pi * case.frequency
    return [rest, (2.0 * size, 0.0, 0.0), (-size, speed, 0.0), (0.1 * size, -2.0 * speed, 0.0)]


def _bifurcation(case, scene, pool):
    sine = case.tables["excitation"]
    values = np.linspace(0.3, 1.5, 7) * sine["amplitude"]
    found = harvester.bifurcation(
        scene, over={"excitation.amplitude": values.tolist()}, executor=pool
    )
    truths = [[] for _ in values]
    for order in (range(values.size), reversed(range(values.size))):
        states = _starts(case, scene)
        for k in order:
            amplitude = float(values[k])
            there = scene.replace({"excitation.amplitude": amplitude})
            here, states = _attractors(case, there, {**sine, "amplitude": amplitude}, states, pool)
            truths[k] += here
        if case.device in LINEAR:
            break
    checks = []
    for branch in found.branches:
        for k, value in enumerate(values):
            power, bar = float(branch.mean_power[k]), _bar(branch.errors["mean_power"][k])
            what = f"{branch.direction} at {value:.4g} ({branch.motion[k]}):"
            why, right = "" if math.isfinite(power) else branch.motion[k], truths[k]
            if not branch.period[k] and math.isfinite(power) and scene.load.is_resistor:
                # Long means from the section of what does not repeat, wherever it leads.
                section = zip(branch.displacement[k, :3], branch.velocity[k, :3], strict=True)
                states = [(float(x), float(v), 0.0) for x, v in section]
                there = scene.replace({"excitation.amplitude": float(value)})
                changed = {**sine, "amplitude": float(value)}
                right = _attractors(case, there, changed, states, pool, truth.AVERAGED)[0]
            checks.append(Check(what, power, bar, right, why))
    return checks


def _frequency_response(case, scene, pool):
    sine = case.tables["excitation"]
    frequencies = np.linspace(0.85, 1.15, 5) * sine["frequency"]
    found = harvester.frequency_response(scene, frequencies.tolist(), executor=pool)
    (up,) = found.sweeps
    checks, states = [], _starts(case, scene)
    for k, f in enumerate(frequencies):
        changed = {**sine, "frequency": float(f), "phase": 0.0}
        there = scene.replace({"excitation.frequency": float(f)})
        truths, states = _attractors(case, there, changed, states, pool)
        power = float(found.values("mean_power", up)[k])
        residual = float(up.residual[k])
        why = f"residual {residual:.1e}" if not residual <= 0.01 else ""
        bar = float(up.step_error[k]) * power
        checks.append(Check(f"at {f:.4g} Hz:", power, bar, truths, why))
        if why:
            checks[-1] = checks[-1]._replace(value=math.nan)
    return checks


def _optimum(case, scene, pool):
    from scipy.optimize import minimize_scalar

    resistance = case.tables["load"]["resistance"]
    device, motion = truth.device_of(scene), truth.motion_of(case.tables["excitation"])

    def power(log):
        return truth.linear_power(device._replace(resistance=math.exp(log)), motion)[0]

    grid = np.log(resistance) + np.linspace(-9.0, 9.0, 73)
    best = grid[int(np.argmax([power(each) for each in grid]))]
    step = grid[1] - grid[0]
    place = minimize_scalar(
        lambda log: -power(log), bounds=(best - step, best + step), method="bounded"
    ).x
    low, high = math.exp(place) / 4.0, math.exp(place) * 4.0
    found = harvester.optimum(
        scene, {"load.resistance": (low, high)}, executor=pool,
        method="monte-carlo",
    )  # fmt: skip
    at = found.parameters[0].place
    there = truth.linear_power(device._replace(resistance=at), motion)
    return [
        _check("value", found.value, [there]),
        _check("place", found.place, [(math.exp(place), 0.0)]),
    ]


def _load_study(case, scene, pool):
    load = case.tables["load"]
    key = "load.resistance" if "resistance" in load else "load.parameters.resistance"
    value = load.get("resistance") or load["parameters"]["resistance"]
    values = [share * value for share in SWEPT]
    found = harvester.load_study(scene, over={key: values}, method="monte-carlo", executor=pool)
    checks = []
    for value, each in zip(values, found.evaluations, strict=True):
        what = f"at {value:.4g}:"
        estimate = each.estimates.get("output_power")
        if estimate is None:
            checks.append(Check(what, math.nan, None, [(math.nan, 0.0)], each.outcome))
            continue
        there = scene.replace({key: value})
        checks.append(_check(what, estimate, powers(case, there, pool=pool)))
    return checks


def _residence(case, scene, pool):
    found = harvester.residence(scene, executor=pool)
    device, motion = truth.device_of(scene), truth.motion_of(case.tables["excitation"])
    starts = _wells(scene)
    duration = LONGER * scene.run.duration * scene.run.realizations / truth.PATHS
    _, times, exits = truth.under_noise(
        device, motion, starts, case.frequency, _highest(scene), scene.run.settle, duration,
        np.random.default_rng([case.seed, case.number, 1]), truth.wells_of(device),
    )  # fmt: skip
    if len(found.stays) == 1:
        times, exits = (each.sum(axis=1, keepdims=True) for each in (times, exits))
    checks = []
    for number, stay in enumerate(found.stays):
        spent, left = times[:, number], exits[:, number]
        reason = "" if stay.standard_error else f"{stay.stays} stays"
        if not left.sum():
            checks.append(Check("no stay ended", stay.time, None, [(math.inf, 0.0)], reason))
            continue
        right = spent.sum() / left.sum()
        error = math.sqrt(float(((spent - right * left) ** 2).sum())) / left.sum()
        what = f"well at {stay.well:.3g}:"
        checks.append(Check(what, stay.time, stay.standard_error, [(right, error)], reason))
    return checks


def _spectrum(case, scene, pool):
    duration = 3000.0 / case.frequency
    found = harvester.spectrum(scene, duration=duration)
    motion = truth.motion_of(case.tables["excitation"])
    # Noise with a memory has power beyond any knots.
    highest = (4.0 if case.excitation == "noise" else 100.0) * case.frequency
    grid = np.linspace(0.0, highest, 400_001)
    density = motion.densities[0](grid)
    below = found.frequencies < highest
    rms = math.sqrt(found.density[below].sum() * found.frequencies[0])
    square = np.trapezoid(density, grid)
    # Of Gaussian noise: ∫ G² df over the time is the variance of the mean square.
    chance = 0.5 * math.sqrt(np.trapezoid(density**2, grid) / duration) / square
    device = truth.device_of(scene)
    own, _ = truth.linear_power(device, motion)
    written = np.array(found.profile)
    told, _ = truth.linear_power(device, truth.specified(written))
    # The band of the device holds as many independent values as π/2 of its width times the time.
    scatter = math.sqrt(case.quality / (0.5 * math.pi * case.frequency * duration)) * own
    return [
        Check("rms", rms, None, [(math.sqrt(square), chance * math.sqrt(square))]),
        Check("power of the profile", told, None, [(own, scatter)], share=PROFILE_SHARE),
    ]


ASKED = {
    "simulate monte-carlo": lambda *each: _simulated(*each, "monte-carlo"),
    "simulate circuit": lambda *each: _simulated(*each, "circuit"),
    "average": _average,
    "sweep": _sweep,
    "basins": _basins,
    "bifurcation": _bifurcation,
    "frequency-response": _frequency_response,
    "optimum": _optimum,
    "load-study": _load_study,
    "residence": _residence,
    "spectrum": _spectrum,
}
assert tuple(ASKED) == COMMANDS


# --- running -----------------------------------------------------------------------------------


class TooSlow(Exception):
    """A case took longer than its limit."""


def judged(checks):
    """Verdict and words of a case: those of its worst check."""
    order = (WRONG, WITHHELD, RIGHT)
    worst = min(checks, key=lambda each: (order.index(each.verdict), -each.distance))
    count = sum(each.verdict == WRONG for each in checks)
    several = f"{count} of {len(checks)}: " if count and len(checks) > 1 else ""
    return worst.verdict, f"{several}{worst}"


def tried(case, pool, longest=LONGEST):
    """One case's outcome."""

    def ended(*_):
        raise TooSlow

    clock = time.monotonic()
    before = signal.signal(signal.SIGALRM, ended)
    signal.setitimer(signal.ITIMER_REAL, longest)
    try:
        verdict, words = judged(ASKED[case.command](case, case.scene(), pool))
    except harvester.HarvesterError as error:
        verdict, words = REFUSED, f"{type(error).__name__}: {error}".splitlines()[0]
    except TooSlow:
        verdict, words = SLOW, f"more than {longest:g} s"
    except Exception as error:
        verdict, words = BROKEN, f"{type(error).__name__}: {error}".splitlines()[0]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    return Outcome(case, verdict, words, time.monotonic() - clock)


def chosen(seed, count, only, folder):
    """The cases of a seed: the first `count`, or those of numbers or words among them."""
    words = only.split(",") if only else []
    numbers = [int(each) for each in words if each.isdigit()]
    if numbers:
        return [drawn(seed, number, folder) for number in numbers]
    cases = (drawn(seed, number, folder) for number in range(count))
    return [case for case in cases if all(word.strip() in case.words for word in words)]


def main(words=None):
    """Try the cases of a seed; 1 if any fails."""
    parser = argparse.ArgumentParser(prog="make drawn")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=44)
    parser.add_argument("--only", default="", help="numbers, or words of cases, between commas")
    parser.add_argument("--longest", type=float, default=LONGEST, help="s; more on a busy machine")
    asked = parser.parse_args(words)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    outcomes = []
    with tempfile.TemporaryDirectory(prefix="drawn-") as name, WorkerPool(workers=1) as pool:
        cases = chosen(asked.seed, asked.count, asked.only, Path(name))
        for case in cases:
            if len(cases) == 1:
                print(json.dumps(case.tables))
            found = tried(case, pool, asked.longest)
            outcomes.append(found)
            print(
                f"{asked.seed} {case.number:3} {found.verdict:8} {found.seconds:5.1f} s  "
                f"{case.words}: {found.words}",
                flush=True,
            )
    verdicts = Counter(each.verdict for each in outcomes)
    print(", ".join(f"{count} {verdict}" for verdict, count in verdicts.most_common()))
    wrong = [str(each.case.number) for each in outcomes if each.verdict not in PASSES]
    if wrong:
        print(f"make drawn SEED={asked.seed} ONLY={','.join(wrong)} repeats what fails")
    return 1 if wrong or not outcomes else 0


if __name__ == "__main__":
    sys.exit(main())

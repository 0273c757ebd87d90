"""`make bench BASE=<commit>`: where a person waits, by task, now and at a commit.

Both versions run each task by turns, with an empty and with a filled cache of compiled code. In
every process a thread samples the main thread's stack every 10 ms. While compiled code runs, no
sample is taken; that time counts for the Python frame that called this code.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from maintenance import identified
from maintenance.compare import ONE_THREAD, ROOT, _unpacked

from harvester.scene.text import scene_text

SAMPLES, RECORDS = 30_000, 3
GAP = "stoppers.gap=normal:2%"
SINE = 'excitation={kind="sine", amplitude=6.0, frequency=8.0}'
RESISTANCE = "load.resistance=1e4:1e7"
OPTIMUM = ("optimum", "device", "--maximise", "mean_power", "--over", RESISTANCE)
# Name → the command's words.
TASKS = {
    "help": ("--help",),
    "average": ("average", "device"),
    "monte-carlo": ("simulate", "paper", "--method", "monte-carlo"),
    "circuit": ("simulate", "paper", "--method", "circuit"),
    "bridge": ("simulate", "device", "--set", "load.netlist=bridge", "--method", "monte-carlo"),
    "validate": ("validate", "paper", "--output", "validated"),
    "load study": ("load-study", "device", "--load", "bridge", "--method", "monte-carlo", "--sweep",
                   "load.parameters.resistance=1e4:1e7:log:36", "--precision", "0.01"),
    "optimum of 1": OPTIMUM,
    "optimum of 2": (*OPTIMUM, "--over", "oscillator.linear_stiffness=-100:-20"),
    "sensitivity": ("sensitivity", "paper", "--rows", "16", "--vary", GAP, "--vary",
                    "oscillator.cubic_stiffness=±10%"),
    "basins": ("basins", "device", "--points", "40", "--set", SINE),
    "identify": ("identify", "piezo.toml", "--alone", *(
        word for number in range(RECORDS) for word in ("--record", f"record-{number}.csv"))),
    "report": ("simulate", "paper", "--method", "monte-carlo", "--report", "page.html"),
}  # fmt: skip
# Part of the time → texts, one of which is in the "file:function" of its frames. The innermost
# frame with such a text decides.
PARTS = {
    "import": ("<frozen importlib", "<frozen runpy"),
    "compile": ("/numba/", "/llvmlite/"),
    "draw": ("/matplotlib/", "results/drawing", "results/panels", "results/figures", "schemdraw"),
    "write": ("results/files", "results/page", "results/view", "base/writing", "engines/folder",
              "engines/codec", "engines/store", "/json/", "cli/shown", "cli/output"),
    "estimate": ("harvester/statistics/", "engines/outcome"),
    "integrate": ("/averaging/", "monte_carlo/", "kernel/engine.py:integrate", "ngspice/session",
                  "excitation/", "identification/", "/scipy/"),
    "prepare": ("harvester/scene/", "harvester/device/", "circuits/"),
    "wait": ("threading.py", "subprocess.py", "worker_main.py", "selectors.py", "worker_pool.py",
             "runner.py:_collect"),
}  # fmt: skip
# Samples of the main thread, also in workers: lines of end, length, CPU seconds and part.
SAMPLER = """
import sys, threading, time, _thread
def sample(log, parts, main, last):
    clock, used = time.pthread_getcpuclockid(main), 0.0
    while True:
        time.sleep(0.01)
        frame, part = sys._current_frames().get(main), "other"
        while frame is not None and part == "other":
            where = f"{frame.f_code.co_filename}:{frame.f_code.co_name}"
            part = next((p for p, texts in parts.items() if any(t in where for t in texts)), part)
            frame = frame.f_back
        now, cpu = time.monotonic(), time.clock_gettime(clock)
        log.write(f"{now} {now - last} {cpu - used} {part}\\n")
        last, used = now, cpu
def pass_on(event, arguments):
    if event == "subprocess.Popen" and "-P" in arguments[1][:3]:
        arguments[1][4] = START + arguments[1][4]
def begin(folder, parts, last):
    log = open(f"{folder}/{time.monotonic_ns()}", "w", buffering=1)
    main = _thread.get_ident()
    threading.Thread(target=sample, args=(log, parts, main, last), daemon=True).start()
"""
COMMAND = """
sys.addaudithook(pass_on)
sys.argv[0] = "harvester"
from harvester.__main__ import main
sys.exit(main())
"""


def measure(
    words: tuple[str, ...], checkout: Path, folder: Path, cache: Path
) -> dict[str, dict[str, float]]:
    """Run one command; wall and CPU time in seconds, in all and by part."""
    samples = Path(tempfile.mkdtemp(dir=folder))
    begin = f"{SAMPLER}\nbegin({str(samples)!r}, {PARTS!r}, time.monotonic())\n"
    script = f"START = {begin!r}\nexec(START)\n{COMMAND}"
    own = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(cache)}
    # A run in the folder of an earlier one would take its answers.
    shutil.rmtree(folder / "validated", ignore_errors=True)
    start = time.monotonic()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", script, *words], env=own, cwd=folder, **quiet
    )
    message = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.monotonic() - start
    if status:
        raise SystemExit(f"{checkout}: harvester {' '.join(words)}: {message.decode()[-2000:]}")
    logs = [[line.split() for line in log.open()] for log in sorted(samples.iterdir())]
    cpu = _sums((part, float(used)) for log in logs for _, _, used, part in log)
    total = usage.ru_utime + usage.ru_stime
    return {"wall": {"total": wall, **_of_wall(logs, wall)}, "CPU": {"total": total, **cpu}}


def _sums(pairs):
    sums = defaultdict(float)
    for part, seconds in pairs:
        sums[part] += seconds
    return sums


def _of_wall(logs, wall):
    """Seconds of the wall time by part, from the command's samples and those of its workers."""
    command, *workers = [
        [(float(end), float(length), part) for end, length, _, part in log] for log in logs
    ]
    parts = _sums((part, length) for _, length, part in command)
    waits = np.array([(end - length, end) for end, length, part in command if part == "wait"])
    # While the command waits, its time is divided among the parts as the workers' time is.
    meanwhile = _sums(
        (part, np.diff(np.clip(waits, end - length, end)).sum())
        for worker in workers
        for end, length, part in worker
        if part != "wait" and waits.size
    )
    if sum(meanwhile.values()):
        busy = parts.pop("wait") / sum(meanwhile.values())
        for part, seconds in meanwhile.items():
            parts[part] += busy * seconds
    # The time before the first sample is the start of Python.
    parts["import"] += max(wall - sum(parts.values()), 0.0)
    return parts


def write_records(folder: Path) -> None:
    """Three records of a piezo device, and the scene that they are identified from."""
    (folder / "piezo.toml").write_text(
        scene_text(identified._device("piezo", identified.OFF), {}, [])
    )
    for number in range(RECORDS):
        file = folder / f"record-{number}.csv"
        identified._write_record(file, identified._device("piezo"), SAMPLES, number)


def main() -> int:
    """Measure, and print medians; returns the exit code."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("base", metavar="BASE", help="a commit to compare with")
    parser.add_argument("--only", default="", help="tasks whose name holds this")
    parser.add_argument("--runs", type=int, default=9, help="of which medians are taken")
    options = parser.parse_args()
    columns = ("total", *[part for part in PARTS if part != "wait"], "other")
    print(f"{'seconds':29}" + "".join(f"{column:>10}" for column in columns))
    with tempfile.TemporaryDirectory(prefix="bench-") as place:
        folder = Path(place).resolve()
        checkouts = {"before": _unpacked(options.base, folder), "after": folder / "now"}
        for package in ("circuits", "harvester", "netlists"):
            leave = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / package, checkouts["after"] / package, ignore=leave)
        for name, words in TASKS.items():
            if options.only in name:
                if name == "identify":
                    write_records(folder)
                _print_task(name, words, checkouts, folder, options.runs, columns)
    return 0


def _print_task(name, words, checkouts, folder, runs, columns):
    """Medians of wall and CPU time before and after, with a cold and with a warm cache."""
    measured_runs = defaultdict(list)
    for _ in range(runs):
        for side, checkout in checkouts.items():
            cache = folder / f"cache-{side}"
            shutil.rmtree(cache, ignore_errors=True)
            for state in ("cold", "warm"):
                times = measure(words, checkout, folder, cache)
                for clock, parts in times.items():
                    measured_runs[state, clock, side].append(parts)
    for labels, rows in sorted(measured_runs.items()):
        medians = [statistics.median(row.get(column, 0.0) for row in rows) for column in columns]
        head = "{:13}{} {:4} {:6}".format(name, *labels)
        print(head + "".join(f"{median:10.2f}" for median in medians), flush=True)


if __name__ == "__main__":
    sys.exit(main())

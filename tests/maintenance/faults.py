"""`make faults`: puts faults of one line into copies of the checkout; which tests see them?

Each fault of `fault_list` goes into a copy of its own, and the tests that should see it are run
there, but for the exhaustive ones, until the first that fails. Beforehand all these tests pass
without any fault. The command ends with 1 where a fault is not seen or could not be tried.

`make faults ONLY="diode switch"` tries those whose title or file has one of the words.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from maintenance.fault_list import FAULTS, Fault

ROOT = Path(__file__).parents[2]
SIDE_BY_SIDE = 2
# Of one fault's tests (s).
LONGEST = 900.0
PASSED, FAILED = 0, 1
SEEN, NOT_SEEN, NOT_RUN = "seen", "NOT SEEN", "COULD NOT RUN"
# A fault that is no program is seen by every test, and tells nothing of them.
NO_PROGRAM = re.compile(
    r"^E .*\b(SyntaxError|NameError|ImportError|TypingError|LoweringError)\b", re.MULTILINE
)
FIRST_FAILURE = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", re.MULTILINE)
# Prints the folders from which a test and its worker processes take the package.
WHOSE = """
import json, pathlib, circuits, harvester
from harvester.base import worker_command
print(*(pathlib.Path(each.__file__).parents[1] for each in (circuits, harvester)))
print(json.loads(worker_command.command()[-1])[0])
"""


class Outcome(NamedTuple):
    """What the tests said of one fault."""

    verdict: str
    told: str
    seconds: float


def misplaced(fault: Fault, root: Path = ROOT) -> str:
    """Why a fault cannot be put into its file; "" where it can."""
    path = root / fault.file
    count = path.read_text().count(fault.before) if path.exists() else 0
    if count == 1:
        return ""
    return (
        f"{fault.file} has the text {count} times, not once: renew the entry "
        f"{fault.title!r} in tests/maintenance/fault_list.py: {fault.before!r}"
    )


def copy_checkout(copy: Path) -> None:
    """Copy the files that git knows or would take, and what is compiled of them.

    Times of change stay, by which numba and Python tell whether compiled code is still good.
    """
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True)
    files = [name for name in listed.stdout.split("\0") if name and (ROOT / name).exists()]
    for package in ("circuits", "harvester"):
        compiled = (ROOT / package).rglob("__pycache__/*")
        files += [str(path.relative_to(ROOT)) for path in compiled]
    for name in files:
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)


def environment(copy: Path) -> dict[str, str]:
    """In which everything is imported from the copy, also by commands that tests start."""
    return os.environ | {"PYTHONPATH": str(copy), "OPENBLAS_NUM_THREADS": "1"}


def check_whose(copy: Path) -> None:
    """End where the copy's tests would try another program than the copy."""
    found = subprocess.run(
        [sys.executable, "-c", WHOSE], cwd=copy, env=environment(copy), capture_output=True
    )
    if {*found.stdout.decode().split()} != {str(copy)}:
        sys.exit(f"{copy}: imported from {found.stdout.decode()} {found.stderr.decode()}")


def run_tests(copy: Path, tests: Iterable[str], options: Sequence[str]) -> tuple[int | None, str]:
    """Exit code of pytest, None where it took too long, and what it printed."""
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "not exhaustive"]
    try:
        found = subprocess.run(
            [*command, *options, *(f"tests/{test}" for test in tests)],
            cwd=copy,
            env=environment(copy),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LONGEST,
        )
    except subprocess.TimeoutExpired:
        return None, f"more than {LONGEST:g} s"
    return found.returncode, found.stdout + found.stderr


def judged(code: int | None, printed: str) -> tuple[str, str]:
    """The verdict of a run, and the first test that failed or why there is none."""
    if code == PASSED:
        return NOT_SEEN, ""
    broken = NO_PROGRAM.search(printed)
    first = FIRST_FAILURE.search(printed)
    if code != FAILED or broken or not first:
        reason = broken.group(0) if broken else "\n".join(printed.splitlines()[-3:])
        return NOT_RUN, f"pytest ended with {code}: {reason}"
    return SEEN, first.group(1)


def tried(fault: Fault, clean: Path) -> Outcome:
    """Put a fault into a copy of the clean checkout and run its tests."""
    clock = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fault-") as folder:
        copy = Path(folder).resolve() / "copy"
        shutil.copytree(clean, copy)
        path = copy / fault.file
        path.write_text(path.read_text().replace(fault.before, fault.after))
        verdict, told = judged(*run_tests(copy, fault.tests, ["-x"]))
    return Outcome(verdict, told, time.monotonic() - clock)


def check_clean(faults: list[Fault], clean: Path) -> None:
    """End where the faults' tests do not pass without any: every fault would count as seen."""
    tests = dict.fromkeys(test for fault in faults for test in fault.tests)
    several = ["-n", str(SIDE_BY_SIDE), "--dist", "worksteal"]
    code, printed = run_tests(clean, tests, several)
    if code != PASSED:
        sys.exit(f"{printed}\nwithout any fault these tests do not pass (pytest: {code})")


def rows(faults: list[Fault], outcomes: Iterator[Outcome]) -> Iterator[tuple[str, str]]:
    """Verdict and line of the table of each fault, as it is known."""
    width = max(len(fault.title) for fault in faults)
    place = max(len(fault.file) for fault in faults)
    for fault, (verdict, told, seconds) in zip(faults, outcomes, strict=True):
        tests = " ".join(fault.tests)
        yield (
            verdict,
            f"{verdict:13}  {seconds:4.0f} s  {fault.title:{width}}  {fault.file:{place}}  "
            f"{told.removeprefix('tests/') or tests}",
        )


def main(words: list[str]) -> int:
    """Try the faults of the list, or those with one of the words."""
    chosen = [
        fault
        for fault in FAULTS
        if not words or any(word in f"{fault.title} {fault.file}" for word in words)
    ]
    wrong = [reason for reason in map(misplaced, chosen) if reason]
    if wrong or not chosen:
        print(*wrong or ["no fault has one of these words"], sep="\n")
        return 1
    clock = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        clean = Path(folder).resolve() / "clean"
        copy_checkout(clean)
        check_whose(clean)
        check_clean(chosen, clean)
        print(f"without any fault the tests pass, {time.monotonic() - clock:.0f} s", flush=True)
        with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
            outcomes = pool.map(lambda fault: tried(fault, clean), chosen)
            verdicts = []
            for verdict, line in rows(chosen, outcomes):
                verdicts.append(verdict)
                print(line, flush=True)
    seen = verdicts.count(SEEN)
    print(f"{seen} of {len(chosen)} faults are seen, {time.monotonic() - clock:.0f} s")
    return 0 if seen == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

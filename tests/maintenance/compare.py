"""`make compare BASE=<commit>`: whether this checkout answers as a commit does, bit for bit.

For moves of code, which must change no number. Both are asked the same at the same time on the
same machine: nothing is stored, since the processor decides last digits.
"""

import argparse
import json
import math
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from maintenance.cases import all_cases

ROOT = Path(__file__).resolve().parents[2]
# Keys of what every run measures anew.
TIMES = ("seconds", "needed_time")
# Of cases that differ in one kind.
MOST_LINES = 12
LONGEST_SHOWN = 80
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
NUMBERS_OF = {
    "simulate": "moments and quantities",
    "average": "closures",
    "identify": "identification",
    "netlist": "netlists",
    "schematic": "schematics",
}
MISSING = object()


class Difference(NamedTuple):
    """Of one value: what kind, where, and what it was and is."""

    kind: str
    place: str
    before: str
    after: str


def differences(old: Any, new: Any, place: tuple[str, ...] = ()) -> Iterator[Difference]:
    """What differs between two trees of answers; of what one side lacks, the topmost."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            if not _is_time(key):
                inner = old.get(key, MISSING), new.get(key, MISSING)
                yield from differences(*inner, (*place, key))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, (*place, str(number)))
    elif not _same(old, new):
        yield _difference(place, old, new)


def values_in(tree: Any) -> int:
    """How many values are compared of a tree."""
    if isinstance(tree, dict):
        return sum(values_in(value) for key, value in tree.items() if not _is_time(key))
    return sum(map(values_in, tree)) if isinstance(tree, list) else np.size(tree)


def _is_time(key):
    return any(word in key for word in TIMES)


def _difference(place, old, new):
    where = " / ".join(place)
    if old is MISSING or new is MISSING:
        return Difference("keys", where, _shown(old), _shown(new))
    if isinstance(old, np.ndarray) and _alike(old, new):
        places = np.flatnonzero(_bits(old) != _bits(new))
        where += f" [{places[0]}], {places.size} of {old.size}"
        old, new = old.flat[places[0]].item(), new.flat[places[0]].item()
    return Difference(_kind(place, old), where, _shown(old), _shown(new) + _relative(old, new))


def _same(old, new):
    """Whether two values are the same to the bit; NaN is NaN, and 0 is not -0."""
    if type(old) is not type(new):
        return False
    if isinstance(old, np.ndarray):
        return _alike(old, new) and np.array_equal(_bits(old), _bits(new))
    return old.hex() == new.hex() if isinstance(old, float) else old == new


def _alike(old, new):
    return isinstance(new, np.ndarray) and old.dtype == new.dtype and old.shape == new.shape


def _bits(array):
    """Its values by their bits, every NaN as the same one."""
    if array.dtype.kind != "f":
        return array.ravel()
    whole = np.where(np.isnan(array), np.nan, array).astype(array.dtype).ravel()
    return whole.view(f"i{array.dtype.itemsize}")


def _kind(place, value):
    if "exit code" in place:
        return "exit codes"
    of_file = any(part.endswith((".cir", ".svg", ".csv")) for part in place)
    if isinstance(value, str) and not of_file and "netlist_sha256" not in place:
        return "messages"
    return NUMBERS_OF.get(place[0].split(":")[0].split()[0], "studies")


def _shown(value):
    if value is MISSING:
        return "missing"
    if isinstance(value, np.ndarray):
        return f"array of {value.dtype} {value.shape}"
    if isinstance(value, dict | list):
        return f"{len(value)} entries"
    text = str(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"


def _relative(old, new):
    numbers = isinstance(old, int | float) and isinstance(new, int | float)
    largest = max(abs(old), abs(new)) if numbers else 0.0
    return f" ({abs(new - old) / largest:.1e})" if largest and math.isfinite(largest) else ""


def report(found: list[Difference]) -> Iterator[str]:
    """Lines about the differences, by their kinds: of each case how many, and the first."""
    kinds = defaultdict(lambda: defaultdict(list))
    for each in found:
        kinds[each.kind][each.place.partition(" / ")[0]].append(each)
    for kind, cases in kinds.items():
        yield f"{kind}: {sum(map(len, cases.values()))} differ, in {len(cases)} cases"
        for each, *others in list(cases.values())[:MOST_LINES]:
            more = f" (and {len(others)} more)" if others else ""
            yield f"  {each.place}: {each.before} → {each.after}{more}"
        if len(cases) > MOST_LINES:
            yield "  …"


def main() -> int:
    """Compare, and print what differs; returns the exit code."""
    parser = argparse.ArgumentParser(prog="make compare", description=__doc__)
    parser.add_argument("base", metavar="BASE", help="a commit")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    options = parser.parse_args()
    start = time.monotonic()
    # As an interrupt does: nothing stays behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    with tempfile.TemporaryDirectory(prefix="compare-") as place:
        folder = Path(place).resolve()
        base = _unpacked(options.base, folder)
        cases = {k: v for k, v in all_cases(folder).items() if options.only in k}
        before, after = _answers(cases, (base, ROOT), folder)
    found = list(differences(before, after))
    for line in report(found):
        print(line)
    # Many more than before: what is compared is mostly messages.
    refused = sum(bool(answer.get("message")) for answer in after.values())
    print(
        f"{len(cases)} cases ({refused} refused), {values_in(after)} values compared, "
        f"{len(found)} differ, {time.monotonic() - start:.0f} s"
    )
    return 1 if found else 0


def _unpacked(commit, folder):
    """The commit's files in a folder of their own."""
    archive, base = folder / "base.tar", folder / "base"
    subprocess.run(["git", "-C", ROOT, "archive", "-o", archive, commit], check=True)
    shutil.unpack_archive(archive, base, filter="data")
    return base


def _answers(cases, checkouts, folder):
    """Each checkout's answers; both are at work at the same time."""
    asked = folder / "cases.json"
    asked.write_text(json.dumps(cases))
    # Away from this checkout: a script's own folder is imported from.
    script = shutil.copy(Path(__file__).with_name("answers.py"), folder)
    files = [folder / f"answers-{number}" for number in range(len(checkouts))]
    running = []
    try:
        for checkout, file in zip(checkouts, files, strict=True):
            words = [sys.executable, script, checkout, asked, file]
            own = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(checkout)}
            with file.with_suffix(".log").open("w") as log:
                running.append(subprocess.Popen(words, env=own, cwd=folder, stdout=log, stderr=log))
        for process, file in zip(running, files, strict=True):
            if process.wait():
                log = file.with_suffix(".log").read_text()
                raise SystemExit(f"{process.args[2]} failed:\n{log[-3000:]}")
    finally:
        for process in running:
            process.kill()
            process.wait()
    return [pickle.loads(file.read_bytes()) for file in files]


if __name__ == "__main__":
    sys.exit(main())

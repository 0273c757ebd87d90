"""One checkout's answers to all cases, in one warm process; run by `compare` with its path.

It is run with the code of another commit too: it asks what stays as it is when code moves, the
command line and the functions of `harvester`, and imports nothing else of the project.
"""

import contextlib
import dataclasses
import io
import json
import os
import pickle
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import harvester

try:
    from harvester.cli.command_line import main
except ImportError:  # a checkout from before the rooms
    from harvester.command_line import main

# Beside what `to_dict` tells of a result.
KEPT = ("moments", "densities", "joint_density", "waveform")
TEXTS = (".cir", ".svg", ".csv", ".toml")
# Neither the store of a study, whose names tell the version of the code.
WRITTEN = (*TEXTS, ".json", ".png", ".html", ".nc")
# Its only name for a place that differs between the two.
HERE = "CHECKOUT"


def all_answers(cases: dict[str, dict], checkout: Path) -> dict[str, Any]:
    """Name of each case → what came of it, as plain values and arrays."""
    answers = {}
    # One thread, and so one worker process for all calls: it compiles each kind of device once.
    with ThreadPoolExecutor(1) as executor:
        for name, case in cases.items():
            start = time.monotonic()
            found = _of_command(case) if "arguments" in case else _of_function(case, executor)
            answers[name] = plain(found, str(checkout))
            print(f"{time.monotonic() - start:6.1f} s  {name}", flush=True)
    return answers


def _of_function(case, executor):
    """What a function of `harvester` returns for a scene, or the error that it raises."""
    try:
        read = getattr(harvester.Scene, "read", None) or harvester.Scene.load
        scene = read(case["scene"], case["overrides"])
        more = {"executor": executor} if case["function"] in ("simulate", "validate") else {}
        found = getattr(harvester, case["function"])(scene, **case["options"], **more)
    except harvester.HarvesterError as error:
        return {"message": f"{type(error).__name__}: {error}"}
    return {"result": found.to_dict(), **{name: getattr(found, name, None) for name in KEPT}}


def _of_command(case):
    """Exit code, complaint and files of a command, carried out in an empty folder."""
    before = os.getcwd()
    complaint = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(complaint):
                code = main(case["arguments"])
        except SystemExit as end:
            code = end.code
        finally:
            os.chdir(before)
        said = complaint.getvalue().splitlines()
        files = [path for path in sorted(Path(folder).rglob("*.*")) if path.suffix in WRITTEN]
        return {
            "exit code": code or 0,
            "message": "\n".join(line for line in said if line.startswith("harvester")),
            "files": {path.name: _content(path) for path in files},
        }


def _content(path):
    if path.suffix == ".json":
        return json.loads(path.read_text())
    return path.read_text().splitlines() if path.suffix in TEXTS else "not read"


def plain(value: Any, checkout: str) -> Any:
    """The same of dicts, lists, arrays, numbers and texts alone, without the checkout's path."""
    if dataclasses.is_dataclass(value):
        value = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {str(key): plain(each, checkout) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each, checkout) for each in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | np.ndarray):
        return value
    return str(value).replace(checkout, HERE)


def watch_processes(checkout: Path) -> None:
    """End where a process of Python is started that does not import from this checkout."""

    def heard(event, details):
        if event == "subprocess.Popen" and details[0] == sys.executable:
            words = " ".join(map(str, details[1]))
            if f'"{checkout}"' not in words:
                # Not an error, which would be taken for an answer.
                print(f"a worker process imports from elsewhere: {words}", flush=True)
                os._exit(1)

    sys.addaudithook(heard)


def run(checkout: Path, cases: Path, answers: Path) -> None:
    """Read the cases, write the answers; `checkout` must be where `harvester` comes from."""
    if Path(harvester.__file__).resolve().parents[1] != checkout.resolve():
        raise SystemExit(f"harvester was imported from {harvester.__file__}, not from {checkout}")
    watch_processes(checkout)
    found = all_answers(json.loads(cases.read_text()), checkout)
    answers.write_bytes(pickle.dumps(found))


if __name__ == "__main__":
    run(*map(Path, sys.argv[1:]))

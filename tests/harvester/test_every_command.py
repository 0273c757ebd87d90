"""Each command with each device, load and excitation: an answer, or a refusal that says why."""

import re
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import every_command
import pytest
import worker_calls

from harvester.averaging import closures
from harvester.base.worker_process import Worker
from harvester.cli.command_line import main
from harvester.engines.task import Task
from harvester.results import figures
from harvester.validation import accuracy_measurement as measurement
from harvester.validation import stability as matrix
from harvester.validation import throughput
from harvester.validation.accuracy_methods import ComparedMethod
from harvester.validation.stability_cases import Case

# Words of Python about a fault of ours.
FAULT = re.compile(r"Traceback|\b(?!Memory)[A-Z]\w*(?:Error|Exception|Warning)\b: ")
OURS = ("Simulat", "SolutionDiverged", "EnergyNotBalanced")
FEW_CASES = (
    Case("scene", "as it is", {}),
    Case("corner", "all", {"stiffness": 100.0, "gap_in_wells": 1.2, "decay_rate": 0.1}),
)
FEW_METHODS = (
    ComparedMethod("circuit", "circuit", 2),
    ComparedMethod("Monte Carlo", "monte-carlo", 4),
)
FEW_LOAD_METHODS = (FEW_METHODS[0], ComparedMethod("Monte Carlo", "monte-carlo", 2))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the loads and records that the cases name."""
    path = tmp_path_factory.mktemp("every")
    every_command.write_files(path)
    return path


class SameWorker(Worker):
    """The worker of every pool: one process, which compiles once for all calls."""

    made: ClassVar[list] = []

    def __new__(cls, folders=()):
        if not cls.made:
            cls.made.append(super().__new__(cls))
            Worker.__init__(cls.made[0], [Path(every_command.__file__).parent])
        return cls.made[0]

    def __init__(self, folders=()):
        pass

    def close(self):
        pass


@pytest.fixture(scope="module")
def briefly():
    """One worker process for all calls, each closure computed once, studies cut to a few points."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harvester.base.worker_pool.Worker", SameWorker)
        patch.setattr("harvester.studies.frequency_response.SETTLED_SHARE", 0.9)
        patch.setattr("harvester.studies.sensitivity.study.FEWEST_ROWS", 2)
        patch.setattr(matrix, "default_cases", lambda: FEW_CASES)
        patch.setattr(matrix, "METHODS", ("circuit", "monte-carlo", "consistent"))
        patch.setattr(measurement, "NOISE_CLOSURES", ("consistent",))
        patch.setattr("harvester.validation.stability_cases.STEP_BUDGET", 4000)
        patch.setattr("harvester.validation.path_deviation.PATH_STEPS", 2000)
        patch.setattr(measurement, "METHODS", FEW_METHODS)
        patch.setattr(measurement, "LOAD_METHODS", FEW_LOAD_METHODS)
        patch.setattr(measurement, "PERIODS", 1)
        patch.setattr(measurement, "PATHS", 2)
        patch.setattr(throughput, "task", speeds_here)
        patch.setattr(figures, "write", write_whole)
        # Rates of jumps take several times as long as all else that `validate` averages.
        patch.setattr("harvester.averaging.jumps.MOST_WORK", 1e6)
        patch.setattr("harvester.averaging.closures.average", lru_cache(closures.average))
        yield
    for worker in SameWorker.made:
        Worker.close(worker)


def write_whole(figure, path, write=figures.write):
    """Write a figure; fail if its texts reach beyond it by more than a hundredth of an inch."""
    write(figure, path)
    drawn = figure.get_tightbbox().padded(-0.01)
    width, height = figure.get_size_inches()
    assert min(drawn.min) >= 0.0, path
    assert drawn.x1 <= width, path
    assert drawn.y1 <= height, path


def speeds_here(scene, version):
    """Speeds of the circuit, measured without processes of their own."""
    return Task(worker_calls.speeds, {"scene": scene}, version)


def faults(case, folder, capsys):
    """What is wrong with the end of a call, or ""."""
    capsys.readouterr()
    code = main(every_command.call(case, folder))
    streams = capsys.readouterr()
    said = streams.out + streams.err
    found = FAULT.search(said)
    if found and not found.group().startswith(OURS):
        return f"{case}: {said[-600:]}"
    refusals = [line for line in streams.err.splitlines() if line.startswith("harvester: ")]
    if code in (0, None) or (code == 2 and len(refusals) == 1):
        return ""
    # A run that failed says so in one line, or in its place of a table.
    if code == 1 and (len(refusals) == 1 or any(name in said for name in OURS)):
        return ""
    return f"{case}: exit code {code}: {said[-600:]}"


@pytest.mark.usefixtures("briefly")
@pytest.mark.slow
@pytest.mark.parametrize("case", every_command.EACH_ONCE, ids=lambda case: case[0])
def test_each_command_answers(case, folder, capsys):
    """But for `optimum`: it may find none in runs as brief as these."""
    words = every_command.call(case, folder)
    output = [] if "--output" in words else ["--output", str(folder / case[0])]
    if case[0] == "optimum":
        assert not faults(case, folder, capsys)
    else:
        code = main([*words, *output])
        assert code in (0, None), capsys.readouterr()
        assert not FAULT.search(str(capsys.readouterr()))


def test_between_them_these_calls_hold_all_kinds():
    held = [set(names) for names in zip(*every_command.EACH_ONCE, strict=True)]
    kinds = (every_command.COMMANDS, every_command.KINDS_OF_DEVICE)
    others = (every_command.LOADS, every_command.EXCITATIONS)
    assert held == [set(each) for each in (*kinds, *others)]
    assert len(every_command.EACH_ONCE) == len(every_command.COMMANDS)


@pytest.mark.exhaustive
@pytest.mark.usefixtures("briefly")
def test_every_two_of_command_kind_of_device_load_and_excitation(folder, capsys):
    cases = every_command.covering(2, 3, every_command.KINDS_OF_DEVICE)
    assert not [fault for case in cases if (fault := faults(case, folder, capsys))]


@pytest.mark.exhaustive
@pytest.mark.usefixtures("briefly")
def test_every_two_of_command_other_device_load_and_excitation(folder, capsys):
    kinds = every_command.KINDS_OF_DEVICE
    others = [device for device in every_command.DEVICES if device not in kinds]
    cases = every_command.covering(2, 0, others)
    assert not [fault for case in cases if (fault := faults(case, folder, capsys))]

import json
import subprocess
import sys

import numpy as np
import pytest

from harvester.cli.command_line import main
from harvester.scene.model import Scene

BRIEF = ["--set", "run.realizations=2", "--set", "run.duration=60", "--set", "run.settle=10"]
QUANTITIES = {
    "mean_square_voltage",
    "rms_voltage",
    "mean_power",
    "power_conversion_efficiency",
    "mean_square_velocity",
    "mean_square_displacement",
}
EVIDENCE = {
    "energy_balance_residual",
    "wall_seconds",
    "simulated_time",
    "engine",
    "engine_version",
    "seed",
    "scene",
    "netlist_sha256",
}


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
@pytest.mark.parametrize(
    "command",
    [
        ["simulate", "paper", "--method", "circuit", *BRIEF],
        ["simulate", "paper_si", "--method", "monte-carlo", *BRIEF],
        ["average", "paper", "--method", "paper"],
        ["average", "device", "--method", "consistent"],
    ],
)
def test_json_alone_on_standard_output(capsys, command):
    assert main([*command, "--json", "-", "--seed", "7"]) == 0
    streams = capsys.readouterr()
    content = json.loads(streams.out)
    assert set(content) >= EVIDENCE
    assert set(content["quantities"]) >= QUANTITIES
    for entry in content["quantities"].values():
        assert set(entry) >= {"estimate", "standard_error", "unit"}
    assert content["seed"] == 7
    assert content["scene"]["run"]["seed"] == 7
    assert "mean square voltage" in streams.err


@pytest.mark.slow
def test_output_writes_json_and_figure(tmp_path, capsys):
    folder = tmp_path / "new" / "results"
    assert main(["simulate", "linear", *BRIEF, "--output", str(folder)]) == 0
    assert {path.name for path in folder.iterdir()} == {
        "linear-circuit.csv",
        "linear-circuit.json",
        "linear-circuit.nc",
        "linear-circuit.png",
        "linear-circuit-densities.csv",
        "linear-circuit-waveform.png",
    }
    table = np.genfromtxt(
        folder / "linear-circuit-densities.csv", delimiter=",", names=True, dtype=None
    )
    of_voltage = table[table["quantity"] == "voltage"]
    width = of_voltage["centre"][1] - of_voltage["centre"][0]
    assert of_voltage["density"].sum() * width == pytest.approx(1.0)
    assert (folder / "linear-circuit.png").read_bytes().startswith(b"\x89PNG")
    assert "mean power" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_validate_shows_three_ways_and_writes_figures(tmp_path, capsys):
    # Five times the scene's noise: the rates of its jumps take a third of the time.
    sets = ["run.realizations=2", "run.duration=400", "excitation.intensity=0.1"]
    options = [word for each in sets for word in ("--set", each)]
    assert main(["validate", "paper", *options, "--output", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    closures = ("paper", "consistent", "fokker_planck")
    for word in ("circuit", "Monte Carlo", *closures, "σ", "wall time", "jump rate", "p(X, X')"):
        assert word in shown
    content = json.loads((tmp_path / "paper-validate.json").read_text())
    assert set(content["results"]) == {
        "circuit",
        "monte-carlo",
        "averaging paper",
        "averaging consistent",
        "averaging fokker_planck",
    }
    assert content["results"]["averaging fokker_planck"]["quantities"]["jump_rate"]["estimate"]
    assert "jump_rate" in content["difference_in_standard_errors"]
    assert "fokker_planck" in content["joint_density_distance"]
    for ending in ("", "-joint"):
        assert (tmp_path / f"paper-validate{ending}.png").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_validate_goes_on_where_no_closure_knows_the_load(tmp_path, capsys):
    brief = ["run.realizations=2", "run.duration=4", "run.settle=1", "load.netlist=bridge"]
    sets = [word for value in brief for word in ("--set", value)]
    assert main(["validate", "device", *sets, "--output", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    for word in (
        "mean output power",
        "end to end efficiency: power harvested at the load's output and into its stores",
        "Stationary methods that are not valid: paper, consistent, fokker_planck, spectral: ",
    ):
        assert word in shown
    content = json.loads((tmp_path / "device-validate.json").read_text())
    assert set(content["results"]) == {"circuit", "monte-carlo"}
    assert set(content["refused"]) == {"paper", "consistent", "fokker_planck", "spectral"}


def test_netlist_goes_to_a_file_or_to_standard_output(tmp_path, capsys):
    brief = ["--set", "run.realizations=2", "--set", "run.duration=1", "--set", "run.settle=0"]
    assert main(["netlist", "paper", *brief]) == 0
    text = capsys.readouterr().out
    assert text.startswith(".title")
    assert text.rstrip().endswith(".end")
    assert main(["netlist", "paper", *brief, "--output", str(tmp_path / "a.cir")]) == 0
    assert (tmp_path / "a.cir").read_text() == text
    assert main(["netlist", "paper", *brief, "--realization", "1"]) == 0
    assert capsys.readouterr().out != text


def test_engine_tells_what_was_found(capsys):
    assert main(["engine", "--json", "-"]) == 0
    streams = capsys.readouterr()
    found = json.loads(streams.out)
    assert found["version"].startswith("ngspice-")
    assert found["library"] in streams.err


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (["simulate", "papr"], "did you mean paper"),
        (["simulate", "paper", "--set", "stoppers.gap=-1"], "stoppers.gap"),
        (["simulate", "paper", "--method", "spice"], "unknown method"),
        (["simulate", "paper", "--step", "0"], "step"),
        (["simulate", "paper", "--step", "5m"], "--step 5m: must be default, fine, finest or"),
        (["simulate", "paper", "--workers", "0"], "--workers 0"),
        (["simulate", "paper", "--time-limit", "-1"], "--time-limit"),
        (["simulate", "paper", "--time-limit", "nan"], "--time-limit"),
        (["average", "paper", "--method", "papre"], "paper"),
        (["netlist", "paper", "--realization", "64"], "--realization 64"),
        (["simulate", "paper", "--json", "/dev/null/x.json"], "cannot be written"),
        (["simulate", "paper", "--json", "/"], "name a file"),
        (["netlist", "paper", "--output", "/dev/null/x.cir"], "cannot be written"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_two(capsys, command, word):
    assert main(command) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.count("\n") == 1
    assert word in streams.err


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (["load-study", "paper", "--over", "load.resistance=1,2"], "--sweep"),
        (["residence", "paper", "--sweep", "excitation.intensity=1,2"], "--over"),
        (["sensitivity", "paper", "--over", "stoppers.gap=1:2"], "--vary"),
    ],
)
def test_an_option_of_another_command_is_told_in_this_ones_word(capsys, command, option):
    assert main(command) == 2
    assert f"(did you mean {option}?)" in capsys.readouterr().err


def test_an_option_in_front_of_its_command_is_told_where_it_goes(capsys):
    assert main(["--quiet", "simulate", "paper"]) == 2
    assert capsys.readouterr().err == "harvester: write --quiet after simulate\n"


def test_a_missing_library_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setenv("NGSPICE_LIBRARY_PATH", "/nowhere/libngspice.so")
    assert main(["simulate", "paper", *BRIEF]) == 1
    message = capsys.readouterr().err
    assert "NGSPICE_LIBRARY_PATH=/nowhere/libngspice.so" in message
    for word in ("apt-get", "brew", "conda", "Windows"):
        assert word in message


def test_a_library_that_is_no_ngspice_is_refused(monkeypatch, capsys):
    import math

    monkeypatch.setenv("NGSPICE_LIBRARY_PATH", math.__file__ or "libm.so.6")
    assert main(["engine"]) == 1
    assert "NGSPICE_LIBRARY_PATH" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_a_failed_run_keeps_what_it_had(tmp_path, capsys):
    target = tmp_path / "partial.json"
    command = ["simulate", "paper", "--set", "run.realizations=2", "--set", "run.duration=1e6"]
    # On a busy machine a run may have nothing to keep yet at the first limits.
    for limit in ("2", "5", "20", "80"):
        assert main([*command, "--time-limit", limit, "--json", str(target)]) == 1
        assert "SimulatorTimeout" in capsys.readouterr().err
        content = json.loads(target.read_text()) if target.exists() else {}
        if content.get("simulated_time", 0.0) > 100.0:
            break
    assert content["outcome"] == "SimulatorTimeout"
    assert content["simulated_time"] > 100.0


def test_light_commands_import_nothing_heavy():
    heavy = ("numpy", "scipy", "numba", "matplotlib", "PySpice")
    code = (
        "import sys, harvester, harvester.cli.command_line as c\n"
        "c.main(['--help'])\n"
        f"print('loaded', [m for m in {heavy} if m in sys.modules])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert shown.rstrip().endswith("loaded []")


def test_the_help_of_a_command_imports_the_function_of_no_other():
    others = ("harvester.studies.public", "harvester.engines.simulate", "harvester.cli.circuit")
    code = (
        "import sys, harvester.cli.command_line as c\n"
        "c.main(['cite', '--help'])\n"
        f"print('loaded', [m for m in {others} if m in sys.modules])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert shown.rstrip().endswith("loaded []")


@pytest.mark.slow
def test_simulating_loads_no_library_that_it_does_not_need(tmp_path):
    others = ("matplotlib", "numba", "PySpice")
    code = (
        "import sys, harvester.cli.command_line as c\n"
        f"c.main(['simulate', 'paper', '--method', 'monte-carlo', '--json', r'{tmp_path}/a'])\n"
        f"print('loaded', [m for m in {others} if m in sys.modules])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert shown.rstrip().endswith("loaded []")


@pytest.mark.slow
def test_si_and_scaled_scenes_average_to_the_same_scaled_results():
    from harvester.averaging.of_scene import average

    for closure in ("paper", "consistent"):
        scaled = average(Scene.read("paper"), method=closure).scaled_quantities
        si = average(Scene.read("paper_si"), method=closure).scaled_quantities
        for name, estimate in scaled.items():
            assert si[name].estimate == pytest.approx(estimate.estimate, rel=1e-9), name


def test_values_are_read_where_pydantic_is_imported():
    """cyclopts checks values by pydantic then, which another library of a process may import."""
    pytest.importorskip("pydantic")
    words = ["sweep", "linear", "--over", "load.decay_rate=0.1,0.2", "--method", "consistent"]
    code = f"import pydantic\nfrom harvester.cli.command_line import main\nexit(main({words}))"
    subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)

"""The commands of the command line: a new one is a function with a docstring, and an entry here."""

from __future__ import annotations

import harvester
from harvester.commands import circuit, verification
from harvester.commands.cite import cite
from harvester.commands.command import Command, Study
from harvester.commands.completion import completion
from harvester.commands.identify import identify
from harvester.commands.new import new
from harvester.commands.optimum import optimum, title_of
from harvester.studies.public import LOAD_STUDY_FILES, SENSITIVITY_FILES, TIME_BUDGET

COMMANDS = (
    Command("new", new, "harvester new beam.toml --from asymmetric"),
    Study(
        "validate",
        "validate",
        "harvester validate paper --output results --report paper.html",
        title="one scene, the same noise",
        page=True,
        progress="function",
    ),
    Study(
        "simulate",
        "simulate",
        "harvester simulate paper --method circuit --set excitation.intensity=0.1 --json -",
        title=lambda result: result.engine,
        stem="{method}",
        failed=lambda result: result.outcome != "complete",
        progress="simulation",
    ),
    Study(
        "average",
        "average",
        "harvester average paper --method consistent",
        title=lambda result: result.engine,
        stem="{method}",
    ),
    Study(
        "frequency-response",
        "frequency_response",
        "harvester frequency-response device --amplitude 4 --frequencies 5:30:linear:51 --down",
        title="frequency response",
    ),
    Study(
        "work-precision",
        verification.work_precision,
        "harvester work-precision paper --output results",
        title="error against run time",
    ),
    Command(
        "time-to-accuracy",
        verification.time_to_accuracy,
        "harvester time-to-accuracy --output results",
    ),
    Study(
        "stability",
        verification.stability,
        "harvester stability paper --output results",
        title="stiff and extreme cases",
        failed=lambda matrix: matrix.wrong,
    ),
    Study(
        "verify",
        verification.verify,
        "harvester verify --output results",
        title="known results",
        failed=lambda found: found.failed,
    ),
    Study(
        "optimum",
        optimum,
        "harvester optimum device --maximise mean_power --over load.resistance=1e4:1e7 "
        "--over oscillator.linear_stiffness=-100:-20",
        title=title_of,
        progress="function",
    ),
    Study(
        "sensitivity",
        "sensitivity",
        "harvester sensitivity paper --vary oscillator.cubic_stiffness=±10% "
        "--vary stoppers.gap=normal:2% --above 0.001 --output tolerances",
        title="sensitivity",
        json=False,
        files=SENSITIVITY_FILES,
    ),
    Study(
        "load-study",
        "load_study",
        "harvester load-study device --load bridge --load sece "
        "--sweep load.parameters.resistance=1e4:1e7:log:7 --precision 0.03 --output study",
        title="load study",
        failed=lambda report: not any(each.estimates for each in report.study.evaluations),
        json=False,
        shown=lambda study: harvester.Report(study),
        files=LOAD_STUDY_FILES,
        budget=lambda options: TIME_BUDGET if options.get("precision") else None,
    ),
    Study(
        "identify",
        identify,
        "harvester identify device --record shaker.csv load.resistance=1e5 --output identified",
        title=lambda found: f"identified from {', '.join(r.name for r in found.measurements)}",
        stem="identified",
        page=True,
        progress="function",
    ),
    Command(
        "reproduce",
        verification.reproduce,
        "harvester reproduce fig6 fig9 --quick --output results",
    ),
    Study(
        "claims",
        verification.claims,
        "harvester claims --output results",
        title="the paper's statements",
    ),
    Command(
        "schematic",
        circuit.schematic,
        "harvester schematic device --set load.netlist=bridge --output bridge.svg",
    ),
    Command(
        "netlist",
        circuit.netlist,
        "harvester netlist paper --set run.duration=100 --output paper.cir",
    ),
    Command("cite", cite, "harvester cite results/paper-validate.json"),
    Command("engine", circuit.engine, "harvester engine --json -"),
    Command("completion", completion, "harvester completion bash"),
)

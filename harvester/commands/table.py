"""The commands of the command line: a new one is a function with a docstring, and an entry here."""

from __future__ import annotations

from harvester.commands import circuit, verification
from harvester.commands.beam import beam
from harvester.commands.cite import cite
from harvester.commands.command import Command, Study
from harvester.commands.completion import completion
from harvester.commands.new import new
from harvester.studies import LOAD_STUDY_FILES, SENSITIVITY_FILES
from harvester.studies.public import TIME_BUDGET
from harvester.verification.stability import TIME_LIMIT


def _engine(result):
    return result.engine


# All commands, each with the example of its help. A text names a public function of `harvester`.
COMMANDS = (
    Command(new, "new beam.toml --from asymmetric"),
    Study(
        "validate",
        "validate paper --output results --report paper.html",
        title="one scene, the same noise",
    ),
    Study(
        "simulate",
        "simulate paper --method circuit --set excitation.intensity=0.1 --json -",
        title=_engine,
        stem="{method}",
        waveform=True,
        failed=lambda result: result.outcome != "complete",
        bar="simulated time",
    ),
    Study(beam, "beam bimorph --output results", title="from its drawing"),
    Study("average", "average paper --method consistent", title=_engine, stem="{method}"),
    Study(
        "frequency_response",
        "frequency-response device --amplitude 4 --frequencies 5:30:linear:51 --down",
        title="frequency response",
    ),
    Study(
        "spectrum",
        "spectrum truck.csv --unit g --device device --breakpoints 12 --output truck",
        title=lambda found: f"spectrum of {found.name}",
        stem="spectrum",
    ),
    Command(verification.accuracy, "accuracy paper --output results"),
    Study(
        verification.work_precision,
        "work-precision paper --output results",
        title="error against run time",
    ),
    Command(verification.time_to_accuracy, "time-to-accuracy --output results"),
    Study(
        verification.stability,
        "stability paper --output results",
        title="stiff and extreme cases",
        failed=lambda matrix: matrix.wrong,
        running=lambda options: {"time_limit": TIME_LIMIT},
    ),
    Study(
        verification.verify,
        "verify --output results",
        title="known results",
        failed=lambda found: found.failed,
    ),
    Study(
        "basins",
        """basins device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}' """
        "--points 60 --output basins",
        title=lambda found: f"orbits of {found.scene.name}",
    ),
    Study(
        "bifurcation",
        """bifurcation device --set 'excitation={kind="sine", amplitude=6.0, frequency=8.0}' """
        "--over excitation.amplitude --values 1:12:linear:100",
        title="bifurcation",
        failed=lambda found: len(found.failures) == len(found.values) * len(found.branches),
    ),
    Study(
        "residence",
        "residence duffing --over excitation.intensity --values 0.02:0.06:log:5 --precision 0.05",
        title="residence times",
    ),
    Study(
        "sweep",
        "sweep paper --over excitation.intensity=0.005:0.1:log:7 --method monte-carlo "
        "--method fokker_planck --quantity mean_square_voltage --output swept",
        title="sweep",
        failed=lambda swept: not any(cell.estimates for _, cell in swept.places()),
    ),
    Study(
        "optimum",
        "optimum device --maximise mean_power --over load.resistance=1e4:1e7 "
        "--over oscillator.linear_stiffness=-100:-20",
        title=lambda found: f"optimum over {', '.join(found.keys)}",
        bar="function",
    ),
    Study(
        "sensitivity",
        "sensitivity paper --vary oscillator.cubic_stiffness=±10% "
        "--vary stoppers.gap=normal:2% --above 0.001 --output tolerances",
        title="sensitivity",
        json=False,
        files=SENSITIVITY_FILES,
    ),
    Study(
        "load_study",
        "load-study device --load bridge --load sece "
        "--sweep load.parameters.resistance=1e4:1e7:log:7 --precision 0.03 --output study",
        title="load study",
        failed=lambda study: not any(each.estimates for each in study.evaluations),
        json=False,
        files=LOAD_STUDY_FILES,
        running=lambda options: {"time_budget": TIME_BUDGET} if options.get("precision") else {},
    ),
    Study(
        "identify",
        "identify device --record shaker.csv load.resistance=1e5 --output identified",
        title=lambda found: f"identified from {', '.join(r.name for r in found.measurements)}",
        stem="identified",
    ),
    Command(verification.reproduce, "reproduce fig6 fig9 --quick --output results"),
    Study(verification.claims, "claims --output results", title="the paper's statements"),
    Command(circuit.schematic, "schematic device --set load.netlist=bridge --output bridge.svg"),
    Command(circuit.load, "load rectifier.net --nodes N001,N002,out,0 --output rectifier.lib"),
    Command(circuit.netlist, "netlist paper --set run.duration=100 --output paper.cir"),
    Command(circuit.export, "export device --as deck --output block", bar="export"),
    Command(cite, "cite results/paper-validate.json"),
    Command(circuit.engine, "engine --json -"),
    Command(completion, "completion bash"),
)
# Commands that `harvester --help` lists first and last; the others stand between them.
FIRST = (
    "average", "validate", "new", "simulate", "load-study", "optimum", "schematic", "identify"
)  # fmt: skip
PROOF = (
    "verify", "claims", "reproduce", "accuracy", "stability", "work-precision", "time-to-accuracy"
)  # fmt: skip

"""Every study of the runner in little: what it says, without how long it took."""

import json
import sys
from dataclasses import replace

from harvester.engines.opening import open_runner
from harvester.scene.model import Scene
from harvester.studies.optimum import line
from harvester.studies.public import frequency_response, load_study, optimum, sensitivity
from harvester.validation import accuracy_measurement as measurement
from harvester.validation import claims, reproduce, throughput
from harvester.validation import paper_figures as runs
from harvester.validation import stability as matrix
from harvester.validation import stability_cases as cases
from harvester.validation.accuracy_methods import ComparedMethod
from harvester.validation.paper_figures import FIGURES
from harvester.validation.public import accuracy, stability
from harvester.validation.statements import Claim, Trend

PAPER = Scene.read("paper", ["run.settle=5"])
BRIEF = Scene.read("linear", ["run.realizations=4", "run.duration=600", "run.settle=50"])
CLAIM = Claim(
    "4", "“q”", "rises", Trend("mean_square_voltage", "excitation.intensity", (0.02, 0.1))
)


def loads(**options):
    """Two resistances of the linear device, by Monte Carlo with its judge and by the circuit."""
    scene = Scene.read("linear").replace({"run.duration": 100.0, "run.settle": 25.0})
    sweeps = {"load.parameters.resistance": [0.3, 1.0]}
    found = []
    for engine, precision in (("judged", 0.05), ("circuit", 0.2)):
        options["method"], options["precision"] = engine, precision
        study = load_study(scene, loads=["resistor"], over=sweeps, time_budget=600.0, **options)
        found += [(e.outcome, e.realizations, e.power, e.power_error) for e in study.evaluations]
        assert study.table()
    return found


def figure(**options):
    """Two points of Fig. 7, and what the claims say of them, in one folder."""
    runs.DURATIONS = {"monte-carlo": 800.0, "circuit": 20.0}
    reproduce.QUICK = {
        "monte-carlo": reproduce.Effort(8, 0.05, 32),
        "circuit": reproduce.Effort(8, 0.6, 16),
    }
    reproduce.NOISE_CLOSURES = ("paper", "consistent")
    claims.REALIZATIONS = {"monte-carlo": 24, "circuit": 8}
    claims.METHODS = ("monte-carlo", "circuit", "paper", "consistent")
    panel = FIGURES["fig7"].panels[0]
    panel = replace(panel, first=0.02, last=0.1, quick=2, curves=panel.curves[:1])
    FIGURES["fig7"] = replace(FIGURES["fig7"], panels=(panel,))
    contents = reproduce.reproduce(PAPER, ["fig7"], quick=True, **options)
    statements = claims.claims(PAPER, chosen=[CLAIM], **options)
    return [each.to_dict() for each in (*contents, statements)]


def response(**options):
    """A linear device, both ways."""
    scene = Scene.read("linear")
    return frequency_response(scene, [0.3, 0.5], amplitude=0.3, down=True, **options).to_dict()


def tolerances(**options):
    """Two tolerances of a linear device."""
    vary = {"load.decay_rate": "±60%", "piezo.coupling": "normal:20%"}
    return sensitivity(BRIEF, vary, rows=16, above=0.01, **options).to_dict()


def maximum(**options):
    """The best load of a linear device, and the best load and noise."""
    line.SCANNED, line.REFINED = 9, 5
    one = optimum(
        BRIEF, "load.decay_rate", maximise="mean_power", closure="consistent", **options
    ).to_dict()
    over = {"load.decay_rate": (0.5, 10.0), "excitation.correlation_time": (0.1, 1.0)}
    both = optimum(BRIEF, over, maximise="mean_power", evaluations=24, **options).to_dict()
    return [one, both]


def stiff(**options):
    """Some cases of the source paper's device."""
    cases.STEP_BUDGET = 4000
    matrix.METHODS = ("circuit", "monte-carlo", "paper", "consistent")
    chosen = [cases.Case("gap", f"{gap:g}", {"gap_in_wells": gap}) for gap in (1.1, 1.2, 1.3, 1.5)]
    return stability(PAPER, cases=chosen, **options).to_dict()


def precision(**options):
    """A step of either engine on a linear device."""
    throughput.KNOTS, throughput.REPEATS = 200, 1
    measurement.PERIODS, measurement.BRIEF_KNOTS = 1, 400
    measurement.NOISE_CLOSURES = ("paper",)
    circuit = ComparedMethod("circuit", "circuit", 2, brief=True)
    measurement.METHODS = (circuit, ComparedMethod("MC", "monte-carlo", 4))
    return accuracy(BRIEF, **options).to_dict()


STUDIES = {
    "load-study": loads,
    "reproduce and claims": figure,
    "frequency-response": response,
    "sensitivity": tolerances,
    "optimum": maximum,
    "stability": stiff,
    "accuracy": precision,
}
# Keys of what differs from one run to another: times on the wall, and what is made of them.
TIMED = (
    "seconds", "wall_seconds", "seconds_per_unit", "seconds_to_one_percent", "throughput",
    "wall_seconds_per_second", "seconds_to",
)  # fmt: skip


def timeless(told):
    """Nested plain values without times on the wall."""
    if isinstance(told, dict):
        return {key: timeless(value) for key, value in told.items() if key not in TIMED}
    return [timeless(each) for each in told] if isinstance(told, (list, tuple)) else told


def told(kind, **options):
    """What one of `STUDIES` says, as text."""
    return json.dumps(timeless(STUDIES[kind](**options)))


def main():
    """Print what the study of the first argument says; its folder is the second."""
    with open_runner(sys.argv[2], workers=2) as runner:
        print(told(sys.argv[1], runner=runner))

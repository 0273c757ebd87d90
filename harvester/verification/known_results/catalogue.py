"""The results that `verify` compares with, each with its source: a new one is one more entry."""

import math

from harvester.device import timescales
from harvester.excitation.base import kernel_loss
from harvester.prepared.prepared import prepared
from harvester.prepared.steps import knot_spacing
from harvester.running import Request
from harvester.running.task import Task
from harvester.scene.model import Scene
from harvester.verification.known_results import formulas, tasks
from harvester.verification.known_results.truth import Truth

# Share by which near-ideal diodes and coils, and the ripple of the storage, leave a closed form.
IDEAL_PARTS = 0.03
# Share of a mean that the numerical error of the circuit's and Monte Carlo's steps may take.
STEPS = 0.005
# Share that Kramers' formula itself is off at a barrier of five temperatures.
KRAMERS = 0.15
BARRIER = 5.0
SOLVER = "fokker_planck"
# Knots of scaled scenes so close that the noise is white for every motion.
WHITE = {"kind": "white", "knot_spacing": 0.05}
# Without an effect on the motion.
UNCOUPLED = {"piezo.coupling": 1e-6}
# θ (N/V), u (m), f (Hz) of a piezo in prescribed motion, and the quality of its switched coil.
PRESCRIBED = {"amplitude": 0.005, "frequency": 12.0}
QUALITY = 8.0
# (f, Ω) of published high orbits and ten times their mean power.
ORBITS = (
    (0.0922, 0.7500, 0.0164),
    (0.0997, 0.7500, 0.0165),
    (0.0962, 0.7684, 0.0170),
    (0.0999, 0.7786, 0.0172),
)
ORBIT_STARTS = tuple(
    {"start.displacement": x, "start.velocity": v}
    for x in (1.0, 2.0, -2.0, 0.0)
    for v in (0.0, 1.0, 2.0)
)
ORBIT_SOURCE = "HarvesterOpt (americocunhajr), DS_2var; Nonlinear Dynamics 103, 137"
# Of paths by others: source, and the difference that their steps and ours leave.
PATH = {"run.duration": 50.0, "run.settle": 0.0, "run.realizations": 1}
OTHERS = {
    "DOP853": ("scipy's DOP853 at 3e-14", 1e-4),
    "Radau": ("scipy's Radau on the node equations", 1e-4),
    "ngspice -b": ("plain ngspice on the exported netlist", 1e-4),
    # At the longest step alone, without steps cut by the local error.
    "VACASK": ("VACASK, another simulator, on the exported netlist", 5e-4),
}
# Half a width of the resonance off it, and the words for that.
FLANKS = ((-1.0, "on the lower flank"), (0.0, "on resonance"), (1.0, "on the upper flank"))
SHU_LIEN = "standard interface, Ottman et al. 2002"


def catalogue() -> list[Truth]:
    """All of them."""
    return [
        *_linear_piezo(),
        *_linear_coil(),
        *_gibbs(),
        _kramers(),
        *_mass_law(),
        *_loads(),
        *_coupled_bridges(),
        *_coupled_sece(),
        *_flanks_of_a_resistor(),
        *_flanks_of_a_bridge(),
        *_rebounds(),
        *_paths(),
        *_orbits(),
    ]


def _linear_piezo():
    source = "closed form of a linear oscillator with a piezo under Ornstein-Uhlenbeck noise"
    for decay_rate, memory in ((2.0, 0.4), (0.2, 0.4), (20.0, 0.1)):
        changes = {
            "load.decay_rate": decay_rate,
            "excitation.correlation_time": memory,
            "excitation.knot_spacing": memory / 40.0,
            "run.duration": 1000.0,
        }
        scene = Scene.load("linear").replace(changes)
        system = prepared(scene).system
        # Where the load decays within a step the stationary solver refuses.
        methods = ("circuit", "monte-carlo", SOLVER)[: 3 if decay_rate < 10.0 else 2]
        exact = formulas.linear_piezo_power(
            system.damper.damping,
            4.0,
            system.transducer.coupling,
            decay_rate,
            scene.excitation.intensity,
            memory,
        )
        # Straight lines between knots take this share of the noise's variance.
        allowance = (1.0 / 120.0 + STEPS) * exact
        yield Truth(
            f"power of a linear piezo harvester, lambda = {decay_rate:g}, tau1 = {memory:g}",
            source,
            exact,
            allowance,
            {method: Request(scene, method) for method in methods},
            "mean_power",
        )


def _linear_coil():
    for resistance in (400.0, 4000.0):
        changes = {
            "oscillator.restoring_force": [0.0, 15.393],
            "load.resistance": resistance,
            "excitation": {"kind": "white", "intensity": 0.3, "knot_spacing": 5e-4},
        }
        scene = Scene.load("electromagnetic").replace(changes)
        exact = formulas.linear_coil_power(0.0103, 0.047, 14.9, 391.0, resistance, 0.3)
        yield Truth(
            f"power of a linear coil harvester in white noise, R = {resistance:g} ohm",
            "mass law: E[eta x'] = D whatever the spring",
            exact,
            (_white_loss(scene) + STEPS) * exact,
            {method: Request(scene, method) for method in ("circuit", "monte-carlo", SOLVER)},
            "mean_power",
            "W",
        )


def _white_loss(scene):
    """Share that white noise lacks between knots: of its density, and to the device's memory."""
    ready = prepared(scene)
    system = ready.system
    spacing, frequency = knot_spacing(ready), timescales.angular_frequency(system)
    damping = system.damper.damping + system.transducer.damping()
    return kernel_loss(spacing, frequency) + damping * spacing / math.sqrt(6.0)


def _double_well(damping, temperature, **run):
    """ω0² = κ = 1 in white noise: wells at ±1, a barrier of ¼."""
    changes = {
        "oscillator.damping": damping,
        "oscillator.linear_stiffness": -1.0,
        "oscillator.cubic_stiffness": 1.0,
        "excitation": {**WHITE, "intensity": damping * temperature},
        **UNCOUPLED,
        **{f"run.{key}": value for key, value in run.items()},
    }
    return Scene.load("duffing").replace(changes)


def _gibbs():
    for temperature in (0.1, 0.5):
        scene = _double_well(0.2, temperature, duration=4000.0)
        exact = formulas.gibbs_mean(lambda x: -(x**2) / 2 + x**4 / 4, temperature, lambda x: x * x)
        asked = {method: Request(scene, method) for method in ("monte-carlo", SOLVER)}
        title = f"E[X^2] of a double well in white noise, T = {temperature:g}"
        allowance = (_white_loss(scene) + STEPS) * exact
        yield Truth(title, "Gibbs", exact, allowance, asked, "mean_square_displacement")
        yield Truth(
            f"E[X'^2] of a double well in white noise, T = {temperature:g}",
            "Gibbs, equipartition",
            temperature,
            (_white_loss(scene) + STEPS) * temperature,
            asked,
            "mean_square_velocity",
        )


def _kramers():
    damping = 0.5
    scene = _double_well(damping, 0.25 / BARRIER, duration=20_000.0)
    exact = formulas.kramers_rate(damping, math.sqrt(2.0), 1.0, BARRIER)
    return Truth(
        f"jumps between two wells, barrier {BARRIER:g} T",
        "Kramers 1940, moderate damping",
        exact,
        KRAMERS * exact,
        {"monte-carlo": Request(scene, "monte-carlo")},
        "jump_rate",
        "1/s",
    )


def _mass_law():
    source = "mass law: E[eta x'] = D in white noise, any spring, contacts and load"
    white = {**WHITE, "intensity": 0.1}
    scene = Scene.load("paper").replace({"excitation": white})
    yield _input_power(scene, "with stoppers", source, 0.1, "scaled", "circuit", "monte-carlo")
    white = {"kind": "white", "intensity": 0.3}
    changes = {"excitation": white, "load.netlist": "bridge"}
    scene = Scene.load("device").replace(changes)
    yield _input_power(scene, "behind a bridge", source, 0.022 * 0.3, "W", "monte-carlo")


def _input_power(scene, what, source, exact, unit, *methods):
    allowance = (_white_loss(scene) + 2.0 * STEPS) * exact
    asked = {method: Request(scene, method) for method in methods}
    title = f"mechanical power taken in, bistable {what}"
    return Truth(title, source, exact, allowance, asked, "mean_input_power", unit)


def _loads():
    base = Scene.load("device").replace({"length_scale": None})
    theta, capacitance = base.transducer.coupling, base.transducer.capacitance
    omega = 2.0 * math.pi * PRESCRIBED["frequency"]
    unit = theta**2 * PRESCRIBED["amplitude"] ** 2 * omega / capacitance
    period = 1.0 / PRESCRIBED["frequency"]
    run = {"run.duration": 10 * period, "run.settle": 40 * period, "run.realizations": 1}
    excitation = {"kind": "prescribed_displacement", **PRESCRIBED}
    base = base.replace({"excitation": excitation, **run})

    def truth(name, source, resistance, exact, **parameters):
        resistance /= omega * capacitance
        values = {"resistance": resistance, **parameters}
        if name != "resistor":
            values |= {"diode": 0, "storage": 10.0 * period / resistance}
            values["initial"] = math.sqrt(exact * resistance)
        changes = {"load.netlist": name, "load.parameters": values}
        asked = {"circuit": Request(base.replace(changes), "circuit")}
        share = STEPS if name == "resistor" else IDEAL_PARTS
        quantity = "mean_power" if name == "resistor" else "mean_output_power"
        title = f"{name} on a prescribed sine, omega C R = {resistance * omega * capacitance:.3g}"
        return Truth(title, source, exact, share * exact, asked, quantity, "W")

    for share in (0.3, 1.0, 4.0):
        yield truth("resistor", "Ohm's law", share, formulas.resistor_power(unit, share))
    for share in (0.25, 1.0, 4.0):
        power = formulas.bridge_power(unit, share)
        yield truth("bridge", SHU_LIEN, share * math.pi / 2.0, power)
    switched = {
        "capacitance": capacitance,
        "inversion_time": period / 400.0,
        "sense_time": period / 1000.0,
    }
    for name, source, power in (
        ("sshi_parallel", "Guyomar et al. 2005", formulas.parallel_sshi_power(unit, QUALITY)),
        ("sshi_series", "Lefeuvre et al. 2006", formulas.series_sshi_power(unit, QUALITY)),
        ("sece", "Lefeuvre et al. 2005", formulas.sece_power(unit)),
    ):
        quality = 1000.0 if name == "sece" else QUALITY
        resistance = formulas.best_resistance(name, QUALITY)
        yield truth(name, source, resistance, power, quality=quality, **switched)


def _unit_device(coupling, capacitance, damping, force, omega, load, settle, duration):
    """Mass and spring of 1 under F0 sin ωt, in SI with units of 1."""
    frequency = omega / (2.0 * math.pi)
    tables = {
        "units": "SI",
        "length_scale": 1.0,
        "oscillator": {"mass": 1.0, "damping": damping, "linear_stiffness": 1.0},
        "piezo": {"coupling": coupling, "capacitance": capacitance},
        "excitation": {"kind": "sine", "amplitude": force, "frequency": frequency},
        "load": load,
        "run": {"seed": 1, "realizations": 1, "settle": settle, "duration": duration},
    }
    return Scene.from_tables(tables, name="unit device")


def _coupled_bridges():
    damping, force, coupling = 0.08, 3.0, 1e-3
    for ratio in (0.01, 0.09, 0.3):
        capacitance = coupling**2 / ratio
        omega, resistance, exact = formulas.best_coupled_bridge(
            force, damping, coupling, capacitance
        )
        values = {"diode": 0, "resistance": resistance, "storage": 60.0 / resistance}
        load = {"netlist": "bridge", "parameters": values}
        run = 600.0, 200.0 * math.pi / omega
        scene = _unit_device(coupling, capacitance, damping, force, omega, load, *run)
        asked = {"monte-carlo": Request(scene, "monte-carlo")}
        title = f"coupled bridge at its best frequency and resistance, theta^2/(k Cp) = {ratio:g}"
        source = "Shu and Lien 2006"
        yield Truth(title, source, exact, 0.02 * exact, asked, "mean_output_power", "W")


def _flanks_of_a_resistor():
    """On resonance and where the power is about half of that: steps must not shift it."""
    damping, force, coupling, capacitance = 1e-3, 1e-3, 1e-3, 2e-3
    resistance = 0.2 / capacitance
    for side, words in FLANKS:
        omega = 1.0 + side * 0.5 * damping
        run = 25.0 / damping, 200.0 * math.pi / omega
        load = {"resistance": resistance}
        scene = _unit_device(coupling, capacitance, damping, force, omega, load, *run)
        exact = formulas.resistor_power_at(omega, resistance, force, damping, coupling, capacitance)
        asked = {method: Request(scene, method) for method in ("circuit", "monte-carlo")}
        title = f"resistor at Q = 1000, {words}"
        yield Truth(title, "linear circuit", exact, STEPS * exact, asked, "mean_power", "W")


def _flanks_of_a_bridge():
    damping, force, coupling, ratio = 0.01, 3.0, 1e-3, 0.01
    capacitance = coupling**2 / ratio
    resistance = 0.5 * math.pi / capacitance
    numbers = resistance, force, damping, coupling, capacitance
    peak = max(
        (1.0 + ratio * k / 1000.0 for k in range(1001)),
        key=lambda omega: formulas.coupled_bridge_power(omega, *numbers),
    )
    values = {"diode": 0, "resistance": resistance, "storage": 60.0 / resistance}
    load = {"netlist": "bridge", "parameters": values}
    for side, words in FLANKS:
        omega = peak * (1.0 + side * 0.5 * damping)
        run = 40.0 / damping, 200.0 * math.pi / omega
        scene = _unit_device(coupling, capacitance, damping, force, omega, load, *run)
        exact = formulas.coupled_bridge_power(omega, *numbers)
        asked = {method: Request(scene, method) for method in ("circuit", "monte-carlo")}
        title = f"bridge at Q = 100, {words}"
        source = "Shu and Lien 2006"
        yield Truth(title, source, exact, 0.02 * exact, asked, "mean_output_power", "W")


def _coupled_sece():
    share, coupling = 0.005, 1e-3
    capacitance = coupling**2 / share
    load = {
        "netlist": "sece",
        "parameters": {
            "diode": 0,
            "resistance": 0.1 / capacitance,
            "storage": 400.0 * capacitance,
            "capacitance": capacitance,
            "inversion_time": 0.02,
            "sense_time": 0.005,
            "quality": 1000,
            "threshold": 1e-6,
            "residual": 0.5,
        },
    }
    for figure in (0.1, math.pi / 4.0, math.pi):
        quality = figure / share
        damping, force, run = 1.0 / quality, 100.0 / quality, (10.0 * quality, 100.0 * math.pi)
        scenes = [
            _unit_device(coupling, capacitance, damping, force, omega, load, *run)
            for omega in (math.sqrt(1.0 + share * shift) for shift in (0.6, 0.8, 1.0, 1.2, 1.4))
        ]
        exact = formulas.coupled_sece_share(figure) * force**2 / (8.0 * damping)
        title = f"SECE at its best frequency, k^2 Q = {figure:.3g}"
        source = "Lefeuvre et al. 2006"
        yield Truth(title, source, exact, 0.02 * exact, _highest_power(scenes), unit="W")


def _highest_power(scenes):
    call = {"scenes": scenes, "engine": "monte-carlo", "quantity": "mean_power"}
    return {"monte-carlo": Task(tasks.highest, call, label="highest", time_limits=len(scenes))}


def _task(function, scene, engine, **arguments):
    call = {"scene": scene, "engine": engine, **arguments}
    return Task(function, call, label=function.__name__)


def _rebounds():
    lonely = {
        "oscillator.damping": 1e-12,
        "oscillator.linear_stiffness": 1e-12,
        "oscillator.cubic_stiffness": 0.0,
        "piezo.coupling": 1e-12,
        "excitation.intensity": 1e-30,
        "excitation.knot_spacing": 0.01,
        "stoppers.impact_velocity": "event",
        "start.velocity": 1.0,
        "run.duration": 3.0,
        "run.settle": 0.0,
        "run.realizations": 1,
    }
    for restitution in (0.3, 0.7, 1.0):
        scene = Scene.load("paper").replace({**lonely, "stoppers.restitution": restitution})
        yield Truth(
            f"speed after a drop on a Hertz-damp stopper, e = {restitution:g}",
            "rebound law of the contact's equation of motion",
            formulas.rebound_speed(restitution),
            1e-3,
            {e: _task(tasks.rebound, scene, e) for e in ("circuit", "monte-carlo")},
        )


def _paths():
    paper = Scene.load("paper").replace(PATH)
    asymmetric = Scene.load("asymmetric").replace({**PATH, "run.duration": 1.0})
    load = {"netlist": "bridge", "parameters": {"resistance": 2e5, "storage": 2e-7}}
    bridge = Scene.load("device").replace({**PATH, "run.duration": 0.4, "load": load})
    for other, scene, named, column in (
        ("DOP853", paper, "of paper", "displacement"),
        ("DOP853", asymmetric, "of asymmetric", "displacement"),
        ("ngspice -b", paper, "of paper", "displacement"),
        ("VACASK", paper, "of paper", "displacement"),
        ("Radau", bridge, "behind a bridge", "voltage"),
        ("ngspice -b", bridge, "behind a bridge", "voltage"),
        ("VACASK", bridge, "behind a bridge", "voltage"),
    ):
        source, allowance = OTHERS[other]
        call = {"step": "finest", "other": other, "column": column}
        yield Truth(
            f"one path {named} by {other}: rms difference over rms {column}",
            source,
            0.0,
            allowance,
            {e: _task(tasks.path_deviation, scene, e, **call) for e in ("circuit", "monte-carlo")},
        )


def _orbits():
    for amplitude, frequency, power in ORBITS:
        changes = {
            "oscillator.damping": 0.02,
            "oscillator.linear_stiffness": -0.5,
            "oscillator.cubic_stiffness": 0.5,
            "piezo.coupling": 0.025,
            "load.decay_rate": 0.05,
            "excitation": {
                "kind": "sine",
                "amplitude": amplitude,
                "frequency": frequency / (2.0 * math.pi),
                "phase": math.pi / 2.0,
            },
            "run.duration": 100 * 2.0 * math.pi / frequency,
            "run.settle": 1000.0,
            "run.realizations": 1,
        }
        scene = Scene.load("duffing").replace(changes)
        yield Truth(
            f"high orbit of a bistable harvester, f = {amplitude:g}, Omega = {frequency:g}",
            ORBIT_SOURCE,
            power / 10.0,
            0.02 * power / 10.0,
            _highest_power([scene.replace(start) for start in ORBIT_STARTS]),
        )

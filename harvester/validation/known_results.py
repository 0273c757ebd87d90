"""The results that `verify` compares with, each with its source: a new one is one more entry."""

import math

from harvester.device import timescales
from harvester.device.piezo import PiezoTable
from harvester.engines.request import Request
from harvester.engines.task import Task
from harvester.excitation.base import kernel_loss
from harvester.excitation.ornstein_uhlenbeck import OrnsteinUhlenbeck
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.scene.steps import knot_spacing
from harvester.validation import formulas, tasks
from harvester.validation.truth import Truth

# Near-ideal diodes and coils, and the ripple of the storage, deviate from the closed form by this
# share.
IDEAL_PARTS = 0.03
# The steps of circuit and Monte Carlo may change a mean by this share.
STEPS = 0.005
# One harmonic, or a published power with two digits, may be off by this share.
TWO_DIGITS = 0.02
# Kramers' formula itself is off by this share at a barrier of five temperatures.
KRAMERS = 0.15
BARRIER = 5.0
CIRCUIT, MONTE_CARLO, SOLVER = "circuit", "monte-carlo", "fokker_planck"
SPECTRAL = "spectral"
ENGINES = (CIRCUIT, MONTE_CARLO)
# With knots so close (in scaled scenes) the noise is white for every motion.
WHITE = {"kind": "white", "knot_spacing": 0.05}
# A coupling so weak that it does not affect the motion.
UNCOUPLED = {"piezo.coupling": 1e-6}
# Amplitude (m) and frequency (Hz) of a piezo in prescribed motion; below, the quality factor of its
# switched coil.
PRESCRIBED = {"amplitude": 0.005, "frequency": 12.0}
QUALITY = 8.0
# Published high orbits: forcing f, frequency Ω, and ten times the mean power.
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
SINGLE_PATH = {"run.settle": 0.0, "run.realizations": 1}
# Paths by other programs: the source, and the largest difference that their steps and ours explain.
OTHERS = {
    "DOP853": ("scipy's DOP853 at 3e-14", 1e-4),
    "Radau": ("scipy's Radau on the node equations", 1e-4),
    "ngspice -b": ("plain ngspice on the exported netlist", 1e-4),
    # VACASK runs at the longest step alone, without control by the local error.
    "VACASK": ("VACASK, another simulator, on the exported netlist", 5e-4),
}
# Distances from the resonance, in half widths, and their names.
FLANKS = ((-1.0, "on the lower flank"), (0.0, "on resonance"), (1.0, "on the upper flank"))
SHU_LIEN = "Shu and Lien 2006"


def catalogue() -> list[Truth]:
    """All known results."""
    return [
        *_linear_piezo(),
        *_linear_coil(),
        _spectrum(),
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


def _within(share, title, source, exact, asked, quantity="", unit="scaled"):
    """A truth that is met within a share of itself."""
    return Truth(title, source, exact, share * exact, asked, quantity, unit)


def _by(scene, *methods):
    return {method: Request(scene, method) for method in methods}


def _linear_piezo():
    source = "closed form of a linear oscillator with a piezo under Ornstein-Uhlenbeck noise"
    for decay_rate, memory in ((2.0, 0.4), (0.2, 0.4), (20.0, 0.1)):
        changes = {
            "load.decay_rate": decay_rate,
            "excitation.correlation_time": memory,
            "excitation.knot_spacing": memory / 40.0,
            "run.duration": 1000.0,
        }
        scene = Scene.read("linear").replace(changes)
        system = prepared(scene).system
        # The stationary solver refuses loads that decay within a step.
        methods = (*ENGINES, SOLVER) if decay_rate < 10.0 else ENGINES
        coupling, noise = system.transducer.coupling, scene.excitation
        assert isinstance(noise, OrnsteinUhlenbeck)
        exact = formulas.linear_piezo_power(
            system.damper.damping, 4.0, coupling, decay_rate, noise.intensity, memory
        )
        title = f"power of a linear piezo harvester, lambda = {decay_rate:g}, tau1 = {memory:g}"
        # Straight lines between knots lower the variance of the noise by 1/120.
        share = 1.0 / 120.0 + STEPS
        yield _within(share, title, source, exact, _by(scene, *methods), "mean_power")


def _linear_coil():
    for resistance in (400.0, 4000.0):
        changes = {
            "oscillator.restoring_force": [0.0, 15.393],
            "load.resistance": resistance,
            "excitation": {"kind": "white", "intensity": 0.3, "knot_spacing": 5e-4},
        }
        scene = Scene.read("electromagnetic").replace(changes)
        exact = formulas.linear_coil_power(0.0103, 0.047, 14.9, 391.0, resistance, 0.3)
        title = f"power of a linear coil harvester in white noise, R = {resistance:g} ohm"
        source = "mass law: E[eta x'] = D whatever the spring"
        asked, share = _by(scene, *ENGINES, SOLVER), _white_loss(scene) + STEPS
        yield _within(share, title, source, exact, asked, "mean_power", "W")


def _spectrum():
    points = ((0.1, 0.02), (0.25, 0.02), (0.3, 0.1), (1.0, 0.004))
    excitation = {"kind": "spectrum", "unit": "scaled", "breakpoints": points}
    changes = {"load.decay_rate": 2.0, "excitation": excitation, "run.duration": 1000.0}
    scene = Scene.read("linear").replace(changes)
    system = prepared(scene).system
    exact = formulas.power_of_spectrum(
        system.damper.damping, 4.0, system.transducer.coupling, 2.0, points
    )
    title, source = "power of a linear piezo harvester by breakpoints", "integral of |H|^2 G"
    return _within(STEPS, title, source, exact, _by(scene, *ENGINES, SPECTRAL), "mean_power")


def _white_loss(scene):
    """Share that white noise lacks between knots: of its density, and to the device's memory."""
    model = prepared(scene)
    system = model.system
    spacing, frequency = knot_spacing(model), timescales.angular_frequency(system)
    damping = system.damper.damping + system.transducer.damping()
    return kernel_loss(spacing, frequency) + damping * spacing / math.sqrt(6.0)


def _double_well(damping, temperature, duration):
    """ω0² = κ = 1 in white noise: wells at ±1, a barrier of ¼."""
    changes = {
        "oscillator.damping": damping,
        "oscillator.linear_stiffness": -1.0,
        "oscillator.cubic_stiffness": 1.0,
        "excitation": {**WHITE, "intensity": damping * temperature},
        **UNCOUPLED,
        "run.duration": duration,
    }
    return Scene.read("duffing").replace(changes)


def _gibbs():
    for temperature in (0.1, 0.5):
        scene = _double_well(0.2, temperature, 4000.0)
        asked, share = _by(scene, MONTE_CARLO, SOLVER), _white_loss(scene) + STEPS
        exact = formulas.gibbs_mean(lambda x: -(x**2) / 2 + x**4 / 4, temperature, lambda x: x * x)
        for title, source, mean, quantity in (
            ("E[X^2]", "Gibbs", exact, "mean_square_displacement"),
            ("E[X'^2]", "Gibbs, equipartition", temperature, "mean_square_velocity"),
        ):
            title += f" of a double well in white noise, T = {temperature:g}"
            yield _within(share, title, source, mean, asked, quantity)


def _kramers():
    damping = 0.5
    scene = _double_well(damping, 0.25 / BARRIER, 20_000.0)
    exact = formulas.kramers_rate(damping, math.sqrt(2.0), 1.0, BARRIER)
    title = f"jumps between two wells, barrier {BARRIER:g} T"
    source = "Kramers 1940, moderate damping"
    return _within(KRAMERS, title, source, exact, _by(scene, MONTE_CARLO), "jump_rate", "1/s")


def _mass_law():
    source = "mass law: E[eta x'] = D in white noise, any spring, contacts and load"
    stopped = Scene.read("paper").replace({"excitation": {**WHITE, "intensity": 0.1}})
    white = {"kind": "white", "intensity": 0.3}
    loaded = Scene.read("device").replace({"excitation": white, "load.netlist": "bridge"})
    for scene, what, exact, unit, methods in (
        (stopped, "with stoppers", 0.1, "scaled", ENGINES),
        (loaded, "behind a bridge", 0.022 * 0.3, "W", [MONTE_CARLO]),
    ):
        share = _white_loss(scene) + 2.0 * STEPS
        title = f"mechanical power taken in, bistable {what}"
        yield _within(share, title, source, exact, _by(scene, *methods), "mean_input_power", unit)


def _loads():
    base = Scene.read("device").replace({"length_scale": None})
    piezo = base.transducer
    assert isinstance(piezo, PiezoTable)
    theta, capacitance = piezo.coupling, piezo.capacitance
    omega = 2.0 * math.pi * PRESCRIBED["frequency"]
    unit = theta**2 * PRESCRIBED["amplitude"] ** 2 * omega / capacitance
    period = 1.0 / PRESCRIBED["frequency"]
    run = {"run.duration": 10 * period, "run.settle": 40 * period, "run.realizations": 1}
    excitation = {"kind": "prescribed_displacement", **PRESCRIBED}
    base = base.replace({"excitation": excitation, **run})

    def truth(name, source, share, exact, **parameters):
        """`share` is ωCR."""
        resistance = share / (omega * capacitance)
        values = {"resistance": resistance, **parameters}
        ideal, quantity = STEPS, "mean_power"
        if name != "resistor":
            values |= {"diode": 0, "storage": 10.0 * period / resistance}
            values["initial"] = math.sqrt(exact * resistance)
            ideal, quantity = IDEAL_PARTS, "mean_output_power"
        scene = base.replace({"load.netlist": name, "load.parameters": values})
        title = f"{name} on a prescribed sine, omega C R = {resistance * omega * capacitance:.3g}"
        return _within(ideal, title, source, exact, _by(scene, CIRCUIT), quantity, "W")

    for share in (0.3, 1.0, 4.0):
        yield truth("resistor", "Ohm's law", share, formulas.resistor_power(unit, share))
    for share in (0.25, 1.0, 4.0):
        power = formulas.bridge_power(unit, share)
        yield truth(
            "bridge", "standard interface, Ottman et al. 2002", share * math.pi / 2.0, power
        )
    switched = {
        "capacitance": capacitance,
        "inversion_time": period / 400.0,
        "sense_time": period / 1000.0,
    }
    for name, source in (
        ("sshi_parallel", "Guyomar et al. 2005"),
        ("sshi_series", "Lefeuvre et al. 2006"),
        ("sece", "Lefeuvre et al. 2005"),
    ):
        quality = 1000.0 if name == "sece" else QUALITY
        share, power = formulas.switched_load(name, unit, QUALITY)
        yield truth(name, source, share, power, quality=quality, **switched)


def _unit_device(device, omega, load, settle, duration=None):
    """The scene of a `Driven` device, in SI with units of 1, measured for 100 periods."""
    frequency = omega / (2.0 * math.pi)
    duration = duration or 200.0 * math.pi / omega
    tables = {
        "units": "SI",
        "length_scale": 1.0,
        "oscillator": {"mass": 1.0, "damping": device.damping, "linear_stiffness": 1.0},
        "piezo": {"coupling": device.coupling, "capacitance": device.capacitance},
        "excitation": {"kind": "sine", "amplitude": device.force, "frequency": frequency},
        "load": load,
        "run": {"seed": 1, "realizations": 1, "settle": settle, "duration": duration},
    }
    return Scene.from_tables(tables, name="unit device")


def _ideal_bridge(resistance):
    values = {"diode": 0, "resistance": resistance, "storage": 60.0 / resistance}
    return {"netlist": "bridge", "parameters": values}


def _coupled_bridges():
    coupling = 1e-3
    for ratio in (0.01, 0.09, 0.3):
        device = formulas.Driven(3.0, 0.08, coupling, coupling**2 / ratio)
        omega, resistance, exact = formulas.best_coupled_bridge(device)
        scene = _unit_device(device, omega, _ideal_bridge(resistance), 600.0)
        title = f"coupled bridge at its best frequency and resistance, theta^2/(k Cp) = {ratio:g}"
        asked = _by(scene, MONTE_CARLO)
        yield _within(TWO_DIGITS, title, SHU_LIEN, exact, asked, "mean_output_power", "W")


def _flanks_of_a_resistor():
    """A resistor on resonance and at half power beside it: steps must not shift the resonance."""
    device = formulas.Driven(force=1e-3, damping=1e-3, coupling=1e-3, capacitance=2e-3)
    resistance, damping = 0.2 / device.capacitance, device.damping
    for side, words in FLANKS:
        omega = 1.0 + side * 0.5 * damping
        scene = _unit_device(device, omega, {"resistance": resistance}, 25.0 / damping)
        exact = formulas.resistor_power_at(omega, resistance, device)
        title = f"resistor at Q = 1000, {words}"
        asked = _by(scene, *ENGINES)
        yield _within(STEPS, title, "linear circuit", exact, asked, "mean_power", "W")


def _flanks_of_a_bridge():
    ratio, coupling = 0.01, 1e-3
    device = formulas.Driven(3.0, 0.01, coupling, coupling**2 / ratio)
    resistance, damping = 0.5 * math.pi / device.capacitance, device.damping

    def power(omega):
        return formulas.coupled_bridge_power(omega, resistance, device)

    peak = max((1.0 + ratio * k / 1000.0 for k in range(1001)), key=power)
    for side, words in FLANKS:
        omega = peak * (1.0 + side * 0.5 * damping)
        scene = _unit_device(device, omega, _ideal_bridge(resistance), 40.0 / damping)
        title = f"bridge at Q = 100, {words}"
        asked = _by(scene, *ENGINES)
        yield _within(TWO_DIGITS, title, SHU_LIEN, power(omega), asked, "mean_output_power", "W")


def _coupled_sece():
    share, coupling = 0.005, 1e-3
    capacitance = coupling**2 / share
    values = {
        "diode": 0,
        "resistance": 0.1 / capacitance,
        "storage": 400.0 * capacitance,
        "capacitance": capacitance,
        "inversion_time": 0.02,
        "sense_time": 0.005,
        "quality": 1000,
        "threshold": 1e-6,
        "residual": 0.5,
    }
    load = {"netlist": "sece", "parameters": values}
    for figure in (0.1, math.pi / 4.0, math.pi):
        quality = figure / share
        force, damping = 100.0 / quality, 1.0 / quality
        device = formulas.Driven(force, damping, coupling, capacitance)
        omegas = [math.sqrt(1.0 + share * shift) for shift in (0.6, 0.8, 1.0, 1.2, 1.4)]
        scenes = [
            _unit_device(device, omega, load, 10.0 * quality, 100.0 * math.pi) for omega in omegas
        ]
        exact = formulas.coupled_sece_share(figure) * force**2 / (8.0 * damping)
        title = f"SECE at its best frequency, k^2 Q = {figure:.3g}"
        asked = _highest_power(scenes)
        yield _within(TWO_DIGITS, title, "Lefeuvre et al. 2006", exact, asked, unit="W")


def _highest_power(scenes):
    call = {"scenes": scenes, "engine": MONTE_CARLO, "quantity": "mean_power"}
    return {MONTE_CARLO: Task(tasks.highest, call, label="highest", time_limits=len(scenes))}


def _tasks(function, scene, **arguments):
    """The task of this result for each engine."""
    calls = {engine: {"scene": scene, "engine": engine, **arguments} for engine in ENGINES}
    return {engine: Task(function, call, label=function.__name__) for engine, call in calls.items()}


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
        **SINGLE_PATH,
    }
    source = "rebound law of the contact's equation of motion"
    for restitution in (0.3, 0.7, 1.0):
        scene = Scene.read("paper").replace({**lonely, "stoppers.restitution": restitution})
        title = f"speed after a drop on a Hertz-damp stopper, e = {restitution:g}"
        exact = formulas.rebound_speed(restitution)
        yield Truth(title, source, exact, 1e-3, _tasks(tasks.rebound, scene))


def _paths():
    load = {"netlist": "bridge", "parameters": {"resistance": 2e5, "storage": 2e-7}}
    paper, asymmetric, bridge = (
        Scene.read(name).replace({**SINGLE_PATH, **changes})
        for name, changes in (
            ("paper", {"run.duration": 50.0}),
            ("asymmetric", {"run.duration": 1.0}),
            ("device", {"run.duration": 0.4, "load": load}),
        )
    )
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
        title = f"one path {named} by {other}: rms difference over rms {column}"
        yield Truth(title, source, 0.0, allowance, _tasks(tasks.path_deviation, scene, **call))


def _orbits():
    for amplitude, frequency, power in ORBITS:
        excitation = {
            "kind": "sine",
            "amplitude": amplitude,
            "frequency": frequency / (2.0 * math.pi),
            "phase": math.pi / 2.0,
        }
        changes = {
            "oscillator.damping": 0.02,
            "oscillator.linear_stiffness": -0.5,
            "oscillator.cubic_stiffness": 0.5,
            "piezo.coupling": 0.025,
            "load.decay_rate": 0.05,
            "excitation": excitation,
            "run.duration": 100 * 2.0 * math.pi / frequency,
            "run.settle": 1000.0,
            "run.realizations": 1,
        }
        scene = Scene.read("duffing").replace(changes)
        asked = _highest_power([scene.replace(start) for start in ORBIT_STARTS])
        title = f"high orbit of a bistable harvester, f = {amplitude:g}, Omega = {frequency:g}"
        yield _within(TWO_DIGITS, title, ORBIT_SOURCE, power / 10.0, asked)

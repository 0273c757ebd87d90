"""What there is to be put together: devices, loads, excitations and commands, each by overrides.

A value of a dimension is a name with what it adds to the call. Together they make a scene that is
run as briefly as its command allows.
"""

import itertools

import numpy as np

from harvester.scene.model import Scene
from harvester.scene.prepared import prepared

# Of a run, a quarter of them to settle in; an optimum is refused where each mean is of fewer.
PERIODS, PERIODS_OF_AN_OPTIMUM = 6.0, 12.0
STOPPER = 'gap = 1.1, stiffness = 10.0, restitution = 0.7, side = "{}"'
RIGHT = "{" + STOPPER.format("right") + "}"
LEFT = "{" + STOPPER.format("left").replace("1.1", "0.7") + ', impact_velocity = "event"}'

# Name → built-in scene and what is changed of it.
DEVICES = {
    **{name: (name, ()) for name in Scene.names()},
    "one side of paper": ("paper", (f"stoppers=[{RIGHT}]",)),
    "uneven stoppers": ("duffing", (f"stoppers=[{RIGHT}, {LEFT}]",)),
    "held impact velocity": ("paper", ("stoppers.impact_velocity=event",)),
    "leak and drag": (
        "device",
        ("piezo.leakage_resistance=1e6", "oscillator.quadratic_damping=0.05"),
    ),
    "coil with inductance": ("electromagnetic", ("coil.inductance=0.2",)),
    "start": ("asymmetric", ("start.displacement=0.003", "start.velocity=0.1")),
}
# {d} is D, {a} an acceleration and {l} a length of the device, {f} the frequency of its well,
# {k} a knot, {r} a resistance.
LOADS = {
    "own resistor": (),
    "netlist resistor": ("load.netlist=resistor", "load.parameters.resistance={r}"),
    "bridge": ("load.netlist=bridge",),
    "sshi_parallel": ("load.netlist=sshi_parallel",),
    "sece": ("load.netlist=sece",),
    "a user's file": ("load.netlist={folder}/mine.cir",),
    "one resistor in a file": ("load.netlist={folder}/single.cir",),
}
EXCITATIONS = {
    "ornstein-uhlenbeck": (),
    "white": ('excitation={{kind = "white", intensity = {d}}}',),
    "sine": ('excitation={{kind = "sine", amplitude = {a}, frequency = {f}}}',),
    "sum": (
        'excitation={{kind = "sum", parts = [{{kind = "white", intensity = {d}}}, '
        '{{kind = "sine", amplitude = {a}, frequency = {f}}}], knot_spacing = {k}}}',
    ),
    "record": (
        'excitation={{kind = "record", file = "{folder}/{name}.csv", unit = "{unit}", '
        'column = "acceleration", time_column = "time", repetition = "periodic"}}',
    ),
    "prescribed displacement": (
        'excitation={{kind = "prescribed_displacement", amplitude = {l}, frequency = {f}}}',
    ),
}
# Each command once, with all kinds of devices, loads and excitations between them.
EACH_ONCE = (
    ("simulate circuit", "paper", "one resistor in a file", "sum"),
    ("simulate monte-carlo", "leak and drag", "sshi_parallel", "white"),
    ("average paper", "paper", "own resistor", "ornstein-uhlenbeck"),
    ("average consistent", "paper", "own resistor", "white"),
    ("average fokker_planck", "electromagnetic", "netlist resistor", "ornstein-uhlenbeck"),
    ("validate", "asymmetric", "bridge", "ornstein-uhlenbeck"),
    ("frequency-response monte-carlo", "one_sided", "bridge", "sine"),
    ("frequency-response circuit", "coil with inductance", "own resistor", "sine"),
    ("load-study", "asymmetric", "a user's file", "record"),
    ("optimum", "paper", "own resistor", "ornstein-uhlenbeck"),
    ("sensitivity", "one_sided", "sece", "ornstein-uhlenbeck"),
    ("stability", "paper", "own resistor", "ornstein-uhlenbeck"),
    ("accuracy", "paper", "own resistor", "ornstein-uhlenbeck"),
    ("netlist ngspice", "leak and drag", "bridge", "prescribed displacement"),
    ("netlist ltspice", "one_sided", "sshi_parallel", "sine"),
    ("export", "leak and drag", "one resistor in a file", "sum"),
    ("schematic", "coil with inductance", "sece", "record"),
)
BRIEFLY = ("--workers", "1")
FREQUENCIES = ("--frequencies", "{f}", "--amplitude", "{a}")
# Name → what stands before the scene, and behind it.
COMMANDS = {
    "simulate circuit": (("simulate",), ("--method", "circuit", *BRIEFLY)),
    "simulate monte-carlo": (("simulate",), ("--method", "monte-carlo", *BRIEFLY)),
    **{
        f"average {closure}": (("average",), ("--method", closure, "--tolerance", "0.3"))
        for closure in ("paper", "consistent", "fokker_planck")
    },
    "validate": (("validate",), (*BRIEFLY, "--report", "{folder}/report.html")),
    "frequency-response monte-carlo": (("frequency-response",), (*FREQUENCIES, *BRIEFLY)),
    "frequency-response circuit": (
        ("frequency-response",),
        (*FREQUENCIES, "--method", "circuit", *BRIEFLY),
    ),
    "load-study": (("load-study",), BRIEFLY),
    "optimum": (
        ("optimum",),
        ("--over", "excitation.intensity", "--closure", "consistent", *BRIEFLY),
    ),
    "sensitivity": (
        ("sensitivity",),
        ("--vary", "oscillator.damping=±10%", "--rows", "2", *BRIEFLY),
    ),
    "stability": (("stability",), BRIEFLY),
    "accuracy": (("accuracy",), BRIEFLY),
    "netlist ngspice": (("netlist",), ("--output", "{folder}/ngspice.cir")),
    "netlist ltspice": (
        ("netlist",),
        ("--dialect", "ltspice", "--output", "{folder}/ltspice.cir"),
    ),
    "export": (("export",), ("--as", "deck", "--output", "{folder}/exported")),
    "schematic": (("schematic",), ("--output", "{folder}/schematic.svg")),
}
# One of each kind of part: what is compiled for one kind serves all of it.
KINDS_OF_DEVICE = (
    "paper",
    "asymmetric",
    "one_sided",
    "electromagnetic",
    "coil with inductance",
    "leak and drag",
)
USERS_LOAD = """.subckt mine p n load_resistance=100k
D1 p out plain
D2 n out plain
D3 ref p plain
D4 ref n plain
Rload out ref {load_resistance}
Cload out ref 100n
.model plain d(is=1n n=1.2)
.ends
"""
SINGLE = ".subckt single p n value=220k\nR1 p n {value}\n.ends\n"


def write_files(folder):
    """The loads and records that the overrides name."""
    (folder / "mine.cir").write_text(USERS_LOAD)
    (folder / "single.cir").write_text(SINGLE)
    generator = np.random.default_rng(1)
    for device in DEVICES:
        values = _values(device, folder)
        times = np.arange(400) * values["k"]
        motion = 3.0 * values["a"] * generator.standard_normal(times.size)
        np.savetxt(
            folder / f"{values['name']}.csv",
            np.column_stack([times, motion]),
            delimiter=",",
            header="time,acceleration",
            comments="",
        )


def _values(device, folder):
    """Numbers that suit a device, for the fields of the overrides."""
    scene = _scene(device)
    ready = prepared(scene)
    system, scales = ready.system, ready.scales
    length = scales.displacement
    frequency = _period(system) ** -1
    intensity = scene.excitation.intensity
    acceleration = float(np.sqrt(intensity / scene.excitation.correlation_time))
    return {
        "folder": folder,
        "name": device.replace(" ", "-"),
        "unit": "m/s^2" if scene.units == "SI" else "scaled",
        "d": intensity,
        "a": acceleration,
        "l": 0.5 * length,
        "f": frequency,
        "k": 1.0 / (40.0 * frequency),
        "r": 0.7 * (scene.load.resistance or 1.0 / scene.load.decay_rate),
    }


def _scene(device):
    name, overrides = DEVICES[device]
    return Scene.read(name, overrides)


def _period(system):
    from harvester.device import timescales

    return 2.0 * np.pi / timescales.angular_frequency(system)


def call(case, folder):
    """Arguments of the command line for one of (command, device, load, excitation)."""
    command, device = case[:2]
    before, behind = COMMANDS[command]
    periods = PERIODS_OF_AN_OPTIMUM if command == "optimum" else PERIODS
    name, overrides = changed(*case[1:], folder, periods)
    sets = itertools.chain.from_iterable(("--set", text) for text in overrides)
    values = _values(device, folder)
    return [*before, name, *sets, *(text.format(**values) for text in behind)]


def changed(device, load, excitation, folder, periods=PERIODS):
    """Built-in scene and overrides of one of (device, load, excitation)."""
    name, changes = DEVICES[device]
    values = _values(device, folder)
    length = periods / values["f"]
    return name, [
        *changes,
        *(text.format(**values) for text in LOADS[load]),
        *(text.format(**values) for text in EXCITATIONS[excitation]),
        "run.realizations=2",
        f"run.duration={length}",
        f"run.settle={0.25 * length}",
    ]


def covering(size, seed, devices=tuple(DEVICES)):
    """Cases that hold every combination of values of any `size` dimensions, greedily chosen."""
    generator = np.random.default_rng(seed)
    dimensions = (tuple(COMMANDS), devices, tuple(LOADS), tuple(EXCITATIONS))
    lengths = [len(values) for values in dimensions]
    left = {
        (places, values)
        for places in itertools.combinations(range(len(lengths)), size)
        for values in itertools.product(*(range(lengths[place]) for place in places))
    }
    cases = []
    for places, values in sorted(left):
        if (places, values) not in left:
            continue
        best, most = None, -1
        for _ in range(50):
            case = [int(generator.integers(length)) for length in lengths]
            for place, value in zip(places, values, strict=True):
                case[place] = value
            covered = len(left & _held(case, size))
            if covered > most:
                best, most = case, covered
        left -= _held(best, size)
        cases.append(tuple(names[k] for names, k in zip(dimensions, best, strict=True)))
    return cases


def _held(case, size):
    places = itertools.combinations(range(len(case)), size)
    return {(chosen, tuple(case[place] for place in chosen)) for chosen in places}

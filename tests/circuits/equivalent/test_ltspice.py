import math
import re

import numpy as np
import pytest
from raw_files import run_raw

from circuits.equivalent.export import stand_alone
from circuits.equivalent.ltspice import to_ltspice, translate
from circuits.netlist.subcircuits import load_names
from harvester.base.errors import NetlistError
from harvester.cli.command_line import main
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared

# Documented in LTspice's help under "B. Arbitrary Behavioral Voltage or Current Sources".
FUNCTIONS = {
    "abs", "absdelay", "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "buf", "ceil",
    "cos", "cosh", "ddt", "delay", "exp", "floor", "hypot", "i", "idt", "idtmod", "if", "int",
    "inv", "limit", "ln", "log", "log10", "max", "min", "pow", "pwr", "pwrs", "rand", "random",
    "round", "sdt", "sgn", "sin", "sinh", "sqrt", "table", "tan", "tanh", "u", "uramp", "v",
    "white",
}  # fmt: skip
# What LTspice's help says its functions do, as Python.
MEANING = {
    "pwr": lambda x, y: abs(x) ** y,
    "pwrs": lambda x, y: math.copysign(abs(x) ** y, x),
    "if": lambda a, b, c: b if a > 0.5 else c,
    "limit": lambda x, y, z: sorted((x, y, z))[1],
    "ln": math.log,
    "sgn": lambda x: (x > 0) - (x < 0),
    "abs": abs,
    "round": round,
    "min": min,
    "max": max,
}


def value(expression, **names):
    """A translated expression's value by LTspice's rules; & and | as its booleans."""
    words = re.sub(r"\bif\(", "if_(", re.sub(r"(?<![\d.])(\d+)k\b", r"\g<1>e3", expression))
    known = {"if_" if name == "if" else name: f for name, f in MEANING.items()}
    return float(eval(words, {"__builtins__": {}}, {**known, **names}))


@pytest.mark.parametrize(
    ("ngspice", "x", "expected"),
    [
        ("x > 1 ? 2 : x < 0 ? 3 : 4", 2.0, 2.0),
        ("x > 1 ? 2 : x < 0 ? 3 : 4", -1.0, 3.0),
        ("x > 1 ? 2 : x < 0 ? 3 : 4", 0.5, 4.0),
        ("pow(x, 1.5)", -4.0, 8.0),
        ("pwr(x, 1.5)", -4.0, -8.0),
        ("2*x**2", 3.0, 18.0),
        ("(x==3) ? 1 : 0", 3.0, 1.0),
        ("(x!=3) ? 1 : 0", 3.0, 0.0),
        ("x ? 5 : 6", 0.4, 5.0),
        ("!x ? 5 : 6", 0.4, 6.0),
        ("x && 2 ? 5 : 6", 0.4, 5.0),
        ("x == 1 && x < 2 || x > 5 ? 1k : 2", 1.0, 1000.0),
        ("u2(x)", 0.25, 0.25),
        ("u2(x)", 7.0, 1.0),
        ("log(x)", math.e, 1.0),
        ("nint(x)", 2.7, 3.0),
        ("ternary_fcn(x>1, 5, 6)", 0.0, 6.0),
        ("1-2-x", 1.0, -2.0),
        ("abs(x)-sgn(x)*1e-1", -1.0, 1.1),
    ],
)
def test_an_expression_keeps_its_value(ngspice, x, expected):
    assert value(translate(ngspice), x=x) == pytest.approx(expected)


def test_powers_and_signs_bind_as_in_ngspice(tmp_path):
    expressions = ["-v(x)^2", "2^3^2", "v(y)^3", "2*-v(x)^2", "v(y)**3", "pow(v(y),3)", "2^-v(x)"]
    sources = "".join(f"B{k} b{k} 0 v={text}\n" for k, text in enumerate(expressions))
    (tmp_path / "a.cir").write_text(f"* powers\nVx x 0 3\nVy y 0 -2\n{sources}.op\n.end\n")
    found = run(tmp_path, "a.cir")
    for k, text in enumerate(expressions):
        said = translate(text, True).replace("v(x)", "3.0").replace("v(y)", "(-2.0)")
        assert value(said) == pytest.approx(found[f"v(b{k})"][0])


def test_parameters_of_a_behavioural_source_stand_in_braces():
    assert translate("gain*v(a, b)+{2*gain}*time", True) == "{gain}*v(a,b)+(2.0*{gain}*time)"
    assert translate("gain*2") == "gain*2.0"


@pytest.mark.parametrize("fault", ["hertz2(x)", "a b", "sin(", "a ? b", "a % b", "a;b"])
def test_what_cannot_be_said_is_refused(fault):
    with pytest.raises(NetlistError, match="cannot be written for LTspice"):
        translate(fault)


IDEAL = "bridge_ideal"
SCENES = {
    "paper": ("paper", []),
    "impact speed held": ("paper_si", ["stoppers.impact_velocity=event"]),
    **{load: ("device", [f"load.netlist={load}"]) for load in load_names() if load != IDEAL},
    # Its own values are for scaled scenes.
    IDEAL: ("paper", [f"load.netlist={IDEAL}"]),
    **{name: (name, []) for name in ("asymmetric", "one_sided", "tristable", "electromagnetic")},
    "coil with inductance": ("electromagnetic", ["coil.inductance=0.1"]),
}
# Where a contact is too short for the default one.
STEPS = {"one_sided": 0.001}
BRIEF = ["run.realizations=1", "run.settle=0"]


@pytest.mark.parametrize("case", SCENES)
def test_every_word_is_ltspices(case):
    name, overrides = SCENES[case]
    scene = Scene.read(name, [*overrides, *BRIEF, "run.duration=1"])
    text = to_ltspice(
        stand_alone(
            prepared(scene), noise_path(prepared(scene), 0), step=STEPS.get(case, "default")
        ).text
    )
    expressions = re.findall(r"\{([^{}]*)\}|\b[iv]=(.*)$", text, re.MULTILINE | re.IGNORECASE)
    assert expressions
    for expression in map("".join, expressions):
        called = set(re.findall(r"([a-z_]\w*)\(", expression, re.IGNORECASE))
        assert called <= FUNCTIONS
        assert not re.search(r"[?:^]|==|!=|&&|\|\|", expression)
    assert not re.search(r"^\.title|@|^a", text, re.MULTILINE | re.IGNORECASE)


def run(folder, name, compatible=False):
    """Variables of a stand-alone ngspice's run, in its LTspice mode or not."""
    mode = "set ngbehavior=ltpsa\n" if compatible else "* none\n"
    (folder / ".spiceinit").write_text(mode)
    return run_raw(folder, name, env={"HOME": str(folder), "PATH": "/usr/bin:/bin"})


@pytest.mark.parametrize(
    "case", ["paper", "impact speed held", "bridge", "one_sided", "electromagnetic"]
)
def test_ngspice_in_its_ltspice_mode_gives_the_same_waveform(tmp_path, capsys, case):
    name, overrides = SCENES[case]
    duration = 20 if name.startswith("paper") else 0.3
    settings = [*overrides, *BRIEF, f"run.duration={duration}"]
    options = [word for setting in settings for word in ("--set", setting)]
    step = str(STEPS.get(case, "default"))
    command = ["netlist", name, *options, "--step", step, "--output"]
    assert main([*command, str(tmp_path / "a.cir")]) == 0
    assert main([*command, str(tmp_path / "b.cir"), "--dialect", "ltspice"]) == 0
    text = (tmp_path / "b.cir").read_text()
    # ngspice 39 reads no file into a current source: its points are put in here.
    points = " ".join((tmp_path / "b-noise.txt").read_text().split())
    text = text.replace('PWL file="b-noise.txt"', f"PWL({points})")
    text = text.replace("I(inoise)", "").replace("plotwinsize=0", "")
    (tmp_path / "b.cir").write_text(text)
    own, other = run(tmp_path, "a.cir"), run(tmp_path, "b.cir", compatible=True)
    terminal = "v(coil)" if name == "electromagnetic" else "v(piezo)"
    for node in ("v(displacement)", terminal):
        size = np.ptp(own[node])
        found = np.interp(own["time"], other["time"], other[node])
        assert size > 0.0
        np.testing.assert_allclose(found, own[node], atol=1e-3 * size)


def test_the_header_says_what_differs_and_the_noise_lies_beside(tmp_path, capsys):
    target = tmp_path / "deep" / "scene.cir"
    options = ["--set", "run.duration=1", "--set", "run.settle=0", "--output", str(target)]
    assert main(["netlist", "paper", *options, "--dialect", "ltspice"]) == 0
    text = target.read_text(encoding="ascii")
    assert text.startswith("* harvester scene paper, for LTspice")
    assert "Differences from ngspice" in text
    assert 'Inoise 0 velocity PWL file="scene-noise.txt"' in text
    scene = Scene.read("paper")
    written = np.loadtxt(target.parent / "scene-noise.txt")
    rate = float(re.search(r"minus the base acceleration, over ([\d.]+)", text).group(1))
    np.testing.assert_allclose(
        written[:, 1] * rate, noise_path(prepared(scene), 0).read(21), rtol=1e-12
    )
    assert main(["netlist", "paper", "--dialect", "ltspice"]) == 2
    assert "--output FILE.cir" in capsys.readouterr().err
    assert main(["netlist", "paper", "--dialect", "ltspise"]) == 2
    assert "did you mean ltspice" in capsys.readouterr().err

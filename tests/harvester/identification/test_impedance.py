"""Identification from an impedance, against the circuit written out here."""

import sys

import numpy as np
import pytest
from measured_records import band_noise, linear_device, linear_record, scene_of, states

from harvester.base.errors import HarvesterError, IdentificationError, SceneError
from harvester.cli.command_line import main
from harvester.identification.fitting import fitted
from harvester.identification.identify import identify
from harvester.identification.impedance_fit import fitted_circuit, from_impedance
from harvester.identification.measured_response import (
    MeasuredImpedance,
    MeasuredResponse,
    read_impedance,
)
from harvester.identification.measurement import Measurement
from harvester.scene.model import Scene
from harvester.scene.numbers import numbers
from harvester.scene.text import scene_text

MASS, STIFFNESS, COUPLING, CAPACITANCE = 14.04e-3, 1157.9, 2.327e-3, 41.26e-9
DAMPING = 2.0 * 0.027 * np.sqrt(STIFFNESS * MASS)
LOSS, NOISE = 0.018, 0.005
FREQUENCY = np.linspace(35.0, 60.0, 251)
TRUE = {
    "series_resonance": np.sqrt(STIFFNESS / MASS) / (2.0 * np.pi),
    "parallel_resonance": np.sqrt((STIFFNESS + COUPLING**2 / CAPACITANCE) / MASS) / (2.0 * np.pi),
    "capacitance": CAPACITANCE,
    "coupling_factor": COUPLING**2 / (COUPLING**2 + STIFFNESS * CAPACITANCE),
    "quality": np.sqrt(STIFFNESS * MASS) / DAMPING,
    "loss_tangent": LOSS,
}
# Of 0.5 % noise, as the issue asks for; the loss is not among them.
ALLOWED = {
    "series_resonance": 1e-3,
    "parallel_resonance": 1e-3,
    "capacitance": 0.02,
    "coupling_factor": 0.02,
    "quality": 0.02,
}


def impedance(frequency=FREQUENCY, stiffness=STIFFNESS, loss=LOSS):
    """With the base clamped: i = iω Cp V − iω θ x, (k − M ω² + iω C) x = −θ V."""
    rate = 2j * np.pi * frequency
    moved = -COUPLING / (stiffness + MASS * rate**2 + DAMPING * rate)
    return 1.0 / (rate * CAPACITANCE * (1.0 - 1j * loss) - rate * COUPLING * moved)


def noisy(rng, values, noise=NOISE):
    parts = rng.standard_normal((2, values.size))
    return values * np.exp(noise * (parts[0] + 1j * parts[1]))


def scene(mass=MASS, force=(0.0, 800.0)):
    piezo = {"coupling": 3e-3, "capacitance": 7e-8}
    return scene_of(mass, 0.1, force, {"piezo": piezo}, 1e5)


def written(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return str(path)


def test_the_circuit_of_one_mode_is_found():
    seen = noisy(np.random.default_rng(1), impedance())
    found = fitted_circuit(FREQUENCY, seen, "here").numbers(0)
    for name, share in ALLOWED.items():
        assert found[name] == pytest.approx(TRUE[name], rel=share), name
    assert found["loss_tangent"] == pytest.approx(LOSS, abs=0.002)


@pytest.mark.slow
def test_several_modes_are_found_and_those_above_add_to_the_capacitance():
    frequency = np.geomspace(20.0, 900.0, 700)
    rate, admittance = 2j * np.pi * frequency, 1.0 / impedance(frequency)
    for resonance, quality, motional in ((280.0, 45.0, 1.1e-9), (610.0, 60.0, 0.4e-9)):
        ratio = frequency / resonance
        admittance = admittance + rate * motional / (1.0 - ratio**2 + 1j * ratio / quality)
    seen = noisy(np.random.default_rng(2), 1.0 / admittance)
    circuit = fitted_circuit(frequency, seen, "here")
    assert circuit.modes[:, 0] == pytest.approx([TRUE["series_resonance"], 280.0, 610.0], rel=1e-3)
    assert circuit.numbers(0)["capacitance"] == pytest.approx(CAPACITANCE + 1.5e-9, rel=0.01)
    assert circuit.numbers(1)["quality"] == pytest.approx(45.0, rel=0.05)
    measured = MeasuredImpedance(frequency, seen)
    # The scene's own frequency tells which of them it is.
    second = from_impedance(scene(force=(0.0, MASS * (2.0 * np.pi * 300.0) ** 2)), measured)
    assert second.mode == 1
    model = fitted(second.scene, [second.measured], second.keys)
    assert "another mode at 45.7" in "".join(second.findings(model))


@pytest.mark.slow
def test_an_impedance_gives_a_scene_up_to_its_mass(tmp_path, capsys):
    seen = noisy(np.random.default_rng(3), impedance())
    file = written(
        tmp_path / "z.csv",
        "Frequency [Hz],|Z| [kohm],Phase [deg]",
        FREQUENCY,
        1e-3 * np.abs(seen),
        np.degrees(np.angle(seen)),
    )
    half = scene(0.5 * MASS)
    (tmp_path / "half.toml").write_text(scene_text(half, {}, []))
    words = ["identify", str(tmp_path / "half.toml"), "--impedance", file]
    assert main([*words, "--output", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "not the mass" in said
    assert "base clamped" in said
    assert (tmp_path / "half-identified.toml").exists()
    found = identify(half, impedance=file)
    wanted = [0.5 * STIFFNESS, 0.5 * DAMPING, np.sqrt(0.5) * COUPLING, CAPACITANCE]
    resonance = 2.0 * np.pi * TRUE["series_resonance"]
    wanted.append(1.0 / (resonance * CAPACITANCE * LOSS))
    for (key, value), true in zip(found.values.items(), wanted, strict=True):
        assert abs(value - true) < 4.0 * found.standard_errors[key], key
    assert found.to_dict()["impedance"]["quality"]["interval"][0] < TRUE["quality"]
    assert "impedance" in found.texts()[".html"]


@pytest.mark.slow
def test_of_a_bistable_spring_the_stiffness_at_rest_is_told():
    seen = noisy(np.random.default_rng(4), impedance())
    bistable = scene(force=(0.0, -400.0, 0.0, 1e7))
    found = identify(bistable, impedance=MeasuredImpedance(FREQUENCY, seen))
    # F' = −2 k1 at the wells of a spring k1 x + k3 x³.
    key = "oscillator.restoring_force[1]"
    assert found.values[key] == pytest.approx(-0.5 * STIFFNESS, rel=2e-3)
    half = 1.96 * found.standard_errors[key]
    assert 1e-5 * STIFFNESS < half < 1e-3 * STIFFNESS


@pytest.mark.slow
def test_with_a_response_an_impedance_tells_the_mass():
    rng = np.random.default_rng(5)
    rate = 2j * np.pi * FREQUENCY
    volts = rate * COUPLING / (rate * CAPACITANCE * (1.0 - 1j * LOSS) + 1e-5)
    answer = -MASS * volts / (STIFFNESS + MASS * rate**2 + DAMPING * rate + COUPLING * volts)
    size = NOISE * np.abs(answer).max()
    parts = rng.standard_normal((2, answer.size))
    answer = answer + size * (parts[0] + 1j * parts[1])
    found = identify(
        scene(0.6 * MASS),
        MeasuredResponse(FREQUENCY, answer, name="response"),
        impedance=MeasuredImpedance(FREQUENCY, noisy(rng, impedance()), name="impedance"),
        compare=False,
    )
    agree(found, [MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE])
    assert found.standard_errors["oscillator.mass"] < 0.02 * MASS
    assert found.verdict.good


def agree(found, wanted):
    keys = [
        "oscillator.mass",
        "oscillator.damping",
        "oscillator.restoring_force[1]",
        "piezo.coupling",
        "piezo.capacitance",
    ]
    for key, true in zip(keys, wanted, strict=True):
        assert abs(found.values[key] - true) < 4.0 * found.standard_errors[key], key


@pytest.mark.exhaustive
@pytest.mark.parametrize("first_mass", [None, 0.002, 0.1])
def test_records_in_time_responses_and_an_impedance_are_fitted_together(first_mass):
    mass, damping, coupling, capacitance, load = 0.01, 0.05, 1.2e-3, 4e-8, 3e5
    stiffness = mass * (2.0 * np.pi * 30.0) ** 2
    cubic = 0.2 * stiffness / 2e-3**2
    piezo = {"coupling": coupling, "capacitance": capacitance}
    truth = scene_of(mass, damping, [0.0, stiffness, 0.0, cubic], {"piezo": piezo}, load)
    rng = np.random.default_rng(3)
    base = band_noise(rng, 6000, 1000.0, 10.0, 60.0, 3.0)
    voltage = states(truth, base, 1000.0)[2]
    voltage = voltage + NOISE * voltage.std() * rng.standard_normal(voltage.size)
    frequency = np.linspace(18.0, 48.0, 120)
    rate = 2j * np.pi * frequency
    volts = rate * coupling / (rate * capacitance + 1.0 / load)
    mechanical = stiffness + mass * rate**2 + damping * rate
    answer = -mass * volts / (mechanical + coupling * volts)
    parts = rng.standard_normal((2, answer.size))
    answer = answer + NOISE * np.abs(answer).max() * (parts[0] + 1j * parts[1])
    records = [MeasuredResponse(frequency, answer), Measurement(base, 1000.0, voltage=voltage)]
    known = rate * capacitance + rate * coupling**2 / mechanical
    analysed = MeasuredImpedance(frequency, noisy(rng, 1.0 / known)) if first_mass else None
    begun = {
        "oscillator.mass": first_mass or mass,
        "oscillator.damping": 0.08,
        "oscillator.restoring_force": [0.0, 0.8 * stiffness, 0.0, 0.5 * cubic],
        "piezo": {"coupling": 8e-4, "capacitance": 6e-8},
    }
    found = identify(truth.replace(begun), records, impedance=analysed)
    exact = numbers(truth)
    for key, value in found.values.items():
        assert abs(value - exact[key][0]) < 4.0 * found.standard_errors[key], key
    assert ("oscillator.mass" in found.values) == bool(first_mass)
    assert found.verdict.good
    assert "and two of every three frequencies of" in found.sentences()[-1]


@pytest.mark.exhaustive
@pytest.mark.parametrize("lines", [(35.0, 60.0, 251), (20.0, 100.0, 401)])
def test_intervals_hold_the_truth_in_93_to_97_of_100_draws(lines):
    draws, rng = 1000, np.random.default_rng(6)
    frequency = np.linspace(*lines)
    true, begun = impedance(frequency), scene()
    wanted = [STIFFNESS, DAMPING, COUPLING, CAPACITANCE]
    held, off = np.zeros(len(TRUE)), {name: [] for name in ALLOWED}
    held_of_scene = np.zeros(len(wanted))
    for _ in range(draws):
        found = from_impedance(begun, MeasuredImpedance(frequency, noisy(rng, true)))
        model = fitted(found.scene, [found.measured], found.keys)
        table = found.parameters(model)
        held += [
            table[name]["interval"][0] <= value <= table[name]["interval"][1]
            for name, value in TRUE.items()
        ]
        for name, share in off.items():
            share.append(table[name]["value"] / TRUE[name] - 1.0)
        half = 1.96 * model.standard_errors[: len(wanted)]
        held_of_scene += np.abs(model.values[: len(wanted)] - wanted) < half
    for name, share in ALLOWED.items():
        assert np.abs(off[name]).max() < share, name
    for count in (*held, *held_of_scene):
        assert 0.93 < count / draws < 0.97


def test_every_kind_of_file_gives_the_same(tmp_path):
    true = impedance()
    magnitude, phase = np.abs(true), np.angle(true)
    reflected = (true - 50.0) / (true + 50.0)
    touchstone = tmp_path / "z.s1p"
    lines = zip(FREQUENCY, reflected.real, reflected.imag, strict=True)
    touchstone.write_text(
        "# HZ S RI R 50\n" + "\n".join("{:.17g} {:.17g} {:.17g}".format(*x) for x in lines)
    )
    both = [FREQUENCY, true.real, true.imag, magnitude, phase]
    names = "f [Hz],R [ohm],X [ohm],Z [ohm],theta [rad]"
    for file, settings in (
        (written(tmp_path / "a.csv", "f [Hz],|Z| [ohm],phase [rad]", *(both[n] for n in (0, 3, 4))),
         {}),
        # As a sweep downwards, by the numbers of its columns.
        (written(tmp_path / "b.csv", "", *(each[::-1] for each in both[:3])),
         {"frequency": "0:Hz", "real": "1:ohm", "imaginary": "2:ohm"}),
        (written(tmp_path / "c.csv", names, *both), {}),
        (written(tmp_path / "d.csv", names, *both), {"resistance": "R", "reactance": "X"}),
        (str(touchstone), {}),
    ):  # fmt: skip
        read = read_impedance(file, settings)
        assert read.frequency == pytest.approx(FREQUENCY)
        # S at 50 Ω keeps 11 of 16 digits of 100 kΩ.
        assert read.response == pytest.approx(true, rel=1e-9)
    np.save(tmp_path / "e.npy", np.column_stack([FREQUENCY, true]))
    read = read_impedance(tmp_path / "e.npy", {"frequency": "0:Hz", "impedance": "1:ohm"})
    assert read.response == pytest.approx(true)


MAGNITUDE, PHASE = np.abs(impedance()), np.angle(impedance())
POLAR = "frequency [Hz],impedance [ohm],phase [deg]"


@pytest.mark.parametrize(
    ("header", "columns", "said"),
    [
        ("frequency [Hz],a,b", (FREQUENCY, MAGNITUDE, PHASE), "no columns of an impedance: write"),
        ("a,impedance [ohm],phase [deg]", (FREQUENCY, MAGNITUDE, PHASE), "no column of frequencie"),
        ("frequency [Hz],|Z|,phase [deg]", (FREQUENCY, MAGNITUDE, np.degrees(PHASE)),
         "impedance has no unit"),
        ("frequency [Hz],|Z| [V/g],phase [deg]", (FREQUENCY, MAGNITUDE, np.degrees(PHASE)),
         "units of impedance are ohm, kohm, Mohm"),
        ("frequency [Hz],|Z| [mohm],phase [deg]", (FREQUENCY, MAGNITUDE, np.degrees(PHASE)),
         "ambiguous: megaohms"),
        ("frequency [Hz],|Z| [ohm],phase", (FREQUENCY, MAGNITUDE, np.degrees(PHASE)),
         "phase has no unit .*as degrees would be"),
        ("frequency [Hz],|Z| [ohm],phase", (FREQUENCY, MAGNITUDE, PHASE),
         "phase has no unit .*as radians would be"),
        (POLAR, (FREQUENCY, MAGNITUDE, PHASE), r"in radians, give the unit \(phase=COLUMN:rad"),
        (POLAR.replace("deg", "rad"), (FREQUENCY, MAGNITUDE, np.degrees(PHASE)),
         r"if the column is in degrees, write phase=COLUMN:deg"),
        (POLAR, (FREQUENCY - 40.0, MAGNITUDE, np.degrees(PHASE)), "frequency: -5: must be > 0"),
        (POLAR, (np.abs(FREQUENCY - 45.0) + 1.0, MAGNITUDE, np.degrees(PHASE)),
         "must be monotonic"),
        (POLAR, (FREQUENCY, MAGNITUDE, -np.degrees(PHASE)), "the sign of the phase"),
        (POLAR, (FREQUENCY, MAGNITUDE, np.degrees(PHASE) * 3.0), "within ±90 deg"),
        ("frequency [Hz],R [ohm],X [ohm]", (FREQUENCY, -MAGNITUDE * np.cos(PHASE),
         MAGNITUDE * np.sin(PHASE)), "resistance is negative"),
        (POLAR + ",impedance 2 [ohm]", (FREQUENCY, 0.0 * MAGNITUDE, np.degrees(PHASE), MAGNITUDE),
         "is 0 in some lines"),
    ],
)  # fmt: skip
def test_what_is_no_impedance_is_refused_with_the_cure(tmp_path, header, columns, said):
    file = written(tmp_path / "z.csv", header, *columns)
    with pytest.raises(SceneError, match=said) as refused:
        read_impedance(file)
    assert str(refused.value).count("\n") == 0


@pytest.mark.parametrize(
    ("measured", "said"),
    [
        (MeasuredImpedance(FREQUENCY, 1e-3 * impedance()), "check the units .ohm or kohm"),
        (MeasuredImpedance(FREQUENCY[:10], impedance()[:10]), "too short: 10 frequencies"),
        (MeasuredImpedance(FREQUENCY + 100.0, impedance(FREQUENCY + 100.0)),
         "no resonance between 135 and 159.9 Hz"),
        (MeasuredImpedance(FREQUENCY[::25], impedance()[::25]), "too short|too few points"),
    ],
)  # fmt: skip
def test_an_impedance_without_the_device_in_it_is_refused(measured, said):
    rng = np.random.default_rng(7)
    seen = MeasuredImpedance(measured.frequency, noisy(rng, measured.response))
    with pytest.raises(IdentificationError, match=said):
        identify(scene(), impedance=seen)


def test_too_few_points_over_a_sharp_resonance_are_named():
    frequency = np.linspace(35.0, 60.0, 60)
    rate, ratio = 2j * np.pi * frequency, frequency / 46.0
    admittance = rate * (4e-8 * (1.0 - 0.01j) + 4e-10 / (1.0 - ratio**2 + 1j * ratio / 400.0))
    seen = noisy(np.random.default_rng(8), 1.0 / admittance, 1e-3)
    with pytest.raises(IdentificationError, match="too few points in the resonance at 46"):
        identify(scene(), impedance=MeasuredImpedance(frequency, seen))


def test_what_an_impedance_alone_does_not_take(tmp_path, monkeypatch):
    measured = MeasuredImpedance(FREQUENCY, impedance())
    with pytest.raises(IdentificationError, match="free: an impedance alone determines"):
        identify(scene(), impedance=measured, free=["oscillator.damping"])
    coil = scene_of(MASS, 0.1, (0.0, 800.0), {"coil": {"coupling": 1.0, "resistance": 5.0}}, 1e3)
    with pytest.raises(SceneError, match=r"a table \[piezo\]"):
        identify(coil, impedance=measured)
    with pytest.raises(SceneError, match="unknown setting volts"):
        read_impedance(written(tmp_path / "z.csv", POLAR, *[FREQUENCY] * 3), {"volts": "1"})
    (tmp_path / "z.s1p").write_text("# HZ Z RI R 50\n1 2\n")
    with pytest.raises(SceneError, match="not a valid Touchstone file"):
        read_impedance(tmp_path / "z.s1p")
    (tmp_path / "z.s1p").write_text("40 1 2\n50 1 2\n")
    with pytest.raises(SceneError, match="has no option line: write its first line as #"):
        read_impedance(tmp_path / "z.s1p")
    monkeypatch.setitem(sys.modules, "skrf", None)
    with pytest.raises(HarvesterError, match=r"pip install 'vibration-harvester\[analyser\]'"):
        read_impedance(tmp_path / "z.s1p")


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("reference", [None, 75])
@pytest.mark.parametrize("parameter", ["Z", "Y", "S"])
def test_touchstone_of_every_parameter_and_reference_is_read(
    tmp_path, version, reference, parameter
):
    pytest.importorskip("skrf")
    true, known = impedance(), reference or 50.0
    unit = known if version == 1 else 1.0
    values = {
        "Z": true / unit,
        "Y": unit / true,
        "S": (true - known) / (true + known),
    }[parameter]
    lines = [f"# hz {parameter} ri" + (f" r {reference} ! analyser" if reference else "")]
    if version == 2:
        lines = ["[Version] 2.0", *lines, "[Number of Ports] 1"]
        lines += [f"[Number of Frequencies] {true.size}", "[Network Data]"]
    table = zip(FREQUENCY, values.real, values.imag, strict=True)
    lines += ["{:.17g} {:.17g} {:.17g}".format(*x) for x in table]
    (tmp_path / "z.s1p").write_text("\n".join(lines + ["[End]"] * (version == 2)))
    read = read_impedance(tmp_path / "z.s1p")
    np.testing.assert_allclose(read.response, true, rtol=1e-8)


@pytest.mark.slow
def test_a_scene_may_give_frequency_and_damping_ratio():
    tables = scene(force=(0.0, 900.0)).to_tables()
    tables["oscillator"] = {"mass": MASS, "frequency": 41.0, "quality_factor": 25.0}
    start = Scene.from_tables(tables, name="by frequency")
    values = noisy(np.random.default_rng(4), impedance(loss=0.0))
    found = identify(start, [], impedance=MeasuredImpedance(FREQUENCY, values)).scene
    assert found.oscillator.linear_stiffness == pytest.approx(STIFFNESS, rel=5e-3)
    assert found.oscillator.damping == pytest.approx(DAMPING, rel=0.03)
    assert found.transducer.coupling == pytest.approx(COUPLING, rel=0.02)
    # A record in time too.
    device, record = linear_device(0.03), linear_record(0.03, 1, 4.0)
    tables = device.to_tables()
    tables["oscillator"] = {"mass": 0.01, "frequency": 12.5, "damping_ratio": 0.03}
    found = identify(Scene.from_tables(tables, name="a"), record, compare=False).scene.oscillator
    assert found.linear_stiffness == pytest.approx(device.oscillator.coefficients[1], rel=5e-3)
    assert found.damping == pytest.approx(0.03, rel=0.03)

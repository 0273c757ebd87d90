"""Beams from their drawings against published values, finite elements and sums of modes."""

from dataclasses import replace

import numpy as np
import pytest
from beam_voltages import discrete, of_lumped_values, sum_of_modes
from finite_elements_of_beams import modes_of

from harvester.base.errors import SceneError
from harvester.device.beam.lumped import Beam, frequencies, lumped, pieces_of, section, tip_of
from harvester.device.beam.modes import modes, rest
from harvester.device.beam.summary import remarks
from harvester.scene.model import Scene
from harvester.validation import entries

REFERENCE = {
    "length": 50.8e-3, "width": 31.8e-3, "thickness": 0.14e-3, "piezo_thickness": 0.26e-3,
    "piezo": "PSI-5A4E",
}  # fmt: skip
LOADED = {**REFERENCE, "tip_mass": 0.012, "damping_ratio": 0.027}
BARE = {**REFERENCE, "damping_ratio": 0.00874}
PATCHED = {**LOADED, "piezo_start": 4e-3, "piezo_length": 21e-3, "layers": 1}
BLOCK = {
    **BARE, "tip_material": "steel", "tip_length": 6e-3, "tip_height": 4e-3, "tip_offset": 3e-3,
}  # fmt: skip


def published(name):
    """Mass, stiffness, coupling, capacitance and μ of a measured device of `verify`."""
    [scene] = [d["scene"] for d in entries("known_results")["device"] if d["name"] == name]
    oscillator, piezo = scene["oscillator"], scene["piezo"]
    mechanical = oscillator["mass"], oscillator["linear_stiffness"]
    return *mechanical, piezo["coupling"], piezo["capacitance"], oscillator["base_factor"]


@pytest.mark.parametrize(
    ("beam", "expected"),
    [
        # A. Erturk and D. J. Inman, Smart Mater. Struct. 18, 025009 (2009), by its closed forms.
        (LOADED, (45.70, *published("bimorph with a tip mass"))),
        (BARE, (118.6, 2.147e-3, 1192.1, 2.161e-3, 41.26e-9, 1.5660)),
    ],
)
def test_reference_bimorph(beam, expected):
    found = lumped(Beam(**beam))
    values = (
        found.short_frequency, found.mass, found.stiffness, found.coupling,
        found.material_capacitance, found.base_factor,
    )  # fmt: skip
    assert values == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("beam", "expected"), [(LOADED, 48.22), (BARE, 124.1)])
def test_open_frequency_of_one_mode(beam, expected):
    assert lumped(Beam(**beam)).one_mode_open_frequency == pytest.approx(expected, rel=1e-3)


def test_parallel_layers_have_twice_the_coupling_and_four_times_the_capacitance():
    series, parallel = (lumped(Beam(**LOADED, connection=each)) for each in ("series", "parallel"))
    assert parallel.coupling == pytest.approx(2.0 * series.coupling)
    assert parallel.capacitance == pytest.approx(4.0 * series.capacitance)


def test_bimorph_of_the_bare_paper():
    # Proc. IMechE I 225, 485 (2011), table 2: T226-H4-203X.
    beam = Beam(24.53e-3, 6.4e-3, 0.14e-3, 0.265e-3, piezo="PSI-5H4E")
    found = lumped(beam)
    values = found.mass, found.stiffness, found.coupling, found.material_capacitance
    assert values == pytest.approx(published("bare bimorph")[:4], rel=1e-3)


@pytest.mark.parametrize("beam", [LOADED, BARE, PATCHED, BLOCK])
def test_frequencies_of_finite_elements(beam):
    beam = Beam(**beam)
    _, _, (k, m, _, free, _) = discrete(beam)
    expected = modes_of(k, m, free, 3)[0] / (2.0 * np.pi)
    assert frequencies(beam) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("beam", [LOADED, BARE, PATCHED, BLOCK])
@pytest.mark.parametrize("resistance", [1e3, 47e3, 470e3])
def test_voltage_of_a_sum_of_25_modes(beam, resistance):
    beam = Beam(**beam)
    found = lumped(beam)
    frequencies = np.linspace(0.9, 1.15, 21) * found.short_frequency
    exact = np.abs(sum_of_modes(beam, frequencies, resistance))
    voltage = np.abs(of_lumped_values(found, frequencies, 1.0 / resistance))
    assert voltage == pytest.approx(exact, rel=5e-3)


def test_the_static_rest_is_the_sum_of_the_higher_modes():
    beam = Beam(**PATCHED)
    pieces, tip = pieces_of(beam), tip_of(beam)
    several, every = modes(pieces, tip, 12), rest(pieces, tip)
    capacitance = sum((each.coupling / each.angular_frequency) ** 2 for each in several)
    assert capacitance < every.capacitance
    charge = [each.coupling * each.forcing / each.angular_frequency**2 for each in several]
    assert sum(charge) == pytest.approx(every.charge, rel=1e-3)


def test_section_of_a_unimorph_by_integration():
    beam = Beam(**REFERENCE, layers=1)
    z = (np.arange(400_000) + 0.5) * 0.4e-3 / 400_000 - 0.07e-3
    modulus = np.where(z < 0.07e-3, 105e9, 66e9)
    dz = z[1] - z[0]
    axis = (modulus * z).sum() / modulus.sum()
    made = section(beam, True)
    assert made.rigidity == pytest.approx(
        31.8e-3 * (modulus * (z - axis) ** 2).sum() * dz, rel=1e-5
    )
    moment = (190e-12 * 66e9 / 0.26e-3 * (z - axis))[z > 0.07e-3].sum() * dz * 31.8e-3
    assert made.moment_per_volt == pytest.approx(moment, rel=1e-5)


@pytest.mark.parametrize(
    ("material", "capacitance", "coupling"),
    [("brass", 29.462e-9, 0.03480), ("aluminium", 29.607e-9, 0.02995)],
)
def test_a_unimorph_also_stretches(material, capacitance, coupling):
    """Free capacitance and (f_open/f_short)² − 1 by 2-D finite elements in plane stress."""
    made = lumped(Beam(40e-3, 10e-3, 0.2e-3, 0.2e-3, material=material, layers=1))
    free = made.capacitance + made.coupling**2 / made.stiffness
    assert free == pytest.approx(capacitance, rel=3e-3)
    # Without the stretch 7.6 % more; shear and the clamp's section are in the elements alone.
    assert (made.open_frequency / made.short_frequency) ** 2 - 1.0 == pytest.approx(
        coupling, rel=0.03
    )


def test_a_measured_frequency_softens_the_clamp():
    beam = Beam(**LOADED, measured_frequency=44.0)
    found = lumped(beam)
    assert found.short_frequency == pytest.approx(44.0, rel=1e-9)
    assert found.clamp_compliance > 0.0
    with pytest.raises(SceneError, match="of a rigid clamp"):
        lumped(Beam(**LOADED, measured_frequency=47.0))


def test_a_measured_capacitance_is_that_of_the_free_beam():
    found = lumped(Beam(**LOADED, measured_capacitance=50e-9))
    whole = found.capacitance + found.coupling**2 / found.stiffness
    assert whole == pytest.approx(50e-9, rel=1e-9)


STEEL_BLOCK = {
    "beam.tip_mass": 0.0, "beam.tip_material": "steel", "beam.tip_length": 8e-3,
    "beam.tip_height": 4e-3,
}  # fmt: skip


def test_a_report_says_where_a_block_stands():
    beam = Scene.read("bimorph").replace(STEEL_BLOCK).beam
    (line,) = (each for each in remarks(beam) if "tip_offset" in each)
    flush = replace(beam, tip_offset=-4e-3)
    frequency = lumped(flush).short_frequency
    assert f"tip_offset = -0.004: the frequency is then {frequency:.4g} Hz" in line
    assert not any("tip_offset" in each for each in remarks(flush))


def test_notes_name_a_layer_that_its_field_stiffens_and_a_strain_in_per_cent():
    """Finite elements with the field inside the layer: 227.37 Hz for 222.45 Hz (+2.2 %)."""
    thick = Beam(30e-3, 8e-3, 0.1e-3, 0.3e-3, piezo="PZT-5A", layers=1, strain_limit=0.04)
    lines = remarks(thick)
    assert any("4.5% stiffer; its frequency is up to 2.2% higher" in each for each in lines)
    assert any("0.04 % would be 0.0004" in each for each in lines)
    thin = remarks(replace(thick, thickness=0.5e-3, piezo_thickness=0.1e-3, strain_limit=4e-4))
    assert not any("stiffer;" in each or "would be" in each for each in thin)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"beam.length": 2e-3}, "slender"),
        ({"beam.piezo_length": 0.06}, "must lie within the beam"),
        ({"beam.piezo_length": 3e-4}, "times piezo_thickness"),
        ({"oscillator.mass": 0.01}, r"oscillator.mass follows from \[beam\]"),
        ({"beam.material": "bras"}, "did you mean brass"),
        ({"beam.tip_length": 0.01}, "needs beam.tip_material"),
        ({"beam.length": 40}, r"beam.length = 40: .*; 40 mm is 0.04$"),
        ({"beam.modulus": 105}, r"105 GPa is 1.05e\+11$"),
        ({"beam.thickness": 0.14}, "0.14 mm is 0.00014$"),
        ({"beam.piezo_d31": -190}, "-190 pm/V is -1.9e-10$"),
        ({"beam.piezo_permittivity": 13.3e-9}, "1.33e-08 F/m is 1502"),
        ({"beam.measured_capacitance": 29.5}, "29.5 nF is 2.95e-08$"),
        ({"beam.measured_capacitance": 2.95e-7}, "of the order of the drawing's 4.76e-08 F"),
        ({"beam.measured_frequency": 12}, "at least 0.5 of the 45.7 Hz of a rigid clamp"),
        ({"beam.tip_mass": 12.0}, "12 g is 0.012$"),
        ({"beam.tip_mass": 12e3}, "1e-15 to 10 kg$"),
        ({"beam.tip_mass": 5.0}, "under its weight"),
        ({**STEEL_BLOCK, "beam.tip_length": 0.06}, "a block longer than the beam's 0.0508 m"),
        ({"beam": None, "magnets.distance": 0.01}, r"add the table \[beam\]"),
        ({"units": "scaled"}, 'needs units = "SI"'),
        ({"beam": 3}, "must be a table"),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(SceneError, match=message):
        Scene.read("bimorph").replace(changes)


def test_a_drawn_scene_is_its_lumped_one():
    scene = Scene.read("bimorph")
    lumped_scene = scene.without_drawing()
    assert lumped_scene.oscillator == scene.oscillator
    again = Scene.from_tables(lumped_scene.to_tables(), name=scene.name)
    assert again.oscillator == scene.oscillator
    assert again.transducer == scene.transducer
    assert Scene.from_dict(scene.to_dict()) == scene


def test_measured_power_of_the_bare_bimorph():
    """Proc. IMechE I 225, 485 (2011), figure 6: µW per g², read to 2 %."""
    beam = Beam(24.53e-3, 6.4e-3, 0.14e-3, 0.265e-3, piezo="PSI-5H4E", damping_ratio=0.0088)
    found = lumped(beam)
    resistances = [0.47e3, 1.2e3, 6.7e3, 9.9e3, 21.5e3, 44.9e3, 90e3, 246e3, 491e3, 995e3]
    measured = {
        502.5: [46.1, 101.8, 221.8, 219.0, 170.3, 108.4, 63.1, 25.56, 12.97, 6.58],
        524.7: [2.046, 5.25, 27.9, 39.2, 76.2, 129.2, 186.0, 213.6, 176.9, 118.3],
    }
    for frequency, powers in measured.items():
        for resistance, power in zip(resistances, powers, strict=True):
            (voltage,) = 9.80665 * np.abs(of_lumped_values(found, [frequency], 1.0 / resistance))
            assert 1e6 * voltage**2 / resistance == pytest.approx(power, rel=0.04)

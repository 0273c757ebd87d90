"""Strain of the layers and their life: closed forms, finite elements and E1049."""

import math
import sys

import numpy as np
import pytest
from finite_elements_of_beams import matrices, modes_of

import harvester
from harvester.base.errors import HarvesterError, MissingLibrary, SceneError
from harvester.device.beam.lumped import Beam, lumped, pieces_of, section, tip_of
from harvester.device.beam.modes import rest
from harvester.device.beam.strain import strain_of_layers, strain_of_substrate
from harvester.excitation.base import kernel_loss
from harvester.scene.model import Scene
from harvester.statistics.strain import estimate_strain
from harvester.statistics.strain_moments import StrainWatch

LOADED = {
    "length": 50.8e-3, "width": 31.8e-3, "thickness": 0.14e-3, "piezo_thickness": 0.26e-3,
    "piezo": "PSI-5A4E", "tip_mass": 0.012, "damping_ratio": 0.027,
}  # fmt: skip
PATCHED = {**LOADED, "piezo_length": 21e-3, "layers": 1}
BARE_ROOT = {**PATCHED, "piezo_start": 4e-3}
LINE = {"beam.fatigue_strain": 1e-4, "beam.fatigue_cycles": 1e6, "beam.fatigue_exponent": 4.0}


def test_static_deflection_of_a_uniform_beam():
    beam = Beam(**LOADED)
    found, made = strain_of_layers(beam), lumped(beam)
    uniform = section(beam, True)
    moment = uniform.mass * beam.length**2 / 2.0 + beam.tip_mass * beam.length
    outer = 0.33e-3
    # The base's steady acceleration of 1 m/s²: the first mode goes to −μ M/K.
    deflection = -made.base_factor * made.mass / made.stiffness
    strain = found.per_displacement * deflection + found.per_acceleration
    assert strain == pytest.approx(-outer * moment / uniform.rigidity, rel=1e-9)
    # 1 V at rest: curvature −ϑ/EI all along, the first mode at −θ/K.
    strain = -found.per_displacement * made.coupling / made.stiffness + found.per_volt
    theta = 190e-12 * 66e9 * 31.8e-3 / (2 * 0.26e-3) * ((0.07e-3 + 0.26e-3) ** 2 - 0.07e-3**2)
    assert strain == pytest.approx(-outer * theta / uniform.rigidity, rel=1e-9)
    assert found.stress_per_volt == pytest.approx(190e-12 * 66e9 / (2 * 0.26e-3))


@pytest.mark.parametrize("values", [LOADED, PATCHED, BARE_ROOT])
def test_curvature_of_finite_elements(values):
    beam = Beam(**values)
    pieces, tip = pieces_of(beam), tip_of(beam)
    ends = np.cumsum([0.0, *(each.length for each in pieces)])
    rigidity, mass = [each.rigidity for each in pieces], [each.mass for each in pieces]
    k, m, load, free, slopes = matrices(ends, rigidity, mass, tuple(tip))
    root, end = slopes[0.0], slopes[float(ends[-1])] - 1
    omega, phi = modes_of(k, m, free, 1)
    # The clamp's moment is what the equation of its rotation lacks: more exact than a derivative.
    moment = -((k - omega[0] ** 2 * m) @ phi[:, 0])[root]
    curvature = moment / rigidity[0] / phi[end, 0]
    cut = section(beam, beam.piezo_start == 0.0)
    surface = 0.07e-3 + abs(cut.axis)
    substrate = strain_of_substrate(beam)
    if values is PATCHED:  # The bare part is strained most, at the patch's end.
        assert substrate.position == 21e-3
    else:
        assert abs(substrate.per_displacement) == pytest.approx(surface * curvature, rel=1e-4)
    # In the layers by the second derivative of the element where they begin.
    places = sorted(slopes)
    low, high = [x for x in places if x >= beam.piezo_start - 1e-9][:2]
    (w, turn), (w2, turn2) = (phi[[slopes[x] - 1, slopes[x]], 0] for x in (low, high))
    size = high - low
    curvature = (-6.0 * w - 4.0 * size * turn + 6.0 * w2 - 2.0 * size * turn2) / size**2
    layers = (0.33e-3 - section(beam, True).axis) * curvature / phi[end, 0]
    assert strain_of_layers(beam).per_displacement == pytest.approx(layers, rel=2e-3)
    still = np.zeros(len(k))
    still[free] = np.linalg.solve(k[np.ix_(free, free)], load[free])
    expected = load[root] - (k @ still)[root]
    assert rest(pieces, tip).moments[0][0] == pytest.approx(expected, rel=1e-6)


def test_a_voltage_bends_and_stretches_a_unimorph():
    """Strain of 1 V at rest by the balance of force and moment of a free section."""
    beam = Beam(**{**LOADED, "layers": 1})
    z = (np.arange(40_000) + 0.5) * 0.4e-3 / 40_000 - 0.07e-3
    modulus = np.where(z < 0.07e-3, 105e9, 66e9)
    free = np.where(z < 0.07e-3, 0.0, -190e-12 / 0.26e-3)
    left = [[modulus.sum(), (modulus * z).sum()], [(modulus * z).sum(), (modulus * z**2).sum()]]
    right = [(modulus * free).sum(), (modulus * free * z).sum()]
    stretch, curvature = np.linalg.solve(left, right)
    made = lumped(beam)
    for found, height in ((strain_of_layers(beam), 0.33e-3), (strain_of_substrate(beam), -0.07e-3)):
        strain = -found.per_displacement * made.coupling / made.stiffness + found.per_volt
        assert strain == pytest.approx(stretch + height * curvature, rel=1e-6)


def test_a_limit_is_of_the_layers_alone():
    """A patch off the clamp has 26 % of the strain of the aluminium at the clamp."""
    beam = Beam(
        70e-3, 15e-3, 0.5e-3, 0.25e-3, material="aluminium", piezo_start=5e-3, piezo_length=22e-3,
        connection="parallel", tip_material="steel", tip_length=9e-3, tip_height=6e-3,
    )  # fmt: skip
    layers, substrate = strain_of_layers(beam), strain_of_substrate(beam)
    # Own finite elements: Hermite cubics, 60 a piece.
    assert layers.per_displacement == pytest.approx(0.0779, rel=2e-3)
    assert abs(substrate.per_displacement) == pytest.approx(0.3024, rel=2e-3)


def test_outer_fibre_is_the_layers():
    weights = np.array([105e9 * 0.14e-3, 66e9 * 0.26e-3])
    axis = (weights @ [0.0, 0.20e-3]) / weights.sum()
    assert section(Beam(**PATCHED), True).axis == pytest.approx(axis)
    assert section(Beam(**BARE_ROOT), False).axis == pytest.approx(0.0, abs=1e-12)
    layers, substrate = strain_of_layers(Beam(**BARE_ROOT)), strain_of_substrate(Beam(**BARE_ROOT))
    assert (layers.position, layers.modulus, substrate.modulus) == (4e-3, 66e9, 105e9)


def _driven(frequency, resistance, base):
    """The bimorph under a sine."""
    return Scene.read("bimorph").replace(
        {"load.resistance": resistance},
        excitation={
            "kind": "sine", "amplitude": base, "frequency": frequency, "intensity": None,
            "correlation_time": None,
        },
        run={"duration": 2.0, "settle": 2.0, "realizations": 1},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_peak_and_rms_of_a_sine():
    frequency, resistance, base = 46.5, 33e3, 10.0
    scene = _driven(frequency, resistance, base)
    result = harvester.simulate(scene, method="monte-carlo", step="fine", workers=1)
    made, strain = lumped(scene.beam), strain_of_layers(scene.beam)
    rate = 2j * math.pi * frequency
    compliance = 1.0 / (made.stiffness + rate * made.damping + rate**2 * made.mass)
    force = -made.base_factor * made.mass * base
    admittance = 1.0 / resistance + rate * (made.capacitance + made.coupling**2 * compliance)
    voltage = rate * (made.coupling * compliance * force - made.rest_charge * base) / admittance
    x = compliance * (force - made.coupling * voltage)
    expected = abs(strain.per_displacement * x + strain.per_volt * voltage)
    stress = abs(
        strain.modulus * (strain.per_displacement * x + strain.per_volt * voltage)
        + strain.stress_per_volt * voltage
    )
    assert result["peak_strain"].estimate == pytest.approx(expected, rel=2e-3)
    assert result["rms_strain"].estimate == pytest.approx(expected / math.sqrt(2.0), rel=2e-3)
    assert result["peak_stress"].estimate == pytest.approx(stress, rel=2e-3)
    assert result["rms_stress"].estimate == pytest.approx(stress / math.sqrt(2.0), rel=2e-3)
    # A ceramic bears 27.6 MPa over 66 GPa, without a word in the scene.
    assert expected > 27.6e6 / 66e9
    assert any("exceeds 0.000418, the limit of PSI-5A4E" in note for note in result.notes)
    with pytest.raises(HarvesterError, match="needs the Basquin curve"):
        result["fatigue_life"]


@pytest.mark.exhaustive
def test_life_under_narrow_band_noise():
    """Rayleigh amplitudes: damage rate f/N (√2 σ/ε)^m Γ(1 + m/2)."""
    noise, ratio = 1e-3, 0.005
    scene = Scene.read("bimorph").replace(
        {
            **LINE, "beam.damping_ratio": ratio, "beam.strain_limit": 1e-6,
            "load.resistance": 1.0, "run.duration": 30.0, "run.settle": 3.0,
        }
    )  # fmt: skip
    result = harvester.simulate(scene, method="monte-carlo", workers=1)
    made, omega = lumped(scene.beam), 2.0 * math.pi * lumped(scene.beam).short_frequency
    tau = 1e-3
    filtered = (1.0 + 2.0 * ratio * omega * tau) / (
        1.0 + 2.0 * ratio * omega * tau + (omega * tau) ** 2
    )
    square = made.base_factor**2 * noise / (2.0 * ratio * omega**3) * filtered
    square *= 1.0 - kernel_loss(2.0 * math.pi / omega / 40.0, omega)
    sigma = strain_of_layers(scene.beam).per_displacement * math.sqrt(square)
    expected = omega / (2.0 * math.pi) / 1e6 * (math.sqrt(2.0) * sigma / 1e-4) ** 4 * math.gamma(3)
    rate, life, rms = (result[name] for name in ("damage_rate", "fatigue_life", "rms_strain"))
    assert rms.estimate == pytest.approx(sigma, abs=3.0 * rms.standard_error)
    assert rate.estimate == pytest.approx(expected, abs=3.0 * rate.standard_error)
    assert rate.standard_error < 0.1 * expected
    assert life.estimate == pytest.approx(1.0 / rate.estimate)
    assert life.standard_error == pytest.approx(rate.standard_error / rate.estimate**2)
    # Peaks of some 1,400 cycles with a memory of 1/(2 ζ) each lie at 3 to 5 σ.
    assert 3.0 * sigma < result["peak_strain"].estimate < 5.0 * sigma
    assert result["peak_strain"].standard_error is not None
    assert any("exceeds 1e-06, beam.strain_limit" in note for note in result.notes)


# ASTM E1049-85, 5.4.4, figure 6: its history, and its cycles by range.
HISTORY = (-2, 1, -3, 5, -1, 3, -4, 4, -2)
CYCLES = {3: 0.5, 4: 1.5, 6: 0.5, 8: 1.0, 9: 0.5}


def test_cycles_of_e1049():
    rainflow = pytest.importorskip("rainflow")
    assert dict(rainflow.count_cycles(HISTORY)) == CYCLES
    # The same through a record whose strain goes from one reversal to the next.
    scene = Scene.read("bimorph").replace({**LINE, "run.settle": 0.0})
    watch, moments = _watched(scene, HISTORY)
    watch.close()
    damage = sum(share * (0.5 * span / 1e-4) ** 4.0 for span, share in CYCLES.items()) / 1e6
    assert moments.strain.damage.sum() == pytest.approx(damage, rel=1e-6)
    assert moments.strain.peaks.max(axis=0)[0] == pytest.approx(5.0, rel=1e-4)


def _watched(scene, history):
    """A watch that has seen half waves between these strains, in two chunks."""
    from harvester.device.record import Record
    from harvester.engines.realization import empty_moments
    from harvester.scene.prepared import prepared

    moments = empty_moments(prepared(scene))
    moments.strain.rows[:] = [[1.0, 0.0], [2.0, 0.0]]
    watch = StrainWatch(moments, scene.beam.fatigue_line)
    # No point lies on a reversal but the first and the last.
    phase = np.linspace(0.0, len(history) - 1.0, 150 * (len(history) - 1))
    begin = np.minimum(phase.astype(int), len(history) - 2)
    low, high = np.array(history, dtype=float)[begin], np.array(history, dtype=float)[begin + 1]
    x = low + (high - low) * 0.5 * (1.0 - np.cos(np.pi * (phase - begin)))
    time = 1e-3 * (1.0 + np.arange(x.size))
    rest_of = [np.zeros(x.size)] * 7
    for part in (slice(0, 311), slice(311, None)):
        watch.add(Record(time[part], x[part], *(each[part] for each in rest_of)))
    return watch, moments


def test_peaks_have_the_errors_of_their_realizations():
    from dataclasses import replace

    from harvester.engines.realization import empty_moments
    from harvester.scene.prepared import prepared

    one = empty_moments(prepared(Scene.read("bimorph")))
    one.integrals[:, 0] = one.batch_length
    one.last[0] = one.start + one.batch_length * len(one.integrals)
    heights = (3.0, 4.0, 5.0, 6.0)
    several = []
    for height in heights:
        strain = replace(one.strain, peaks=one.strain.peaks.copy())
        strain.peaks[1], strain.squares[:, 0] = (height, 2.0 * height), one.batch_length
        several.append(replace(one, strain=strain))
    noise = Scene.read("bimorph").excitation
    found = estimate_strain(several, noise)["peak_strain"]
    assert found.estimate == 4.5
    # Student's t of three degrees of freedom over the normal's 1.96.
    expected = np.std(heights, ddof=1) / 2.0 * 3.182446 / 1.959964
    assert found.standard_error == pytest.approx(expected, rel=1e-5)
    assert "one peak" in estimate_strain(several[:1], noise)["peak_strain"].note


def test_refusals(monkeypatch):
    scene = Scene.read("bimorph")
    monkeypatch.setitem(sys.modules, "rainflow", None)
    with pytest.raises(MissingLibrary, match=r"pip install 'vibration-harvester\[fatigue\]'"):
        _watched(scene.replace({**LINE, "run.settle": 0.0}), HISTORY)
    with pytest.raises(SceneError, match=r"give beam.fatigue_cycles, "):
        scene.replace({"beam.fatigue_strain": 1e-4})
    lumped_scene = scene.without_drawing()
    assert lumped_scene.beam is None
    with pytest.raises(HarvesterError):
        Scene.read("cantilever").replace({"beam.strain_limit": 1e-4})


@pytest.mark.exhaustive
def test_an_optimum_keeps_the_limit():
    """The power grows with a sine's amplitude until the strain, in proportion, is at its limit."""
    pytest.importorskip("optuna")
    scene = _driven(46.5, 33e3, 1.0).replace({"run.duration": 0.5, "run.settle": 1.0})
    unit = harvester.simulate(scene, method="monte-carlo", workers=1)["peak_strain"].estimate
    limited = scene.replace({"beam.strain_limit": 4.0 * unit})
    found = harvester.optimum(limited, {"excitation.amplitude": (1.0, 10.0)}, evaluations=16)
    assert 0.9 * 4.0 < found.parameters[0].place <= 4.0 * (1.0 + 1e-6)
    assert any("strain_limit" in line for line in found.sentences())
    with pytest.raises(HarvesterError, match="computes no peak strain"):
        harvester.optimum(limited, {"excitation.amplitude": (1.0, 10.0)}, method="spectral")


def test_a_stored_answer_holds_the_strain():
    from harvester.engines.codec import packed, unpacked
    from harvester.engines.realization import empty_moments
    from harvester.scene.prepared import prepared

    moments = empty_moments(prepared(Scene.read("bimorph")))
    moments.strain.peaks[:] = 3.0
    moments.strain.damage = np.full(len(moments.strain.peaks), 0.25)
    again = unpacked(packed("key", [moments]), "key")[0].strain
    assert (again.rows == moments.strain.rows).all()
    assert (again.peaks == 3.0).all()
    assert (again.damage == 0.25).all()

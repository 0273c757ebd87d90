"""Every figure's axes: the printed unit times the number drawn is the result's own number."""

import re

import numpy as np
import pytest

import harvester
from harvester import Scene
from harvester.device.record import Record
from harvester.scene.prepared import prepared
from harvester.studies.comparison.excitation_drawing import draw_spectrum, excitation_spectrum
from harvester.studies.loads.drawing import (
    EFFICIENCIES,
    draw_efficiency,
    draw_power,
    draw_waveforms,
)
from harvester.studies.sensitivity.study import draw_distribution

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("shared_workers")]

PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "m": 1e-3, "µ": 1e-6, "n": 1e-9, "p": 1e-12}
UNIT = re.compile(r"([kMmµnp]?)(?:[VWAsmΩ]|Hz)(²?)|1|%|\D+/.*")
# Marks of the ends of error bars, which matplotlib keeps as lines.
CAPS = ("|", "_")
SHORT = {"run.duration": 4.0, "run.settle": 1.0, "run.realizations": 4}
# Linear and in SI units, so that powers, voltages and displacements have prefixes.
CANTILEVER = Scene.read("cantilever").replace(SHORT)
SINE = CANTILEVER.replace({"excitation": {"kind": "sine", "amplitude": 1.0, "frequency": 46.0}})
DEVICE = Scene.read("device").replace(
    {**SHORT, "excitation": {"kind": "sine", "amplitude": 3.5, "frequency": 8.0}}
)


def drawn(figure, words, axis="y"):
    """Largest size drawn on the axis whose label begins with `words`, in units without prefix."""
    labels = []
    for axes in figure.axes:
        label = getattr(axes, f"get_{axis}label")().replace("\n", " ")
        labels.append(label)
        if not label.startswith(words):
            continue
        unit = re.search(r"\[(.*)\]", label).group(1)
        prefix, squared = UNIT.fullmatch(unit).groups()
        factor = 0.01 if unit == "%" else PREFIXES[prefix or ""] ** (2 if squared else 1)
        sizes = [
            np.abs(np.asarray(getattr(line, f"get_{axis}data")(), float))
            for line in axes.lines
            # A vertical line across the axes has no value on the y axis.
            if line.get_transform().contains_branch_seperately(axes.transData)[axis == "y"]
            and line.get_marker() not in CAPS
        ]
        return factor * max(np.nanmax(size) for size in sizes if size.size)
    raise AssertionError(f"no axis {words!r} among {labels}")


def largest(cells, name):
    return max(abs(cell.estimates[name].estimate) for cell in cells)


@pytest.mark.parametrize(
    "quantity", ["mean_square_voltage", "mean_power", "power_conversion_efficiency"]
)
def test_a_sweep(quantity):
    over = {"load.resistance": [5e4, 2e5]}
    sweep = harvester.sweep(CANTILEVER, over, quantities=[quantity])
    words = quantity.replace("_", " ")
    assert drawn(sweep.figure(), words) == pytest.approx(largest(sweep.cells.ravel(), quantity))
    axes = sweep.figure().axes[0]
    assert axes.get_xlabel() == "load resistance [kΩ]"
    # The values are in Ω, the labels of the ticks in kΩ.
    assert axes.xaxis.get_major_formatter()(max(axes.lines[0].get_xdata()), None) == "200"


def test_an_optimum():
    optimum = harvester.optimum(
        CANTILEVER, "load.resistance", low=4e4, high=4e5, maximise="mean_power", closure="spectral"
    )
    value = optimum.value.estimate
    assert drawn(optimum.figure(), "mean power") == pytest.approx(value, rel=1e-3)


def test_a_distribution_over_devices():
    study = harvester.sensitivity(
        CANTILEVER, {"load.resistance": "±20%"}, quantity="mean_power", method="spectral", rows=16
    )
    figure = draw_distribution(study)
    [axes] = figure.axes
    unit = re.search(r"\[(.*)\]", axes.get_xlabel()).group(1)
    edges = [patch.get_x() * PREFIXES[unit[0]] for patch in axes.patches if patch.get_width()]
    assert min(edges) < study.nominal.estimate < 1.3 * max(edges)


def test_a_load_study():
    study = harvester.load_study(
        CANTILEVER,
        loads=["resistor"],
        over={"load.parameters.resistance": [5e4, 2e5]},
        method="monte-carlo",
        precision=0.3,
    )
    largest_power = max(each.power for each in study.evaluations)
    assert drawn(draw_power(study), "output power") == pytest.approx(largest_power)
    share = largest(study.evaluations, EFFICIENCIES[1])
    assert drawn(draw_efficiency(study), "(output + store)/input") == pytest.approx(share)
    [best] = [study.best((0,))]
    voltage = np.abs(best.waveform[Record._fields.index("voltage")]).max()
    assert drawn(draw_waveforms(study), "voltage") == pytest.approx(voltage)


def test_a_frequency_response():
    response = harvester.frequency_response(SINE, [44.0, 46.0], amplitude=1.0)
    [sweep] = response.to_dict()["sweeps"].values()
    power = max(sweep[response.power])
    figure = response.figure()
    label = response.power.replace("_", " ")
    assert drawn(figure, label) == pytest.approx(power)


def test_a_bifurcation():
    found = harvester.bifurcation(
        DEVICE, over={"excitation.amplitude": [0.5, 1.0]}, down=False, periods=40
    )
    told = found.to_dict()["branches"][0]
    assert drawn(found.figure(), "mean power") == pytest.approx(np.nanmax(told["mean_power"]))
    moved = np.nanmax(np.abs(told["displacement"]))
    assert drawn(found.figure(), "displacement") == pytest.approx(moved)


def test_basins():
    found = harvester.basins(DEVICE, points=3)
    figure = found.figure()
    for axis, column in (("x", 0), ("y", 1)):
        words = ("displacement", "velocity")[column] + " at the start"
        furthest = max(np.abs(orbit.points[:, column]).max(initial=0.0) for orbit in found.orbits)
        assert drawn(figure, words, axis) == pytest.approx(furthest)


def test_a_waveform():
    result = harvester.simulate(CANTILEVER, method="monte-carlo", window=(1.0, 1.5))
    waveform = result.waveform
    figure = waveform.figure()
    for name in ("displacement", "voltage"):
        assert drawn(figure, name) == pytest.approx(np.abs(waveform.columns[name]).max())


def test_densities():
    result = harvester.simulate(CANTILEVER, method="monte-carlo")
    density = result.densities["displacement"]
    furthest = np.abs(density.centre).max() * result.scales.of("displacement")
    rms = np.sqrt(result["mean_square_displacement"].estimate)
    assert 2.0 * rms < drawn(result.figure(), "displacement", "x") <= furthest


def test_the_spectrum_of_an_excitation():
    frequency, density = excitation_spectrum(prepared(CANTILEVER))
    figure = draw_spectrum(CANTILEVER)
    assert drawn(figure, "acceleration") == pytest.approx(density.max())
    assert drawn(figure, "frequency", "x") <= frequency.max()

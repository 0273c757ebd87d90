"""Waveforms in SI, against Ohm's law on a load of two resistors."""

import csv

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from harvester.base.errors import HarvesterError, LoadError, NetlistError, UnknownQuantity
from harvester.cli.output import check_outputs
from harvester.engines.simulate import simulate
from harvester.results import figures
from harvester.results.files import save
from harvester.results.panels import Panel, Series, draw_panels
from harvester.results.waveform import Waveform
from harvester.scene.model import Scene

pytestmark = pytest.mark.usefixtures("shared_workers")

UPPER, LOWER, COIL = 2e5, 1e5, 1e-3
DIVIDER = f"""
.subckt divider p n out ref
Rupper p mid {UPPER:g}
Lcoil mid out {COIL:g}
Rlower out ref {LOWER:g}
Rwire ref n 1m
.ends
"""


@pytest.fixture(scope="module")
def divided(tmp_path_factory):
    file = tmp_path_factory.mktemp("loads") / "divider.lib"
    file.write_text(DIVIDER)
    return Scene.read("device", [f'load.netlist="{file}"', "run.realizations=2", "run.duration=6"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", [pytest.param("circuit", marks=pytest.mark.exhaustive), "monte-carlo"]
)
def test_ohms_law_in_volts_and_amperes(divided, method):
    """Closed form; the numbers of the run are those without nodes."""
    result = simulate(divided, method=method, nodes=["MID", "I(Lcoil)"])
    wave = result.waveform
    assert list(wave.columns) == [
        "displacement", "velocity", "voltage", "current", "output_voltage", "mid", "i(lcoil)",
    ]  # fmt: skip
    # The settled part, 50 periods of 12.1 Hz.
    assert wave.time[0] == pytest.approx(5.0, abs=0.002)
    assert wave.time[-1] == pytest.approx(5.0 + 50 / 12.1, abs=0.1)
    at = 0.1 + np.arange(1.0, 4.0, 0.01) + 4.0
    voltage = np.interp(at, wave.time, wave.voltage)
    size = np.abs(wave.voltage).max()
    assert size > 1.0
    for column, truth in (
        ("output_voltage", voltage * LOWER / (UPPER + LOWER)),
        ("mid", voltage * LOWER / (UPPER + LOWER)),
        ("current", voltage / (UPPER + LOWER)),
        ("i(lcoil)", voltage / (UPPER + LOWER)),
    ):
        found = np.interp(at, wave.time, wave[column])
        np.testing.assert_allclose(found, truth, atol=2e-4 * np.abs(truth).max())
    velocity = np.gradient(wave.displacement, wave.time)[5:-5]
    np.testing.assert_allclose(velocity, wave.velocity[5:-5], atol=0.02 * velocity.max())
    bare = simulate(divided, method=method, window=(5.5, 5.7))
    for name, estimate in bare.scaled_quantities.items():
        assert estimate.estimate == pytest.approx(
            result.scaled_quantities[name].estimate, rel=1e-13
        )
    assert 5.5 <= bare.waveform.time[0] < bare.waveform.time[-1] <= 5.7


def test_files_and_tables(tmp_path):
    scene = Scene.read("device", ["run.realizations=1", "run.duration=2", "run.settle=1"])
    wave = simulate(scene, method="monte-carlo", window=(1.0, 1.5)).waveform
    save(wave, tmp_path / "w.csv")
    with open(tmp_path / "w.csv", newline="") as file:
        header, first, *_ = csv.reader(file)
    assert header[:4] == ["time [s]", "displacement [m]", "velocity [m/s]", "voltage [V]"]
    assert float(first[4]) == pytest.approx(float(first[3]) / 306e3)
    frame = wave.to_dataframe()
    assert frame.columns[0] == "time [s]"
    assert frame["voltage [V]"].to_numpy() == pytest.approx(wave.voltage)
    assert wave.to_xarray()["current"].attrs["unit"] == "A"
    for ending in (".nc", ".png"):
        assert save(wave, tmp_path / f"w{ending}") == [f"w{ending}"]
        assert (tmp_path / f"w{ending}").stat().st_size > 1000
    with pytest.raises(HarvesterError, match=r"\.csv, \.nc"):
        check_outputs(None, None, waveform="w.xls")
    with pytest.raises(HarvesterError, match=r"a scene.s file ends in \.toml"):
        save(scene, tmp_path / "scene")
    with pytest.raises(UnknownQuantity, match="did you mean voltage"):
        wave["volt"]


# A bridge whose DC side holds a filter; the diodes part it from the piezo's terminals.
FILTERED = """
.subckt filtered p n out ref
D1 p dc d
D2 n dc d
D3 ref p d
D4 ref n d
Rfilter dc out 1k
Cfilter dc ref 10n
Rload out ref 1meg
.model d D(is=1n)
.ends
"""


@pytest.mark.slow
def test_voltages_of_the_dc_side_are_against_its_reference(tmp_path):
    """Ohm's law and Kirchhoff's: a node against ref, two nodes, the reference against n."""
    file = tmp_path / "filtered.lib"
    file.write_text(FILTERED)
    settings = ["run.realizations=1", "run.duration=2", "run.settle=1"]
    scene = Scene.read("device", [f'load.netlist="{file}"', *settings])
    nodes = ["dc", "v(out)", "V(dc, out)", "p", "v(ref)", "v(dc,n)"]
    wave = simulate(scene, method="monte-carlo", nodes=nodes, window="all").waveform
    assert wave.time[0] == pytest.approx(0.0, abs=1e-3)
    assert wave.time[-1] == pytest.approx(3.0, abs=1e-3)
    size = wave["output_voltage"].max()
    assert size > 0.1
    close = {"atol": 1e-9 * size}
    np.testing.assert_allclose(wave["out"], wave["output_voltage"], **close)
    np.testing.assert_allclose(wave["p"], wave.voltage, **close)
    np.testing.assert_allclose(wave["dc"], wave["out"] * (1.0 + 1e3 / 1e6), **close)
    np.testing.assert_allclose(wave["v(dc,out)"], wave["dc"] - wave["out"], **close)
    np.testing.assert_allclose(wave["v(dc,n)"], wave["dc"] + wave["ref"], **close)


def waveform(columns, units):
    time = np.linspace(0.0, 1.0, len(columns["velocity"]))
    return Waveform(Scene.read("device"), "engine", time, columns, units, None)


@pytest.mark.parametrize("periods", [70, 900])
def test_a_line_of_many_points_is_a_small_file(periods):
    """matplotlib leaves out points that change no pixel; all of them would be megabytes."""
    phase = 2.0 * np.pi * periods * np.linspace(0.0, 1.0, 300_001)
    values = (1.0 + 0.2 * np.cos(phase / periods)) * np.sin(phase)
    wave = waveform({"velocity": values, "voltage": values}, {"velocity": "m/s", "voltage": "V"})
    figure = wave.figure()
    (line,) = figure.axes[0].lines
    assert line.get_xdata()[-1] == wave.time[-1]
    assert len(figures.image(figure)) < 300_000


def test_a_column_constant_but_for_rounding_and_a_negative_offset():
    time = np.linspace(0.0, 1.0, 200)
    columns = {
        "velocity": time,
        "i(v1)": -1.8 / 16.2e3 * (1.0 + 4e-7 * np.sin(20.0 * time)),
        "i(v2)": -1.8 / 16.2e3 * (1.0 + 1e-5 * np.sin(20.0 * time)),
        "i(v3)": 5e-11 * np.sin(20.0 * time),
    }
    units = dict.fromkeys(columns, "A") | {"velocity": "m/s"}
    first, second, third = waveform(columns, units).figure().axes
    assert first.get_ylabel() == "i(v1)\n(constant to\n110 pA)\n[µA]"
    assert np.ptp(first.lines[0].get_ydata()) == 0.0
    assert second.get_ylabel() == "i(v2)\n+ 111.1111 µA\n[nA]"
    assert third.get_ylabel() == "i(v3)\n(constant to\n110 pA)\n[A]"
    assert not third.lines[0].get_ydata().any()


def test_equal_columns_share_a_panel_and_a_small_ripple_is_drawn_as_deviation():
    time = np.linspace(0.0, 1.0, 200)
    ripple = 2.00913 + 1e-5 * np.sin(20.0 * time)
    columns = {"velocity": time, "output_voltage": ripple, "out": ripple * (1.0 + 1e-15), "a": time}
    units = {"velocity": "m/s", "output_voltage": "V", "out": "V", "a": "V"}
    figure = waveform(columns, units).figure()
    FigureCanvasAgg(figure).draw()
    output, node = figure.axes
    assert output.get_ylabel() == "output voltage, out\n− 2.00913 V\n[µV]"
    (line,) = output.lines
    np.testing.assert_allclose(line.get_ydata(), 1e6 * (ripple - ripple.mean()), atol=1e-6)
    assert node.get_ylabel() == "a\n[V]"
    assert not any(axes.yaxis.get_offset_text().get_text() for axes in figure.axes)


def test_no_axis_has_an_offset():
    panel = Panel("x", "y", [Series((0.0, 1.0), (2.00913, 2.00914))])
    figure = figures.drawn(lambda panels: draw_panels(panels, "title"), [panel])
    FigureCanvasAgg(figure).draw()
    assert not figure.axes[0].yaxis.get_offset_text().get_text()


def test_refusals(divided):
    with pytest.raises(NetlistError, match="no node or current q"):
        simulate(divided, nodes=["v(p,q)"])
    with pytest.raises(NetlistError, match="did you mean mid"):
        simulate(divided, nodes=["midd"])
    for spelling in ("i(Rlower)", "@rlower[i]", "rlower"):
        with pytest.raises(
            NetlistError, match=r"0 V in series \(V1 a b 0\) and use i\(V1\); there"
        ):
            simulate(divided, nodes=[spelling])
    with pytest.raises(LoadError, match="resistor alone"):
        simulate("device", nodes=["p"])
    with pytest.raises(HarvesterError, match="START < END"):
        simulate(divided, window=(2.0, 1.0))
    with pytest.raises(HarvesterError, match=r"window 1e\+06:2e\+06: the run ends at "):
        simulate(divided, window=(1e6, 2e6))

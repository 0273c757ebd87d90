"""Traces of voltage and current: their energies, and that Shepherd's own reader takes them."""

import logging

import numpy as np
import pytest

import harvester
from harvester.base.errors import HarvesterError
from harvester.interop.formats import write
from harvester.interop.traces import record_trace

pytestmark = pytest.mark.usefixtures("shared_workers")


def test_a_trace_too_long_is_refused_with_its_size(tmp_path):
    pytest.importorskip("shepherd_core")
    with pytest.raises(HarvesterError, match=r"2e\+08 samples, 3.2 GB.*up to 200 s"):
        write(harvester.Scene.read("paper_si"), "shepherd", tmp_path)


def test_a_trace_without_a_sample_is_refused(tmp_path):
    with pytest.raises(HarvesterError, match=r"no sample: give --duration 0\.333333 or more"):
        write(harvester.Scene.read("device"), "csv", tmp_path, rate=3.0, duration=0.1)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_named_like_a_file_is_refused(tmp_path):
    with pytest.raises(HarvesterError, match=r"trace\.csv must be a folder, such as --output .*e$"):
        write(harvester.Scene.read("device"), "csv", tmp_path / "trace.csv", duration=0.1)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.exhaustive
def test_shepherd_reads_the_energy_of_the_load(tmp_path, caplog):
    """V²/R of the load's own voltage, from the resistor's moments of the same run."""
    reader = pytest.importorskip("shepherd_core").Reader
    scene = harvester.Scene.read("cantilever").replace({"run.settle": 0.0, "run.realizations": 1})
    said = []
    path = write(scene, "shepherd", tmp_path, said.append, duration=2.0)[0]
    assert said[0] == "2 s at 100000 samples a second: up to 3.2 MB"
    assert "real device gives" in said[1]
    caplog.set_level(logging.WARNING)
    with reader(path) as file:
        assert file.is_valid()
        energy, rate, kind = file.energy(), file.samplerate_sps, file.get_datatype()
    assert not caplog.records
    assert (rate, kind) == (100_000, "ivsample")
    result = harvester.simulate(scene.replace({"run.duration": 2.0}), method="monte-carlo")
    assert energy == pytest.approx(2.0 * result["mean_power"].estimate, rel=1e-3)


@pytest.mark.exhaustive
def test_open_and_shorted_terminals(tmp_path, caplog):
    reader = pytest.importorskip("shepherd_core").Reader
    said = []
    scene = harvester.Scene.read("cantilever")
    path = write(scene, "shepherd", tmp_path, said.append, data="isc_voc", duration=1.0)[0]
    caplog.set_level(logging.WARNING)
    with reader(path) as file:
        assert file.is_valid()
        energy = file.energy()
    assert not caplog.records
    assert energy > 0.0
    assert "straight line between them predicts" in said[1]


@pytest.mark.exhaustive
def test_what_a_load_behind_a_bridge_takes(tmp_path):
    """CSV of the bridge's output, and the energy of its resistor."""
    scene = harvester.Scene.read("device").replace(
        load={"kind": None, "resistance": None, "netlist": "bridge"}
    )
    trace = record_trace(scene, 1e4, 0.5, 0)
    assert trace.voltage @ trace.current / 1e4 == pytest.approx(trace.energy, rel=1e-3)
    path = write(scene, "csv", tmp_path, duration=0.5)[0]
    time, voltage, current = np.loadtxt(path, delimiter=",", skiprows=1).T
    assert time[1] - time[0] == pytest.approx(1e-4)
    assert voltage == pytest.approx(trace.voltage, rel=1e-6)
    resistance = voltage / current
    assert resistance == pytest.approx(np.median(resistance), rel=1e-6)

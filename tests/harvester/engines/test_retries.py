"""Options of ngspice tried in turn where Newton's iterations fail, and when they are refused."""

import re
from types import SimpleNamespace

import pytest

from harvester.base.errors import NotConverged, SimulatorAborted
from harvester.engines.methods import Circuit, MonteCarlo
from harvester.engines.realization import empty_moments
from harvester.engines.retries import run_converged
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.prepared import prepared
from harvester.statistics.moments import QUANTITIES

BRIDGE = (
    ".subckt own p n out ref\n.model dm d(is=1e-9 n=1)\nD1 p rail dm\nD2 n rail dm\nD3 ref p dm\n"
    "D4 ref n dm\nCb rail ref 1u\n{}\nRload out ref 100k\n.ends\n"
)
# A reference, an amplifier and a PMOS transistor with hardly any capacitance at the output.
STEEP = (
    "Vr vr ref 1.8\nE1 g ref vol='v(rail,ref)*0.5*(1+tanh(1e3*(v(vo,ref)-v(vr,ref))))'\n"
    "M1 vo g rail rail pm l=1u w=1m\n.model pm pmos(vto=-0.7 kp=200u lambda=0.02 w=1 cgso=1n "
    "cgdo=1n)\nCv vo ref {}\nRo vo out 1"
)
# A source that its own voltage controls has several voltages at once, and jumps between them.
FOLDED = (
    "B1 q ref V=tanh(200*(v(rail,ref)-3+0.5*v(q,ref)))\nB2 rail vo I=(1+v(q,ref))*v(rail,vo)/1k\n"
    "Cv vo ref 10n\nRp vo ref 25k\nRo vo out 1"
)


def scene(tmp_path, body, duration=0.4):
    path = tmp_path / "own.lib"
    path.write_text(BRIDGE.format(body))
    return Scene.from_tables({
        "units": "SI",
        "oscillator": {"mass": 0.01, "damping": 0.1, "linear_stiffness": 100.0,
                       "cubic_stiffness": 0.0},
        "piezo": {"coupling": 4e-4, "capacitance": 40e-9},
        "load": {"netlist": str(path)},
        "excitation": {"kind": "sine", "amplitude": 2.0, "frequency": 16.0},
        "run": {"duration": duration, "settle": 0.0, "realizations": 1},
    })  # fmt: skip


def engine_that(where, converges, energy):
    """A stand-in for a run: it fails unless `converges(engine)`; its energies are `energy`."""
    calls = []

    def run(engine):
        calls.append(engine)
        if not converges(engine):
            raise NotConverged("trouble with node vo")
        moments = empty_moments(prepared(where))
        for name in ("input_power", "load_power"):
            moments.integrals[:, QUANTITIES.index(name)] = energy(engine)
        moments.first[:] = moments.last[:] = 0.0
        return [SimpleNamespace(moments=moments)]

    return run, calls


def test_a_run_that_converges_is_made_once(tmp_path):
    where = scene(tmp_path, STEEP.format("1u"))
    run, calls = engine_that(where, lambda engine: True, lambda engine: 1.0)
    (found,) = run_converged(prepared(where), Circuit(), run)
    assert calls == [Circuit()]
    assert found.moments.note == ""


def test_options_are_tried_in_order_and_the_first_that_converges_is_named(tmp_path):
    where = scene(tmp_path, STEEP.format("1u"))
    run, calls = engine_that(where, lambda engine: engine.gmin, lambda engine: 1.0)
    (found,) = run_converged(prepared(where), Circuit(), run)
    settings = [sorted(each.settings) for each in calls]
    ramp, gmin = ["ramp", "scheme"], ["gmin", "scheme"]
    assert settings == [[], ["scheme"], ["step"], ramp, gmin, gmin]
    assert calls[-1].gmin == 2.0 * calls[-2].gmin
    note = found.moments.note
    words = r"with Gear's rule and gmin = 1e-10 S; without: node vo \(.*twice"
    assert re.search(words, note)


@pytest.mark.parametrize("slope", [0.0, 1e9])
def test_an_option_that_changes_the_energies_is_refused(tmp_path, slope):
    where = scene(tmp_path, STEEP.format("1u"))
    run, _ = engine_that(where, lambda engine: engine.gmin, lambda e: 1.0 + slope * e.gmin)
    if slope == 0.0:
        assert run_converged(prepared(where), Circuit(), run)[0].moments.note
        return
    words = r"gmin = 1e-10 S \(refused: changes the energies by 9\.1%\).*cshunt.*e1 \(own\.lib:9\)"
    with pytest.raises(SimulatorAborted, match=words):
        run_converged(prepared(where), Circuit(), run)


def test_monte_carlo_is_not_repeated(tmp_path):
    where = scene(tmp_path, STEEP.format("1u"))
    run, calls = engine_that(where, lambda engine: False, lambda engine: 1.0)
    with pytest.raises(NotConverged):
        run_converged(prepared(where), MonteCarlo(), run)
    assert len(calls) == 1


@pytest.mark.slow
def test_a_steep_regulator_takes_the_power_of_one_with_a_capacitor(tmp_path, pool):
    """Plain ngspice at its default tolerance ends with "Timestep too small" on the first."""
    powers = [
        simulate(scene(tmp_path, STEEP.format(size)), runner=pool)["mean_power"].estimate
        for size in ("10p", "1n")
    ]
    assert powers[0] == pytest.approx(powers[1], rel=0.002)


@pytest.mark.slow
def test_a_source_with_several_voltages_is_refused_in_one_line(tmp_path, pool):
    with pytest.raises(
        SimulatorAborted, match=r"tried without success: Gear's rule; .*b1 \(own\.lib:8\)"
    ):
        simulate(scene(tmp_path, FOLDED, 1.0), runner=pool)

"""Path by path: the compiled engine against ngspice at its finest."""

import numpy as np
import pytest

from circuits.kernel.engine import circuit_of, integrate
from circuits.netlist.part_values import conductance
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path, start_state
from harvester.scene.prepared import prepared
from harvester.scene.steps import steps_per_sample, stop_time

SHORT = ["run.duration=0.8", "run.settle=0", "run.realizations=1"]
# With a linear spring no path parts from its neighbour.
LINEAR = ["oscillator.linear_stiffness=126.9", "oscillator.cubic_stiffness=0"]


def ours(scene):
    """(E[V²] of the piezo, power in the output's resistors, energy into the load), SI."""
    ready = prepared(scene)
    s, scales = ready.system, ready.scales
    circuit = circuit_of(prepared(scene))
    fixed = steps_per_sample(ready, "finest", "monte-carlo")
    path, stop = noise_path(ready, 0), stop_time(ready)
    chunks = [
        np.array([record.time, record.voltage, volts, record.load_power])
        for record, (volts, *_) in integrate(s, circuit, path, start_state(ready, 0), stop, fixed)
    ]
    time, piezo, output, power = np.concatenate(chunks, axis=1)
    square = np.trapezoid(piezo**2, time) / stop * scales.voltage**2
    siemens = conductance(circuit.load.across_output)
    used = np.trapezoid(output**2, time) / stop * scales.voltage**2 * siemens
    return square, used, np.trapezoid(power, time) * scales.power


@pytest.mark.slow
@pytest.mark.parametrize("load", ["bridge", "doubler", "bridge_buck"])
def test_diode_loads_follow_ngspice(pool, load):
    against_ngspice(pool, load)


@pytest.mark.slow
@pytest.mark.parametrize("load", ["sshi_parallel", "sshi_series", "sece"])
def test_switching_loads_follow_ngspice(pool, load):
    against_ngspice(pool, load)


def against_ngspice(pool, load):
    # A storage that has something to give, and is not charged from a rounding's worth.
    scene = Scene.read(
        "device",
        [*SHORT, f"load.netlist={load}", "load.parameters.initial=2", "load.parameters.storage=1u"],
    )
    theirs = simulate(scene, method="circuit", step="finest", runner=pool)
    square, used, _ = ours(scene)
    rms = theirs.quantity("rms_voltage").estimate
    assert square == pytest.approx(rms**2, rel=3e-3)
    assert used == pytest.approx(theirs.quantity("mean_output_power").estimate, rel=3e-3)


# A transformer, a bridge of two sorts of diodes, a Zener clamp and a switch that sheds the load.
OWN = """* a node of my own
.subckt node p n out ref resistance=300k
.model fast d(is=2.5n n=1.75 rs=0.6 cjo=4p tt=8n bv=100 ibv=10u)
.model slow d(is=40n n=1.1 rs=1 bv=30 ibv=10u)
.model clamp d(is=1f n=1 rs=5 bv=4.7 ibv=1m nbv=2 cjo=20p)
.model gate sw(vt=3 vh=0.5 ron=100 roff=1g)
Lfirst p n 400
Lsecond a b 100
Kboth Lfirst Lsecond 0.98
Rbleed b n 100meg
D1 a out fast
D2 ref a slow
D3 b out fast
D4 ref b slow
D5 ref out clamp
Cstray ref n 10p
Cout out ref 500n ic=2
S1 out shed out ref gate
R1 shed ref {resistance}
R2 out ref 1meg
.ends
"""


@pytest.mark.slow
def test_a_users_own_file_follows_ngspice(pool, tmp_path):
    path = tmp_path / "node.lib"
    path.write_text(OWN)
    scene = Scene.read("device", [*SHORT, f"load.netlist={path}", "excitation.intensity=1"])
    theirs = simulate(scene, method="circuit", step="finest", runner=pool)
    square, _, energy = ours(scene)
    assert square == pytest.approx(theirs.quantity("rms_voltage").estimate ** 2, rel=3e-3)
    taken = theirs.quantity("mean_power").estimate * scene.run.duration
    assert energy == pytest.approx(taken, rel=3e-3)


ZENER = """* clamped by a diode that breaks down
.subckt clamped p n
R1 p a 1k
D1 n a zener {part}
R2 p n 200k
.model zener d({model})
.ends
"""


@pytest.mark.parametrize(
    "model",
    [
        "is=1f n=1 bv=4.7 ibv=1m",
        "is=1f n=1 bv=4.7 ibv=1m nbv=2",
        "is=1f n=1.752 bv=4.7 ibv=1m rs=2",
        "is=10n n=1.5 bv=6.2 ibv=20u cjo=20p",
        "is=1u n=1 bv=6 ibv=50u",
        "is=20n n=1.05 bv=3 ibv=100u tt=1n area=20 m=2",
    ],
)
def test_a_breakdown_follows_ngspice(pool, tmp_path, model):
    path = tmp_path / "clamped.lib"
    model, of_part, area = model.partition("area")
    path.write_text(ZENER.format(part=of_part + area, model=model))
    scene = Scene.read("device", [*SHORT, *LINEAR, f"load.netlist={path}"])
    theirs = simulate(scene, method="circuit", step="finest", runner=pool)
    square, _, energy = ours(scene)
    assert square == pytest.approx(theirs.quantity("rms_voltage").estimate ** 2, rel=3e-3)
    taken = theirs.quantity("mean_power").estimate * scene.run.duration
    assert energy == pytest.approx(taken, rel=3e-3)


CLOCKED = """* a switch turned by a clock of quick edges, often at the same steps
.subckt clocked p n out ref
V1 ck n pulse(0 5 0.1 1u 1u 50m 100m)
I1 n out sin(0 1u 50 0.1 0)
S1 p q ck n gate
.model gate sw(vt=2.5 vh=0.1 ron=1k roff=1g)
R1 q out 47k
C1 out ref 220n
R2 out ref 100k
V2 ref n 0
.ends
"""


@pytest.mark.slow
@pytest.mark.parametrize("step", ["default", pytest.param("finest", marks=pytest.mark.exhaustive)])
def test_a_switch_that_turned_conducts_as_it_should(pool, tmp_path, step):
    path = tmp_path / "clocked.lib"
    path.write_text(CLOCKED)
    run = ("run.duration=1.5", "run.settle=0", "run.realizations=2")
    scene = Scene.read("device", [f"load.netlist={path}", *LINEAR, *run])
    theirs = simulate(scene, method="circuit", step="finest", runner=pool)
    own = simulate(scene, method="monte-carlo", step=step, runner=pool)
    for name in ("mean_square_voltage", "mean_output_power"):
        reference = theirs.quantity(name).estimate
        assert own.quantity(name).estimate == pytest.approx(reference, rel=5e-3)


BUCK = """* a buck converter without a clock: the switch closes at 8 V and opens at 4 V
.subckt buck p n out ref
.model fast d(is=10n n=1.1 rs=1)
D1 p r fast
D2 n r fast
D3 ref p fast
D4 ref n fast
C1 r ref 220n
R1 ref n 100meg
S1 r sw r ref gate
.model gate sw(vt=6 vh=2 ron=2 roff=100meg)
L1 sw out 4.7m
D5 ref sw fast
C2 out ref 22u ic=1
R2 out ref 20k
.ends
"""


def test_the_circuits_steps_follow_a_switch_whose_turn_throws_its_control_back(pool, tmp_path):
    """As it opens, its supply rises again and its coil's node falls by 5 V."""
    path = tmp_path / "buck.lib"
    path.write_text(BUCK)
    run = ("run.duration=1.5", "run.settle=0", "run.realizations=2")
    scene = Scene.read("device", [f"load.netlist={path}", *LINEAR, *run])
    theirs = simulate(scene, method="circuit", runner=pool)
    own = simulate(scene, method="monte-carlo", step="fine", runner=pool)
    for name in ("mean_output_power", "mean_storage_power", "mean_converter_loss"):
        reference = own.quantity(name).estimate
        assert theirs.quantity(name).estimate == pytest.approx(reference, rel=1e-2)


FORWARD = """* a forward converter: as the switch turns, coupled coils hand over their current
.subckt forward p n out ref
.model schottky d(is=1u n=1.05 rs=0.1 cjo=20p)
.model gate sw(vt=4 vh=2 ron=5 roff=1g)
D1 p r schottky
D2 n r schottky
D3 g p schottky
D4 g n schottky
R1 g ref 1
C1 r g 220n
L1 r d 50m
L2 a b 50m
K1 L1 L2 0.98
S1 d g r g gate
R2 b ref 10
D5 a out schottky
R3 d e 10k
C2 e r 100p
C3 out ref 10u
R4 out ref 50k
.ends
"""


@pytest.mark.slow
def test_coils_that_hand_over_their_current_lose_no_more_than_they_should(pool, tmp_path):
    """In times much shorter than the first step after a switch's turn usually is."""
    path = tmp_path / "forward.lib"
    path.write_text(FORWARD)
    run = ("run.duration=2", "run.settle=0", "run.realizations=4")
    scene = Scene.read("device", [f"load.netlist={path}", *LINEAR, *run])
    rough, known = (
        simulate(scene, method="monte-carlo", step=step, runner=pool).quantity("mean_output_power")
        for step in ("default", "finest")
    )
    assert rough.estimate == pytest.approx(known.estimate, rel=5e-3)


DUMPED = """* a charged capacitor, switched onto a Zener diode at 5 ms
.subckt dumped p n out ref
.model zener d(is=1f n=1 rs=0.5 bv=6 ibv=1m)
.model gate sw(vt=0.5 vh=0.1 ron=0.1 roff=1t)
R1 p n 100k
C1 out ref 10n ic=10
R2 out ref 1t
R3 ref n 1
V1 c n pulse(0 1 5m 1u 1u 1 2)
S1 out z c n gate
D1 ref z zener
.ends
"""


def test_what_a_diode_lets_out_at_once_is_no_more_than_its_law_allows(tmp_path):
    path = tmp_path / "dumped.lib"
    path.write_text(DUMPED)
    scene = Scene.read("device", [*SHORT, f"load.netlist={path}"])
    ready = prepared(scene)
    s, scales = ready.system, ready.scales
    path, stop, start = (
        noise_path(ready, 0),
        stop_time(ready),
        start_state(ready, 0),
    )
    *_, (_, (volts, *_)) = integrate(s, circuit_of(prepared(scene)), path, start, stop)
    # Long after, C dV/dt is ibv exp((V - 6 V)/Vt): V = 6 V - Vt ln(ibv t/(C Vt)).
    thermal = 1.380649e-23 * 300.15 / 1.602176634e-19
    left = 6.0 - thermal * np.log(1e-3 * (stop - 5e-3) / (1e-8 * thermal))
    assert volts[-1] * scales.voltage == pytest.approx(left, rel=5e-3)


LOADS = ("bridge", "doubler", "sshi_parallel", "sshi_series", "sece", "bridge_buck")


@pytest.mark.slow
@pytest.mark.parametrize("load", LOADS)
def test_energy_is_balanced_by_default(pool, load):
    scene = Scene.read(
        "device", [f"load.netlist={load}", "run.duration=8", "run.settle=1", "run.realizations=2"]
    )
    result = simulate(scene, method="monte-carlo", runner=pool)
    assert abs(result.energy_balance_residual) < 0.005
    assert 0.0 < result.quantity("converter_efficiency").estimate < 1.0
    again = simulate(scene, method="monte-carlo", runner=pool)
    assert again.to_dict()["quantities"] == result.to_dict()["quantities"]


@pytest.mark.exhaustive
def test_no_extreme_is_missed_by_default(pool):
    """Series SSHI, whose voltage grows by every inversion; by chance one failure in 16 000."""
    scene = Scene.read("device", ["load.netlist=sshi_series", "run.realizations=64"])
    usual, fine = (
        simulate(scene, method="monte-carlo", runner=pool, step=step)["mean_square_voltage"]
        for step in ("default", "fine")
    )
    error = 4.0 * np.hypot(usual.standard_error, fine.standard_error)
    assert error < 0.05 * fine.estimate
    assert usual.estimate == pytest.approx(fine.estimate, abs=error)


def test_pulses_into_a_full_store_are_counted(pool):
    """SECE at tens of volts empties the piezo within microseconds, between two knots."""
    parameters = ["load.parameters.resistance=1e7", "load.parameters.storage=1e-7"]
    run = ["run.duration=0.5", "run.settle=0", "run.realizations=16"]
    scene = Scene.read("device", ["load.netlist=sece", *parameters, *run])
    usual, finest = (
        simulate(scene, method="monte-carlo", runner=pool, step=step)
        for step in ("default", "finest")
    )
    assert abs(usual.energy_balance_residual) < 0.005
    power = finest["mean_power"].estimate
    assert usual["mean_power"].estimate == pytest.approx(power, rel=5e-3)


def test_a_control_known_no_better_than_newton_leaves_it_stops_nothing():
    """SECE into an open circuit, its store full: the one of twenty paths that found no step."""
    parameters = ["load.parameters.resistance=1e8", "load.parameters.storage=1e-8"]
    run = ["run.duration=4.2", "run.settle=5", "run.realizations=128"]
    scene = Scene.read("device", ["load.netlist=sece", *parameters, *run])
    ready = prepared(scene)
    s = ready.system
    times = [
        record.time[-1]
        for record, _ in integrate(
            s,
            circuit_of(prepared(scene)),
            noise_path(ready, 105),
            start_state(ready, 105),
            stop_time(ready),
        )
    ]
    assert times[-1] == pytest.approx(stop_time(ready))

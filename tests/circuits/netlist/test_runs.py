"""Loads in the circuit, against the built-in resistor and against the diode equation by scipy."""

import numpy as np
import pytest
from foreign_loads import DOUBLER
from raw_files import run_raw
from scipy.integrate import solve_ivp
from truths import flat

from circuits.equivalent.assembly import assemble
from circuits.equivalent.export import stand_alone
from harvester.averaging.of_scene import average
from harvester.base.errors import LoadError, NetlistError, SimulatorAborted
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared

SHORT = ["run.duration=2", "run.settle=0", "run.realizations=1"]
LINEAR = ["oscillator.linear_stiffness=126.9", "oscillator.cubic_stiffness=0"]
# Q = 38, so that an open circuit has no narrow resonance.
DAMPED = [*LINEAR, "oscillator.damping=0.044"]
SATURATION, EMISSION, THERMAL = 1e-9, 0.5, 1.380649e-23 * 300.15 / 1.602176634e-19
BRIDGE = f"""
.subckt bridge p n out ref resistance=1meg storage=200n
.model junction d(is={SATURATION} n={EMISSION})
D1 p out junction
D2 n out junction
D3 ref p junction
D4 ref n junction
C1 out ref {{storage}}
R1 out ref {{resistance}}
.ends
"""
SWITCH = """
.subckt switch p n out ref
.model closing sw(ron=10 roff=1g vt=2 vh=0.5)
.model junction d(is=1n)
D1 p out junction
D2 ref n junction
S1 p x p n closing
L1 x n 1m
R2 x n 1k
R1 out ref 100k
C1 out ref 1u
.ends
"""


def with_load(tmp_path, text, *overrides, scene="device"):
    path = tmp_path / "load.lib"
    path.write_text(text)
    return Scene.read(scene, [*SHORT, f"load.netlist={path}", *overrides])


@pytest.mark.parametrize(
    ("name", "key", "value", "resistance"),
    [("linear", "decay_rate", 2.0, 0.5), ("device", "resistance", 2e5, 2e5)],
)
def test_the_resistors_netlist_is_the_built_in_resistor(pool, name, key, value, resistance):
    """Also where the motion is chaotic and any other rounding would end in another path."""
    built_in = Scene.read(name, [*SHORT, f"load.{key}={value}", "run.duration=20"])
    netlist = built_in.replace(
        {"load.netlist": "resistor", "load.parameters.resistance": resistance}
    )
    assert flat(netlist) == flat(built_in)
    ours, theirs = (simulate(scene, method="circuit", runner=pool) for scene in (netlist, built_in))
    assert ours.steps == theirs.steps
    for quantity in ("mean_square_voltage", "mean_power", "mean_square_velocity"):
        value = theirs.quantity(quantity).estimate
        assert ours.quantity(quantity).estimate == pytest.approx(value, rel=1e-6)
    ours, theirs = (
        simulate(scene, method="monte-carlo", runner=pool) for scene in (netlist, built_in)
    )
    assert ours.quantity("mean_power") == theirs.quantity("mean_power")


@pytest.mark.parametrize(
    ("name", "overrides", "key", "resistance"),
    [("linear", [], "decay_rate", 0.5), ("device", DAMPED, "resistance", 2e5)],
)
def test_the_ammeter_measures_the_power_of_a_resistor(
    tmp_path, pool, name, overrides, key, resistance
):
    halves = f".subckt load p n\nR1 p x {resistance / 2}\nR2 x n {resistance / 2}\n.ends\n"
    scene = with_load(tmp_path, halves, *overrides, scene=name)
    value = resistance if key == "resistance" else 1.0 / resistance
    built_in = scene.replace({f"load.{key}": value})
    assert built_in.load.netlist is None
    # Both with the same steps: without a resistor known, they are chosen for an open circuit. Its
    # resonance is not so narrow that steps are made exact at it.
    step = 1e-3
    ours, theirs = (
        simulate(s, method="circuit", step=step, runner=pool) for s in (scene, built_in)
    )
    for quantity in ("mean_power", "mean_square_voltage", "power_conversion_efficiency"):
        value = theirs.quantity(quantity).estimate
        assert ours.quantity(quantity).estimate == pytest.approx(value, rel=1e-6)


def diode_equation(scene, resistance, storage):
    """(X, X', piezo volts, output volts, energy out of the piezo, energy used) at the knots.

    The four diodes share the voltages evenly, so the potential of the output against the piezo
    drops out.
    """
    ready = prepared(scene)
    p, scales = flat(scene), ready.scales
    path = noise_path(ready, 0)
    knots = round(scene.run.duration / path.spacing)
    noise = path.read(knots + 1)
    capacitance = scene.transducer.capacitance
    swing = 2.0 * EMISSION * THERMAL

    def currents(volts, output):
        # The integrator's trial steps go anywhere.
        forward = np.exp(min((volts - output) / swing, 300.0))
        backward = np.exp(min((-volts - output) / swing, 300.0))
        return SATURATION * (forward - backward), SATURATION * (forward + backward - 2.0)

    def derivative(t, y):
        x, v, volts, output, *_ = y
        drawn, given = currents(volts, output)
        push = np.interp(t, path.spacing * np.arange(knots + 1), noise)
        push -= p.damping * v + p.linear_stiffness * x + p.coupling * volts / scales.voltage
        return [
            v,
            push,
            scales.voltage * v - drawn / capacitance,
            (given - output / resistance) / storage,
            volts * drawn,
            output**2 / resistance,
        ]

    state = np.array([p.rest, 0.0, 0.0, 0.0, 0.0, 0.0])
    states = []
    for knot in range(knots):
        span = (knot * path.spacing, (knot + 1) * path.spacing)
        solution = solve_ivp(derivative, span, state, "LSODA", rtol=1e-8, atol=1e-10)
        state = solution.y[:, -1]
        states.append(state)
    return np.array(states)


def test_a_bridge_follows_the_diode_equation(tmp_path, pool):
    resistance, storage = 1e6, 200e-9
    scene = with_load(tmp_path, BRIDGE, *LINEAR, "run.duration=1")
    states = diode_equation(scene, resistance, storage)
    scales = prepared(scene).scales
    output, energy, used = states[-1, 3:]
    stored = 0.5 * storage * output**2
    errors = {}
    for step in ("default", "fine"):
        result = simulate(scene, method="circuit", step=step, window=(0.0, 1e9), runner=pool)
        assert abs(result.energy_balance_residual) < 1e-3
        power = result.quantity("mean_power").estimate
        errors[step] = power / energy - 1.0
        at = 1.25e-3 * np.arange(1, len(states) + 1)
        record = result.waveform.record
        ours = np.interp(at, record.time, record.voltage * scales.voltage)
        deviation = np.sqrt(np.mean((ours - states[:, 2]) ** 2) / np.mean(states[:, 2] ** 2))
        assert deviation < {"default": 0.03, "fine": 0.004}[step]
        final = result.quantity("final_stored_energy").estimate
        assert final == pytest.approx(stored, rel={"default": 0.03, "fine": 0.003}[step])
        # Over 1 s, less the first step, which has no point before it.
        stored_power = result.quantity("mean_storage_power").estimate
        assert stored_power == pytest.approx(final, rel=2.0 / 800)
    assert abs(errors["default"]) < 0.02
    assert abs(errors["fine"]) < 0.002
    assert result.quantity("mean_output_power").estimate == pytest.approx(used, rel=0.005)
    # What is left is the diodes' own.
    loss = energy - stored - used
    assert result.quantity("mean_converter_loss").estimate == pytest.approx(loss, rel=0.01)


AMPLITUDE, FREQUENCY = 0.005, 12.0


def prescribed(*changes):
    """(scene, θ²u²ω/C): the displacement a sine, which every load's closed form starts from."""
    scene = Scene.read("device", ["length_scale=none"])
    excitation = {
        "kind": "prescribed_displacement",
        "amplitude": AMPLITUDE,
        "frequency": FREQUENCY,
    }
    run = {"run.duration": 1.0, "run.settle": 1.0, "run.realizations": 1}
    scene = scene.replace({"excitation": excitation, **run, **dict(changes)})
    theta, capacitance = scene.transducer.coupling, scene.transducer.capacitance
    return scene, theta**2 * AMPLITUDE**2 * 2.0 * np.pi * FREQUENCY / capacitance


@pytest.mark.parametrize("share", [0.3, 1.0, 4.0])
def test_a_resistor_on_a_prescribed_sine_has_the_closed_form(pool, share):
    """P = θ²u²ω/2C · r/(1 + r²), r = ωCR; its greatest is θ²u²ω/4C at r = 1."""
    resistance = share / (2.0 * np.pi * FREQUENCY * 4.3e-8)
    scene, unit = prescribed(("load.resistance", resistance))
    result = simulate(scene, method="circuit", runner=pool)
    power = 0.5 * unit * share / (1.0 + share**2)
    assert result.quantity("mean_power").estimate == pytest.approx(power, rel=1e-3)
    # All that is put in leaves by the load, but for what the capacitance holds at the end.
    assert abs(result.energy_balance_residual) < 1e-6
    with pytest.raises(LoadError, match="circuit"):
        simulate(scene, method="monte-carlo")


def test_a_near_ideal_bridge_on_a_prescribed_sine_has_the_closed_form(tmp_path, pool):
    """P = θ²u²ω/2πC at R = π/2ωC, V = θu/2C (physics of the standard interface)."""
    path = tmp_path / "load.lib"
    path.write_text(BRIDGE.replace("n=0.5", "n=0.05"))
    resistance = np.pi / (4.0 * np.pi * FREQUENCY * 4.3e-8)
    parameters = {"resistance": resistance, "storage": 2e-6}
    scene, unit = prescribed(
        ("load.netlist", str(path)), ("load.parameters", parameters), ("run.settle", 8.0)
    )
    result = simulate(scene, method="circuit", runner=pool)
    power = result.quantity("mean_output_power").estimate
    assert power == pytest.approx(unit / (2.0 * np.pi), rel=0.03)
    volts = scene.transducer.coupling * AMPLITUDE / (2.0 * scene.transducer.capacitance)
    assert result.quantity("output_voltage").estimate == pytest.approx(volts, rel=0.015)
    assert abs(result.energy_balance_residual) < 1e-3


def test_a_pump_written_for_ltspice_runs_as_it_is(tmp_path, pool):
    scene = with_load(tmp_path, DOUBLER, "load.parameters.cpump=100n", "run.duration=10")
    result = simulate(scene, method="circuit", runner=pool)
    assert abs(result.energy_balance_residual) < 0.01
    assert result.quantity("output_voltage").estimate > 1.0
    loss = result.quantity("mean_converter_loss")
    assert loss.estimate > -3.0 * (loss.standard_error or 0.0)
    assert 0.0 < result.quantity("converter_efficiency").estimate < 1.0
    end, out = result.quantity("end_to_end_efficiency"), result.quantity("converter_efficiency")
    whole = result.quantity("power_conversion_efficiency_of_input")
    assert end.estimate == pytest.approx(whole.estimate * out.estimate, rel=1e-9)
    assert 0.0 < result.quantity("start_up_time").estimate < 10.0


def test_a_switching_load_balances_its_energy_by_default(tmp_path, pool):
    scene = with_load(tmp_path, SWITCH, "run.duration=5")
    result = simulate(scene, method="circuit", runner=pool)
    assert abs(result.energy_balance_residual) < 0.01
    fine = simulate(scene, method="circuit", step="fine", runner=pool)
    assert abs(fine.energy_balance_residual) < 0.001


@pytest.mark.slow
@pytest.mark.parametrize("load", ["sshi_parallel", "sshi_series", "sece"])
def test_a_switched_load_takes_few_steps_beside_the_local_errors_control(pool, load):
    """Of 2 s with 48 turns of the motion; the grid alone has 4800 steps."""
    scene, _ = prescribed(("load.netlist", load), ("excitation.knot_spacing", 1.0 / 2400.0))
    result = simulate(scene, method="circuit", runner=pool)
    strict = simulate(scene, method="circuit", tolerance=1e-7, runner=pool)
    assert result.steps < 13_000
    assert result.steps < 0.2 * strict.steps
    for name in ("mean_output_power", "mean_square_voltage", "mean_power"):
        value = strict.quantity(name).estimate
        assert result.quantity(name).estimate == pytest.approx(value, rel=4e-3)
    assert abs(result.energy_balance_residual) < 5e-3


@pytest.mark.parametrize("storage", [1e-9, 1.0])
@pytest.mark.parametrize("load", ["sshi_parallel", "sshi_series", "sece"])
def test_a_switched_load_takes_any_storage(pool, load, storage):
    """At steps of 0.1 us the rounding of a farad's current is far above any other current."""
    changes = {"load.parameters.storage": storage, "run.duration": 1.0, "run.settle": 0.0}
    scene = Scene.read("device", [f"load.netlist={load}"]).replace(changes)
    scene = scene.replace({"run.realizations": 1})
    result = simulate(scene, method="circuit", time_limit=60.0, runner=pool)
    assert abs(result.energy_balance_residual) < 5e-3


def test_scaled_scenes_take_a_netlist_too(tmp_path, pool):
    scene = with_load(
        tmp_path,
        BRIDGE,
        "load.parameters.resistance=10",
        "load.parameters.storage=5",
        "run.duration=200",
        scene="linear",
    )
    result = simulate(scene, method="circuit", runner=pool)
    assert abs(result.energy_balance_residual) < 0.01
    p = flat(scene)
    square = result.quantity("output_voltage").estimate ** 2
    square += result.quantity("output_ripple").estimate ** 2
    power = result.quantity("mean_output_power").estimate
    assert power == pytest.approx(p.coupling * square / 10.0, rel=1e-9)


@pytest.mark.slow
def test_what_ngspice_does_not_know_is_no_result(tmp_path):
    text = BRIDGE.replace("n=0.5", "n=0.5 emission=2")
    with pytest.raises(NetlistError, match="a model d has no emission"):
        with_load(tmp_path, text)


def test_averaging_refuses_a_load_that_is_no_resistor(tmp_path):
    scene = with_load(tmp_path, BRIDGE)
    with pytest.raises(LoadError, match="averaging"):
        average(scene)


def test_plain_ngspice_runs_an_exported_load(tmp_path, pool):
    scene = with_load(tmp_path, SWITCH, "run.duration=0.5")
    (tmp_path / "scene.cir").write_text(
        stand_alone(prepared(scene), noise_path(prepared(scene), 0)).text + ".end\n"
    )
    raw = run_raw(tmp_path, "scene.cir")
    result = simulate(scene, method="circuit", runner=pool)
    output = raw["v(load_out)"] - raw["v(load_ref)"]
    steps = np.diff(raw["time"])
    mean = np.sum(0.5 * (output[1:] + output[:-1]) * steps) / np.sum(steps)
    assert result.quantity("output_voltage").estimate == pytest.approx(mean, rel=0.02)


def test_the_netlist_holds_the_load_and_its_digest_tells_loads_apart(tmp_path):
    one, other = with_load(tmp_path, BRIDGE), with_load(tmp_path, BRIDGE.replace("0.5", "0.6"))
    assert one.digest() != other.digest()
    assert assemble(prepared(one)).sha256 != assemble(prepared(other)).sha256
    text = assemble(prepared(one)).text
    assert "Vload piezo load_piezo 0.0" in text
    assert text.count(".subckt") == 1
    assert "Vload" not in assemble(prepared(Scene.read("device"))).text


# A gain that feeds back past the resistance of its node: the voltage grows by e in 1.5 ms.
FEEDBACK = """
.subckt feedback p n out ref
E2 x n a n 2
R2 x a 24k
R3 a p 5k
D1 p out junction
R4 ref n 10
R1 out ref 230k
C1 out ref 90n
.model junction d(is=1n rs=2)
.ends
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", ["monte-carlo", pytest.param("circuit", marks=pytest.mark.exhaustive)]
)
def test_a_load_whose_voltage_grows_without_an_end_is_stopped(pool, tmp_path, method):
    scene = with_load(tmp_path, FEEDBACK, *DAMPED)
    with pytest.raises(SimulatorAborted, match=r"grows beyond 1e\+09 V, since the load feeds"):
        simulate(scene, method=method, runner=pool, time_limit=100.0)


@pytest.mark.parametrize("line", ["D1 p out x junction", "D1 p junction", "D1 p out m=2 junction"])
def test_a_diode_between_other_than_two_nodes_is_refused(tmp_path, line):
    with pytest.raises(NetlistError, match=r"d1 p .*too (many|few)"):
        with_load(tmp_path, FEEDBACK.replace("D1 p out junction", line))

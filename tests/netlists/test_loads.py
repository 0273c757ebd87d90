"""Load netlists in a stand-alone `ngspice -b`, against the closed forms of prescribed motion.

The piezo, coupling θ and clamped capacitance C, moves as u cos ωt: θ²u²ω/C is the unit of power,
1/(ωC) that of resistance, θu/C that of voltage, so that every closed form is a pure number. Those
of the bridge, SSHI and SECE: E. Lefeuvre et al., Sensors and Actuators A 126 (2006) 405–416.
"""

import math
from dataclasses import dataclass
from importlib import resources

import pytest
from by_hand import measured, ngspice

NETLISTS = str(resources.files("netlists"))
NEAR_IDEAL, SILICON, SCHOTTKY = 0, 1, 2
THERMAL_VOLTAGE = 8.617333e-5 * 300.15  # V, at SPICE's 27 degrees


@dataclass(frozen=True)
class Piezo:
    """Prescribed motion: coupling in N/V, amplitude in m, frequency in Hz, capacitance in F."""

    coupling: float
    amplitude: float
    frequency: float
    capacitance: float

    @property
    def voltage(self):
        return self.coupling * self.amplitude / self.capacitance

    @property
    def resistance(self):
        return 1 / (2 * math.pi * self.frequency * self.capacitance)

    @property
    def power(self):
        return self.voltage**2 / self.resistance

    @property
    def current(self):
        """SPICE expression of θ dx/dt."""
        peak = self.voltage / self.resistance
        return f"{peak!r}*sin({2 * math.pi * self.frequency!r}*time)"


PIEZOS = [Piezo(4e-4, 1e-3, 50.0, 20e-9), Piezo(3e-3, 0.5e-3, 12.0, 90e-9)]
# Two qualities, one for each piezo.
SWITCHED = list(zip(PIEZOS, [3.0, 8.0], strict=True))


def deck(
    load,
    piezo,
    resistance,
    *,
    current=None,
    cycles=50,
    settle=40,
    storage=10,
    step=50,
    tolerance=1e-4,
    extra="",
    **parameters,
):
    """A bench: means of input and output power, energies from the start to the end.

    storage is the time constant of load and storage, in cycles; step the steps per cycle.
    """
    parameters = {"diode": NEAR_IDEAL, **parameters}
    if load in ("sshi_parallel", "sshi_series", "sece"):
        parameters = {"capacitance": piezo.capacitance, **timing(piezo), **parameters}
    period = 1 / piezo.frequency
    capacitor = parameters.setdefault("storage", storage * period / resistance)
    initial = parameters.get("initial", 0.0)
    values = " ".join(f"{name}={value!r}" for name, value in parameters.items())
    window = f"from={settle * period!r} to={cycles * period!r}"
    return f""".title {load}
.include {NETLISTS}/{load}.lib
Bmotion current 0 v={current or piezo.current}
Gmotion 0 p current 0 1
Cpiezo p 0 {piezo.capacitance!r} ic=0
Xload p 0 out ref {load} resistance={resistance!r} {values}
Binput input 0 v=v(p)*v(current)
Boutput output 0 v=v(out,ref)*v(out,ref)/{resistance!r}
Bstored stored 0 v={capacitor / 2!r}*(v(out,ref)*v(out,ref)-{initial**2!r})
+ +{piezo.capacitance / 2!r}*v(p)*v(p)
{extra}
.options method=trap reltol={tolerance!r} abstol=1e-10
.tran {period / step!r} {cycles * period!r} 0 {period / step!r} uic
.measure tran input_power avg v(input) {window}
.measure tran output_power avg v(output) {window}
.measure tran input_energy integ v(input)
.measure tran output_energy integ v(output)
.measure tran stored_energy find v(stored) at={cycles * period * 0.999999!r}
.end
"""


def timing(piezo):
    """Inversion and sensing that last a small part of the cycle."""
    period = 1 / piezo.frequency
    return {"inversion_time": period / 400, "sense_time": period / 1000}


def run(load, piezo, resistance, power, folder, **options):
    """Output power over `power`, started at the voltage that belongs to it."""
    initial = math.sqrt(power * resistance)
    result = ngspice(deck(load, piezo, resistance, initial=initial, **options), folder)
    assert result["output_energy"] + result["stored_energy"] <= result["input_energy"]
    return result


BENCHES = ["resistor", "bridge", "doubler", "bridge_ideal", "sshi_parallel", "sshi_series", "sece"]


@pytest.mark.parametrize("name", BENCHES)
def test_every_bench_runs_by_hand_and_meets_its_closed_form(name):
    result = measured(f"{name}.cir", NETLISTS)
    assert result["output_power"] == pytest.approx(result["closed_form"], rel=0.03)
    assert result["efficiency"] < 1


@pytest.mark.parametrize("piezo", PIEZOS)
def test_bridge_over_its_whole_curve(piezo, tmp_path):
    for share in (0.25, 1.0, 4.0):
        resistance = share * math.pi / 2 * piezo.resistance
        voltage = piezo.voltage * share / (1 + share)
        power = voltage**2 / resistance
        result = run("bridge", piezo, resistance, power, tmp_path)
        assert result["output_power"] == pytest.approx(power, rel=0.03)
    best = piezo.power / (2 * math.pi)
    assert (piezo.voltage / 2) ** 2 / (math.pi / 2 * piezo.resistance) == pytest.approx(best)


@pytest.mark.parametrize("piezo", PIEZOS)
def test_doubler_gives_the_bridge_power_at_twice_its_voltage(piezo, tmp_path):
    power = piezo.power / (2 * math.pi)
    resistance = 2 * math.pi * piezo.resistance
    assert math.sqrt(power * resistance) == pytest.approx(piezo.voltage)
    result = run("doubler", piezo, resistance, power, tmp_path, storage=20)
    assert result["output_power"] == pytest.approx(power, rel=0.03)


@pytest.mark.parametrize(("piezo", "quality"), SWITCHED)
def test_parallel_sshi(piezo, quality, tmp_path):
    """Power and, in what the inductor burns, the inversion quality itself."""
    gamma = math.exp(-math.pi / (2 * quality))
    power = piezo.power / (math.pi * (1 - gamma))
    resistance = math.pi / (1 - gamma) * piezo.resistance
    result = run("sshi_parallel", piezo, resistance, power, tmp_path, quality=quality)
    assert result["output_power"] == pytest.approx(power, rel=0.03)
    stored = piezo.capacitance / 2 * (piezo.voltage / (1 - gamma)) ** 2
    burnt = 2 * piezo.frequency * stored * (1 - gamma**2)
    assert result["input_power"] - result["output_power"] == pytest.approx(burnt, rel=0.05)


@pytest.mark.parametrize(("piezo", "quality"), SWITCHED)
def test_series_sshi(piezo, quality, tmp_path):
    gamma = math.exp(-math.pi / (2 * quality))
    power = piezo.power / (2 * math.pi) * (1 + gamma) / (1 - gamma)
    resistance = math.pi / 2 * (1 - gamma) / (1 + gamma) * piezo.resistance
    result = run("sshi_series", piezo, resistance, power, tmp_path, quality=quality)
    assert result["output_power"] == pytest.approx(power, rel=0.03)


@pytest.mark.parametrize("piezo", PIEZOS)
@pytest.mark.parametrize("share", [0.3, 30.0])
def test_sece_gives_the_same_at_any_resistance(piezo, share, tmp_path):
    power = 2 / math.pi * piezo.power
    result = run("sece", piezo, share * piezo.resistance, power, tmp_path, quality=1000.0)
    assert result["input_power"] == pytest.approx(power, rel=0.02)
    assert result["output_power"] == pytest.approx(power, rel=0.03)


@pytest.mark.parametrize("step", [50, 200])
@pytest.mark.parametrize("load", ["sshi_parallel", "sshi_series", "sece"])
def test_power_does_not_hang_on_the_step(load, step, tmp_path):
    """The longest step and the tolerance of the local error change it by under 2 %."""
    piezo = PIEZOS[0]
    options = {"cycles": 15, "settle": 10, "initial": 10.0, "quality": 5.0}
    coarse = ngspice(deck(load, piezo, 1e6, step=step, **options), tmp_path)
    fine = ngspice(deck(load, piezo, 1e6, step=100, tolerance=1e-6, **options), tmp_path)
    assert coarse["input_power"] == pytest.approx(fine["input_power"], rel=0.02)
    assert coarse["output_power"] == pytest.approx(fine["output_power"], rel=0.02)


# Forward voltage (lowest, highest) at a current: data sheets of Diotech, 1N4148/1N4448 and BAT54
# series (typical values ± 15 mV).
DATA_SHEET = {
    SILICON: {5e-3: (0.62, 0.72)},
    SCHOTTKY: {
        0.1e-3: (0.205, 0.235),
        1e-3: (0.275, 0.305),
        10e-3: (0.335, 0.365),
        30e-3: (0.395, 0.425),
        100e-3: (0.505, 0.535),
    },
}


@pytest.mark.parametrize("part", DATA_SHEET)
def test_diodes_follow_their_data_sheets(part, tmp_path):
    for current, (lowest, highest) in DATA_SHEET[part].items():
        text = f""".title forward voltage
.include {NETLISTS}/diodes.lib
Iforward 0 anode {current!r}
Xpart anode 0 junction_diode part={part}
.tran 1u 1m
.measure tran forward find v(anode) at=0.5m
.end
"""
        assert lowest < ngspice(text, tmp_path)["forward"] < highest


@pytest.mark.parametrize(
    ("part", "saturation", "emission", "leakage"),
    [(SILICON, 2.52e-9, 1.752, 0.9e9), (SCHOTTKY, 4.1e-8, 1.09, 54e6)],
)
def test_loss_of_real_diodes_is_their_drop(part, saturation, emission, leakage, tmp_path):
    """The bridge's curve with θu/C − 2 V_d, V_d the diode law's at the load's current, within 2 %.

    The drops cost 10 % (silicon) and 4 % (Schottky). What the bridge burns, within 10 %: drop times
    current, at the mean current of conduction, half a cycle, and what two blocking diodes leak.
    """
    piezo = PIEZOS[1]
    resistance = math.pi / 2 * piezo.resistance
    ideal = (piezo.voltage / 2) ** 2 / resistance
    current = piezo.voltage / 2 / resistance
    drop = emission * THERMAL_VOLTAGE * math.log(current / saturation)
    power = ideal * (1 - 2 * drop / piezo.voltage) ** 2
    assert power < 0.96 * ideal
    result = run("bridge", piezo, resistance, power, tmp_path, diode=part)
    assert result["output_power"] == pytest.approx(power, rel=0.02)
    voltage = math.sqrt(power * resistance)
    drop = emission * THERMAL_VOLTAGE * math.log(2 * voltage / resistance / saturation)
    leaked = 2 * voltage * (saturation + voltage / leakage)
    burnt = result["input_power"] - result["output_power"]
    assert burnt == pytest.approx(2 * drop * voltage / resistance + leaked, rel=0.1)


# Twelve frequencies without a common period about that of the scene device, fixed phases.
DEVICE = Piezo(3.69e-4, 2e-3, 12.0, 43e-9)
TONES = [(0.62 + 0.0673 * k + 0.011 * math.sin(5 * k), 2.4 * k * k) for k in range(12)]


def irregular(piezo):
    """SPICE expression of θ dx/dt of a motion with the mean square of the sine's displacement."""
    terms = []
    for ratio, phase in TONES:
        angular = 2 * math.pi * ratio * piezo.frequency
        peak = piezo.coupling * piezo.amplitude * angular / math.sqrt(len(TONES))
        terms.append(f"{peak!r}*sin({angular!r}*time+{phase % (2 * math.pi)!r})")
    return "\n+ +".join(terms)


@pytest.mark.slow
@pytest.mark.parametrize("part", [NEAR_IDEAL, SILICON])
def test_irregular_motion_where_no_clock_would_help(part, tmp_path):
    """Energy is accounted for, and every switching load harvests more than the bridge's best."""
    harvested = {}
    for load, share in [
        ("bridge", math.pi / 2),
        ("doubler", 2 * math.pi),
        ("sshi_parallel", 5.0),
        ("sshi_series", 0.5),
        ("sece", 1.0),
    ]:
        options = {"current": irregular(DEVICE), "cycles": 40, "settle": 10, "diode": part}
        text = deck(load, DEVICE, share * DEVICE.resistance, storage=5, **options)
        result = ngspice(text, tmp_path)
        out = result["output_energy"] + result["stored_energy"]
        assert 0.3 * result["input_energy"] < out < result["input_energy"]
        if part == NEAR_IDEAL and load in ("bridge", "doubler"):
            assert out > 0.97 * result["input_energy"]
        harvested[load] = out
    for load in ("sshi_parallel", "sshi_series", "sece"):
        assert harvested[load] > 1.5 * harvested["bridge"]


@pytest.mark.parametrize("load", ["sshi_parallel", "sshi_series", "sece"])
def test_nothing_fires_at_rest(load, tmp_path):
    """After five cycles only a third of the threshold of 1 µA is left: the coil stays silent."""
    piezo = PIEZOS[0]
    moving = 5 / piezo.frequency
    ends = "winding,out" if load == "sece" else "winding,xload.middle"
    extra = f"""Bcoil coil 0 v=abs(v(xload.{ends}))
.measure tran peak max v(coil) from=0 to={moving!r}
.measure tran rest max v(coil) from={1.5 * moving!r} to={3 * moving!r}"""
    tremor = f"0.3u*sin({2 * math.pi * piezo.frequency!r}*time)"
    current = f"time<{moving!r} ? {piezo.current} : {tremor}"
    text = deck(load, piezo, piezo.resistance, current=current, cycles=15, settle=1, extra=extra)
    result = ngspice(text, tmp_path)
    assert result["rest"] < 1e-4 * result["peak"]


@pytest.mark.parametrize(
    ("load", "resistance", "initial"), [("sshi_series", 1e5, 3.0), ("sshi_parallel", 1e8, 99.0)]
)
def test_breakdown_is_no_turn_of_the_motion(load, resistance, initial, tmp_path):
    """Series SSHI far below its best resistance, parallel SSHI far above: it swings at extrema.

    What breaks through in mid motion, 0.4 mA at most, is under 1/20 of a swing's current.
    """
    piezo = Piezo(3.69e-4, 15e-3, 12.0, 43e-9)
    fast = 0.4 * piezo.voltage / piezo.resistance
    extra = f"""Bcoil coil 0 v=abs(v(xload.winding,xload.middle))
Bmoving moving 0 v=abs(v(current))>{fast!r} ? v(coil) : 0
Bclamped clamped 0 v=abs(v(p))
.measure tran highest max v(clamped)
.measure tran peak max v(coil)
.measure tran moving max v(moving)"""
    options = {"diode": SILICON, "initial": initial, "cycles": 8, "settle": 4}
    result = ngspice(deck(load, piezo, resistance, extra=extra, **options), tmp_path)
    assert 100.0 < result["highest"] < 105.0
    assert result["moving"] < 0.05 * result["peak"]


def buck(folder, resistance, piezo, cycles, extra=""):
    options = {"buffer": 2e-6, "storage": 4.7e-6, "settle": cycles - 20, "cycles": cycles}
    return ngspice(deck("bridge_buck", piezo, resistance, extra=extra, **options), folder)


def test_buck_starts_by_itself_and_regulates(tmp_path):
    """Empty at first; silent until 5.05 V, then 3.3 V; the converter and the clamp take a part."""
    piezo = PIEZOS[0]
    extra = """Bvoltage voltage 0 v=v(out,ref)
Brail rail 0 v=v(xload.rail,ref)
.measure tran start when v(voltage)=0.1 rise=1
.measure tran buffer_at_start find v(rail) when v(voltage)=0.1 rise=1
.measure tran lowest min v(voltage) from=1.6 to=2
.measure tran highest max v(voltage) from=1.6 to=2"""
    result = buck(tmp_path, 100e3, piezo, 100, extra)
    assert result["start"] > 0.05
    assert result["buffer_at_start"] == pytest.approx(5.05, rel=0.02)
    assert 3.3 < result["lowest"] <= result["highest"] < 1.03 * 3.3
    assert result["output_energy"] + result["stored_energy"] < 0.85 * result["input_energy"]


def test_buck_runs_in_bursts_where_the_load_takes_more_than_there_is(tmp_path):
    piezo = PIEZOS[0]
    extra = """Brail rail 0 v=v(xload.rail,ref)
.measure tran lowest min v(rail) from=1 to=2
.measure tran highest max v(rail) from=1 to=2"""
    result = buck(tmp_path, 10e3, piezo, 100, extra)
    assert result["lowest"] == pytest.approx(3.67, rel=0.05)
    assert result["highest"] == pytest.approx(5.05, rel=0.02)
    given = result["output_energy"] + result["stored_energy"]
    assert 0.6 * result["input_energy"] < given < 0.85 * result["input_energy"]

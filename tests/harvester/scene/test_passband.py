"""What misplaced frequencies cost under noise: quadrature, and both engines on one path."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import harvester
from harvester import Scene
from harvester.engines.realization import run
from harvester.scene.passband import misplacement
from harvester.scene.prepared import prepared
from harvester.scene.steps import NOISE_ERROR, knot_spacing, step_error, steps_per_sample
from harvester.studies.loads.evaluation import power_series

RESONANCE, QUALITY = 40.0, 40.0
BANDS = {"above": (200.0, 400.0), "flank": (51.0, 300.0), "across": (30.0, 60.0)}


def device(excitation, **run):
    """A linear device whose load hardly matters."""
    tables = {
        "units": "SI",
        "oscillator": {"mass": 0.01, "frequency": RESONANCE, "quality_factor": QUALITY},
        "piezo": {"coupling": 1e-4, "capacitance": 50e-9},
        "load": {"resistance": 80e3},
        "excitation": excitation,
        "run": {"duration": 4.0, "settle": 1.0, "seed": 1, "realizations": 1, **run},
    }
    return Scene.from_tables(tables, name="passband")


def band(low, high):
    points = [[low, 1.0], [high, 1.0]]
    return {"kind": "spectrum", "unit": "(m/s^2)^2/Hz", "breakpoints": points, "source": "own"}


def square(low, high, spacing, shift):
    """∫ |H|² sinc⁴ df with each frequency ω taken for ω (1 + shift ω²)."""

    def integrand(frequency):
        omega = 2.0 * math.pi * frequency
        moved, own = omega * (1.0 + shift * omega**2), 2.0 * math.pi * RESONANCE
        size = abs(own**2 - moved**2 + 1j * own / QUALITY * moved)
        return np.sinc(frequency * spacing) ** 4 / size**2

    points = [each for each in (39.0, 40.0, 41.0) if low < each < high]
    return quad(integrand, low, high, points=points, limit=400, epsrel=1e-11)[0]


@pytest.mark.parametrize("name", BANDS)
def test_misplacement_is_that_of_quadrature(name):
    ready = prepared(device(band(*BANDS[name])))
    spacing = knot_spacing(ready)
    small = 1e-10
    change = square(*BANDS[name], spacing, small) / square(*BANDS[name], spacing, -small)
    exact = abs(change - 1.0) / (2.0 * small)
    assert misplacement(ready, spacing, 2) == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("band_at", [(40.2, 40.8), (41.0, 41.3), (41.5, 42.0)])
def test_misplacement_between_short_and_open_is_that_of_the_load(band_at):
    """A matched resistor places the resonance between 40.0 Hz (short) and 41.6 Hz (open)."""
    k2, own = 0.08, 2.0 * math.pi * RESONANCE
    scene = device(band(*band_at)).replace(
        {"piezo": {"k2": k2, "capacitance": 50e-9}, "load.resistance": 1.0 / (own * 50e-9)}
    )
    ready = prepared(scene)
    spacing, small = knot_spacing(ready), 1e-9

    def square(shift):
        def integrand(frequency):
            omega = 2.0 * math.pi * frequency
            moved = omega * (1.0 + shift * omega**2)
            load = k2 * own**2 * 1j * moved / (1j * moved + own)
            size = abs(own**2 - moved**2 + 1j * own / QUALITY * moved + load)
            return np.sinc(frequency * spacing) ** 4 / size**2

        return quad(integrand, *band_at, limit=400, epsrel=1e-11)[0]

    exact = abs(square(small) / square(-small) - 1.0) / (2.0 * small)
    assert misplacement(ready, spacing, 2) == pytest.approx(exact, rel=0.05)


def test_a_record_has_the_misplacement_of_its_density(tmp_path):
    rate, count = 4000.0, 2**16
    frequencies = np.fft.rfftfreq(count, 1.0 / rate)
    inside = (frequencies >= 200.0) & (frequencies <= 400.0)
    turns = np.random.default_rng(1).uniform(size=frequencies.size)
    np.save(tmp_path / "r.npy", np.fft.irfft(inside * np.exp(2j * np.pi * turns)) * count)
    record = {"kind": "record", "file": str(tmp_path / "r.npy"), "sampling_rate": rate}
    ready = prepared(device({**record, "unit": "m/s^2"}))
    known = prepared(device(band(200.0, 400.0)))
    found, exact = (misplacement(each, 1.0 / rate, 2) for each in (ready, known))
    assert found == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("engine", ["circuit", "monte-carlo"])
def test_steps_follow_the_excitation_far_above_the_resonance(engine):
    near, far = (prepared(device(band(*BANDS[name]))) for name in ("across", "above"))
    assert steps_per_sample(near, engine=engine) == {"circuit": 2, "monte-carlo": 1}[engine]
    assert steps_per_sample(far, engine=engine) > steps_per_sample(near, engine=engine)
    assert step_error(far, engine=engine) <= 1.01 * NOISE_ERROR


def test_sines_keep_their_steps():
    """The integrators are exact at a sine."""
    sine = {"kind": "sine", "amplitude": 1.0, "frequency": 300.0}
    assert misplacement(prepared(device(sine)), 1e-4, 2) == 0.0
    assert steps_per_sample(prepared(device(sine))) == 1


@pytest.mark.slow
@pytest.mark.usefixtures("shared_workers")
def test_both_engines_hold_far_above_the_resonance():
    """At the steps of the resonance the circuit had 5 % less, and Monte Carlo an open balance."""
    scene = device(band(*BANDS["above"]), duration=1.0, settle=0.2)
    options = {"circuit": {"device": "behavioural"}, "monte-carlo": {}}
    exact = harvester.simulate(scene, method="monte-carlo", workers=1, step="finest")
    for method, chosen in options.items():
        found = harvester.simulate(scene, method=method, workers=1, **chosen)
        assert abs(found.energy_balance_residual) < 0.1
        for name in ("mean_power", "mean_square_displacement"):
            truth = exact.quantities[name].estimate
            assert found.quantities[name].estimate == pytest.approx(truth, rel=NOISE_ERROR)


@pytest.mark.slow
@pytest.mark.parametrize("netlist", ["bridge", "doubler"])
def test_behind_a_rectifier_steps_cost_the_mean_no_more_than_is_said(netlist):
    """On the paths of 32 realizations; longer steps change one path, by some percent of its error.

    Within four standard errors: false alarm one in 16 000. Half widths of 1 % of the resonance, and
    noise that falls with the frequency there.
    """
    changes = {
        "oscillator.damping_ratio": 0.011,
        "load.netlist": netlist,
        "load.parameters.resistance": 2e4,
        "load.parameters.storage": 1e-6,
        "excitation.intensity": 0.1,
        "excitation.correlation_time": 1e-2,
        "run.duration": 3.0,
        "run.realizations": 32,
    }
    prepared_scene = prepared(Scene.read("cantilever").replace(changes))
    powers = {}
    for step in ("default", "fine"):
        engine = harvester.MonteCarlo(step=step)
        runs = run(prepared_scene, engine, list(range(32)), None, lambda share: None)
        powers[step] = np.array([power_series([part.moments], 1.0).mean() for part in runs])
    change, mean = powers["default"] - powers["fine"], powers["fine"].mean()
    allowed = step_error(prepared_scene, engine="monte-carlo") * mean
    assert abs(change.mean()) < allowed + 4.0 * change.std(ddof=1) / math.sqrt(32)
    assert change.std() < 0.05 * powers["fine"].std()

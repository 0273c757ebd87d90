"""Loads that move by themselves, by both engines, against closed forms and plain `ngspice -b`."""

import numpy as np
import pytest
from by_hand import ngspice
from scipy.integrate import quad
from scipy.special import ive

from harvester.base.errors import LoadError
from harvester.engines.simulate import simulate
from harvester.scene.model import Scene

# A linear device that a sine drives; the load's own part does not touch it. Means are over 0.8 s,
# whole periods of all that is periodic here.
SCENE = """
units = "SI"
[oscillator]
mass = 0.022
damping = 0.03342
linear_stiffness = 126.902
cubic_stiffness = 0.0
[piezo]
coupling = 3.69e-4
capacitance = 4.3e-8
[load]
netlist = "load.lib"
[excitation]
kind = "sine"
amplitude = 0.5
frequency = 12.5
[run]
duration = 0.8
settle = 0.4
realizations = 1
"""
# The sources feed the output, so that nothing of its power is harvested: it is measured apart.
MEASURED = "* measure: loss output = v(out,ref)^2/10k\n.ends\n"
LOAD = ".subckt load p n out ref\n{}\nRl out ref 10k\nRg ref n 1k\nRp p n 306k\n" + MEASURED
BEGIN, END, OHMS, W = 0.4, 1.2, 1e4, 2.0 * np.pi
BOTH = ("monte-carlo", "circuit")


def output_power(folder, body, method, pool, scene=SCENE):
    (folder / "scene.toml").write_text(scene)
    (folder / "load.lib").write_text(LOAD.format(body))
    scene = Scene.read(str(folder / "scene.toml"))
    return simulate(scene, method=method, runner=pool)["output_loss"].estimate


def power_of(volts, points=2_000_001):
    """Mean power of a voltage of the time across the output's resistor."""
    time = np.linspace(BEGIN, END, points)
    return np.trapezoid(volts(time) ** 2, time) / (END - BEGIN) / OHMS


def relaxation(supply, low, high):
    """Mean power of a capacitor that charges from one threshold to the other and drops back."""
    ratio = (supply - low) / (supply - high)
    square = quad(lambda x: (supply - (supply - low) * np.exp(-x)) ** 2, 0.0, np.log(ratio))[0]
    return square / np.log(ratio) / OHMS


OF_TIME = {
    "a sine of time": ("B1 out ref i=1m*sin(6.283185307*5000*time)", 5e-3),
    "pulses that turn on the grid": (
        "B1 out ref i=(sin(2*pi*50*time)>0.5&&cos(2*pi*1000*time)>0)?1m:0",
        power_of(lambda t: 10.0 * (np.sin(W * 50 * t) > 0.5) * (np.cos(W * 1000 * t) > 0.0)),
    ),
    "a source compared": (
        "Vs s ref sin(0 5 20)\nB1 ref out i=(v(s,ref)>2)?0.1m:0", 1e-4 * np.arccos(0.4) / np.pi
    ),
}  # fmt: skip
MORE_OF_TIME = {
    "narrow pulses of time": (
        "B1 out ref i=(sin(2*pi*700*time)>0.999)?1m:0", 1e-2 * np.arccos(0.999) / np.pi
    ),
    "a triangular pulse": ("I1 ref out pulse(0 1m 0 1m 1m 1n 50m)", 1e-2 * 2.0 / 3.0 / 50.0),
    "an amplitude modulated": (
        "B1 out ref i=1m*sin(2*pi*3000*time)*(1+0.5*sin(2*pi*50*time))", 5.625e-3
    ),
    "a chirp": (
        "B1 out ref v=3*cos(6.283185307*(500*time+800*time*time))",
        power_of(lambda t: 3.0 * np.cos(W * (500.0 * t + 800.0 * t * t))),
    ),
    "peaks": ("B1 out ref i=1m*exp(40*(sin(2*pi*200*time)-1))", 1e-2 * ive(0, 80)),
    "a saw": ("B1 out ref i=1m*(time*250-int(time*250))", 1e-2 / 3.0),
    "stairs": ("B1 out ref i=0.25m*floor(4*(time*50-floor(time*50)))", 1e-2 * 14.0 / 64.0),
    "shares of a period": ("B1 out ref i=1m*(time*400-floor(time*400)<0.03)", 3e-4),
    "a source of 7 kHz": ("I1 ref out sin(0 1m 7k)", 5e-3),
    "pulses on both sides": (
        "V1 out ref pulse(0 2 0 .2m .2m .1m 5m)", 4.0 / OHMS * (0.4 / 3.0 + 0.1) / 5.0
    ),
    "points once": ("I1 ref out pwl(0 0 .5 0 .502 1m .503 0)", 1e-2 * 3e-3 / 3.0 / 0.8),
    "exponentials once": (
        "I1 ref out exp(0 1m 0.6 0.1m 0.6002 0.1m)",
        1e-2 * 1e-4 / 0.8 * (2 - 2 * (1 - np.exp(-2)) + 0.5 * (1 - np.exp(-4))
                             + 0.5 * (1 - np.exp(-2)) ** 2),
    ),
    "a decay from a time on": (
        "B1 out ref i=(time>0.6)?1m*exp(-(time-0.6)/1m):0", 0.5e-3 * 1e-2 / 0.8
    ),
    "two sources compared": (
        "Vs s ref sin(0 5 20)\nVq q ref sin(0 1 35)\nB1 ref out i=(v(s,ref)>v(q,ref))?0.1m:0", 5e-5
    ),
    "an amplified source compared": (
        "Vs s ref sin(0 5 20)\nE1 e ref s ref 2\nB1 ref out i=(v(e,ref)>4)?0.1m:0",
        1e-4 * np.arccos(0.4) / np.pi,
    ),
    "a sign": (
        "Vs s ref sin(0 5 20)\nRs s e 1k\nB1 ref out i=50u*sgn(v(e,ref)-4)+50u",
        1e-4 * np.arccos(0.8) / np.pi,
    ),
}  # fmt: skip
# A switch discharges in a nanosecond what a resistor charges in a millisecond.
RELAXING = (
    "C1 a ref {}\nR1 d a {}\nVd d ref {}\n.model sx sw(vt={} vh={} ron={} roff=1e13)\n"
    "S1 a ref a ref sx\nE1 out ref a ref 1"
)
OSCILLATING = {
    "relaxes in 1 pF": (RELAXING.format("1p", "1g", 1, 0.5, 0.2, "1k"), relaxation(1, 0.3, 0.7)),
    # With little damping the amplitude is the root of 4/3, to a share of (g/2ωC)².
    "van der Pol": (
        "L1 a ref 25k\nC1 a ref 1p ic=0.1\n"
        "B1 a ref i=-1n*v(a,ref)+1n*v(a,ref)*v(a,ref)*v(a,ref)\nE1 out ref a ref 1",
        2.0 / 3.0 / OHMS,
    ),
}
MORE_OSCILLATING = {
    "relaxes within 0.1 ns": (
        RELAXING.format("100p", "20meg", 2, 1, 0.6, 1), relaxation(2, 0.4, 1.6)
    ),
    "charged from above": (
        "C1 a ref 1n ic=1\nR1 a ref 1meg\nVd d ref 2\nVc c ref 2\n"
        ".model sx sw(vt=1.3 vh=0.3 ron=100 roff=1e13)\nS1 d a c a sx\nE1 out ref a ref 1",
        0.5 * (1.0 - 0.16) / np.log(2.5) / OHMS,
    ),
}  # fmt: skip
BY_HAND = {
    "diodes limit": (
        "L1 a ref 1\nC1 a ref 10n ic=0.1\nR1 a ref -5k\n.model dx d(is=1e-9)\n"
        "D1 a ref dx\nD2 ref a dx\nE1 out ref a ref 1", "1u"
    ),
    "a Wien bridge": (
        "B1 x ref v=3*tanh(1.05*v(b,ref))\nR1 x y 1meg\nC1 y b 100p ic=0.01\nR2 b ref 1meg\n"
        "C2 b ref 100p\nE1 out ref b ref 1", "2u"
    ),
    "a falling characteristic": (
        "V1 d ref 0.2\nL1 d a 10\nR1 a b 1k\nC1 b ref 1n\n"
        "B1 b ref i=20u*(v(b,ref)-0.2)*(400*(v(b,ref)-0.2)^2-1)\nE1 out ref b ref 1", "1u"
    ),
    "a low-passed source compared": (
        "Vs s ref sin(0 5 20)\nRf s f 100k\nCf f ref 100n\nB1 ref out i=(v(f,ref)>2)?0.1m:0", "2u"
    ),
}  # fmt: skip
SOON = {**OF_TIME, **OSCILLATING}
LATER = {**MORE_OF_TIME, **MORE_OSCILLATING}


@pytest.mark.slow
@pytest.mark.parametrize("name", SOON)
@pytest.mark.parametrize("method", BOTH)
def test_output_power(tmp_path, pool, name, method):
    body, truth = SOON[name]
    assert output_power(tmp_path, body, method, pool) == pytest.approx(truth, rel=0.005)


@pytest.mark.slow
@pytest.mark.exhaustive
@pytest.mark.parametrize("name", LATER)
@pytest.mark.parametrize("method", BOTH)
def test_output_power_of_more_loads(tmp_path, pool, name, method):
    body, truth = LATER[name]
    assert output_power(tmp_path, body, method, pool) == pytest.approx(truth, rel=0.008)


@pytest.mark.slow
@pytest.mark.exhaustive
@pytest.mark.parametrize("method", BOTH)
def test_a_run_that_is_no_multiple_of_the_loads_period(tmp_path, pool, method):
    scene = SCENE.replace("duration = 0.8", "duration = 1.0")
    body, truth = OF_TIME["a source compared"]
    assert output_power(tmp_path, body, method, pool, scene) == pytest.approx(truth, rel=0.005)


@pytest.mark.slow
@pytest.mark.exhaustive
@pytest.mark.parametrize("name", BY_HAND)
def test_output_power_by_hand(tmp_path, pool, name):
    """Of what has no closed form, against plain ngspice with a tight tolerance and short steps."""
    body, longest = BY_HAND[name]
    deck = (
        f"by hand\n{LOAD.format(body)}Xload p 0 out ref load\nRpiezo p 0 1k\n"
        "Bpower power 0 v=v(out,ref)*v(out,ref)/10k\n"
        ".options reltol=1e-6 abstol=1e-15 vntol=1e-9 chgtol=1e-18\n"
        f".tran 1u {END} 0 {longest} uic\n.save v(power)\n"
        f".measure tran mean avg v(power) from={BEGIN} to={END}\n.end\n"
    )
    truth = ngspice(deck, tmp_path)["mean"]
    for method in BOTH:
        assert output_power(tmp_path, body, method, pool) == pytest.approx(truth, rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("method", BOTH)
def test_a_turn_too_fast_for_any_run_is_refused(tmp_path, pool, method):
    body = RELAXING.format("1p", "1g", 1, 0.5, 0.2, "1m")
    with pytest.raises(LoadError, match=r"s1 \(load\.lib:6\) toggles endlessly"):
        output_power(tmp_path, body, method, pool)

"""What a load does by itself in the course of time, against its closed forms."""

import numpy as np
import pytest

from circuits.netlist.source_schedule import AHEAD, SourceSchedule, steep
from circuits.netlist.subcircuits import find_netlist, read_load
from circuits.netlist.waveform import waveform
from harvester.base.errors import LoadError

STEP = 1e-3


def load_of(tmp_path, *lines):
    path = tmp_path / "load.lib"
    path.write_text("\n".join([".subckt load p n", *lines, "R1 p n 1k", ".ends", ""]))
    return read_load(path)


def plan_of(tmp_path, *lines, count=AHEAD):
    return SourceSchedule(load_of(tmp_path, *lines).elements).steps(STEP).plan(0, count)


def jumps_of(plan):
    """The times at which the plan's jumps begin and end."""
    inside = plan.jumps > 0.0
    begins = np.append(0.0, plan.ends[:-1])
    return begins[inside], plan.ends[inside]


@pytest.mark.parametrize(
    ("source", "times"),
    [
        # The pulses last 0.0045 of a period and a hundredth of a step.
        ("B1 p n i=sin(2*pi*500*time)>0.9999 ? 1m : 0",
         [(k + 0.25 + side * np.arccos(0.9999) / (2 * np.pi)) / 500
          for k in range(8) for side in (-1, 1)]),
        ("B1 p n i=time*300-floor(time*300)", np.arange(1, 5) / 300),
        ("B1 p n i=u(time-2.5m)*v(p,n)", [2.5e-3]),
        ("Vs s n sin(0 5 20)\nB1 p n i=v(s,n)>2 ? 1 : 0",
         [np.arcsin(0.4) / (40 * np.pi)]),
    ],
)  # fmt: skip
def test_jumps_are_where_they_are(tmp_path, source, times):
    begins, ends = jumps_of(plan_of(tmp_path, source, count=16))
    times = np.array(times)[np.array(times) < 0.016]
    assert begins.size == times.size
    assert np.all((begins < times) & (times < ends))
    assert np.all(ends - begins < 1e-5 * STEP)


@pytest.mark.parametrize(
    ("source", "frequency"),
    [
        ("B1 p n i=1m*sin(2*pi*5000*time)", 5000.0),
        ("V1 p n sin(0 1 7k)", 7000.0),
        ("I1 p n sffm(0 1m 3k 0.001 100)", 3000.0),
        ("B1 p n i=v(p,n)*cos(6.283185*2k*time)", 2000.0),
    ],
)
def test_a_sine_takes_so_many_steps_a_period(tmp_path, source, frequency):
    plan = plan_of(tmp_path, source)
    lengths = np.diff(plan.ends, prepend=0.0)
    steps = np.sum(lengths / plan.longest)
    assert 31.0 <= steps / (frequency * AHEAD * STEP) <= 64.0
    assert not plan.jumps.any()


def test_what_the_grid_follows_has_no_plan(tmp_path):
    for source in (
        "V1 p n sin(0 1 12)",
        "B1 p n i=time*1m",
        "I1 p n exp(0 1m 0 1 2 3)",
        "R2 p n 1",
    ):
        assert plan_of(tmp_path, source).ends.size == 0


def test_a_plan_goes_on_where_the_one_before_ended(tmp_path):
    """In stretches of any length the same steps, once the swing is known."""
    load = load_of(tmp_path, "B1 p n i=1m*sin(2*pi*900*time)*(1+0.5*sin(2*pi*31*time))")
    whole = SourceSchedule(load.elements).steps(STEP)
    whole.plan(0, AHEAD)
    parts = SourceSchedule(load.elements).steps(STEP)
    parts.plan(0, AHEAD)
    one = whole.plan(AHEAD, 64)
    others = [parts.plan(AHEAD + k, 16) for k in range(0, 64, 16)]
    count = sum(np.sum(np.diff(p.ends, prepend=(AHEAD + 16 * k) * STEP) / p.longest)
                for k, p in enumerate(others))  # fmt: skip
    assert count == pytest.approx(
        np.sum(np.diff(one.ends, prepend=AHEAD * STEP) / one.longest), rel=0.02
    )


def test_what_no_run_follows_is_refused_by_name(tmp_path):
    with pytest.raises(LoadError, match=r"load\.lib:2: b1: from 0 s on it changes within"):
        plan_of(tmp_path, "B1 p n i=1m*sin(2*pi*10meg*time)")


@pytest.mark.parametrize(
    ("kind", "numbers", "expected"),
    [
        ("pulse", [0, 1, 0, 1e-6, 1e-6, 2e-4, 2e-2], True),
        ("pulse", [0, 1, 0, 1e-3, 1e-3, 1e-9, 5e-2], False),
        ("pwl", [0, 0, 1, 0, 1.001, 1, 2, 1], True),
        ("pwl", [0, 0, 1, 0, 1.1, 1, 2, 1], False),
        ("sin", [0, 1, 50], False),
    ],
)
def test_steep_sources_are_left_to_their_corners(kind, numbers, expected):
    assert steep(waveform(kind, numbers)) == expected


def test_the_librarys_loads_have_no_plan():
    """Their clock is steep: steps and numbers are as they were."""
    for name in ("bridge", "bridge_ideal", "node_boost", "node_buck", "sece", "sshi_parallel"):
        assert not SourceSchedule(read_load(find_netlist(name)).elements)

"""What is said of a run that takes long where there is no terminal."""

import pytest

import harvester
from harvester.cli import console


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (3.4, "3 s"),
        (119.0, "119 s"),
        (600.0, "10 min"),
        (7200.0, "2 h"),
        (1e6, "12 days"),
        (1e29, "centuries"),
    ],
)
def test_durations_are_told_in_a_unit_that_fits(seconds, words):
    assert console._duration(seconds) == words


def lines_of(label, seconds, reports, monkeypatch, capsys):
    """Lines of a run by a fake clock that a thread looks at once a second; reports by second."""
    clock = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(console.threading.Thread, "start", lambda thread: None)
    lines = console._Lines(label)
    for second in range(seconds):
        clock[0] = 100.0 + second
        if second in reports:
            lines(*reports[second])
        lines._say()
    return capsys.readouterr().err.splitlines()


def test_a_long_run_says_what_it_will_take_from_its_first_seconds(monkeypatch, capsys):
    reports = {second: (second / 600.0, "") for second in range(60)}
    lines = lines_of("circuit", 60, reports, monkeypatch, capsys)
    assert lines[0] == "circuit: 0.83% after 5 s, about 10 min more"
    assert len(lines) == 4


def test_a_run_without_reports_says_that_it_goes_on(monkeypatch, capsys):
    lines = lines_of("identify", 50, {}, monkeypatch, capsys)
    start = "starting; the first run compiles for about a minute"
    assert lines == [f"identify: after {s} s, {start}" for s in (5, 10, 20, 40)]


def test_the_last_report_is_said_again_as_long_as_there_is_no_other(monkeypatch, capsys):
    reports = {2: (0.0, "0 of 3"), 12: (0.5, "1 of 3"), 25: (1.0, "3 of 3")}
    lines = lines_of("basins", 50, reports, monkeypatch, capsys)
    assert lines == [
        f"basins: after 5 s, 0 of 3: {console.STARTING}",
        f"basins: after 10 s, 0 of 3: {console.STARTING}",
        "basins: 50.00% after 20 s, about 18 s more",
        "basins: 100.00% after 40 s, evaluating the results",
    ]


def test_a_stage_without_words_has_no_colon(monkeypatch, capsys):
    (line,) = lines_of("load study", 6, {2: (0.0, "")}, monkeypatch, capsys)
    assert line == f"load study: after 5 s, {console.STARTING}"


def test_a_thread_says_it(monkeypatch, capsys):
    monkeypatch.setattr(console, "SAY_AFTER_SECONDS", 0.01)
    said = console.threading.Event()
    monkeypatch.setattr(console, "print", lambda *_, **__: said.set(), raising=False)
    with console.progress("silent"):
        assert said.wait(30.0)


def test_a_short_run_says_nothing(monkeypatch, capsys):
    reports = {second: (second / 4.0, "") for second in range(5)}
    assert lines_of("circuit", 5, reports, monkeypatch, capsys) == []


def test_a_result_is_shown_by_its_table_and_its_sentences(capsys):
    result = harvester.average("linear", method="consistent")
    console.show_view(result.view(), "linear: power")
    shown = capsys.readouterr().out
    header, rows = result.table()
    assert shown.startswith("linear: power\n")
    assert all(cell in shown for cell in [*header, *rows[0], *result.sentences()])

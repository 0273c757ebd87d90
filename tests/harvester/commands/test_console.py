"""What is said of a run that takes long where there is no terminal."""

import pytest

import harvester
from harvester.commands import console


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


def test_a_long_run_says_what_it_will_take_from_its_first_seconds(monkeypatch, capsys):
    clock = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: clock[0])
    with console.progress() as follow:
        update = follow("circuit", None)
        for second in range(60):
            clock[0] = 100.0 + second
            update(second / 600.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "circuit: 0.83% after 5 s, about 10 min more"
    assert len(lines) == 4


def test_a_start_that_takes_long_is_told_once_and_only_until_its_first_report(monkeypatch, capsys):
    monkeypatch.setattr(console, "SAY_AFTER_SECONDS", 0.1)
    with console.progress() as follow:
        slow, quick = follow("slow", None), follow("quick", None)
        quick(0.0)
        console.time.sleep(0.5)
        slow(1.0)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["slow"]


def test_a_short_run_says_nothing(monkeypatch, capsys):
    clock = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: clock[0])
    with console.progress() as follow:
        update = follow("circuit", None)
        for second in range(5):
            clock[0] = 100.0 + second
            update(second / 4.0)
    assert capsys.readouterr().err == ""


def test_a_result_is_shown_by_its_table_and_its_sentences(capsys):
    result = harvester.average("linear", method="consistent")
    console.show_table(result, "power")
    shown = capsys.readouterr().out
    header, rows = result.table()
    assert shown.startswith("linear: power ")
    assert all(cell in shown for cell in [*header, *rows[0], *result.sentences()])

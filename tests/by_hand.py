"""Netlists run by `ngspice -b`, as by hand, and what they measure."""

import re
import subprocess


def ngspice(deck, folder):
    """Measurements of one run, by name; fails with ngspice's own words."""
    (folder / "deck.cir").write_text(deck)
    return measured("deck.cir", folder)


def measured(name, folder):
    done = subprocess.run(
        ["ngspice", "-b", name], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    text = done.stdout + done.stderr
    assert "aborted" not in text, text[-2000:]
    assert "fatal" not in text, text[-2000:]
    found = re.findall(r"^(\w+)\s+=\s+([-+.\deE]+)", text, re.MULTILINE)
    assert found, text[-2000:]
    return {name: float(value) for name, value in found}

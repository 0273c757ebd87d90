"""`make netlists SEED=1 COUNT=300`: both engines and plain ngspice on random loads.

Each load of `drawn_loads` runs for a tenth of a second behind one device that is shaken by one
sine: by Monte Carlo, by the circuit, and as it is written in plain `ngspice -b`, the device being
that of an exported deck. Two answers agree if every quantity differs by at most 1 %, or by a share
FLOOR of what the device gives without a load.
"""

import argparse
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
from maintenance.drawn_loads import CONSTANTS, DIODE, FRONT_DIODE, FRONTS, FUNCTIONS, PARTS, VENDORS
from raw_files import program_46

import harvester
from circuits.equivalent.export import stand_alone
from circuits.netlist.numbers import INFIX
from harvester.base.worker_pool import WorkerPool
from harvester.scene.paths import noise_path
from harvester.scene.prepared import prepared
from harvester.validation.other_programs import read_raw

BASE = {
    "units": "SI",
    "oscillator": {"mass": 1000.0, "quality_factor": 2.0, "frequency": 50.0},
    "piezo": {"coupling": 1e-2, "capacitance": 4e-8},
    "load": {"kind": "resistor", "resistance": 8e4},
    "excitation": {"kind": "sine", "amplitude": 5.0, "frequency": 50.0},
    "run": {"duration": 0.1, "settle": 0.0, "seed": 1, "realizations": 1},
}
AGREE, FLOOR = 0.01, 2e-4
# What the device gives without a load: V², W into a matched resistor, V².
SCALES = {
    "mean_square_voltage": 320.0,
    "mean_power": 2e-3,
    "output_square": 25.0,
    "mean_output_power": 2e-3,
}
ENGINES = ("monte-carlo", "circuit", "ngspice -b")
LONGEST = 30.0
# Texts of LTspice's and PSpice's files that mean something else in ngspice, as
# docs/reference/netlists.md says.
FOREIGN = re.compile(r"limit\(|vh=-|\* dialect:(?s:.*)(\^|\*\*|pow|pwr|&&|\|\||!|\?|\bu\()")

SUFFIXES = ((12, "t"), (9, "g"), (6, "meg"), (3, "k"), (0, ""), (-3, "m"), (-6, "u"), (-9, "n"),
            (-12, "p"), (-15, "f"), (-18, "e-18"), (-21, "e-21"))  # fmt: skip


def spelt(draw, low, high):
    """A log-uniform number of three digits in one of SPICE's spellings."""
    value = float(f"{math.exp(draw.uniform(math.log(max(low, 1e-3 * high)), math.log(high))):.3g}")
    power, letter = next(each for each in SUFFIXES if value >= 0.999 * 10.0 ** each[0])
    digits = f"{value / 10.0**power:.4g}"
    whole, _, rest = digits.partition(".")
    unit = str(draw.choice(["", "", "", "ohm", "V", "Hz", "s"])) if letter else ""
    shifted = dict(SUFFIXES).get(power + 3) or f"e{power + 3}"
    forms = [f"{value:g}", f"{value:.6E}", digits + letter, (digits + letter).upper()]
    forms += [digits + letter + unit, f"{value / 10.0 ** (power + 3):.6g}{shifted}"]
    if letter and rest and len(letter) == 1 and letter != "f":
        forms.append(f"{whole}{letter}{rest}")
    return str(draw.choice(forms))


def filled(draw, template, number):
    """A template's text: choices from the innermost, then numbers, then its own number."""
    text = template.replace("<DIODE>", DIODE).replace("#", str(number))
    while found := re.search(r"<([^<>\n]*[|:][^<>\n]*)>", text):
        if "|" in found[1]:
            new = str(draw.choice(found[1].split("|")))
        else:
            ends = [float(re.sub("u$", "e-6", each)) for each in found[1].split(":")]
            new = spelt(draw, *ends)
        text = text[: found.start()] + new + text[found.end() :]
    for word, pool in (("<FUNCTION>", FUNCTIONS), ("<CONSTANT>", CONSTANTS)):
        while word in text:
            text = text.replace(word, str(draw.choice(pool)), 1)
    return text.replace("$", str(draw.choice(["v(p,n)/20", "(v(p,n)/20)", "(v(a)-v(n))/20"])))


def load_text(seed, number, kind):
    """One load: `kind` "random", or "vendor" whose text has parts of a vendor's library."""
    draw = np.random.default_rng([seed, number, kind == "vendor"])
    pool, several = (VENDORS, 1) if kind == "vendor" else (PARTS, int(draw.integers(2, 5)))
    parts = [pool[number % len(pool)], *draw.choice(PARTS, several - 1)]
    lines = [filled(draw, each, k) for k, each in enumerate(parts, 1)]
    lines += [filled(draw, str(draw.choice(FRONTS)), 0), filled(draw, FRONT_DIODE, 0)]
    lines += [f"Rload out ref {spelt(draw, 5e4, 1e6)}", f"Cs out ref {spelt(draw, 1e-8, 2e-7)}"]
    dialect = str(
        draw.choice(
            ["", "", "", "* dialect: ngspice\n", "* dialect: ltspice\n", "* dialect: pspice\n"]
        )
    )
    return (
        f"* {kind} {number} of {seed}\n{dialect}.subckt z p n out ref\n"
        + "\n".join(lines)
        + "\n.ends\n"
    )


def device_lines():
    """The device and its excitation in the deck of a scene whose load is the resistor."""
    ready = prepared(harvester.Scene.from_tables(BASE, name="base"))
    text = stand_alone(ready, noise_path(ready, 0), (0.0, 0.0, 0.0), "fine").text
    return "\n".join(
        line
        for line in text.splitlines()[1:]
        if not line.lower().startswith(("vload", "rload", "xload", ".", "*"))
    )


def plain(text, device, folder):
    """Answers of `ngspice -b` on the text as it is; a message instead where it does not run."""
    end = BASE["run"]["duration"]
    if FOREIGN.search(text.lower().replace("* dialect: ngspice", "")):
        return "means something else to ngspice"
    # Plain ngspice drops what stands behind the letter of LTspice's 4k7.
    text = INFIX.sub(r"\1.\3\2", text)
    (folder / "deck.cir").write_text(
        f"deck\n{device}\nVload piezo load 0\nXload load 0 out ref z\n{text}\nCo out 0 4e-14\n"
        "Cr ref 0 4e-14\n.options reltol=1e-5 itl4=100 abstol=1e-13\n"
        ".save v(load) i(Vload) v(out) v(ref)\n"
        f".tran 10u {end} 0 10u uic\n.end\n"
    )
    (folder / "deck.raw").unlink(missing_ok=True)
    command = [program_46(), "-n", "-b", "-r", "deck.raw", "deck.cir"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=LONGEST)
    said = [line for line in (done.stdout + done.stderr).splitlines() if "rror" in line]
    if done.returncode or not (folder / "deck.raw").exists():
        return " ".join([*said, "no answer"])[:150]
    raw = read_raw(folder / "deck.raw")
    if raw["time"][-1] < 0.999 * end:
        return "stopped " + " ".join(said)[:150]

    def mean(values):
        return float(np.trapezoid(values, raw["time"]) / end)

    return {
        "mean_square_voltage": mean(raw["v(load)"] ** 2),
        "mean_power": mean(raw["v(load)"] * raw["i(vload)"]),
        "output_square": mean((raw["v(out)"] - raw["v(ref)"]) ** 2),
    }


def simulated(path, method, pool):
    """Answers of an engine; its message instead where it refuses."""
    try:
        scene = harvester.Scene.from_tables({**BASE, "load": {"netlist": str(path)}}, name="drawn")
        result = harvester.simulate(
            scene, method=method, step="fine", runner=pool, time_limit=LONGEST
        )
    except (harvester.SimulatorTimeout, harvester.OutOfTime):
        return f"SLOW, more than {LONGEST:g} s"
    except harvester.HarvesterError as error:
        return f"{type(error).__name__}: {error}".splitlines()[0]
    found = {name: result[name].estimate for name in SCALES if name != "output_square"}
    found["output_square"] = sum(
        result[f"output_{name}"].estimate ** 2 for name in ("voltage", "ripple")
    )
    return found


def compared(one, other):
    """ "agreed", "refused" or "DISAGREED", with the worst difference."""
    if isinstance(one, str) or isinstance(other, str):
        return "refused", ""
    words = []
    for name in one.keys() & other.keys():
        a, b = one[name], other[name]
        if not abs(a - b) <= AGREE * max(abs(a), abs(b)) + FLOOR * SCALES[name]:
            words.append(f"{name} {a:.5g} {b:.5g}")
    return ("DISAGREED" if words else "agreed"), ", ".join(sorted(words))


def tried(text, device, folder, pool):
    """Answers or messages of the three programs; "BROKEN …" where one ends in a traceback."""
    path = folder / "z.lib"
    path.write_text(text)
    answers = []
    for asked in (*ENGINES[:2], plain):
        try:
            answers.append(
                simulated(path, asked, pool) if asked in ENGINES else plain(text, device, folder)
            )
        except subprocess.TimeoutExpired:
            answers.append("SLOW")
        except Exception as error:
            answers.append(f"BROKEN {type(error).__name__}: {error}".splitlines()[0])
    return answers


def main(words=None):
    """Try the loads of a seed; 1 if any disagrees or is broken."""
    parser = argparse.ArgumentParser(prog="make netlists")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--kind", choices=("random", "vendor"), default="random")
    parser.add_argument("--only", default="", help="numbers between commas")
    asked = parser.parse_args(words)
    numbers = [int(each) for each in asked.only.split(",") if each] or range(asked.count)
    device, counts, failed = device_lines(), Counter(), []
    with tempfile.TemporaryDirectory(prefix="netlists-") as name, WorkerPool(workers=1) as pool:
        for number in numbers:
            text, clock = load_text(asked.seed, number, asked.kind), time.monotonic()
            answers = tried(text, device, Path(name), pool)
            if asked.only:
                print(text, *answers, sep="\n")
            said = [
                f"{e}: {a}" for e, a in zip(ENGINES, answers, strict=True) if isinstance(a, str)
            ]
            bad = any(
                word in each for each in said for word in ("BROKEN", "SLOW", "HarvesterError: ")
            )
            for (a, one), (b, other) in combinations(zip(ENGINES, answers, strict=True), 2):
                verdict, words = compared(one, other)
                counts[f"{a} and {b}", verdict] += 1
                bad |= verdict == "DISAGREED"
                said += [f"{a}, {b}: {words}"] if words else []
            failed += [number] if bad else []
            mark = "WRONG" if bad else "right"
            seconds = f"{time.monotonic() - clock:5.1f} s"
            print(asked.seed, f"{number:3}", mark, f"{seconds} ", "; ".join(said), flush=True)
    for (pair, verdict), count in sorted(counts.items()):
        print(f"{pair}: {count} {verdict}")
    if failed:
        again = f"SEED={asked.seed} KIND={asked.kind} ONLY={','.join(map(str, failed))}"
        print(f"make netlists {again} repeats what fails")
    return 1 if failed else 0


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())

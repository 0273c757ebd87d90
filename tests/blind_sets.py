"""Verdicts on right and on faulty sets that are drawn anew: a table of what is said of each kind.

    PYTHONPATH=tests python -m blind_sets SEED COUNT

Kind, excitation, strength, device, load and sensors are drawn from the seed.
"""

import sys

import numpy as np
from measured_sets import FAULTS, a_set

from harvester.base.errors import HarvesterError
from harvester.identification.identify import identify

WORDS = ("predicts", "fits", "wrong", "incomplete", "nothing", "refused")
DURATION = 15.0


def said(seed, fault, noise, strength):
    """The verdict's word on a set, and its sentence."""
    scene, records, *_ = a_set(seed, fault, noise, strength, DURATION)
    try:
        found = identify(scene, records, compare=False)
    except HarvesterError as error:
        return "refused", str(error)
    return found.verdict.word, found.verdict.sentence


def drawn(seed, count):
    """(seed, fault, noise, strength) of so many right sets and so many faulty ones."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        for faulty in (True, False):
            fault = FAULTS[random.integers(len(FAULTS))] if faulty else None
            noise, strength = bool(random.integers(2)), float(random.uniform(0.6, 1.8))
            yield int(random.integers(10**6, 10**9)), fault, noise, strength


def main(seed, count):
    """Print each verdict as it comes, then the table."""
    table = {}
    for own, fault, noise, strength in drawn(seed, count):
        word, sentence = said(own, fault, noise, strength)
        kind = fault or "right"
        table.setdefault((kind, "noise" if noise else "sines"), []).append(word)
        print(
            own, kind, "noise" if noise else "sines", f"{strength:.2f}", word, sentence, flush=True
        )
    print(f"{'':28}" + "".join(f"{word:>11}" for word in WORDS))
    for (kind, base), words in sorted(table.items()):
        counts = "".join(f"{words.count(word):>11}" for word in WORDS)
        print(f"{kind + ', ' + base:28}{counts}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

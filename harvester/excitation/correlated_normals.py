"""Normal sequences from numpy's generator, bit for bit its numbers, in less than half its time.

numpy calls its generator of bits for each number. Here a block of words is drawn at once, and
compiled code makes of them the normal numbers that numpy makes: by the ziggurat of G. Marsaglia and
W. W. Tsang, J. Stat. Softw. 5 (8) (2000), with the tables that numba has of numpy's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from harvester.base.compilation import compiled, uncounted, ziggurat
from harvester.excitation.base import ExcitationPath

if TYPE_CHECKING:
    from numpy.random.bit_generator import SeedSequence

# Tables of the ziggurat method. For each strip under the bell curve: the width of its rectangle
# over the strip's, in units of 2⁻⁵²; the strip's width in the same unit; the curve's height. Then
# the beginning of the tail and its inverse.
INNER, WIDTH, HEIGHT = ziggurat.ki_double, ziggurat.wi_double, ziggurat.fi_double
TAIL, INVERSE_TAIL = ziggurat.ziggurat_nor_r, ziggurat.ziggurat_nor_inv_r
# Random words per number: one is enough but for 1.2 % of the numbers.
WORDS_FOR_A_NUMBER = 1.02
# Random words at the end of a block that stay unused, so that no number runs out of words.
SPARE_WORDS = 64
DOUBLES_IN_ONE = 2.0**53


class NormalPath(ExcitationPath):
    """Stationary normal numbers of mean zero, each of which keeps a share of the one before.

    x_{k+1} = a x_k + √(1 − a²) ξ_k in units of their deviation, where ξ are the numbers of
    `numpy.random.default_rng(seed).standard_normal`, and the first of them is the first x.

    `decay`: −ln a, from one number to the next; inf for independent numbers. `spacing`: time
    between two numbers (s).
    """

    def __init__(
        self,
        seed: SeedSequence,
        deviation: float,
        decay: float = math.inf,
        spacing: float = math.nan,
    ) -> None:
        self.spacing = spacing
        self._bits = np.random.default_rng(seed).bit_generator
        self._words = np.empty(0, dtype=np.uint64)
        self._law = deviation, math.exp(-decay), math.sqrt(-math.expm1(-2.0 * decay))
        self._last = math.nan

    def read(self, count: int) -> np.ndarray:
        """The next numbers; the sequence does not depend on the sizes of the parts."""
        numbers, done = np.empty(count), 0
        while done < numbers.size:
            least_words = int((numbers.size - done) * WORDS_FOR_A_NUMBER) + 2 * SPARE_WORDS
            if least_words > self._words.size:
                fresh = self._bits.random_raw(least_words - self._words.size)
                self._words = np.concatenate([self._words, fresh])
            done, self._last, consumed = _write(self._words, self._law, self._last, numbers, done)
            self._words = self._words[consumed:]
        return numbers


@uncounted
def _write(words, law, last, numbers, done):
    """Write numbers until words run out; return their count, the last one, and words used."""
    deviation, memory, kick = law
    position = 0
    while done < numbers.size and position < words.size - SPARE_WORDS:
        word = words[position]
        position += 1
        # Eight bits choose the strip, one bit the sign, 52 bits the position in the strip.
        strip, across = word & np.uint64(0xFF), (word >> np.uint64(9)) & np.uint64(2**52 - 1)
        normal = across * WIDTH[strip]
        normal = -normal if (word >> np.uint64(8)) & np.uint64(1) else normal
        if across >= INNER[strip]:
            normal, position = _beyond(words, position, strip, across, normal)
            if math.isnan(normal):
                continue
        last = memory * last + kick * normal if not math.isnan(last) else normal
        numbers[done] = last * deviation
        done += 1
    return done, last, position


@compiled
def _beyond(words, position, strip, across, normal):
    """A number outside the rectangle within a strip, NaN if rejected; and the next index."""
    if strip > 0:
        density = (HEIGHT[strip - 1] - HEIGHT[strip]) * _unit(words[position]) + HEIGHT[strip]
        return normal if density < math.exp(-0.5 * normal * normal) else math.nan, position + 1
    while True:
        over = -INVERSE_TAIL * math.log1p(-_unit(words[position]))
        height = -math.log1p(-_unit(words[position + 1]))
        position += 2
        if height + height > over * over:
            tail = TAIL + over
            return -tail if (across >> np.uint64(8)) & np.uint64(1) else tail, position


@compiled
def _unit(word):
    """A number of [0, 1) from a word's 53 highest bits."""
    return (word >> np.uint64(11)) * (1.0 / DOUBLES_IN_ONE)

"""A runner whose method is a function of the scene: what studies make of its answers is known."""

import contextlib

import numpy as np

from harvester.engines.progress import Stages
from harvester.engines.request import Answer
from harvester.statistics.estimate import Estimate


class ToyRunner:
    """Answers every request at once by a function of its scene, with noise of the scene's seed.

    Parameters
    ----------
    function : callable
        Of a scene.
    noise : float
        Standard deviation of an answer.
    """

    out_of_time, warnings = False, ()

    def __init__(self, function, noise=0.0):
        self.function, self.noise, self.asked = function, noise, []

    def in_stages(self):
        """See `harvester.engines.Runner.in_stages`."""
        return contextlib.nullcontext(Stages(lambda share, words: None))

    def answer(self, requests, on_answer=None):
        """See `harvester.engines.Runner.answer`."""
        answers = []
        for index, request in enumerate(requests):
            self.asked.append(request)
            answers.append(self._answer(request))
            if on_answer:
                on_answer(index, answers[-1])
        return answers

    def _answer(self, request):
        value = self.function(request.scene)
        error = None
        if self.noise:
            # Devices of equal seed share one draw, and each has one of its own.
            words = np.random.SeedSequence([request.scene.run.seed, hash_of(request.scene)])
            own, common = (
                np.random.default_rng(words),
                np.random.default_rng(request.scene.run.seed),
            )
            value += self.noise * (0.8 * own.standard_normal() + 0.6 * common.standard_normal())
            error = self.noise
        estimate = Estimate(float(value), error, None, "power")
        return Answer(
            scene=request.scene,
            method=request.method,
            quantities={"mean_power": estimate, "jump_rate": estimate},
            seconds=0.0,
            realizations=request.scene.run.realizations,
        )


def hash_of(scene):
    """A number that differs where scenes do."""
    return int(scene.digest()[:12], 16)

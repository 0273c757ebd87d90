"""Propose points for the maximum of a noisy quantity of several parameters.

Optuna's tree-structured Parzen estimator (Bergstra et al., NeurIPS 24 (2011); Akiba et al., KDD
(2019)) models parameters jointly and tolerates failed runs. The table shows the comparison that led
to this choice, all in batches of 8. Column 2: the lowest of 10 searches of 500 evaluations over the
published 65 536 powers of a bistable harvester (americocunhajr/HarvesterOpt, f and Ω, highest
0.0172, most of the range below 0.01). Columns 3 and 4: median and largest loss, as shares of the
maximum, under noise of 5 % of it, for the Branin function (two parameters, 120 evaluations) and
Hartmann's of three (160).

====================================  =======  ===========  ===========  =================
method                                lowest   Branin       Hartmann 3   s for 500 points
====================================  =======  ===========  ===========  =================
Parzen estimator, Optuna              0.0171   0.7, 3.7 %   1.7, 4.7 %   9
CMA-ES with restarts, cma             0.0169   0.7, 3.1 %   2.5, 12.6 %  0.2
CMA-ES, Optuna                        0.0093   1.8, 4.6 %   2.0, 5.6 %   3
differential evolution                0.0170   2.2, 6.3 %   2.5, 8.4 %   0.1
at random                             0.0168   2.2, 5.1 %   4.3, 8.9 %   0
Gaussian process, scikit-optimize     —        0.3, 0.4 %   —            50 for 80 points
extra trees, scikit-optimize          —        1.6, 1.6 %   1.3, 3.3 %   110 for 200 points
====================================  =======  ===========  ===========  =================

A Gaussian process is better in few evaluations of a smooth function, but takes half a second per
evaluation (only two searches of 80 were measured); Optuna's needs PyTorch. The climb of
`harvester.studies.optimum.flat_region` then corrects the remaining loss.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from harvester.base.libraries import optional_library

# Number of points proposed at a time. It is independent of the number of workers, since the answers
# determine the next points.
BATCH = 8


class Proposals:
    """Proposes points in the unit cube, reproducibly for the same answers.

    `first`: the first point.
    """

    def __init__(self, parameters: int, seed: int, first: Sequence[float] | None = None):
        optuna = optional_library("optuna", "an optimum over several parameters", "optimum")
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        distribution = optuna.distributions.FloatDistribution(0.0, 1.0)
        self._names = [f"parameter {k}" for k in range(parameters)]
        self._distributions: dict[str, Any] = dict.fromkeys(self._names, distribution)
        self._failed = optuna.trial.TrialState.FAIL
        word = np.random.SeedSequence(seed).generate_state(1)[0]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            sampler = optuna.samplers.TPESampler(
                seed=int(word), multivariate=True, constant_liar=True
            )
        self._study = optuna.create_study(direction="maximize", sampler=sampler)
        if first is not None:
            self._study.enqueue_trial(dict(zip(self._names, first, strict=True)))
        self._trials: list[Any] = []

    def ask(self, count: int = BATCH) -> list[tuple]:
        """`count` points as tuples of coordinates in 0 … 1."""
        self._trials = [self._study.ask(self._distributions) for _ in range(count)]
        return [tuple(trial.params[name] for name in self._names) for trial in self._trials]

    def tell(self, values: Sequence[float | None]) -> None:
        """Report the values at the last proposed points; None for a missing value."""
        for trial, value in zip(self._trials, values, strict=True):
            if value is None:
                self._study.tell(trial, state=self._failed)
            else:
                self._study.tell(trial, value)

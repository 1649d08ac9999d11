"""Plain Monte Carlo: many trials, reduced block by block in the order of their indices (:mod:`.shards`).

Of each norm only the largest are kept: enough for the quantiles that will be asked for (``shards.Tail``); ``deepen``
repeats a run when more are wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ..errors import IllPosedError, OutOfRangeError, Problem
from ..estimation.missed import NEGLIGIBLE, probability_unanswered
from ..geometry.arrays import Array
from ..kernels.process import usable_cores
from .plan import ChainPlan
from .shards import (
    BLOCK,
    REPROJECTION_TRIALS,
    Moments,
    ShardSampler,
    Tail,
    TrialsTask,
    draw_shards,
    merge_moments,
    tail_size,
)

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """Trials of one plan and seed: what is kept of them, and who draws them."""

    plan: ChainPlan
    seed: int
    quantile: float = 0.95  # the lowest that will be asked for: the tail above it is kept
    limits: tuple[float, ...] = ()  # mm, one for each metric (inf: none): how many trials are beyond is counted
    reprojection: bool = False  # RMS reprojection errors of the first trials are kept too
    threads: int | None = None  # None: one for each core
    progress: Progress | None = None  # called after every part with the trials done, and how many there may be
    sampler: ShardSampler | None = None  # gives parts that were drawn elsewhere; what it raises is passed on
    keep: int | None = None  # norms to keep, whatever the quantile


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSample:
    """What is kept of one error metric at one target; mm, mm^2."""

    target: str  # or the site of a measure that joins several
    error: str  # name of the measure
    trials: int
    mean: Array  # (3,); it, scatter and mean_norm of the trials that have an answer
    scatter: Array  # (3, 3) sum of products about the mean
    mean_norm: float
    tail: Array  # the largest norms, ascending; every trial above tail[0] is in it
    above: tuple[float, int] | None = None  # a limit, mm, and how many norms are beyond it
    unanswered: int = 0  # trials without an answer, whose norm is infinite

    @property
    def covariance(self) -> Array:
        """(3, 3) mm^2, divisor n - 1."""
        return np.asarray(self.scatter / (self.trials - self.unanswered - 1))

    @property
    def worst(self) -> float:
        """The largest norm of a trial that has an answer."""
        return float(self.tail[len(self.tail) - self.unanswered - 1])


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A run so far.  ``errors`` is in the order of ``System.metrics``."""

    simulation: Simulation
    trials: int
    errors: tuple[ErrorSample, ...]
    redone: int  # trials that the plain form redid because the kernel's answer was not proven
    reprojection_px: Array | None  # RMS reprojection errors of the first trials that have an answer, ascending
    missed: int = 0  # trials in which a fiducial is missed
    unanswered: int = 0  # of these, trials that leave too few for an answer

    @property
    def has_open_means(self) -> bool:
        """Whether a mean over all shots has no upper end, by the design and not by the luck of the shots drawn."""
        return self.unanswered > 0 or probability_unanswered(self.simulation.plan.system) >= NEGLIGIBLE

    def of(self, target: str | int, error: str = "tcp") -> ErrorSample:
        """The sample of a measure at one target (by name or index) or site."""
        name = target if isinstance(target, str) else self.simulation.plan.system.targets[target].name
        return next(sample for sample in self.errors if (sample.target, sample.error) == (name, error))


class Run:
    """A simulation that grows: longer steps or shorter ones give the same digits."""

    def __init__(self, simulation: Simulation) -> None:
        if simulation.threads is not None and simulation.threads < 1:
            raise OutOfRangeError(Problem("", "threads", f"threads must be at least 1, got {simulation.threads}"))
        self._metrics = simulation.plan.system.metrics
        metrics = len(self._metrics)
        self.simulation = simulation
        self._limits = simulation.limits or (inf,) * metrics
        self._moments: Moments | None = None
        self._done = self._missed = self._unanswered = self._redone = 0  # trials
        self._tails = [Tail() for _ in range(metrics)]
        self._above = [0] * metrics
        self._reprojections: list[Array] = []

    def grow(
        self, trials: int, *, most: int | None = None, then: tuple[tuple[int, int], ...] = (), expected: int = 0
    ) -> Samples:
        """Go on to so many trials altogether.

        most: how many there may be in the end, for the progress.  then, expected: see ``TrialsTask``.
        Raises OutOfRangeError for fewer than 2 trials, and where the last number was not a multiple of ``BLOCK``.
        """
        what = self.simulation
        done = self._done
        if trials < 2:
            raise OutOfRangeError(Problem("", "trials", f"at least 2 trials are needed, got {trials}"))
        if done % BLOCK or done > trials:
            detail = f"a run goes on from a multiple of {BLOCK} trials to a larger number, not from {done} to {trials}"
            raise OutOfRangeError(Problem("", "extend", detail))
        keep = tail_size(trials, what.quantile) if what.keep is None else what.keep
        task = TrialsTask(
            what.plan, what.seed, done, trials, what.quantile, what.reprojection, self._limits, then, expected
        )
        threads = usable_cores() if what.threads is None else what.threads
        for shard in draw_shards(task, threads) if what.sampler is None else what.sampler(task):
            for moments in shard.moments:
                self._moments = moments if self._moments is None else merge_moments(self._moments, moments)
            self._done += shard.trials
            self._missed += shard.missed
            self._unanswered += shard.unanswered
            self._redone += shard.redone
            for k, norms in enumerate(shard.tails):
                self._above[k] += shard.above[k]
                tail = self._tails[k]
                tail.add(norms, shard.floors[k])
                if tail.size > keep + keep // 4 + BLOCK:
                    tail.settle(keep)
            if shard.reprojection is not None:
                self._reprojections.append(shard.reprojection)
            if what.progress is not None:
                what.progress(self._done, trials if most is None else most)
        return self._samples(trials, keep)

    def _samples(self, trials: int, keep: int) -> Samples:
        """keep: norms of each error."""
        moments = self._moments
        assert moments is not None  # there is at least one part
        if moments.trials < 2:
            detail = f"{self._unanswered} of {trials} shots miss so many fiducials that they have no answer"
            raise IllPosedError(Problem("/fiducials/loss_probability", "no-answer", detail, "use more fiducials"))
        errors = []
        for k, collected in enumerate(self._tails):
            tail = collected.settle(keep)
            tail.setflags(write=False)
            limit = self._limits[k]
            errors.append(
                ErrorSample(
                    target=self._metrics[k].site.name,
                    error=self._metrics[k].measure.name,
                    trials=trials,
                    mean=moments.mean[k],
                    scatter=moments.scatter[k],
                    mean_norm=float(moments.norm_mean[k]),
                    tail=tail,
                    above=None if limit == inf else (limit, self._above[k]),
                    unanswered=self._unanswered,
                )
            )
        shots = self._reprojections
        reprojection = np.sort(np.concatenate(shots)[:REPROJECTION_TRIALS]) if shots else None
        lost = self._missed, self._unanswered
        return Samples(self.simulation, trials, tuple(errors), self._redone, reprojection, *lost)


def deepen(samples: Samples, keep: int) -> Samples:
    """The same run with at least ``keep`` of the largest norms: itself, or repeated from its seed."""
    if all(len(sample.tail) >= min(keep, sample.trials) for sample in samples.errors):
        return samples
    again = replace(samples.simulation, keep=min(samples.trials, keep), limits=(), sampler=None, progress=None)
    return Run(again).grow(samples.trials)

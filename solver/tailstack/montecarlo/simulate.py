"""Plain Monte Carlo: many trials, reduced block by block in the order of their indices.

Trial i depends on (seed, i) alone and reductions run over fixed blocks of ``BLOCK`` trials, so neither
the number of threads nor the size of a batch reaches a digit of the result.  Of each norm only the
largest are kept: enough for the quantiles asked for; ``deepened`` repeats the run when more are wanted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from ..cores import usable_cores
from ..errors import OutOfRangeError, Problem
from ..system import Array, System
from .plan import ChainPlan, compile_plan
from .shards import (
    BLOCK,
    REPROJECTION_TRIALS,
    Moments,
    Shard,
    ShardSource,
    Wanted,
    block_arguments,
    block_shard,
    largest,
    tail_size,
)

ERRORS = ("tcp", "localisation")
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSample:
    """What is kept of one error metric at one target; mm, mm^2."""

    target: str
    error: str  # "tcp" (in tcp) or "localisation" (in con)
    trials: int
    mean: Array  # (3,)
    scatter: Array  # (3, 3) sum of products about the mean
    mean_norm: float
    tail: Array  # the largest norms, ascending; every trial above tail[0] is in it
    above: tuple[float, int] | None = None  # a limit, mm, and how many norms are beyond it

    @property
    def covariance(self) -> Array:
        """(3, 3) mm^2, divisor n - 1."""
        return np.asarray(self.scatter / (self.trials - 1))

    @property
    def worst(self) -> float:
        return float(self.tail[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Reprojections:
    """RMS reprojection error of the first trials, px, ascending."""

    rms_px: Array


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A finished run.  ``errors`` holds, target by target, the TCP and then the localisation error."""

    plan: ChainPlan
    seed: int
    trials: int
    errors: tuple[ErrorSample, ...]
    redone: int  # trials redone by SVD because the structured solution was not proven
    reprojection: Reprojections | None
    threads: int
    batch: int

    def of(self, target: str | int, error: str = "tcp") -> ErrorSample:
        """The sample of one target (by name or place) and one error ("tcp" or "localisation")."""
        names = [t.name for t in self.plan.system.targets]
        place = names.index(target) if isinstance(target, str) else target
        return self.errors[2 * place + ERRORS.index(error)]


def _merged(a: Moments, b: Moments) -> Moments:
    """Moments of two disjoint sets (Chan, Golub and LeVeque 1983)."""
    count = a.trials + b.trials
    share = b.trials / count
    gap = b.mean - a.mean
    scatter = a.scatter + b.scatter + (a.trials * share) * (gap[:, :, None] * gap[:, None, :])
    norm_mean = a.norm_mean + share * (b.norm_mean - a.norm_mean)
    return Moments(count, a.mean + share * gap, scatter, norm_mean)


def _in_order(wanted: Wanted, batch: int, threads: int) -> Iterator[Shard]:
    """Blocks in the order of their indices; at most two batches per thread are under way."""
    blocks, size = block_arguments(wanted), max(1, batch // BLOCK)
    batches = [blocks[k : k + size] for k in range(0, len(blocks), size)]

    def work(batch: list[Any]) -> list[Shard]:
        return [block_shard(*arguments) for arguments in batch]

    if threads == 1:
        for part in batches:
            yield from work(part)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[list[Shard]]] = deque()
        for part in batches:
            waiting.append(pool.submit(work, part))
            if len(waiting) >= 2 * threads:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()


def simulate(
    system: System | ChainPlan,
    *,
    trials: int,
    seed: int,
    quantile: float = 0.95,
    threads: int | None = None,
    batch: int | None = None,
    vertex: Mapping[str, float] | Array | None = None,
    shots_per_unit: int = 1,
    reprojection: bool = False,
    keep: int | None = None,
    progress: Progress | None = None,
    extend: Samples | None = None,
    limits: Sequence[float] | None = None,
    source: ShardSource | None = None,
    then: tuple[tuple[int, int], ...] = (),
    expected: int = 0,
) -> Samples:
    """Run ``trials`` trials of the full nonlinear chain.

    quantile: the lowest one that will be asked for; the tail above it is kept (``keep``: norms to keep,
    overrides it).  vertex, shots_per_unit: see ``compile_plan``; not with a plan.  reprojection: also over the
    first ``REPROJECTION_TRIALS`` trials.  extend: an earlier run of the same plan and seed, a multiple of
    ``BLOCK`` long, to go on from.  ``progress(done, total)`` is called after each part.  limits: mm, one for each
    metric (inf: none); how many trials are beyond is counted.  source: where parts of the run come from that were
    computed elsewhere; what it raises is passed on.  then, expected: what it is told of trials to come (``Wanted``).
    Raises OutOfRangeError when a count is not positive or the plan and its options disagree.
    """
    if trials < 2:
        raise OutOfRangeError(Problem("", "trials", f"at least 2 trials are needed, got {trials}"))
    if isinstance(system, ChainPlan):
        if vertex is not None or shots_per_unit != 1:
            detail = "vertex and shots_per_unit belong to compile_plan; this plan is already compiled"
            raise OutOfRangeError(Problem("", "plan-options", detail))
        plan = system
    else:
        plan = compile_plan(system, vertex=vertex, shots_per_unit=shots_per_unit)
    threads = usable_cores() if threads is None else threads
    batch = BLOCK if batch is None else batch
    if threads < 1 or batch < 1:
        raise OutOfRangeError(
            Problem("", "threads", f"threads and batch must be at least 1, got {threads} and {batch}")
        )
    keep = tail_size(trials, quantile) if keep is None else keep

    state: Moments | None = None
    tails: list[list[Array]] = [[] for _ in range(2 * len(plan.system.targets))]
    floors = [-inf] * len(tails)
    limits = (inf,) * len(tails) if limits is None else tuple(limits)
    above = [0] * len(tails)
    done, redone, reprojections = 0, 0, []
    if extend is not None:
        if extend.plan is not plan or extend.seed != seed or extend.trials % BLOCK or extend.trials > trials:
            detail = f"only a run of the same plan and seed, a multiple of {BLOCK} trials long, can be extended"
            raise OutOfRangeError(Problem("", "extend", detail))
        state = _moments_of(extend)
        done, redone = extend.trials, extend.redone
        for k, sample in enumerate(extend.errors):
            tails[k].append(sample.tail)
            floors[k] = -inf if len(sample.tail) == sample.trials else float(sample.tail[0])
            above[k] = sample.above[1] if sample.above is not None else 0
        if extend.reprojection is not None:
            reprojections.append(extend.reprojection.rms_px)

    wanted = Wanted(plan, seed, done, trials, quantile, reprojection, limits, then, expected)
    held = [sum(len(part) for part in tail) for tail in tails]
    for shard in _in_order(wanted, batch, threads) if source is None else source(wanted):
        for moments in shard.moments:
            state = moments if state is None else _merged(state, moments)
            done += moments.trials
        redone += shard.redone
        for k, norms in enumerate(shard.tails):
            above[k] += shard.above[k]
            if shard.floors[k] > floors[k]:
                floors[k] = shard.floors[k]
                tails[k].append(norms)
            else:
                tails[k].append(norms[norms > floors[k]])
            held[k] += len(tails[k][-1])
            if held[k] > 2 * keep + BLOCK:
                tails[k] = [largest(np.concatenate(tails[k]), keep)]
                floors[k], held[k] = max(floors[k], float(tails[k][0].min())), keep
        if shard.reprojection is not None:
            reprojections.append(shard.reprojection)
        if progress is not None:
            progress(done, trials)
    if state is None:
        raise OutOfRangeError(Problem("", "trials", "nothing to simulate"))
    names = [target.name for target in plan.system.targets]
    samples = []
    for k, tail in enumerate(tails):
        held_norms = np.concatenate(tail)
        kept = np.sort(largest(held_norms[held_norms >= floors[k]], keep))
        kept.setflags(write=False)
        norm_mean = float(state.norm_mean[k])
        beyond = None if limits[k] == inf else (limits[k], above[k])
        samples.append(
            ErrorSample(names[k // 2], ERRORS[k % 2], trials, state.mean[k], state.scatter[k], norm_mean, kept, beyond)
        )
    rms = Reprojections(np.sort(np.concatenate(reprojections)[:REPROJECTION_TRIALS])) if reprojections else None
    return Samples(plan, seed, trials, tuple(samples), redone, rms, threads, batch)


def _moments_of(samples: Samples) -> Moments:
    return Moments(
        samples.trials,
        np.array([s.mean for s in samples.errors]),
        np.array([s.scatter for s in samples.errors]),
        np.array([s.mean_norm for s in samples.errors]),
    )


def deepened(samples: Samples, keep: int) -> Samples:
    """The same run with at least ``keep`` of the largest norms: itself, or repeated from its seed."""
    if all(len(s.tail) >= min(keep, s.trials) for s in samples.errors):
        return samples
    return simulate(
        samples.plan,
        trials=samples.trials,
        seed=samples.seed,
        keep=min(samples.trials, keep),
        threads=samples.threads,
        batch=samples.batch,
        reprojection=samples.reprojection is not None,
    )

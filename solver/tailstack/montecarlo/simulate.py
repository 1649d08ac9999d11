"""Plain Monte Carlo: many trials, reduced block by block in the order of their indices.

Trial i depends on (seed, i) alone and reductions run over fixed blocks of ``BLOCK`` trials, so neither
the number of threads nor the size of a batch reaches a digit of the result.  Of each norm only the
largest are kept: enough for the quantiles asked for; ``deepen`` repeats the run when more are wanted.

A run may be put together from parts that are kept elsewhere.  Blocks of ``BLOCK`` trials are the unit of summation
and a shard holds whole blocks, each with its own moments: merging them one by one in the order of their indices gives
the digits of an undivided run, wherever it was cut. Of the norms a shard holds the largest; merged, the tail is
complete down to the highest of the shards' floors.

Norms and moments of one block are summed in eight partial sums: lane k sums trials k, k + 8, ...; the lanes are then
added in order, and what does not fill eight last.  That is one fixed order of summation on every machine."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil, inf, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..cores import usable_cores
from ..errors import OutOfRangeError, Problem
from ..packed import pack, unpack
from ..system import System
from .chain import run_indices
from .lanes import fma, lane_entry, lane_jit, load, splat, square_root, store
from .plan import ChainPlan, compile_plan

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


def merge_moments(a: Moments, b: Moments) -> Moments:
    """Moments of two disjoint sets (Chan, Golub and LeVeque 1983)."""
    count = a.trials + b.trials
    share = b.trials / count
    gap = b.mean - a.mean
    scatter = a.scatter + b.scatter + (a.trials * share) * (gap[:, :, None] * gap[:, None, :])
    norm_mean = a.norm_mean + share * (b.norm_mean - a.norm_mean)
    return Moments(count, a.mean + share * gap, scatter, norm_mean)


def _in_order(wanted: TrialsTask, batch: int, threads: int) -> Iterator[Shard]:
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
    source: ShardSampler | None = None,
    then: tuple[tuple[int, int], ...] = (),
    expected: int = 0,
) -> Samples:
    """Run ``trials`` trials of the full nonlinear chain.

    quantile: the lowest one that will be asked for; the tail above it is kept (``keep``: norms to keep,
    overrides it).  vertex, shots_per_unit: see ``compile_plan``; not with a plan.  reprojection: also over the
    first ``REPROJECTION_TRIALS`` trials.  extend: an earlier run of the same plan and seed, a multiple of
    ``BLOCK`` long, to go on from.  ``progress(done, total)`` is called after each part.  limits: mm, one for each
    metric (inf: none); how many trials are beyond is counted.  source: where parts of the run come from that were
    computed elsewhere; what it raises is passed on.  then, expected: trials to come (``TrialsTask``).
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

    wanted = TrialsTask(plan, seed, done, trials, quantile, reprojection, limits, then, expected)
    held = [sum(len(part) for part in tail) for tail in tails]
    for shard in _in_order(wanted, batch, threads) if source is None else source(wanted):
        for moments in shard.moments:
            state = moments if state is None else merge_moments(state, moments)
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
                tails[k] = [take_largest(np.concatenate(tails[k]), keep)]
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
        kept = np.sort(take_largest(held_norms[held_norms >= floors[k]], keep))
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


def deepen(samples: Samples, keep: int) -> Samples:
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


BLOCK = 8192
REPROJECTION_TRIALS = 16384
LARGEST_SHARD = 2**18
SHARD_MICROSECONDS = 60_000.0  # of one core: a hundred times what it costs to hand a shard out and take it back
PILOT = 256  # trials that tell how many are redone by SVD


class Moments(NamedTuple):
    """Of m error metrics over some trials; mm, mm^2."""

    trials: int
    mean: Array  # (m, 3)
    scatter: Array  # (m, 3, 3) sums of products about the mean
    norm_mean: Array  # (m,)


@dataclass(frozen=True, slots=True, eq=False)
class Shard:
    """What is kept of consecutive trials: target by target, the TCP and then the localisation error."""

    moments: tuple[Moments, ...]  # of each block, in order
    tails: Sequence[Array]  # of each metric, its largest norms, mm, in any order
    floors: Sequence[float]  # of each metric: every norm above it is in the tail
    above: tuple[int, ...]  # of each metric: norms beyond its limit
    redone: int  # trials redone by SVD because the structured solution was not proven
    reprojection: Array | None  # px, of the trials before ``REPROJECTION_TRIALS``

    @property
    def trials(self) -> int:
        return sum(block.trials for block in self.moments)


@dataclass(frozen=True, slots=True, eq=False)
class TrialsTask:
    """Trials ``first`` ... ``stop - 1`` of a plan and seed, and what is to be kept of them."""

    plan: ChainPlan
    seed: int
    first: int  # a multiple of BLOCK
    stop: int
    quantile: float  # lowest that will be asked for: the tail above it is kept
    reprojection: bool
    limits: tuple[float, ...]  # mm, one for each metric; inf: none
    then: tuple[tuple[int, int], ...] = ()  # ranges that will almost certainly be wanted next
    expected: int = 0  # trials with which the run will end, as far as is known


ShardSampler = Callable[[TrialsTask], Iterable[Shard]]  # shards that cover the range, in order; may raise Pending


class Pending(Exception):
    """What a source raises that does not hold a part yet: what it wants computed, and how much may follow."""

    def __init__(self, wanted: Sequence[Any], remaining: int = 0) -> None:
        super().__init__(f"{len(wanted)} parts are not there yet")
        self.wanted, self.remaining = tuple(wanted), remaining


def tail_size(trials: int, quantile: float) -> int:
    """How many of the largest norms to keep for this quantile: its interval at any usual confidence, and slack."""
    beyond = trials * (1 - quantile)
    return min(trials, ceil(beyond + 8 * sqrt(beyond + 1)) + 16)


def take_largest(values: Array, count: int) -> Array:
    """The ``count`` largest, in any order."""
    return values if len(values) <= count else np.partition(values, len(values) - count)[-count:]


def block_shard(
    plan: ChainPlan, seed: int, first: int, count: int, reprojection: bool, limits: tuple[float, ...]
) -> Shard:
    """One block with all of its norms."""
    outcome = run_indices(plan, seed, first, count, reprojection=reprojection)
    errors = np.ascontiguousarray(outcome.errors).reshape(-1, 3, count)
    metrics = len(errors)
    norms, norm_mean = np.empty((metrics, count)), np.empty(metrics)
    mean, scatter = np.empty((metrics, 3)), np.empty((metrics, 3, 3))
    reduce_block(errors.reshape(-1), count, norms.reshape(-1), mean, scatter, norm_mean, np.empty(48))
    norms[np.isnan(norms)] = np.inf  # a trial without an answer is beyond any limit, not outside the count
    above = tuple(
        0 if limit == inf else int(np.count_nonzero(own > limit)) for own, limit in zip(norms, limits, strict=True)
    )
    moments = (Moments(count, mean, scatter, norm_mean),)
    return Shard(moments, tuple(norms), (-inf,) * metrics, above, outcome.redone, outcome.reprojection)


def block_arguments(wanted: TrialsTask) -> list[tuple[ChainPlan, int, int, int, bool, tuple[float, ...]]]:
    """Arguments of :func:`block_shard` for every block of a range."""
    return [
        (
            wanted.plan, wanted.seed, first, min(BLOCK, wanted.stop - first),
            wanted.reprojection and first < REPROJECTION_TRIALS, wanted.limits,
        )
        for first in range(wanted.first, wanted.stop, BLOCK)
    ]  # fmt: skip


def compute_shard(wanted: TrialsTask) -> Shard:
    """The whole range as one shard, its tails cut to what its quantile needs, ascending.  Nothing else is read."""
    blocks = [block_shard(*arguments) for arguments in block_arguments(wanted)]
    keep = tail_size(wanted.stop - wanted.first, wanted.quantile)
    tails, floors = [], []
    for k in range(len(wanted.limits)):
        norms = np.concatenate([block.tails[k] for block in blocks])
        tail = np.sort(take_largest(norms, keep))
        tails.append(tail)
        floors.append(-inf if len(tail) == len(norms) else float(tail[0]))
    shots = [block.reprojection for block in blocks if block.reprojection is not None]
    return Shard(
        moments=tuple(moments for block in blocks for moments in block.moments),
        tails=tails,
        floors=floors,
        above=tuple(sum(counts) for counts in zip(*(block.above for block in blocks), strict=True)),
        redone=sum(block.redone for block in blocks),
        reprojection=np.concatenate(shots) if shots else None,
    )


def shard_trials(plan: ChainPlan, seed: int) -> int:
    """Trials, a power of two, that take one core some fifty milliseconds; at least one block.

    By the counts of the plan (fitted to 6 ... 100 fiducials, 2 ... 8 views, 1 ... 50 targets) and by how many of the
    first trials are redone, each of which costs as much as a thousand others.
    """
    share = run_indices(plan, seed, 0, PILOT).redone / PILOT
    views, targets = len(plan.system.views), len(plan.system.targets)
    microseconds = 0.0011 * plan.dimension + 0.03 * (views + targets) + 140 * share
    size = LARGEST_SHARD
    while size > BLOCK and size * microseconds > SHARD_MICROSECONDS:
        size //= 2
    return size


def spans(first: int, stop: int, size: int) -> Iterator[tuple[int, int]]:
    """A range cut at the multiples of ``size``."""
    while first < stop:
        end = min(stop, (first // size + 1) * size)
        yield first, end
        first = end


def shard_to_bytes(shard: Shard) -> bytes:
    """A shard as bytes that :func:`shard_from_bytes` reads back exactly."""
    head = {"trials": [block.trials for block in shard.moments], "above": shard.above, "redone": shard.redone}
    arrays = [
        np.array([block.mean for block in shard.moments]),
        np.array([block.scatter for block in shard.moments]),
        np.array([block.norm_mean for block in shard.moments]),
        np.array(shard.floors),
        *shard.tails,
    ]
    return pack(head, arrays if shard.reprojection is None else [*arrays, shard.reprojection])


def shard_from_bytes(content: bytes) -> Shard:
    """Raises ValueError for bytes that are not a shard."""
    head, arrays = unpack(content)
    mean, scatter, norm_mean, floors = arrays[:4]
    metrics = len(floors)
    blocks = zip(head["trials"], mean, scatter, norm_mean, strict=True)
    return Shard(
        moments=tuple(Moments(*block) for block in blocks),
        tails=arrays[4 : 4 + metrics],
        floors=[float(floor) for floor in floors],
        above=tuple(head["above"]),
        redone=head["redone"],
        reprojection=arrays[4 + metrics] if len(arrays) > 4 + metrics else None,
    )


# mypy: ignore-errors


@lane_jit
def lane_sum(lanes, row):
    total = 0.0
    for k in range(8):
        total += lanes[8 * row + k]
    return total


@lane_entry
def reduce_block(errors, n, norms, mean, scatter, norm_mean, lanes):
    """Norms (flat m n), mean (m, 3), scatter about it (m, 3, 3) and mean norm (m,) of flat (m, 3, n) errors, mm.

    lanes: scratch of 48.  The norm is written without fused operations so that the last, incomplete eight have the
    digits they would have in a longer run.
    """
    zero = splat(0.0)
    whole = n - n % 8
    for m in range(norm_mean.size):
        at = 3 * m * n
        sx, sy, sz, sn = zero, zero, zero, zero
        for i in range(0, whole, 8):
            x, y, z = load(errors, at + i), load(errors, at + n + i), load(errors, at + 2 * n + i)
            norm = square_root(x * x + y * y + z * z)
            store(norms, m * n + i, norm)
            sx, sy, sz, sn = sx + x, sy + y, sz + z, sn + norm
        store(lanes, 0, sx)
        store(lanes, 8, sy)
        store(lanes, 16, sz)
        store(lanes, 24, sn)
        tx, ty, tz, tn = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2), lane_sum(lanes, 3)
        for i in range(whole, n):
            x, y, z = errors[at + i], errors[at + n + i], errors[at + 2 * n + i]
            norms[m * n + i] = sqrt(x * x + y * y + z * z)
            tx, ty, tz, tn = tx + x, ty + y, tz + z, tn + norms[m * n + i]
        ax, ay, az = tx / n, ty / n, tz / n
        mean[m, 0], mean[m, 1], mean[m, 2], norm_mean[m] = ax, ay, az, tn / n

        xx, xy, xz, yy, yz, zz = zero, zero, zero, zero, zero, zero
        for i in range(0, whole, 8):
            x = load(errors, at + i) - splat(ax)
            y = load(errors, at + n + i) - splat(ay)
            z = load(errors, at + 2 * n + i) - splat(az)
            xx, xy, xz = fma(x, x, xx), fma(x, y, xy), fma(x, z, xz)
            yy, yz, zz = fma(y, y, yy), fma(y, z, yz), fma(z, z, zz)
        store(lanes, 0, xx)
        store(lanes, 8, xy)
        store(lanes, 16, xz)
        store(lanes, 24, yy)
        store(lanes, 32, yz)
        store(lanes, 40, zz)
        cxx, cxy, cxz = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2)
        cyy, cyz, czz = lane_sum(lanes, 3), lane_sum(lanes, 4), lane_sum(lanes, 5)
        for i in range(whole, n):
            x, y, z = errors[at + i] - ax, errors[at + n + i] - ay, errors[at + 2 * n + i] - az
            cxx, cxy, cxz = cxx + x * x, cxy + x * y, cxz + x * z
            cyy, cyz, czz = cyy + y * y, cyz + y * z, czz + z * z
        scatter[m, 0, 0], scatter[m, 1, 1], scatter[m, 2, 2] = cxx, cyy, czz
        scatter[m, 0, 1] = scatter[m, 1, 0] = cxy
        scatter[m, 0, 2] = scatter[m, 2, 0] = cxz
        scatter[m, 1, 2] = scatter[m, 2, 1] = cyz

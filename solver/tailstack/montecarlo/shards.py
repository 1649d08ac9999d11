"""Trials in parts that can be drawn anywhere: what is kept of them, and how parts become one run.

Trial i depends on (seed, i) alone.  Blocks of ``BLOCK`` trials are the unit of summation and a shard holds whole
blocks, each with its own moments: merging them one by one in the order of their indices gives the digits of an
undivided run, wherever it was cut and however many threads drew it.  Of the norms a shard holds the largest; merged,
the tail is complete down to the highest of the shards' floors.  A rank that is asked for and was not kept is drawn
again (``simulate.deepen``), never replaced by another.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from math import ceil, fsum, inf, prod, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..geometry.arrays import Array
from ..results.json_text import write_json
from .chain import measure_trials, norms_of, run_indices
from .kernel import reduce_block
from .plan import ChainPlan

BLOCK = 8192
REPROJECTION_TRIALS = 16384  # the first of a run, whose reprojection errors are kept
LARGEST_SHARD = 2**18
SHARD_MICROSECONDS = 60_000.0  # of one core: a hundred times what it costs to hand a shard out and take it back
PILOT = 256  # trials that tell how many the plain form redoes


class Moments(NamedTuple):
    """Of m error metrics over some trials; mm, mm^2."""

    trials: int  # that have an answer
    mean: Array  # (m, 3)
    scatter: Array  # (m, 3, 3) sums of products about the mean
    norm_mean: Array  # (m,)


@dataclass(frozen=True, slots=True, eq=False)
class Shard:
    """What is kept of consecutive trials; metrics in the order of ``System.metrics``."""

    moments: tuple[Moments, ...]  # of each block, in order
    tails: Sequence[Array]  # of each metric, its largest norms, mm, in any order
    floors: Sequence[float]  # of each metric: every norm above it is in the tail
    above: tuple[int, ...]  # of each metric: norms beyond its limit
    redone: int  # trials that the plain form redid because the kernel's answer was not proven
    reprojection: Array | None  # px, of the trials before ``REPROJECTION_TRIALS`` that have an answer
    missed: int = 0  # trials in which a fiducial is missed
    unanswered: int = 0  # of these, trials that leave too few for an answer: their norms are infinite

    @property
    def trials(self) -> int:
        return sum(block.trials for block in self.moments) + self.unanswered


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


def tail_size(trials: int, quantile: float) -> int:
    """How many of the largest norms to keep for this quantile: its interval at any usual confidence, and slack."""
    beyond = trials * (1 - quantile)
    return min(trials, ceil(beyond + 8 * sqrt(beyond + 1)) + 16)


def take_largest(values: Array, count: int) -> Array:
    """The ``count`` largest, in any order."""
    return values if len(values) <= count else np.partition(values, len(values) - count)[-count:]


@dataclass(slots=True)
class Tail:
    """The largest norms of one error so far, mm."""

    parts: list[Array] = field(default_factory=list)
    size: int = 0  # norms in the parts
    floor: float = -inf  # every norm above is in the parts

    def add(self, norms: Array, floor: float) -> None:
        """Norms that are complete above their floor."""
        if floor > self.floor:
            self.floor = floor
        else:
            norms = norms[norms > self.floor]
        self.parts.append(norms)
        self.size += len(norms)

    def settle(self, keep: int) -> Array:
        """The ``keep`` largest, ascending; all others are forgotten."""
        norms = np.concatenate(self.parts)
        self.parts.clear()
        norms = norms[norms >= self.floor]
        cut = len(norms) > keep
        norms = np.sort(take_largest(norms, keep))
        self.floor = float(norms[0]) if cut else self.floor
        self.parts, self.size = [norms], len(norms)
        return norms


ShardSampler = Callable[[TrialsTask], Iterable[Shard]]  # shards that cover the range, in order; may raise Pending


class Pending(Exception):
    """Raised by a sampler that does not hold a part yet: what it wants computed, and how much may follow."""

    def __init__(self, wanted: Sequence[Any], remaining: int = 0) -> None:
        super().__init__(f"{len(wanted)} parts are not there yet")
        self.wanted, self.remaining = tuple(wanted), remaining


def merge_moments(a: Moments, b: Moments) -> Moments:
    """Moments of two disjoint sets (Chan, Golub and LeVeque 1983)."""
    count = a.trials + b.trials
    share = b.trials / count if count else 0.0
    gap = b.mean - a.mean
    scatter = a.scatter + b.scatter + (a.trials * share) * (gap[:, :, None] * gap[:, None, :])
    norm_mean = a.norm_mean + share * (b.norm_mean - a.norm_mean)
    return Moments(count, a.mean + share * gap, scatter, norm_mean)


def draw_block(task: TrialsTask, first: int) -> Shard:
    """The block of a task that begins at ``first``, with all of its norms."""
    count = min(BLOCK, task.stop - first)
    reprojection = task.reprojection and first < REPROJECTION_TRIALS
    outcome = run_indices(task.plan, task.seed, first, count, reprojection=reprojection)
    errors = measure_trials(task.plan, task.seed, first, outcome.errors)
    answered = np.isfinite(errors).all(axis=(0, 1)) if outcome.missed else np.ones(count, dtype=bool)
    answers = int(answered.sum())
    reprojections = outcome.reprojection
    if answers < count:
        errors = np.ascontiguousarray(errors[..., answered])
        reprojections = None if reprojections is None else reprojections[answered]
    metrics = len(errors)
    norms, norm_mean = np.empty((metrics, answers)), np.zeros(metrics)
    mean, scatter = np.zeros((metrics, 3)), np.zeros((metrics, 3, 3))
    if answers:
        reduce_block(errors.reshape(-1), answers, norms.reshape(-1), mean, scatter, norm_mean, np.empty(48))
        for k, metric in enumerate(task.plan.system.metrics):
            if metric.site.is_one_sided:
                norms[k] = norms_of(errors[k], one_sided=True)
                norm_mean[k] = fsum(norms[k]) / answers
    if answers < count:  # a trial without an answer is beyond any limit, not outside the count
        norms = np.concatenate([norms, np.full((metrics, count - answers), inf)], axis=1)
    above = tuple(int(np.count_nonzero(own > limit)) for own, limit in zip(norms, task.limits, strict=True))
    moments = (Moments(answers, mean, scatter, norm_mean),)
    floors = (-inf,) * metrics
    lost = outcome.missed, count - answers
    return Shard(moments, tuple(norms), floors, above, outcome.redone, reprojections, *lost)


def draw_shards(task: TrialsTask, threads: int) -> Iterator[Shard]:
    """Block after block of a task, drawn in this process; at most two for each thread are under way."""
    firsts = range(task.first, task.stop, BLOCK)
    if threads == 1:
        yield from (draw_block(task, first) for first in firsts)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Shard]] = deque()
        for first in firsts:
            waiting.append(pool.submit(draw_block, task, first))
            if len(waiting) >= 2 * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def compute_shard(task: TrialsTask) -> Shard:
    """The whole range as one shard, its tails cut to what its quantile needs, ascending.  Nothing else is read."""
    blocks = [draw_block(task, first) for first in range(task.first, task.stop, BLOCK)]
    keep = tail_size(task.stop - task.first, task.quantile)
    tails, floors = [], []
    for k in range(len(task.limits)):
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
        missed=sum(block.missed for block in blocks),
        unanswered=sum(block.unanswered for block in blocks),
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
    head = {
        "trials": [block.trials for block in shard.moments],
        "above": shard.above,
        "redone": shard.redone,
        "missed": shard.missed,
        "unanswered": shard.unanswered,
    }
    moments = (np.array([getattr(block, name) for block in shard.moments]) for name in Moments._fields[1:])
    arrays = [*moments, np.array(shard.floors), *shard.tails]
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
        missed=head["missed"],
        unanswered=head["unanswered"],
    )


def pack(head: dict[str, Any], arrays: Sequence[Array]) -> bytes:
    """``head`` (JSON's own types) and float64 arrays of any shape as bytes; the same input gives the same bytes.

    Four bytes with the length of the head, the head as JSON (floats in their shortest form that reads back the same),
    then the arrays as little-endian float64, one after another.  Not pickle: reading it runs nothing.
    """
    shapes = [list(array.shape) for array in arrays]
    text = write_json({"head": head, "shapes": shapes}, sort_keys=True).encode()
    parts = [np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays]
    return b"".join([len(text).to_bytes(4, "little"), text, *parts])


def unpack(content: bytes) -> tuple[dict[str, Any], list[Array]]:
    """What :func:`pack` was given; the arrays are read-only.  Raises ValueError for other bytes."""
    start = 4 + int.from_bytes(content[:4], "little")
    try:
        header = json.loads(content[4:start])
        shapes: list[list[int]] = header["shapes"]
        head: dict[str, Any] = header["head"]
    except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{len(content)} bytes are not a packed record: {error}") from None
    arrays = []
    for shape in shapes:
        size = prod(shape)
        if start + 8 * size > len(content):
            raise ValueError(f"a packed record breaks off after {len(content)} bytes")
        arrays.append(np.frombuffer(content, dtype="<f8", count=size, offset=start).reshape(shape))
        start += 8 * size
    if start != len(content):
        raise ValueError(f"{len(content) - start} bytes follow a packed record")
    return head, arrays

"""A run keeps the largest of its norms: the same answers as from all of them."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from scenes import cube8_system, with_noise
from tailstack.montecarlo.estimators import cvar_estimate, exceedance_estimate, quantile_estimate
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.shards import BLOCK, Shard, TrialsTask, compute_shard
from tailstack.montecarlo.simulate import Run, Simulation, simulate
from tailstack.montecarlo.tails import Tail

PLAN = compile_plan(cube8_system())


@pytest.mark.parametrize("law", ["rayleigh", "ties"])
def test_what_is_kept_is_the_largest_of_all(law: str) -> None:
    """independent: numpy's order statistics of every norm."""
    rng = np.random.default_rng(5)
    tail, every = Tail(), np.empty(0)
    for size in (3000, 700, 4000, *[2500] * 40):
        norms = rng.rayleigh(size=size) if law == "rayleigh" else rng.integers(1, 40, size=size) / 8.0
        tail.add(norms, -inf)
        every = np.concatenate([every, norms])
        if tail.size > 1500:
            tail.cut(1000)
    assert np.array_equal(tail.settle(1000), np.sort(every)[-1000:])


def test_a_rank_that_was_not_kept_is_drawn_again() -> None:
    whole = simulate(PLAN, trials=20 * BLOCK, seed=2, quantile=0.5)
    short = simulate(PLAN, trials=20 * BLOCK, seed=2)
    assert len(short.of(0).tail) < 0.1 * len(whole.of(0).tail) + BLOCK
    for quantile in (0.6, 0.98, 0.9999):
        assert quantile_estimate(short, 0, "tcp", quantile) == quantile_estimate(whole, 0, "tcp", quantile)
        assert cvar_estimate(short, 0, "tcp", quantile) == cvar_estimate(whole, 0, "tcp", quantile)
    limit = quantile_estimate(whole, 0, "tcp", 0.7).value_mm
    assert exceedance_estimate(short, 0, "tcp", limit) == exceedance_estimate(whole, 0, "tcp", limit)


def test_what_lies_below_the_floor_of_a_part_is_drawn_again() -> None:
    """A part that was cut far above the quantile: what it lacks is not guessed."""
    whole = simulate(PLAN, trials=20 * BLOCK, seed=2)

    def sampler(task: TrialsTask) -> Iterator[Shard]:
        for first in range(task.first, task.stop, BLOCK):
            shard = compute_shard(replace(task, first=first, stop=first + BLOCK))
            if first == 19 * BLOCK:
                tails = [tail[-20:] for tail in shard.tails]
                shard = replace(shard, tails=tails, floors=[float(tail[0]) for tail in tails])
            yield shard

    short = Run(Simulation(PLAN, 2, sampler=sampler)).grow(20 * BLOCK)
    assert quantile_estimate(short, 0, "tcp", 0.95) == quantile_estimate(whole, 0, "tcp", 0.95)
    assert cvar_estimate(short, 0, "tcp", 0.95) == cvar_estimate(whole, 0, "tcp", 0.95)


def test_memory_of_a_long_run_is_that_of_its_tail() -> None:
    """A twentieth of the norms of either error, at most 1.25 of it in parts and once more where they are sorted."""
    block = compute_shard(TrialsTask(PLAN, 1, 0, BLOCK, 0.95, False, (inf, inf)))
    draw = np.random.default_rng(3)
    blocks = 400

    def sampler(_: TrialsTask) -> Iterator[Shard]:
        for _block in range(blocks):
            yield replace(block, tails=tuple(draw.rayleigh(size=(2, BLOCK))), floors=(-inf, -inf))

    tracemalloc.start()
    try:
        samples = Run(Simulation(PLAN, 1, sampler=sampler, threads=1)).grow(blocks * BLOCK)
        quantile_estimate(samples, 0, "tcp", 0.95)
        assert tracemalloc.get_traced_memory()[1] < 2.5 * blocks * BLOCK
    finally:
        tracemalloc.stop()


def test_a_system_without_noise_has_one_norm() -> None:
    samples = simulate(replace(cube8_system(), views=with_noise(0.0)), trials=4 * BLOCK, seed=1)
    found = quantile_estimate(samples, 0, "tcp", 0.95)
    assert found.interval_mm[0] <= found.value_mm <= found.interval_mm[1]

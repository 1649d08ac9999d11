"""Long runs keep the norms near the quantiles that are asked for, and count and sum the others: the same answers."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from fractions import Fraction
from importlib import import_module
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tailstack.montecarlo.estimators
from scenes import cube8_system, with_noise
from tailstack import load_design, verify
from tailstack.montecarlo.estimators import cvar_estimate, exceedance_estimate, interval_ranks, quantile_estimate
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.shards import BLOCK, Shard, TrialsTask, compute_shard
from tailstack.montecarlo.simulate import Run, Simulation, simulate
from tailstack.montecarlo.tails import Tail, sum_exactly, to_float

EXAMPLES = Path(__file__).parents[2] / "examples"
PLAN = compile_plan(cube8_system())
SIMULATE = import_module("tailstack.montecarlo.simulate")  # the package has a function of the name


def draw_nothing_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def deepen(*_: Any) -> None:
        raise AssertionError("a norm that was not kept was asked for")

    monkeypatch.setattr(tailstack.montecarlo.estimators, "deepen", deepen)


@pytest.mark.parametrize("law", ["rayleigh", "pareto", "ties"])
def test_what_is_kept_counted_and_summed_is_all_there_is(law: str) -> None:
    """independent: numpy's order statistics, and sums of fractions, of every norm."""
    rng = np.random.default_rng(5)
    draws: dict[str, Callable[[int], Any]] = {
        "rayleigh": lambda n: rng.rayleigh(size=n),
        "pareto": lambda n: rng.pareto(1.2, size=n),
        "ties": lambda n: rng.integers(1, 40, size=n) / 8.0,
    }
    tail, every, quantiles = Tail(), np.empty(0), (0.5, 0.95, 0.999)
    for size in (3000, 700, 4000, *[2500] * 40):
        norms = draws[law](size)
        tail.add(norms, -inf)
        every = np.concatenate([every, norms])
        tail.thin(len(every), quantiles, 1000)
    kept, every = tail.settle(), np.sort(every)
    assert len(kept) < 0.15 * len(every)
    assert len(tail.gaps) >= 2
    for gap in tail.gaps:
        inside = every[(every > gap.low) & (every < gap.high)]
        assert gap.count == len(inside)
        assert Fraction(gap.total, 1 << 1127) == sum(map(Fraction, inside.tolist()))
        assert gap.largest == (inside[-1] if len(inside) else -inf)
    outside = np.all([(every <= gap.low) | (every >= gap.high) for gap in tail.gaps], axis=0)
    expected = every[outside & (every >= tail.floor)]
    assert set(kept.tolist()) == set(expected.tolist())
    if law != "ties":  # of equal norms at the lower end, some go
        assert np.array_equal(kept, expected)


def test_sums_have_no_rounding() -> None:
    rng = np.random.default_rng(1)
    values = rng.random(3000) * 10.0 ** rng.integers(-300, 300, size=3000)
    values[:3] = 0.0, 5e-324, 2.0**1000
    exact = sum(map(Fraction, values.tolist()))
    assert Fraction(sum_exactly(values), 1 << 1127) == exact
    assert to_float(sum_exactly(values)) == float(exact)


@pytest.mark.parametrize("most", [64, 5000])
def test_a_long_run_answers_as_a_short_one(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Quantiles with their intervals, exceedance, mean beyond, worst: to the last digit, and nothing is drawn again."""
    asked = Simulation(PLAN, 9, 0.9, (0.95, 0.99))
    whole = Run(asked).grow(24 * BLOCK)
    monkeypatch.setattr(SIMULATE, "MOST_KEPT", most)
    draw_nothing_again(monkeypatch)
    run = Run(asked)
    run.grow(3 * BLOCK)
    long = run.grow(24 * BLOCK)
    assert all(sample.gaps for sample in long.errors)
    for error in ("tcp", "localisation"):
        for quantile in (0.9, 0.95, 0.99):
            mine = quantile_estimate(long, 0, error, quantile, 1 - 1e-6)
            assert mine == quantile_estimate(whole, 0, error, quantile, 1 - 1e-6)
            assert cvar_estimate(long, 0, error, quantile).value_mm == cvar_estimate(whole, 0, error, quantile).value_mm
            spreads = [cvar_estimate(of, 0, error, quantile).standard_error_mm for of in (long, whole)]
            assert spreads[0] == pytest.approx(spreads[1], rel=1e-12)
            limit = mine.value_mm * 1.0001
            assert exceedance_estimate(long, 0, error, limit) == exceedance_estimate(whole, 0, error, limit)
        assert long.of(0, error).worst == whole.of(0, error).worst


def test_a_rank_that_was_not_kept_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = simulate(PLAN, trials=20 * BLOCK, seed=2, quantile=0.5)
    monkeypatch.setattr(SIMULATE, "MOST_KEPT", 64)
    long = simulate(PLAN, trials=20 * BLOCK, seed=2)
    for quantile in (0.6, 0.98, 0.9999):
        rank = interval_ranks(20 * BLOCK, quantile, 0.95)[0]
        assert long.of(0).place_of(rank) is None
        assert quantile_estimate(long, 0, "tcp", quantile) == quantile_estimate(whole, 0, "tcp", quantile)
        assert cvar_estimate(long, 0, "tcp", quantile) == cvar_estimate(whole, 0, "tcp", quantile)
    between = quantile_estimate(whole, 0, "tcp", 0.98).value_mm
    assert exceedance_estimate(long, 0, "tcp", between) == exceedance_estimate(whole, 0, "tcp", between)


@pytest.mark.parametrize("name", ["demo", "locators_321"])
def test_a_check_has_the_same_record_however_much_is_kept(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    data = load_design(EXAMPLES / f"{name}.yaml")
    expected = verify(data, precision=0.01, seed=3)
    monkeypatch.setattr(SIMULATE, "MOST_KEPT", 200)
    draw_nothing_again(monkeypatch)
    assert json.dumps(asdict(verify(data, precision=0.01, seed=3))) == json.dumps(asdict(expected))


def test_parts_that_are_short_of_a_gap_leave_it_without_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """A part that was cut far above the quantile: what lies below its floor is drawn again, not guessed."""
    whole = simulate(PLAN, trials=20 * BLOCK, seed=2)
    monkeypatch.setattr(SIMULATE, "MOST_KEPT", 64)

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


def test_memory_of_a_long_run_does_not_grow_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight times the trials: 2.8 times the norms about the quantile, and beside them as much as before."""
    monkeypatch.setattr(SIMULATE, "MOST_KEPT", 2**15, raising=False)
    block = compute_shard(TrialsTask(PLAN, 1, 0, BLOCK, 0.95, False, (inf, inf)))

    def peak(blocks: int) -> int:
        draw = np.random.default_rng(3)

        def sampler(_: TrialsTask) -> Iterator[Shard]:
            for _block in range(blocks):
                yield replace(block, tails=tuple(draw.rayleigh(size=(2, BLOCK))), floors=(-inf, -inf))

        tracemalloc.start()
        try:
            samples = Run(Simulation(PLAN, 1, sampler=sampler, threads=1)).grow(blocks * BLOCK)
            quantile_estimate(samples, 0, "tcp", 0.95)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert peak(800) < 1.3 * peak(100)


def test_a_system_without_noise_has_one_norm(monkeypatch: pytest.MonkeyPatch) -> None:
    """All norms are equal: windows without width, and nothing beyond them."""
    monkeypatch.setattr(SIMULATE, "MOST_KEPT", 64)
    samples = simulate(replace(cube8_system(), views=with_noise(0.0)), trials=4 * BLOCK, seed=1)
    found = quantile_estimate(samples, 0, "tcp", 0.95)
    assert found.interval_mm[0] <= found.value_mm <= found.interval_mm[1]

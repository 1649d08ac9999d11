"""One seed is one answer; moving everything changes nothing; more noise is never less risk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import (
    broken_system,
    cios_system,
    cube8_system,
    random_rigid,
    random_system,
    read_only,
    target,
    with_noise,
)
from tailstack.montecarlo.chain import draw, evaluate, evaluate_plainly
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.simulate import Run, Samples, Simulation, simulate
from tailstack.system import Reading, System, Triangulation

pytestmark = pytest.mark.hostile


def same(a: Samples, b: Samples) -> None:
    for x, y in zip(a.errors, b.errors, strict=True):
        np.testing.assert_array_equal(x.mean, y.mean)
        np.testing.assert_array_equal(x.scatter, y.scatter)
        assert x.mean_norm == y.mean_norm
        np.testing.assert_array_equal(x.tail, y.tail)
    assert a.redone == b.redone
    if a.reprojection_px is not None and b.reprojection_px is not None:
        np.testing.assert_array_equal(a.reprojection_px, b.reprojection_px)


@pytest.mark.parametrize("threads", [2, 3, 8])
def test_threads_reach_no_digit(threads: int) -> None:
    system = random_system(np.random.default_rng(1), 9, targets=2)
    first = simulate(system, trials=50_001, seed=9, threads=1, reprojection=True)
    same(first, simulate(system, trials=50_001, seed=9, threads=threads, reprojection=True))


@pytest.mark.long
def test_threads_reach_no_digit_where_trials_are_redone() -> None:
    first = simulate(broken_system(), trials=20_000, seed=9, threads=1)
    assert first.redone > 1000
    same(first, simulate(broken_system(), trials=20_000, seed=9, threads=2))


def test_a_trial_has_the_same_digits_in_any_company() -> None:
    for system in (cios_system(), broken_system(), cube8_system(views=with_noise(40.0))):
        plan = compile_plan(system)
        z = draw(plan, 1, np.arange(64))
        together = evaluate(plan, z)
        for index in (0, 5, 63):
            np.testing.assert_array_equal(evaluate(plan, z[index : index + 1])[0], together[index])
        order = np.random.default_rng(0).permutation(64)
        np.testing.assert_array_equal(evaluate(plan, z[order]), together[order])


def test_keeping_more_changes_nothing_that_was_kept() -> None:
    few, many = (simulate(cios_system(), trials=40_000, seed=2, keep=keep) for keep in (500, 20_000))
    np.testing.assert_array_equal(few.of(0).tail, many.of(0).tail[-500:])


def test_extending_a_run_is_the_longer_run() -> None:
    plan = compile_plan(cios_system())
    whole = simulate(plan, trials=50_000, seed=5, reprojection=True)
    run = Run(Simulation(plan, 5, reprojection=True))
    run.grow(16384)
    longer = run.grow(50_000)
    for x, y in zip(longer.errors, whole.errors, strict=True):
        np.testing.assert_array_equal(x.scatter, y.scatter)
        top = min(len(x.tail), len(y.tail))
        np.testing.assert_array_equal(x.tail[-top:], y.tail[-top:])
    same(replace(longer, errors=whole.errors), whole)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32),
    st.integers(6, 40),
    st.integers(2, 4),
    st.sampled_from(list(Reading)),
)
def test_any_scene_agrees_with_svd(seed: int, fiducials: int, views: int, reading: Reading) -> None:
    """Independent: full singular value decompositions, on random scenes with every error source at work."""
    system = random_system(np.random.default_rng(seed), fiducials, views, reading=reading)
    plan = compile_plan(system)
    z = draw(plan, 1, np.arange(64))
    exact, _ = evaluate_plainly(plan, z)
    gap = np.linalg.norm(evaluate(plan, z) - exact, axis=-1)
    assert (gap < 1e-9 * np.maximum(np.linalg.norm(exact, axis=-1), 0.1)).all()


def moved(system: System, transform: np.ndarray) -> System:
    """The same scene described in another connector frame."""

    def point(x: np.ndarray) -> np.ndarray:
        return read_only(x @ transform[:3, :3].T + transform[:3, 3])

    back = np.linalg.inv(transform)
    return replace(
        system,
        views=tuple(replace(v, projection=read_only(v.projection @ back)) for v in system.views),
        fiducials_mm=point(system.fiducials_mm),
        targets=tuple(target(point(t.position_mm), t.name) for t in system.targets),
    )


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_moving_everything_turns_the_errors_and_no_more(seed: int) -> None:
    """Noise only: the same deviates give the same errors, turned.  True of the normalised triangulation."""
    rng = np.random.default_rng(seed)
    transform = random_rigid(rng)
    plain, elsewhere = compile_plan(cube8_system()), compile_plan(moved(cube8_system(), transform))
    z = draw(plain, seed, np.arange(32))
    here, there = evaluate(plain, z), evaluate(elsewhere, z)
    np.testing.assert_allclose(there, here @ transform[:3, :3].T, atol=1e-9)


def test_published_triangulation_depends_on_the_origin() -> None:
    published = cube8_system(triangulation=Triangulation.PUBLISHED)
    transform = np.eye(4)
    transform[:3, 3] = (300.0, -200.0, 100.0)
    plans = compile_plan(published), compile_plan(moved(published, transform))
    z = draw(plans[0], 1, np.arange(16))
    gap = np.abs(evaluate(plans[0], z) - evaluate(plans[1], z)).max()
    assert 1e-6 < gap < 1e-2


@pytest.mark.parametrize("seed", [0, 1])
def test_permuting_fiducials_permutes_nothing_else(seed: int) -> None:
    system = cube8_system()
    order = np.random.default_rng(seed).permutation(8)
    shuffled = replace(system, fiducials_mm=read_only(system.fiducials_mm[order]))
    z = draw(compile_plan(system), 3, np.arange(32))
    permuted = z.copy().reshape(32, 2, 9, 2)
    permuted[:, :, :8] = permuted[:, :, order]
    here = evaluate(compile_plan(system), z)
    np.testing.assert_allclose(evaluate(compile_plan(shuffled), permuted.reshape(32, -1)), here, atol=1e-10)

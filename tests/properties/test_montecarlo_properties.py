"""One seed is one answer, a trial the same in any company, the structured chain that of the decompositions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_invariances import moved

from plain_trials import simulate
from scenes import broken_system, cios_system, cube8_system, random_system, with_noise
from tailstack.montecarlo.chain import draw, evaluate, evaluate_plainly
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.simulate import Samples
from tailstack.system import Reading, Triangulation

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


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.integers(0, 2**32), st.integers(6, 40), st.integers(2, 4), st.sampled_from(list(Reading)))
def test_any_scene_agrees_with_svd(seed: int, fiducials: int, views: int, reading: Reading) -> None:
    """Independent: full singular value decompositions, on random scenes with every error source at work."""
    system = random_system(np.random.default_rng(seed), fiducials, views, reading=reading)
    plan = compile_plan(system)
    z = draw(plan, 1, np.arange(64))
    exact, _ = evaluate_plainly(plan, z)
    gap = np.linalg.norm(evaluate(plan, z) - exact, axis=-1)
    assert (gap < 1e-9 * np.maximum(np.linalg.norm(exact, axis=-1), 0.1)).all()


def test_published_triangulation_depends_on_the_origin() -> None:
    published = cube8_system(triangulation=Triangulation.PUBLISHED)
    transform = np.eye(4)
    transform[:3, 3] = (300.0, -200.0, 100.0)
    plans = compile_plan(published), compile_plan(moved(published, transform))
    z = draw(plans[0], 1, np.arange(16))
    gap = np.abs(evaluate(plans[0], z) - evaluate(plans[1], z)).max()
    assert 1e-6 < gap < 1e-2

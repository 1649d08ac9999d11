"""Random numbers: elementary functions against libm, quality of the deviates, independence of streams.

Statistical tests state their error rate: the probability that a perfect generator fails, for a seed fixed once.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from scenes import cios_system, cube8_system, execution, mount, read_only
from tailstack.errors import OutOfRangeError
from tailstack.montecarlo.chain import draw, standard_normals
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.streams import stream_key, tabulate
from tailstack.system import Law

TRIALS = 40_000


@pytest.fixture(scope="module")
def normals() -> np.ndarray:
    return standard_normals(1, 2, TRIALS, 50)


def test_elementary_functions_against_libm() -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0, 1, 4000), 10.0 ** rng.uniform(-15.6, 0, 4000), rng.uniform(-200, 200, 8000)])
    out = np.empty((3, x.size))
    tabulate(np.abs(x), out.reshape(-1))
    assert np.abs(out[0] - np.log(np.abs(x))).max() < 1e-14
    tabulate(x, out.reshape(-1))
    assert np.abs(out[1] - np.sin(x)).max() < 5e-16
    assert np.abs(out[2] - np.cos(x)).max() < 5e-16


def splitmix(state: int) -> tuple[int, int]:
    """Reference SplitMix64 (Steele, Lea and Flood 2014), on Python integers."""
    state = (state + 0x9E3779B97F4A7C15) % 2**64
    z = state
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) % 2**64
    return state, z ^ (z >> 31)


def xoshiro(s: list[int]) -> int:
    """Reference xoshiro256++ (Blackman and Vigna 2021), on Python integers."""

    def rotl(x: int, k: int) -> int:
        return ((x << k) | (x >> (64 - k))) % 2**64

    result = (rotl((s[0] + s[3]) % 2**64, 23) + s[0]) % 2**64
    t = (s[1] << 17) % 2**64
    s[2] ^= s[0]
    s[3] ^= s[1]
    s[1] ^= s[2]
    s[0] ^= s[3]
    s[2] ^= t
    s[3] = rotl(s[3], 45)
    return result


def test_words_are_xoshiro_seeded_by_splitmix() -> None:
    """Independent: both generators on Python integers reproduce the uniforms, bit for bit."""
    system = cube8_system(execution=execution(1.0, Law.UNIFORM))
    plan = compile_plan(system)
    z = draw(plan, 12345, np.array([0, 7, 123456789]))
    for row, index in enumerate((0, 7, 123456789)):
        base = (int(stream_key(12345, 1)) + index * 0x9E3779B97F4A7C15) % 2**64
        _, state = splitmix((base - 0x9E3779B97F4A7C15) % 2**64)
        words = []
        for _ in range(4):
            state, word = splitmix(state)
            words.append(word)
        for _ in range(36):
            xoshiro(words)
        expected = [2 * ((xoshiro(words) >> 12) * 2.0**-52 - 0.5) for _ in range(3)]
        assert z[row, 36:39].tolist() == expected


def test_normals_have_normal_moments(normals: np.ndarray) -> None:
    """2e6 deviates; each of four moments within 5 standard errors: error rate 2.3e-6."""
    x = normals.ravel()
    for power, expected, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs((x**power).mean() - expected) < 5 * np.sqrt(variance / x.size)


def test_normals_pass_kolmogorov_smirnov(normals: np.ndarray) -> None:
    """Whole sample and each column against N(0, 1); smallest of 51 p-values above 1e-6: error rate 5e-5."""
    p = [stats.kstest(normals.ravel()[::4], "norm").pvalue]
    p += [stats.kstest(normals[:, k], "norm").pvalue for k in range(50)]
    assert min(p) > 1e-6


def test_tails_reach_as_far_as_they_should(normals: np.ndarray) -> None:
    """Counts beyond 3, 4 and 4.5 against their Poisson law; error rate 3e-6."""
    x = np.abs(normals.ravel())
    for limit in (3.0, 4.0, 4.5):
        count, mean = int((x > limit).sum()), 2 * x.size * stats.norm.sf(limit)
        assert min(stats.poisson.cdf(count, mean), stats.poisson.sf(count - 1, mean)) > 5e-7


def test_columns_are_uncorrelated(normals: np.ndarray) -> None:
    """1,225 correlations of columns and of their squares, and of neighbours in a pair; error rate 2.5e-4."""
    for values in (normals, normals**2):
        correlation = np.corrcoef(values.T)[np.triu_indices(50, 1)]
        assert np.abs(correlation).max() < stats.norm.isf(5e-8) / np.sqrt(TRIALS)


@pytest.mark.parametrize("lag", [1, 2, 7, 8, 64])
def test_neighbouring_trials_are_independent(normals: np.ndarray, lag: int) -> None:
    """Same column, ``lag`` trials apart, values and squares: error rate 6e-7 each."""
    for values in (normals, normals**2 - 1):
        products = (values[:-lag] * values[lag:]).ravel()
        assert abs(products.mean()) < 5 * products.std() / np.sqrt(products.size)


def test_neighbouring_seeds_and_streams_are_independent(normals: np.ndarray) -> None:
    """Same trials under seed + 1, seed + 2^32 and another stream: error rate 6e-7 each."""
    for other in (
        standard_normals(2, 2, TRIALS, 50),
        standard_normals(1 + 2**32, 2, TRIALS, 50),
        standard_normals(1, 3, TRIALS, 50),
    ):
        products = (normals * other).ravel()
        assert abs(products.mean()) < 5 / np.sqrt(products.size)
        assert not np.isin(normals[:200], other[:200]).any()


def test_uniform_and_triangular_laws() -> None:
    """Kolmogorov-Smirnov of six columns each against the law on [-1, 1]; error rate 1.2e-5."""
    half = (0.01,) * 3 + (0.5,) * 3
    plan = compile_plan(
        cube8_system(
            structure_connector=mount("structure_connector", half_width=half, law=Law.UNIFORM),
            connector_flange=mount("connector_flange", half_width=half, law=Law.TRIANGULAR),
        )
    )
    z = draw(plan, 8, np.arange(TRIALS))
    for block in plan.blocks:
        if block.name in ("structure_connector", "connector_flange"):
            law = stats.uniform(-1, 2) if block.laws[0] is Law.UNIFORM else stats.triang(0.5, -1, 2)
            for k in range(block.start, block.stop):
                assert stats.kstest(z[:, k], law.cdf).pvalue > 1e-6


def test_a_trial_is_its_index() -> None:
    """Drawn alone, in any order, in any company: the same deviates."""
    plan = compile_plan(cios_system(manufacturing_half_width_mm=read_only(np.full((12, 3), 0.02))))
    every = draw(plan, 77, np.arange(100))
    order = np.random.default_rng(0).permutation(100)
    np.testing.assert_array_equal(draw(plan, 77, order), every[order])
    for index in (0, 9, 99):
        np.testing.assert_array_equal(draw(plan, 77, np.array([index]))[0], every[index])


def test_seeds_of_any_size_but_not_negative() -> None:
    plan = compile_plan(cube8_system())
    first = [draw(plan, seed, np.array([0]))[0, 0] for seed in (0, 1, 2**63, 2**64, 2**64 + 1, 2**200)]
    assert len(set(first)) == 6
    with pytest.raises(OutOfRangeError, match="non-negative"):
        draw(plan, -1, np.array([0]))

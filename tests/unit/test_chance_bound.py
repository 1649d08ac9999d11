"""A quantile from a mean square, held against laws that scipy integrates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from laws import linear_law
from tailstack.optimisation.chance_bound import _kites, raise_quantile
from tailstack.optimisation.global_bound import FREQUENCY, spread_directions

NET = spread_directions(FREQUENCY)
ROUND = np.zeros(3), np.eye(3)


def with_uniform(half_width: float) -> float:
    """The P95 of N(0, 1) in space with one uniform displacement."""

    def chance(r: float) -> float:
        within = quad(lambda y: ncx2.cdf(r * r, 3, max(y * y, 1e-300)), 0, half_width)[0]
        return float(within / half_width) - 0.95

    return float(brentq(chance, 2.5, 6.0))


@pytest.mark.parametrize(("variance", "share"), [(0.01, 0.91), (0.1, 0.89), (0.5, 0.79)])
def test_it_is_below_every_law_of_that_mean_square_and_near(variance: float, share: float) -> None:
    """independent: noncentral chi-square laws.  A uniform displacement along one line, and normal ones along three, of
    one mean square; the one is nearly the worst that a fourth moment allows, the others nearly the best."""
    bare = float(np.sqrt(chi2.ppf(0.95, 3)))
    raised = raise_quantile(linear_law(*ROUND), 0.95, bare, lambda weight: float(variance * np.trace(weight)), NET)
    line, space = with_uniform(3 * np.sqrt(variance)), bare * np.sqrt(1 + variance)
    assert bare < raised < min(line, space)
    assert raised - bare > share * (space - bare)


def test_what_is_known_in_part_of_the_law_is_below_all_of_it() -> None:
    """independent: the uniform displacement in the law, or known by its mean square."""
    half_width = 0.6
    column = np.zeros((3, 1))
    column[1] = half_width
    bare = float(np.sqrt(chi2.ppf(0.95, 3)))
    known = raise_quantile(linear_law(*ROUND), 0.95, bare, lambda weight: float(weight[1, 1]) * half_width**2 / 3, NET)
    assert bare < known <= with_uniform(half_width)
    other = 0.05
    both = raise_quantile(linear_law(*ROUND, column), 0.95, known, lambda weight: float(other * np.trace(weight)), NET)
    assert known < both


def test_nothing_known_raises_nothing() -> None:
    assert raise_quantile(linear_law(*ROUND), 0.95, 2.0, lambda weight: 0.0, NET) == 2.0


def test_tangents_cover_every_direction() -> None:
    """sampled, never wrong of kites that cover: each of 2,000 directions, or its opposite, is in the cone of one half
    of a kite, and most lie in that of the direction that is nearest."""
    directions, faces = NET
    owner, corners = _kites(directions, faces)
    drawn = np.random.default_rng(0).normal(size=(2000, 3))
    inside = np.zeros((len(drawn), len(owner)), dtype=bool)
    for second, third in ((1, 3), (2, 3)):
        shares = np.einsum("qij,nj->nqi", np.linalg.inv(np.swapaxes(corners[:, [0, second, third]], 1, 2)), drawn)
        inside |= (shares > -1e-9).all(axis=2) | (shares < 1e-9).all(axis=2)
    assert inside.any(axis=1).all()
    np.testing.assert_allclose(corners[:, 0], directions[owner], rtol=0, atol=1e-15)
    nearest = np.abs(drawn @ directions.T).argmax(axis=1)
    assert np.mean(owner[inside.argmax(axis=1)] == nearest) > 0.9

"""Allocation at a fixed layout: the oracle, known optima, bounds, placement; and process grades at least price."""

from __future__ import annotations

import itertools
import json
from dataclasses import astuple
from functools import partial
from math import exp, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from optimise_scenes import at_prices, fixed_layout, image_covariance_by_score, oracle_problem, solve_placement
from scenes import cube_fiducials
from tailstack import InfeasibleError
from tailstack.optimisation.allocation import (
    allocate,
    frobenius_excess,
    gaussian_bracket,
    squared_bound,
)
from tailstack.optimisation.grades import choose_grades
from tailstack.optimisation.prices import Price, PricedGrade, cost_of, of_grades, reciprocal
from tailstack.optimisation.terms import free_laws, terms_of
from tailstack.system import Law
from tailstack.tail.gaussian import norm_quantile

CASE = json.loads((Path(__file__).parents[1] / "data" / "oracles" / "convex_allocation.json").read_text())
NOISE, GAINS, COST = (np.array(CASE[key]) for key in ("Sigma_noise", "G_rows", "cost_coeff"))
PRICES = [reciprocal(weight) for weight in COST]
UNIFORM = np.full(COST.size, 1 / sqrt(3))
ONE = 3.841458820694124  # 95 % point of chi-square with one degree of freedom


def random_problem(rng, k, targets):
    """noise (t, 3, 3), gains (t, k, 3), prices, std per half-width, limits (t,), lower, upper."""
    root = rng.normal(size=(targets, 3, 3)) * 0.05
    gains = rng.normal(size=(targets, k, 3)) * rng.choice([1.0, 100.0], k)[:, None]
    size = 1 / np.sqrt((gains**2).sum(axis=(0, 2)))
    prices = [
        Price(
            curve := rng.choice(("power", "exponential")).item(),
            rng.uniform(0.5, 5) * (s ** (n := rng.uniform(0.5, 2.5)) if curve == "power" else 1),
            n if curve == "power" else 1.0,
            s * rng.uniform(0.2, 3),
        )
        for s in size
    ]
    per = rng.choice([1 / sqrt(3), 1 / sqrt(6), 0.5], k)
    return root @ np.swapaxes(root, 1, 2), gains, prices, per, rng.uniform(0.6, 2, targets), 0.02 * size, 3 * size


def cost(prices, half_width):
    return sum(cost_of(price, float(h)) for price, h in zip(prices, half_width, strict=True))


@pytest.mark.parametrize("limit", CASE["results"])
def test_oracle_costs(limit):
    """oracle: cvxpy, IPOPT and closed form."""
    expected = CASE["results"][limit]
    found = allocate(NOISE, GAINS, PRICES, UNIFORM, float(limit), lower=0, upper=np.inf)
    assert found.cost == pytest.approx(expected["fro_cost"], rel=CASE["tol_rel_cost"])
    assert found.gap < 1e-8
    covariance = NOISE + (GAINS.T * found.half_width**2 / 3) @ GAINS
    assert norm_quantile(0.95, np.zeros(3), covariance) == pytest.approx(expected["P95_gauss_at_fro"], rel=1e-5)
    assert found.half_width == pytest.approx(expected["fro_tau_rad"], rel=1e-3)


@pytest.mark.parametrize("p", [0.5, 0.8, 0.9, 0.95, 0.99, 0.999])
def test_bounds_over_spectra(p):
    """independent: over a grid of spectra the bound is at least the exact square, and by at most its excess."""
    spectra = [np.array([1.0, a, b]) for a in np.linspace(0, 1, 13) for b in np.linspace(0, a, 7)]
    exact = np.array([norm_quantile(p, np.zeros(3), np.diag(s)) for s in spectra]) ** 2
    covariances = np.array([np.diag(s) for s in spectra])
    ratios = squared_bound(covariances, p) / exact
    assert ratios.min() > 1 - 1e-9
    assert ratios.max() <= frobenius_excess(p)
    if p == 0.95:
        assert ratios.max() > 1.018  # the excess is not larger than it must be


def test_one_tolerance_by_hand():
    """closed form: without noise the law is on a line, and 1.96 standard deviations are the limit."""
    for price in (reciprocal(7.0), Price("power", 2.0, 1.7), Price("exponential", 3.0, scale=0.004)):
        found = allocate(
            np.zeros((3, 3)), np.array([[0, 165.0, 0]]), [price], np.array([0.5]), 2.0, lower=0, upper=np.inf
        )
        expected = 2.0 / (0.5 * 165 * sqrt(ONE))
        assert found.half_width[0] == pytest.approx(expected, rel=1e-7)


def test_known_primal_and_dual():
    """independent: half-widths and multipliers come first, the prices that make them optimal are derived.

    Stationarity: -cost'(h_i) = 2 per_i^2 h_i sum_j lambda_j g_ji' M_j g_ji, M the gradient of the bound, which for a
    half-width at its largest may be exceeded, and at its smallest may be missed.
    """
    rng = np.random.default_rng(11)
    for _ in range(4):
        k, targets = 7, 3
        root = rng.normal(size=(targets, 3, 3)) * 0.05
        noise, gains = root @ np.swapaxes(root, 1, 2), rng.normal(size=(targets, k, 3)) * 50
        per, half_width = rng.choice([1 / sqrt(3), 0.5], k), rng.uniform(0.002, 0.01, k)
        covariance = noise + np.einsum("tia,tib,i->tab", gains, gains, (per * half_width) ** 2)
        # of the bound of P95, as the oracle states it
        squared = np.array([np.trace(s) + (ONE - 1) * np.sqrt((s**2).sum()) for s in covariance])
        multipliers = np.array([rng.uniform(1, 5), rng.uniform(1, 5), 0.0])
        limits = np.sqrt(squared * np.array([1.0, 1.0, 1.3]))  # the third target has room, and no multiplier
        gradient = np.array([np.eye(3) + (ONE - 1) * s / np.linalg.norm(s) for s in covariance])
        charge = 2 * per**2 * half_width * np.einsum("t,tia,tab,tib->i", multipliers, gains, gradient, gains)
        lower, upper = half_width * 0.3, half_width * 3
        upper[0], lower[1] = half_width[0], half_width[1]
        charge[:2] *= [2.0, 0.5]
        prices = []
        for i in range(k):
            h, n = half_width[i], rng.uniform(0.5, 2.5)
            s = h * rng.uniform(0.3, 2)
            power = i % 2 == 0
            weight = charge[i] * h ** (n + 1) / n if power else charge[i] * s * exp(h / s)
            prices.append(Price("power", weight, n) if power else Price("exponential", weight, scale=s))
        found = allocate(noise, gains, prices, per, limits, lower=lower, upper=upper)
        assert found.half_width == pytest.approx(half_width, rel=1e-5)
        assert found.cost == pytest.approx(cost(prices, half_width), rel=1e-9)
        assert 0 <= found.gap < 1e-7  # of the cost that is known to be the least: so is the bound, to that


def test_units_do_not_matter():
    """closed form: mm to m, half-widths to another unit and the cost's unit scale the answer and nothing else."""
    noise, gains, prices, per, limits, lower, upper = random_problem(np.random.default_rng(2), 6, 2)
    metre, unit, money = 1e-3, 1e3, 1e-4
    rescaled = [
        Price(q.curve, money * q.weight * (unit**q.exponent if q.curve == "power" else 1), q.exponent, q.scale * unit)
        for q in prices
    ]
    found = allocate(noise, gains, prices, per, limits, lower=lower, upper=upper)
    other = allocate(
        noise * metre**2, gains * metre / unit, rescaled, per, limits * metre, lower=lower * unit, upper=upper * unit,
    )  # fmt: skip
    assert other.half_width == pytest.approx(found.half_width * unit, rel=1e-6)
    assert other.cost == pytest.approx(found.cost * money, rel=1e-9)


def test_loose_limit_leaves_every_tolerance_at_its_largest():
    """closed form: what the limit does not reach costs least where it is loosest."""
    noise, gains, prices, per, _, lower, upper = random_problem(np.random.default_rng(8), 5, 2)
    found = allocate(noise, gains, prices, per, 1e3, lower=lower, upper=upper)
    assert (found.half_width == upper).all()
    assert found.gap == 0


def test_tolerances_that_no_target_sees_and_fixed_ones():
    """closed form: an unseen tolerance goes to its largest, equal bounds fix one, whose variance is then noise."""
    gains = np.array([[30.0, 0, 0], [0, 20.0, 0], [0, 0, 0], [10.0, 5.0, 0]])
    per = np.full(4, 0.5)
    prices = [reciprocal(), Price("power", 0.01, 2.0), reciprocal(), reciprocal()]
    lower, upper = np.array([0, 0, 0.1, 0.004]), np.array([1, 1, 0.7, 0.004])
    found = allocate(0.01 * np.eye(3), gains, prices, per, 1.0, lower=lower, upper=upper)
    assert found.half_width[2:] == pytest.approx([0.7, 0.004], rel=1e-12)
    noise = 0.01 * np.eye(3) + (0.5 * 0.004) ** 2 * np.outer(gains[3], gains[3])
    rest = allocate(noise, gains[:2], prices[:2], per[:2], 1.0, lower=0, upper=1)
    assert found.half_width[:2] == pytest.approx(rest.half_width, rel=1e-6)
    assert found.cost == pytest.approx(rest.cost + 1 / 0.7 + 1 / 0.004, rel=1e-9)


def test_limit_out_of_reach_is_refused():
    """closed form: noise alone over the limit, and smallest half-widths over it, by the bound of the second target."""
    with pytest.raises(InfeasibleError, match="smallest the bound of P95"):
        allocate(np.eye(3), GAINS, PRICES, UNIFORM, 0.5, lower=0, upper=1)
    noise = np.array([np.zeros((3, 3)), np.diag([0.04, 0, 0])])
    least = sqrt(ONE) * 0.5  # standard deviation sqrt(0.04 + 0.21) mm
    gains = np.array([[[1.0, 0, 0]], [[10.0, 0, 0]]])
    with pytest.raises(InfeasibleError, match=f"is {least:.4g} mm, not below the limit of 0.9 mm"):
        allocate(noise, gains, [reciprocal()], np.ones(1), np.full(2, 0.9), lower=sqrt(0.0021), upper=1)


CURVES = {
    "reciprocal": Price("power", 1.0),
    "reciprocal square": Price("power", 1e-3, 2.0),
    "exponential": Price("exponential", 800.0, scale=float(np.deg2rad(0.1))),
}


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("limit_mm", [0.5, 1.0])
def test_the_exact_optimum_lies_in_the_convex_bracket(name: str, limit_mm: float) -> None:
    """independent: two solvers, two formulations; normal laws and no bias, where the bracket is one."""
    problem = fixed_layout(oracle_problem(8, limit_mm, law=Law.NORMAL), cube_fiducials())
    prices = [CURVES[name]] * 6
    problem = at_prices(problem, *prices)
    noise = image_covariance_by_score(problem, problem.system.fiducials_mm)
    gains = terms_of(problem, problem.demands[0]).free_gain.T
    per = np.array([value for _, value in free_laws(problem)])
    convex = partial(allocate, noise, gains, prices, per, lower=problem.lower, upper=problem.upper)
    limits_mm = np.array([limit_mm])
    low, high = gaussian_bracket(convex, limits_mm, 0.95)
    solution = solve_placement(problem)
    assert low * (1 - 1e-6) <= solution.cost <= high * (1 + 1e-6)
    assert high / low < 1.05  # the bracket says something
    levers = np.linalg.norm(gains, axis=1) > 1  # without one, an exponential cost is flat out to the bound
    np.testing.assert_allclose(solution.choice.half_width[levers], convex(limits_mm).half_width[levers], rtol=0.05)


def random_prices(rng, k, most):
    """Tables whose prices mostly fall with the half-width; some grades are pointless, some prices equal."""
    tables = []
    for _ in range(k):
        widths = np.exp(rng.uniform(-4, -0.7, rng.integers(1, most + 1)))
        prices = np.round(rng.uniform(0.5, 2) / widths * rng.uniform(0.7, 1.3, widths.size), 1)
        tables.append(
            of_grades(tuple(PricedGrade(f"g{j}", *pair) for j, pair in enumerate(zip(widths, prices, strict=True))))
        )
    return tables


def separable(rng, k):
    """Root of a weighted sum of squares over a limit."""
    weight = rng.uniform(0.3, 3, k)
    limit = rng.uniform(0.3, 0.9)
    return lambda h: float(np.sqrt((weight * h**2).sum())) / limit


def not_separable(rng, k):
    """The largest of several monotone functions, with products and steps, as of several targets."""
    weight, limits = rng.uniform(0, 3, (3, k)), rng.uniform(0.4, 1.2, 3)
    pair = rng.integers(0, k, 2)

    def ratio(h):
        sums = np.sqrt(weight @ h**2) + 2 * h[pair[0]] * h[pair[1]] + 0.1 * np.floor(5 * h.max())
        return float((sums / limits).max())

    return ratio


def cheapest(prices, ratio):
    """Over all combinations of all grades, dominated ones included."""
    costs = [
        sum(grade.price for grade in combination)
        for combination in itertools.product(*(price.grades for price in prices))
        if ratio(np.array([grade.half_width for grade in combination])) <= 1
    ]
    return min(costs, default=None)


@pytest.mark.parametrize("make", [separable, not_separable])
def test_brute_force(make):
    """independent: every combination, up to 5 tolerances of up to 5 grades, 60 random problems."""
    feasible = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        k = int(rng.integers(1, 6))
        prices, ratio = random_prices(rng, k, 5), make(rng, k)
        best = cheapest(prices, ratio)
        if best is None:
            with pytest.raises(InfeasibleError, match="times its limit"):
                choose_grades(prices, ratio)
            continue
        feasible += 1
        start = rng.uniform(0, 0.5, k) if seed % 2 else None
        found = choose_grades(prices, ratio, start=start)
        assert found.bound.cost == pytest.approx(best, rel=1e-9)
        assert found.bound.lower_bound == found.bound.cost
        assert found.bound.gap_percent == 0
        assert ratio(found.half_width) <= 1
        chosen = [{g.name: g for g in price.grades}[name] for price, name in zip(prices, found.names, strict=True)]
        assert sum(g.price for g in chosen) == pytest.approx(found.bound.cost, rel=1e-12)
        assert [g.half_width for g in chosen] == found.half_width.tolist()
        for price, grade in zip(prices, chosen, strict=True):  # no grade as cheap and tighter was passed over
            assert not any(g.half_width < grade.half_width and g.price <= grade.price for g in price.grades)
    assert feasible > 25


def test_stopped_early_the_bracket_is_honest():
    """independent: brute force lies between lower bound and cost, however few evaluations there were."""
    unproven = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        prices, ratio = random_prices(rng, 5, 5), not_separable(rng, 5)
        best = cheapest(prices, ratio)
        if best is None:
            continue
        for most in (1, 2, 5, 10, 20, 40):
            calls: list[Any] = []
            found = choose_grades(prices, lambda h, r=ratio, c=calls: c.append(h) or r(h), max_evaluations=most)  # type: ignore[misc]
            _, cost, least, gap, statement = astuple(found.bound)
            assert len(calls) <= most
            assert f"{len(calls)} evaluations" in statement
            assert least <= best * (1 + 1e-9)
            assert best <= cost * (1 + 1e-9)
            assert (gap == 0) == (least == cost)
            assert gap == pytest.approx(100 * (1 - least / cost), abs=1e-9)
            assert ("Stopped" in statement) == (gap > 0)
            assert ratio(found.half_width) <= 1
            unproven += gap > 0
    assert unproven > 10


def test_a_wish_to_stop_is_heard_and_no_assignment_is_evaluated_twice():
    """closed form: one evaluation, that of the tightest grades."""
    rng = np.random.default_rng(0)
    prices, ratio = random_prices(rng, 5, 5), not_separable(rng, 5)
    assert cheapest(prices, ratio) is not None
    assert "1 evaluations" in choose_grades(prices, ratio, stop=lambda: True).bound.statement
    # independent: the calls are recorded; there are fewer of them than combinations.
    rng = np.random.default_rng(6)
    prices, ratio, calls = random_prices(rng, 5, 5), separable(rng, 5), []
    found = choose_grades(prices, lambda h: calls.append(tuple(h)) or ratio(h))
    assert len(set(calls)) == len(calls)
    assert f"({len(calls)} evaluations" in found.bound.statement
    assert len(calls) < np.prod([len(price.grades) for price in prices]) / 4


def test_one_grade_and_grades_that_are_too_loose():
    """closed form: within the limit at the loosest grades nothing is searched; free grades cost nothing."""
    table = of_grades((PricedGrade("fine", 0.1, 3.0), PricedGrade("rough", 0.4, 1.0)))
    found = choose_grades([table] * 3, lambda h: float(h.max()))
    assert (found.names, found.bound.cost, found.bound.gap_percent) == (("rough",) * 3, 3.0, 0.0)
    assert "(2 evaluations" in found.bound.statement
    free = choose_grades([of_grades((PricedGrade("as it comes", 0.1, 0.0),))], lambda h: float(h.max()))
    assert (free.bound.cost, free.bound.lower_bound, free.bound.gap_percent) == (0.0, 0.0, 0.0)
    # closed form: the ratio at the tightest grades is in the message.
    with pytest.raises(InfeasibleError, match=r"is 1\.25 times its limit"):
        choose_grades([table] * 2, lambda h: float(h.sum()) / 0.16)


def test_a_law_that_is_not_monotone_still_gets_a_feasible_answer():
    """independent: where widening may help, the bound means nothing, but the answer was evaluated and passes."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        prices, ratio = random_prices(rng, 4, 5), separable(rng, 4)

        def bumpy(h, r=ratio, seed=seed):
            return r(h) * (1 + 0.05 * np.sin(1e3 * h.sum() + seed))

        if bumpy(np.array([min(g.half_width for g in price.grades) for price in prices])) <= 1:
            assert bumpy(choose_grades(prices, bumpy).half_width) <= 1

"""Process grades at least price: against brute force over every combination, stopped early, with a real quantile."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from tailstack import InfeasibleError
from tailstack.optimisation.grades import choose_grades
from tailstack.optimisation.prices import PricedGrade, of_grades
from tailstack.tail.declared import law_quantile, linear_law


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
        assert found.proven
        assert found.cost == pytest.approx(best, rel=1e-9)
        assert found.lower_bound == found.cost
        assert found.gap_percent == 0
        assert ratio(found.half_width) <= 1
        chosen = [{g.name: g for g in price.grades}[name] for price, name in zip(prices, found.names, strict=True)]
        assert sum(g.price for g in chosen) == pytest.approx(found.cost, rel=1e-12)
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
            assert len(calls) == found.evaluations <= most
            assert found.lower_bound <= best * (1 + 1e-9)
            assert best <= found.cost * (1 + 1e-9)
            assert found.proven == (found.gap_percent == 0) == (found.lower_bound == found.cost)
            assert found.gap_percent == pytest.approx(100 * (1 - found.lower_bound / found.cost), abs=1e-9)
            assert ("Stopped" in found.statement) != found.proven
            assert ratio(found.half_width) <= 1
            unproven += not found.proven
    assert unproven > 10


def test_a_wish_to_stop_is_heard_before_the_next_evaluation():
    """closed form: one evaluation, that of the tightest grades."""
    rng = np.random.default_rng(0)
    prices, ratio = random_prices(rng, 5, 5), not_separable(rng, 5)
    assert cheapest(prices, ratio) is not None
    assert choose_grades(prices, ratio, stop=lambda: True).evaluations == 1


def test_no_assignment_is_evaluated_twice():
    """independent: the calls are recorded; there are fewer of them than combinations."""
    rng = np.random.default_rng(6)
    prices, ratio, calls = random_prices(rng, 5, 5), separable(rng, 5), []
    found = choose_grades(prices, lambda h: calls.append(tuple(h)) or ratio(h))
    assert len(set(calls)) == len(calls) == found.evaluations
    assert len(calls) < np.prod([len(price.grades) for price in prices]) / 4


def test_another_grade_never_costs_more():
    """closed form: more choice; and a grade that is both tighter and cheaper than all is taken."""
    rng = np.random.default_rng(2)
    prices, ratio = random_prices(rng, 4, 4), separable(rng, 4)
    before = choose_grades(prices, ratio).cost
    for i in range(4):
        width, price = rng.uniform(0.02, 0.5), rng.uniform(0.5, 20)
        more = [*prices]
        more[i] = of_grades((*prices[i].grades, PricedGrade("new", width, price)))
        assert choose_grades(more, ratio).cost <= before * (1 + 1e-12)
    gift = [of_grades((*prices[0].grades, PricedGrade("gift", 0.001, 0.01))), *prices[1:]]
    assert choose_grades(gift, ratio).names[0] == "gift"


def test_everything_loosest_and_only_one_grade():
    """closed form: within the limit at the loosest grades nothing is searched; free grades cost nothing."""
    prices = [of_grades((PricedGrade("fine", 0.1, 3.0), PricedGrade("rough", 0.4, 1.0)))] * 3
    found = choose_grades(prices, lambda h: float(h.max()))
    assert (found.names, found.cost, found.proven, found.evaluations) == (("rough",) * 3, 3.0, True, 2)
    free = choose_grades([of_grades((PricedGrade("as it comes", 0.1, 0.0),))], lambda h: float(h.max()))
    assert (free.cost, free.lower_bound, free.gap_percent, free.proven) == (0.0, 0.0, 0.0, True)


def test_tightest_grades_over_the_limit_are_refused():
    """closed form: the ratio at the tightest grades is in the message."""
    prices = [of_grades((PricedGrade("fine", 0.1, 3.0), PricedGrade("rough", 0.4, 1.0)))] * 2
    with pytest.raises(InfeasibleError, match=r"is 1\.25 times its limit"):
        choose_grades(prices, lambda h: float(h.sum()) / 0.16)


def test_a_law_that_is_not_monotone_still_gets_a_feasible_answer():
    """independent: where widening may help, the bound means nothing, but the answer was evaluated and passes."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        prices, ratio = random_prices(rng, 4, 5), separable(rng, 4)

        def bumpy(h, r=ratio, seed=seed):
            return r(h) * (1 + 0.05 * np.sin(1e3 * h.sum() + seed))

        if bumpy(np.array([min(g.half_width for g in price.grades) for price in prices])) <= 1:
            assert bumpy(choose_grades(prices, bumpy).half_width) <= 1


def test_exact_quantile_of_uniform_tolerances():
    """independent: P95 of four uniform columns plus noise, all 256 combinations."""
    rng = np.random.default_rng(3)
    gains = rng.normal(size=(3, 4))
    prices = [
        of_grades(tuple(PricedGrade(f"IT{j}", w, 0.3 * (i + 1) / w) for j, w in enumerate(np.geomspace(0.05, 0.4, 4))))
        for i in range(4)
    ]

    def ratio(h):
        return law_quantile(linear_law(np.zeros(3), 0.003 * np.eye(3), gains * h), 0.95).quantile_mm / 0.4

    found = choose_grades(prices, ratio)
    assert found.proven
    assert found.cost == pytest.approx(cheapest(prices, ratio), rel=1e-12)
    assert len(set(found.names)) > 1

"""What no layout and no half-widths undercut in cost, held against half-widths and layouts that keep the limits."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import minimize

from optimise_documents import document, moving, optimised
from optimise_scenes import BOX_MM, oracle_problem, pivot_in
from plain_data import DEMO
from tailstack import load_design, optimise
from tailstack.design.drawn import DrawnValues
from tailstack.geometry.arrays import Array
from tailstack.laws import SUMS
from tailstack.optimisation import PlacementProblem, cost_bound
from tailstack.optimisation.cost_bound import Allowed, bound_allocation, bound_any_layout, enough_for, take_smallest
from tailstack.optimisation.exact_law import evaluate_demand
from tailstack.optimisation.global_bound import law_with
from tailstack.optimisation.prices import Price, PricedGrade, of_grades, reciprocal
from tailstack.optimisation.problem import FreeHalfWidth, mount_named, present_choice
from tailstack.optimisation.search import prepare_search, search
from tailstack.optimisation.terms import every_terms
from tailstack.results import Relaxation
from tailstack.system import Law
from tailstack.tail.declared import LinearLaw, law_cdf, law_quantile

ROTATIONS = (("structure_connector", "rx"), ("structure_connector", "ry"), ("connector_flange", "rx"))
MIXED = [
    (Law.NORMAL, Law.NORMAL),
    (Law.UNIFORM, Law.UNIFORM),
    (Law.TRIANGULAR, Law.TRIANGULAR),
    (Law.UNIFORM, Law.NORMAL),
]


def priced(laws: tuple[Law, Law], limit_mm: float = 0.8, price: Price | None = None) -> PlacementProblem:
    """Three free rotations at two mounts of these laws, everything else as it is."""
    free = tuple(
        FreeHalfWidth(mount, name, np.deg2rad(0.01), np.deg2rad(0.5), price or reciprocal())
        for mount, name in ROTATIONS
    )
    problem = oracle_problem(8, limit_mm, half_widths=free)
    mounts = [mount_named(problem.system, name) for name in ("structure_connector", "connector_flange")]
    first, second = (
        replace(mount, sources=replace(mount.sources, laws=(law,) * len(mount.sources.laws)))
        for mount, law in zip(mounts, laws, strict=True)
    )
    return replace(problem, system=replace(problem.system, structure_connector=first, connector_flange=second))


def allowed_of(problem: PlacementProblem) -> Allowed:
    return cost_bound._allow(problem, every_terms(problem)[0], present_choice(problem).half_width)


def ratio_of(allowed: Allowed, width: Array) -> float:
    asked = allowed.term.demand.requirement
    law = law_with(allowed.term, width, allowed.images)
    return law_quantile(law, asked.quantile).quantile_mm / asked.limit


@pytest.mark.parametrize("laws", MIXED)
def test_a_tangent_is_above_the_chance_everywhere(laws: tuple[Law, Law]) -> None:
    """independent: the chance by the law itself at 40 half-widths of the box; never wrong of what is above."""
    problem, rng = priced(laws), np.random.default_rng(0)
    allowed = allowed_of(problem)
    asked, low, high = allowed.term.demand.requirement, np.log(problem.lower), np.log(problem.upper)
    touch = np.log(np.deg2rad([0.13, 0.1, 0.12]))
    tangent = cost_bound._touch(allowed, touch)
    for _ in range(40):
        logs = rng.uniform(low, high)
        logs = np.maximum(logs, np.where(allowed.held, touch, low))  # those that are held stand at their least
        chance = law_cdf(law_with(allowed.term, np.exp(logs), allowed.images), asked.limit)
        edges = np.column_stack([logs - rng.uniform(0, 1, 3), logs])  # the two widest differ from cell to cell
        above = tangent.value - float(cost_bound._charge(allowed, tangent, edges)[:, 1].sum())
        assert np.log(max(chance, 1e-300) / asked.quantile) <= above + 1e-6


def test_two_half_widths_bend_as_normal_ones_do_beside_a_third() -> None:
    """independent: of 40 random laws the chance times ``h^n`` of the third is, half-way between two sizes (of it by its
    half-width, of the others by logarithms), at least the mean; never wrong of what is true."""
    rng, laws = np.random.default_rng(2), (Law.UNIFORM, Law.TRIANGULAR)
    for _ in range(40):
        gains, which = rng.standard_normal((3, 3)), rng.integers(0, 2, 3)
        kinds = np.array([SUMS.index(laws[k]) for k in which])
        near, far = (np.append(np.exp(rng.uniform(-2, 0.5, 2)), rng.uniform(0.1, 1.5)) for _ in range(2))
        middle = np.append(np.sqrt(near * far)[:2], (near + far)[2] / 2)
        chances = [
            law_cdf(LinearLaw(np.zeros(3), 0.05 * np.eye(3), gains * width, kinds), 1.0) * width[2] ** (1 + which[2])
            for width in (near, middle, far)
        ]
        assert chances[1] ** 2 >= chances[0] * chances[2] * (1 - 1e-6)


@pytest.mark.parametrize("laws", MIXED)
def test_a_slope_is_known_to_what_is_allowed_for(laws: tuple[Law, Law]) -> None:
    """independent: the chance by the law's own sum, and its slopes by differences over five points."""
    allowed, touch, step = allowed_of(priced(laws)), np.log(np.deg2rad([0.13, 0.1, 0.12])), 0.02
    tangent = cost_bound._touch(allowed, touch)

    def chance(logs: Array) -> float:
        return np.log(law_cdf(law_with(allowed.term, np.exp(logs), allowed.images), 0.8))

    assert tangent.value == pytest.approx(chance(touch) - np.log(0.95), abs=2e-7)
    for side, slope in zip(step * np.eye(3), tangent.slope, strict=True):
        near, far = ((chance(touch + k * side) - chance(touch - k * side)) / (2 * k * step) for k in (1, 2))
        assert slope == pytest.approx((4 * near - far) / 3, abs=1e-6)


@pytest.mark.parametrize(
    ("laws", "price"),
    [
        *((laws, reciprocal()) for laws in MIXED),
        (MIXED[0], Price("exponential", 100.0, scale=2e-3)),
        (MIXED[3], Price("power", 1e-3, 2.0)),
        (MIXED[1], Price("power", 0.01, 1.0)),
    ],
)
def test_no_half_widths_are_cheaper_and_the_cheapest_are_near(laws: tuple[Law, Law], price: Price) -> None:
    """oracle: a local search (SLSQP) of the half-widths that keep the limit; in the last one costs next to nothing."""
    problem = priced(laws, price=price)
    if price.weight == 0.01:
        dear = [replace(free, price=reciprocal()) for free in problem.half_widths[1:]]
        problem = replace(problem, half_widths=(problem.half_widths[0], *dear))
    allowed = allowed_of(problem)
    begin = present_choice(problem).half_width
    bound = bound_allocation(problem, [allowed], begin).cost
    early, is_early = bound_allocation(problem, [allowed], begin, most=4)
    found = minimize(
        lambda logs: np.log(problem.cost(np.exp(logs))),
        np.log(np.deg2rad([0.06, 0.06, 0.06])),
        bounds=np.log([problem.lower, problem.upper]).T,
        constraints={"type": "ineq", "fun": lambda logs: 1 - ratio_of(allowed, np.exp(logs))},
        method="SLSQP",
    )
    assert ratio_of(allowed, np.exp(found.x)) <= 1 + 1e-5
    assert 0.98 * np.exp(found.fun) <= bound <= np.exp(found.fun) * (1 + 1e-5)
    assert early <= bound
    assert is_early or early == bound


def test_grades_are_enumerated_and_a_limit_out_of_reach_is_said() -> None:
    """oracle: all 27 choices of three grades."""
    table = ((0.05, 9), (0.1, 4), (0.2, 1))
    grades = of_grades(tuple(PricedGrade(str(size), np.deg2rad(size), price) for size, price in table))
    problem = priced((Law.UNIFORM, Law.NORMAL), price=grades)
    allowed, begin = allowed_of(problem), present_choice(problem).half_width
    every = [np.array(each) for each in product(*[[grade.half_width for grade in grades.grades]] * 3)]
    least = min(problem.cost(width) for width in every if ratio_of(allowed, width) <= 1)
    assert bound_allocation(problem, [allowed], begin).cost == pytest.approx(least)
    none = bound_any_layout(priced(MIXED[0], 0.01), every_terms(priced(MIXED[0], 0.01)), begin, 5.0, 0.0)
    assert none.lower_bound is None
    assert "keep the limits. Proven." in none.statement


@pytest.mark.parametrize("laws", MIXED)
def test_no_layout_with_half_widths_that_keep_the_limit_is_cheaper(laws: tuple[Law, Law]) -> None:
    """independent: the score's own quantile at random layouts and half-widths, shrunk until the limit is kept."""
    problem, rng = priced(laws), np.random.default_rng(3)
    terms, here = every_terms(problem), present_choice(problem)
    told = bound_any_layout(problem, terms, here.half_width, np.inf, 7.0)
    assert told.gap_percent is None
    kept = 0
    for _ in range(6):
        layout = rng.uniform(BOX_MM[0], BOX_MM[1], here.fiducials_mm.shape)
        choice = replace(here, fiducials_mm=layout, half_width=np.exp(rng.uniform(-7, -6, 3)))
        for _ in range(30):
            if evaluate_demand(problem, terms[0], choice).exact_mm <= problem.requirements[0].limit:
                assert told.lower_bound <= problem.cost(choice.half_width) + 7.0
                kept += 1
                break
            choice = replace(choice, half_width=np.maximum(choice.half_width * 0.9, problem.lower))
    assert kept > 2


def test_a_limit_that_nothing_comes_near_charges_nothing() -> None:
    """closed_form: a chance of 1; the law's own quantile there is beyond what a lattice knows."""
    problem = priced(MIXED[1], 80.0)
    tangent = cost_bound._touch(allowed_of(problem), np.log(problem.lower))
    assert not tangent.slope.any()
    assert tangent.value == pytest.approx(-np.log(0.95), abs=1e-6)


def test_withheld_with_the_reason() -> None:
    problem = priced(MIXED[0])
    free = replace(problem, pivots=(pivot_in("structure_connector", (0, 0, -100), (0, 0, -90)),))
    told = bound_any_layout(free, every_terms(free), present_choice(free).half_width, 5.0, 0.0)
    assert told.lower_bound is None
    assert "No bound: pivots are free" in told.statement
    fits = (np.array([0.01, 0.02]), np.array([0.03, 0.01]))
    drawn = DrawnValues(("a", "b"), np.ones(2), (0.03, 0.04), fits, "H7/g6", {})
    assert not drawn.widens
    changing = replace(problem, half_widths=(replace(problem.half_widths[0], drawn=drawn), *problem.half_widths[1:]))
    told = bound_any_layout(changing, every_terms(problem), present_choice(problem).half_width, 5.0, 0.0)
    assert "No bound: a value of a drawing" in told.statement
    widened = replace(drawn, half_widths=(fits[0], 2 * fits[0]))
    changing = replace(problem, half_widths=(replace(problem.half_widths[0], drawn=widened), *problem.half_widths[1:]))
    told = bound_any_layout(changing, every_terms(problem), present_choice(problem).half_width, 5.0, 0.0)
    assert "several scalars is chosen beside half-widths of any size" in told.statement
    scaled = replace(problem, objective="scaling")
    assert bound_any_layout(scaled, every_terms(scaled), present_choice(scaled).half_width, 5.0, 0.0) is None


def test_a_search_ends_when_it_is_near_enough() -> None:
    """closed_form: at half as much again as the bound the first start will do, and at no more than the bound none."""
    problem = priced(MIXED[0])
    told = bound_any_layout(problem, every_terms(problem), present_choice(problem).half_width, np.inf, 0.0)
    assert enough_for(problem, 0.5) == pytest.approx(1.5 * told.lower_bound)
    found = search(problem, starts=3, enough=enough_for(problem, 0.5))
    assert found.stopped == "near enough to what no layout undercuts after 1 of 3 starts"
    assert found.converged == 1
    assert told.lower_bound <= found.best_objective <= 1.5 * told.lower_bound
    assert search(problem, starts=2, enough=told.lower_bound).stopped == "all 2 starts were solved"
    least = replace(problem, objective="quantile", half_widths=())
    assert 0 < enough_for(least, 0.01) < search(least, starts=2).best_objective * 1.01
    plain, weighed = (prepare_search(least, starts=4, enough=each).starts for each in (-np.inf, 0.0))
    same = [bool(np.array_equal(a.x, b.x)) for a, b in zip(plain, weighed, strict=True)]
    assert same == [True, False, True, False]  # every second one is drawn from the weights of the bound
    assert enough_for(problem, None) == enough_for(replace(problem, objective="scaling"), 0.01) == -np.inf


@pytest.mark.long
def test_the_demo_is_near_the_cheapest_of_all() -> None:
    """oracle: the optimiser as the adversary."""
    told = optimise(load_design(DEMO)).certificate.cheapest
    assert 0 <= told.gap_percent < 3


def test_of_several_kinds_of_design_the_smallest_bound_counts() -> None:
    """closed_form: what no layout keeps is dearer than all; where one kind has no bound, all have none."""
    kinds = {
        name: Relaxation(kind, 12.0, least, None, f"{name}.")
        for name, kind, least in (("of two", "any layout", 10.0), ("of three", "any layout", 8.0))
    }
    found = take_smallest(kinds, 12.0, "of two or three")
    assert (found.lower_bound, found.gap_percent) == (8.0, pytest.approx(50.0))
    assert "that of three: of three." in found.statement
    never = {"of four": Relaxation("any layout", 12.0, None, None, "None.")}
    assert take_smallest(kinds | never, 12.0, "of any").lower_bound == 8.0
    assert "keeps the limits" in take_smallest(never, 12.0, "of four").statement
    for unknown in (None, Relaxation("none", 12.0, None, None, "No bound: pivots are free.")):
        told = take_smallest(kinds | {"of five": unknown}, 12.0, "of any")
        assert (told.kind, told.lower_bound) == ("none", None)
        assert "of five" in told.statement


@pytest.mark.long
def test_of_any_number_of_fiducials_the_smallest_bound_counts() -> None:
    """oracle: plain optima of each number, as the adversary; what each fiducial costs is in it."""
    each = 60.0
    count = {"min": 6, "max": 8, "cost_per_fiducial": each}
    found = optimised(document(8, limit_mm=0.6, **moving(count=count))).certificate.cheapest
    assert "of 6 to 8 fiducials" in found.statement
    for number in (6, 7, 8):
        assert found.lower_bound <= optimised(document(number, limit_mm=0.6, **moving())).cost_after + each * number

"""A lower bound over every layout, held against layouts: random, optimised, enumerated; and what must break it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from scipy.stats import ncx2
from test_aimed_bound import covariance_at, told_by

from optimise_scenes import BOX_MM, pivot_in, places_in_box, requirement
from plain_data import DEMO, replaced
from scenes import (
    every_effect,
    mount,
    random_system,
    read_only,
    system_of,
    with_effects,
    with_noise,
    with_unseen,
)
from tailstack import load_design
from tailstack.effects.temperature import temperature
from tailstack.errors import IllPosedError
from tailstack.estimation.checks import check_geometry
from tailstack.geometry.arrays import Array
from tailstack.geometry.mesh import Mesh
from tailstack.optimisation import PlacementProblem, global_bound
from tailstack.optimisation.cost_bound import bound_layouts
from tailstack.optimisation.exact_law import evaluate_demand
from tailstack.optimisation.exchanging import mean_square
from tailstack.optimisation.global_bound import (
    AS_THEY_LOOK,
    Cells,
    Information,
    NoBound,
    QuantileBound,
    bound_quantile,
    cells_in,
    cells_of,
    certify_layout,
    choose_unknowns,
    find_net,
    fit_below,
    information_of,
    least_mean_square,
    least_quantile,
    left_out,
    most_known,
    net_of,
    parts_of,
    spread_directions,
    sure_quantile,
)
from tailstack.optimisation.problem import Choice, Survival, apply_choice, present_choice
from tailstack.optimisation.regions import Ball, BoxRegion, Cylinder, Isometry, Shape, bounding_box, sample
from tailstack.optimisation.search import explore, prepare_search, search, solve_start
from tailstack.optimisation.starts import _exchange_model
from tailstack.optimisation.surface import NearSurface
from tailstack.optimisation.terms import DemandTerms, every_terms
from tailstack.system import Estimator, Law, Sources, Triangulation
from tailstack.tail.declared import SAMPLED_METHOD, LinearLaw, law_quantile

SMALL_MM = np.array([[-20.0, -20.0, -40.0], [20.0, 20.0, 0.0]])
EVERY = [(estimator, form) for estimator in Estimator for form in Triangulation]
# Each estimator and each form twice or more; the others are beside them
HALF = [
    pytest.param(*each, marks=pytest.mark.long if (k + k // len(Triangulation)) % 2 else [])
    for k, each in enumerate(EVERY)
]


def navigation(
    fiducials: int = 8, box_mm: Array = BOX_MM, spacing_mm: float = 12.0, **changes: Any
) -> PlacementProblem:
    """Nothing but the images makes the error; all fiducials are free in one box."""
    layout = np.random.default_rng(7).uniform(box_mm[0], box_mm[1], (fiducials, 3))
    return PlacementProblem(
        system=system_of(layout, **changes),
        requirements=(requirement(0.5),),
        places=places_in_box(range(fiducials), box_mm),
        objective="quantile",
        min_spacing_mm=spacing_mm,
    )


def first_term(problem: PlacementProblem) -> DemandTerms:
    return every_terms(problem)[0]


def bound_of(problem: PlacementProblem) -> QuantileBound:
    term = first_term(problem)
    global_bound.net_about.cache_clear()  # some tests change what a net is made of
    return bound_quantile(AS_THEY_LOOK.bound_images(problem, term, np.zeros(0)), problem, term, np.zeros(0))


def layouts(problem: PlacementProblem, rng: np.random.Generator, count: int) -> list[Array]:
    """Random layouts that keep the spacing, half of them with fiducials on faces and in corners of their boxes."""
    found: list[Array] = []
    while len(found) < count:
        drawn = problem.system.fiducials_mm.copy()
        for place in problem.places:
            assert isinstance(place.region, BoxRegion)
            for _ in range(200):
                drawn[place.fiducials[0]] = rng.uniform(place.region.low_mm, place.region.high_mm)
                if len(found) % 2:
                    face = rng.integers(0, 3, 3)
                    edge = np.where(face == 1, place.region.low_mm, place.region.high_mm)
                    drawn[place.fiducials[0]] = np.where(face > 0, edge, drawn[place.fiducials[0]])
                before = drawn[: place.fiducials[0]]
                if not len(before) or np.linalg.norm(before - drawn[place.fiducials[0]], axis=1).min() > 12.1:
                    break
        apart = np.linalg.norm(drawn[:, None] - drawn, axis=2)[np.triu_indices(len(drawn), 1)].min()
        if apart >= problem.min_spacing_mm:
            found.append(drawn)
    return found


def quantile_at(problem: PlacementProblem, layout: Array) -> float:
    choice = replace(present_choice(problem), fiducials_mm=layout)
    return evaluate_demand(problem, first_term(problem), choice).exact_mm


def assert_below_every(problem: PlacementProblem, least: Array, each: list[Array]) -> None:
    for layout in each:
        # A layout that determines no estimate (all but one in a plane, of a pose with nothing known before) has none
        with suppress(IllPosedError, np.linalg.LinAlgError):
            check_geometry(apply_choice(problem, replace(present_choice(problem), fiducials_mm=layout)))
            covariance = covariance_at(problem, layout)
            assert np.linalg.eigvalsh(covariance - least)[0] >= -1e-12


@pytest.mark.parametrize(("estimator", "form"), HALF)
def test_no_layout_has_a_covariance_below_it(estimator: Estimator, form: Triangulation) -> None:
    """independent: Gauss and Markov against the gains that the score runs, normal manufacturing errors included."""
    made = read_only(np.full((8, 3), 0.05))
    problem = navigation(
        estimator=estimator, triangulation=form, manufacturing_half_width_mm=made, manufacturing_law=Law.NORMAL
    )
    least = fit_below(find_net(information_of(problem, first_term(problem))), np.eye(3))
    assert_below_every(problem, least, layouts(problem, np.random.default_rng(1), 20))


@pytest.mark.long
@pytest.mark.hostile
@pytest.mark.parametrize(("estimator", "form"), EVERY)
def test_nor_has_any_of_ten_thousand(estimator: Estimator, form: Triangulation, run_seed: int) -> None:
    """sampled: 625 layouts of each of 16 kinds; never wrong of a true bound."""
    rng = np.random.default_rng(run_seed)
    for box in (BOX_MM, SMALL_MM * 2):
        problem = navigation(int(rng.integers(6, 13)), box, estimator=estimator, triangulation=form)
        least = fit_below(find_net(information_of(problem, first_term(problem))), np.eye(3))
        assert_below_every(problem, least, layouts(problem, rng, 313))


@pytest.mark.parametrize(
    ("estimator", "box", "gap"),
    [
        (Estimator.DLT, BOX_MM, 0.16),
        (Estimator.POSE, BOX_MM, 0.05),
        pytest.param(Estimator.DLT, SMALL_MM, 0.25, marks=pytest.mark.long),
        pytest.param(Estimator.REPROJECTION, BOX_MM, 0.16, marks=pytest.mark.long),
        pytest.param(Estimator.POSE_WITH_PRIOR, BOX_MM, 0.25, marks=pytest.mark.long),
    ],
)
def test_the_best_layout_found_is_above_it_and_not_far(estimator: Estimator, box: Array, gap: float) -> None:
    """oracle: the optimiser itself, from eight starts, as the adversary."""
    problem = navigation(8, box, estimator=estimator, triangulation=Triangulation.WEIGHTED)
    bound = bound_of(problem).value_mm
    found = search(problem, starts=8)
    for optimum in found.iterates:
        reached = quantile_at(problem, found.program.split(optimum.point.x).fiducials_mm)
        assert bound <= reached
    assert reached <= (1 + gap) * bound


ASKED: list[dict[str, Any]] = [
    {"quantile": 0.95},
    {"quantile": 0.55},
    {"statistic": "mean"},
    {"statistic": "cvar", "quantile": 0.9},
    {"statistic": "max_of_n", "n": 10, "quantile": 0.95 ** (1 / 10)},
    {"risk": "per_unit"},
    {"risk": "per_mounting", "quantile": 0.8, "min_yield": 0.6},
]


@pytest.mark.parametrize("asked", ASKED, ids=lambda asked: "-".join(map(str, asked.values())))
def test_every_source_and_every_bias_at_once(asked: dict[str, Any]) -> None:
    """independent: the exact declared law of whole designs, laws mixed, biases of the size of the errors; of units the
    sampled value, with five standard errors: one in a million is wrong."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        system = every_effect(rng) if seed % 2 else random_system(rng, fiducials=7, views=2 + seed // 2)
        problem = PlacementProblem(
            system=system,
            requirements=(requirement(5.0, **asked, targets=("t0",)),),
            places=places_in_box((0, 2, 5), np.array([[-60.0] * 3, [50.0] * 3])),
        )
        bound = bound_of(problem).value_mm
        assert left_out(problem, first_term(problem))
        for layout in layouts(problem, rng, 6):
            choice = replace(present_choice(problem), fiducials_mm=layout)
            found = evaluate_demand(problem, first_term(problem), choice)
            sampled = found.relative_error if "risk" in asked else 0.0
            assert bound <= found.exact_mm * (1 + 5 * sampled)


def test_of_each_unit_it_is_what_units_and_shots_add_up_to() -> None:
    """closed_form: units that shift along x alone, uniformly, and round normal shots: the noncentral chi-square whose
    centre is where 95 % of units are nearer."""
    seat = mount("structure_connector", half_width=[0, 0, 0, 0.3, 0, 0], law=Law.UNIFORM)
    problem = navigation(6, structure_connector=seat)
    problem = replace(problem, requirements=(requirement(0.5, risk="per_unit", quantile=0.9, min_yield=0.95),))
    term, round_mm2 = first_term(problem), 0.02
    told = global_bound._bound_units(term, np.zeros(0), round_mm2 * np.eye(3), moved=False)
    expected = np.sqrt(round_mm2 * ncx2.ppf(0.9, 3, (0.95 * 0.3) ** 2 / round_mm2))
    assert told.value_mm == pytest.approx(expected, rel=1e-6)
    shots_alone = global_bound._bound_units(term, np.zeros(0), np.diag([1.0, 1e-6, 1e-6]), moved=False)
    assert shots_alone.value_mm == pytest.approx(1.6449, rel=1e-4)  # of |N(0, 1)|


def test_a_law_that_has_to_be_sampled_has_the_quantile_of_its_longest_component() -> None:
    """sampled: 400,000 draws; four standard errors: one in ten thousand is wrong."""
    columns = np.array([[1.0, 0.2, 0.1], [0.0, 0.5, 0.1], [0.0, 0.0, 0.3]])
    law = LinearLaw(np.zeros(3), np.zeros((3, 3)), columns, np.zeros(3, dtype=np.int64))
    assert law_quantile(law, 0.95).method == SAMPLED_METHOD
    drawn = np.random.default_rng(0).uniform(-1, 1, (400_000, 3)) @ columns.T
    longest = np.abs(drawn @ np.linalg.eigh(law.total_covariance)[1][:, 2])
    found = least_quantile(law, 0.95)
    with pytest.raises(NoBound):
        sure_quantile(law, 0.95)
    assert found < np.quantile(np.linalg.norm(drawn, axis=1), 0.95)
    below = (longest <= found).mean()
    assert abs(below - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 400_000)


def test_what_temperature_does_at_the_flange_may_undo_what_it_does_in_the_images() -> None:
    """closed_form: kept there and bounded in the images, layouts would undercut the "bound"; so it is dropped whole."""
    kelvin = Sources(("difference",), (Law.NORMAL,), read_only([20.0]), np.ones(1), ("K",), read_only(np.eye(1)))
    bare = navigation()
    still = read_only([0.0, 0.0, -95.0])
    warm = [
        replace(bare, system=with_effects(bare.system, temperature(0.0, kelvin, (46e-6, each), (still, far))))
        for each, far in ((0.0, still), (46e-6, read_only([0.0, 0.0, 70.0])))
    ]
    layout = layouts(bare, np.random.default_rng(0), 1)[0]
    values = [quantile_at(problem, layout) for problem in (bare, *warm)]
    assert values[2] < 0.95 * values[1]  # what the connector grows by takes part of the other away
    assert len({bound_of(problem).value_mm for problem in (bare, *warm)}) == 1
    assert left_out(warm[1], first_term(warm[1])) == ("temperature",)


def on_a_seat(law: Law, bias_mm: float) -> PlacementProblem:
    half_width = [np.deg2rad(0.05)] * 3 + [0.02] * 3
    bias = (0.0, 0.0, 0.0, bias_mm, 0.0, 0.0)
    seat = mount("structure_connector", (0.0, 0.0, -95.0), bias=bias, half_width=half_width, law=law)
    return navigation(6, structure_connector=seat)


@cache
def bound_without_bias(law: Law) -> float:
    return bound_of(on_a_seat(law, 0.0)).value_mm


@pytest.mark.parametrize("law", [Law.NORMAL, Law.UNIFORM])
@pytest.mark.parametrize("size", [0.5, 1.0, 3.0])
def test_a_bias_that_no_layout_moves_is_kept(law: Law, size: float) -> None:
    """closed_form: under normal laws at the same level, otherwise at P94.87, where that is more than what images add
    beyond L (all but the smallest here), and elsewhere nothing is changed by it; never above what layouts have."""
    biased = on_a_seat(law, 0.1 * size)
    bound = bound_of(biased)
    assert ("P94.87" in bound.bias_in_words) == (law is Law.UNIFORM and size > 0.5)
    assert ("without" in bound.bias_in_words) == (size == 0.5)
    if size == 0.5:
        assert bound.value_mm == pytest.approx(bound_without_bias(law), rel=1e-3)
    else:
        assert bound.value_mm > bound_without_bias(law)
    each = layouts(biased, np.random.default_rng(3), 10)
    assert all(bound.value_mm <= quantile_at(biased, layout) for layout in each)


def test_without_the_images_of_the_target_it_is_false(monkeypatch: pytest.MonkeyPatch) -> None:
    """closed_form: sixty beads know where the target is better than its own images tell; what these tell cannot be
    taken for nothing, or layouts undercut the "bound"."""
    problem = navigation(60, spacing_mm=0.0)
    information = information_of(problem, first_term(problem))
    true = fit_below(find_net(information), np.eye(3))
    monkeypatch.setattr(global_bound, "known_from_target", lambda information, z: np.zeros(len(z)))
    false = fit_below(find_net(information), np.eye(3))
    layout = layouts(problem, np.random.default_rng(0), 1)[0]
    covariance = covariance_at(problem, layout)
    assert np.linalg.eigvalsh(covariance - true)[0] >= 0 > np.linalg.eigvalsh(covariance - false)[0]


def pieces(problem: PlacementProblem) -> tuple[Information, tuple[Cells, ...]]:
    information = information_of(problem, first_term(problem))
    return information, tuple(cells_of(information, beads) for beads in information.beads)


@pytest.mark.parametrize("estimator", [Estimator.DLT, Estimator.POSE])
def test_what_a_cell_can_tell_is_enclosed(estimator: Estimator) -> None:
    """independent: slopes of images by differences of projections, at points drawn in each cell."""
    problem = navigation(6, SMALL_MM, estimator=estimator)
    information, (cells,) = pieces(problem)
    rng = np.random.default_rng(0)
    z = rng.normal(size=(3, information.unknowns))
    one = cells._replace(beads=cells.beads._replace(number=1))
    bound = most_known(information, (one,), z) - global_bound.known_from_target(information, z)
    centres, half = cells.centres, cells.half
    away = [centres[rng.integers(len(centres))] + half * rng.choice([-1, 1, 0.3], 3) for _ in range(400)]
    points = SMALL_MM.mean(axis=0) + np.array(away)
    found = np.array([told_by(information, 0, points, each[None], np.eye(4)).max() for each in z])
    assert (found <= bound * (1 + 1e-6)).all()
    assert (bound <= 1.1 * found).all()


def test_the_net_covers_every_direction() -> None:
    """sampled, never wrong of a net that covers: each of 2,000 directions lies in a cone of a triangle or its
    opposite."""
    points, faces = spread_directions(5)
    signed = np.concatenate([points, -points])
    drawn = np.random.default_rng(0).normal(size=(2000, 3))
    shares = np.einsum("fij,nj->nfi", np.linalg.inv(np.swapaxes(signed[faces], 1, 2)), drawn)
    assert (((shares > -1e-9).all(axis=2)) | ((shares < 1e-9).all(axis=2))).any(axis=1).all()
    assert len(points) == 2 * 25 + 1
    assert len(faces) == 4 * 25


def test_a_second_solver_finds_the_same_covariance() -> None:
    """oracle: the semidefinite programme by cvxpy."""
    net = find_net(information_of(navigation(6), first_term(navigation(6))))
    for weight in (np.eye(3), np.diag([1.0, 0.2, 0.05])):
        least = cp.Variable((3, 3), PSD=True)
        unit = np.trace(net.metric)
        rows = [unit * plane @ least @ plane <= 1 for plane in net.planes]
        best = unit * cp.Problem(cp.Maximize(cp.trace(weight @ least)), rows).solve(solver=cp.CLARABEL)
        own = fit_below(net, weight)
        assert np.trace(weight @ own) == pytest.approx(best, rel=1e-3)
        assert np.einsum("fa,ab,fb->f", net.planes, own, net.planes).max() <= 1
        assert np.linalg.eigvalsh(own)[0] > 0


def test_a_second_solver_knows_as_much_along_a_direction() -> None:
    """oracle: the mixture of layouts that knows most, as one linear matrix inequality in its weights (cvxpy)."""
    problem = navigation(6, SMALL_MM, spacing_mm=30.0, estimator=Estimator.POSE)
    information, (cells,) = pieces(problem)
    direction = np.array([0.3, -0.5, 0.8])
    base = global_bound.target_information(information)
    weights, known = cp.Variable(len(cells.slopes), nonneg=True), cp.Variable()
    # The target moves along the direction alone, everything else is free: t is most with G - t e e' still positive.
    along = np.zeros((information.unknowns, information.unknowns - 2))
    along[:3, 0], along[3:, 1:] = direction, np.eye(information.unknowns - 3)
    scale = np.diag(np.diag(along.T @ (base + cells.evenly) @ along) ** -0.5)
    rows = cells.slopes @ along @ scale
    told = sum(weights[i] * (own.T @ own) for i, own in enumerate(rows))
    corner = np.diag(np.eye(len(scale))[0])
    kept = scale @ along.T @ base @ along @ scale + told - known * corner
    cp.Problem(cp.Maximize(known), [cp.sum(weights) <= 6, weights <= 1, kept >> 0]).solve(solver=cp.CLARABEL)
    best = float(known.value) / scale[0, 0] ** 2
    z = choose_unknowns(parts_of(information, (cells,)), direction[None])
    own = float(z[0] @ base @ z[0] + cells.most(((cells.slopes @ z.T) ** 2).sum(axis=1))[0])
    assert best * (1 - 1e-6) <= own <= 1.03 * best
    assert most_known(information, (cells,), z)[0] >= own


def test_a_second_solver_finds_the_same_mean_square() -> None:
    """oracle: the mixture of layouts with the least ``trace(W S)``, a matrix-fractional programme (cvxpy)."""
    problem = navigation(6, SMALL_MM, spacing_mm=30.0, estimator=Estimator.POSE)
    information, (cells,) = pieces(problem)
    weight = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, -0.2], [0.0, -0.2, 0.5]])
    root = np.linalg.cholesky(weight)
    base = global_bound.target_information(information)
    scale = np.diag(np.diag(base + cells.evenly) ** -0.5)
    weights = cp.Variable(len(cells.slopes), nonneg=True)
    told = sum(weights[i] * scale @ own.T @ own @ scale for i, own in enumerate(cells.slopes))
    aims = scale[:, :3] @ root
    least = cp.matrix_frac(aims, scale @ base @ scale + told)
    best = cp.Problem(cp.Minimize(least), [cp.sum(weights) <= 6, weights <= 1]).solve(solver=cp.CLARABEL)
    points = (shrunk_outwards(cells),)  # only the choice of unknowns is judged
    assert 0.98 * best <= least_mean_square(information, points, weight) <= best * (1 + 1e-6)
    assert least_mean_square(information, (cells,), weight) < best


def shrunk_outwards(cells: Cells) -> Cells:
    """Of no size, at the corners that their slopes are those of."""
    return cells._replace(centres=cells.centres + cells.half * np.sign(cells.centres), half=cells.half * 0.0)


@pytest.mark.parametrize("estimator", [Estimator.DLT, Estimator.POSE])
def test_no_layout_has_a_mean_square_below_it_and_the_best_is_near(estimator: Estimator) -> None:
    """oracle: random layouts, and the best that the optimiser finds, uniform manufacturing errors counted."""
    made = read_only(np.full((8, 3), 0.05))
    problem = navigation(estimator=estimator, manufacturing_half_width_mm=made, manufacturing_law=Law.UNIFORM)
    found = search(problem, starts=4)
    best = found.program.split(found.iterates[0].point.x).fiducials_mm
    for layout in [*layouts(problem, np.random.default_rng(1), 3), best]:
        choice = replace(present_choice(problem), fiducials_mm=layout)
        gap = certify_layout(problem, every_terms(problem), choice).images_gap_percent
        assert gap >= 0
    assert gap < 5


def test_all_layouts_of_a_grid() -> None:
    """oracle: every choice of five of twelve sites in the box, 792 layouts."""
    problem = navigation(5, SMALL_MM, estimator=Estimator.POSE)
    least = fit_below(find_net(information_of(problem, first_term(problem))), np.eye(3))
    assert_below_every(problem, least, [np.array(each) for each in combinations(sites_apart(12), 5)])


def sites_apart(count: int) -> list[Array]:
    """In the small box, 12 mm or more from one another."""
    kept: list[Array] = []
    for site in np.random.default_rng(5).uniform(SMALL_MM[0], SMALL_MM[1], (20_000, 3)):
        if len(kept) < count and all(np.linalg.norm(other - site) >= 12 for other in kept):
            kept.append(site)
    assert len(kept) == count
    return kept


@pytest.mark.long
@pytest.mark.parametrize("estimator", [Estimator.DLT, Estimator.POSE])
def test_all_layouts_of_a_larger_grid(estimator: Estimator) -> None:
    """oracle: every choice of six of twenty sites, 38,760 layouts, by the gains that the score runs: the mean square of
    each is at least the trace of L, and the covariances of the best 200 are at least L."""
    problem = replace(navigation(6, SMALL_MM, estimator=estimator), objective="quantile")
    sites = sites_apart(20)
    term = first_term(problem)
    least = fit_below(find_net(information_of(problem, term)), np.eye(3))
    model = _exchange_model(problem, (term,))._replace(std=problem.estimation.std)
    every = [np.array(each) for each in combinations(sites, 6)]
    squares = np.array([mean_square(model._replace(imaging=model.imaging._replace(points=layout))) for layout in every])
    assert len(every) == 38_760
    best = np.argsort(squares)[:200]
    assert np.trace(covariance_at(problem, every[best[0]])) == pytest.approx(squares[best[0]], rel=1e-9)
    assert np.trace(least) <= squares.min()
    information = information_of(problem, term)
    assert np.trace(least) < least_mean_square(information, cells_in(information), np.eye(3)) <= squares.min()
    assert_below_every(problem, least, [every[k] for k in best])


@pytest.mark.long
@pytest.mark.parametrize("form", [Triangulation.WEIGHTED, Triangulation.REPROJECTION])
@pytest.mark.parametrize("estimator", list(Estimator))
def test_no_optimised_layout_is_below_it(estimator: Estimator, form: Triangulation) -> None:
    """oracle: the optimiser as the adversary, from 100 layouts of its own, and from 64 in the cells that know most.
    Weights by the noise are the best of the linear forms, and the bound does not know which of them it is of."""
    problem = navigation(8, estimator=estimator, triangulation=form)
    information, (cells,) = pieces(problem)
    least = fit_below(find_net(information), np.eye(3))
    bound = bound_of(problem).value_mm
    prepared = prepare_search(problem, starts=100)
    ends = [solve_start(prepared, start) for start in prepared.starts]
    found = [prepared.program.split(point.x).fiducials_mm for point in ends if point.solved]
    assert len(found) >= 80
    directions = np.random.default_rng(0).normal(size=(64, 3))
    z = choose_unknowns(parts_of(information, (cells,)), directions)
    told = ((cells.slopes @ z.T) ** 2).sum(axis=1)
    support = [BOX_MM.mean(axis=0) + cells.centres[np.argsort(-own)[:8]] for own in told.T]
    from_support = explore(prepared.program, prepared.terms, support)
    found += [prepared.program.split(item.point.x).fiducials_mm for item in from_support.iterates]
    assert_below_every(problem, least, found)
    assert all(bound <= quantile_at(problem, layout) for layout in found)


def test_beads_that_one_view_sees_fixed_beads_copies_and_tubes() -> None:
    """sampled, never wrong of a true bound: types of beads, a symmetry, and a region that its box is wider than."""
    tube = Cylinder(np.array([0.0, 0.0, -60.0]), np.array([0.0, 0.0, 1.0]), 50.0, 40.0, 38.0)
    system = with_unseen(with_unseen(navigation(9).system, 0, ("F1",)), 1, ("F2",))
    turn = np.diag([-1.0, -1.0, 1.0])
    places = [replace(place, region=tube) for place in places_in_box((0, 1, 2))]
    places = [*places[:2], replace(places[2], fiducials=(2, 3))]
    problem = replace(
        navigation(9), system=system, places=tuple(places), symmetry=(Isometry(turn, np.zeros(3)),), min_spacing_mm=0.0
    )
    net = find_net(information_of(problem, first_term(problem)))
    least, rng = fit_below(net, np.eye(3)), np.random.default_rng(2)
    each = []
    for _ in range(40):
        layout, around = system.fiducials_mm.copy(), rng.uniform(0, 2 * np.pi, 3)
        radius = rng.choice([38.0, 40.0], 3)
        layout[:3] = np.column_stack([radius * np.cos(around), radius * np.sin(around), rng.uniform(-60, -10, 3)])
        layout[3] = turn @ layout[2]
        each.append(layout)
    assert_below_every(problem, least, each)
    boxed = replace(problem, places=tuple(replace(p, region=BoxRegion(*BOX_MM)) for p in places))
    assert np.trace(least) > np.trace(fit_below(find_net(information_of(boxed, first_term(boxed))), np.eye(3)))


def test_manufacturing_that_is_not_normal_counts_by_its_mean_square() -> None:
    """sampled, never wrong of a true bound: where they are larger than noise.  Errors of believed intrinsics are left
    out: of a pose with them there is what there is without."""
    made = read_only(np.full((8, 3), 0.1))
    uniform = navigation(views=with_noise(0.02), manufacturing_half_width_mm=made, manufacturing_law=Law.UNIFORM)
    without = navigation(views=with_noise(0.02))
    bound = bound_of(uniform)
    assert bound_of(without).value_mm < bound.value_mm
    assert bound.counts_made
    each = layouts(uniform, np.random.default_rng(4), 40)
    assert all(bound.value_mm <= quantile_at(uniform, layout) for layout in each)
    assert left_out(uniform, first_term(uniform)) == ("fiducial manufacturing",)
    assert left_out(uniform, first_term(uniform), counts_made=True) == left_out(without, first_term(without)) == ()
    poses = [navigation(estimator=estimator) for estimator in (Estimator.POSE, Estimator.POSE_WITH_PRIOR)]
    assert len({bound_of(problem).value_mm for problem in poses}) == 1


def test_cells_are_narrower_than_the_spacing() -> None:
    """closed_form: two fiducials that keep it are never in one cell."""
    for box in (BOX_MM, SMALL_MM, np.array([[0.0, 0.0, 0.0], [50.0, 30.0, 0.0]]), np.array([[0.0] * 3, [50.0, 0, 0]])):
        information = information_of(navigation(6), first_term(navigation(6)))
        beads = information.beads[0]._replace(region=BoxRegion(*box))
        cells = cells_of(information, beads)
        assert cells.apart
        assert np.linalg.norm(2 * cells.half) < 12
        corners = cells.centres[:, None] + cells.half * np.array([[-1, -1, -1], [1, 1, 1]])[:, None, :].swapaxes(0, 1)
        np.testing.assert_allclose(corners.reshape(-1, 3).min(axis=0), (box[0] - box[1]) / 2, atol=2e-3)


@pytest.mark.parametrize(
    ("problem", "reason"),
    [
        (replace(navigation(6), places=()), "no fiducial is free"),
        (navigation(6, views=with_noise(0.0)), "without noise"),
        (
            replace(
                navigation(6, structure_connector=mount("structure_connector", bias=(0, 0, 0, 0.1, 0, 0))),
                requirements=(requirement(1.0, quantile=0.5),),
            ),
            "at most P50 is not bounded about a known bias",
        ),
        (
            replace(navigation(6), pivots=(pivot_in("structure_connector", (0, 0, -100), (0, 0, -90)),)),
            "pivots are free",
        ),
        (
            replace(navigation(6), places=places_in_box(range(6), np.array([[-50.0, -50, 0], [50, 50, 0]]))),
            "leave what the views' estimates seek open",
        ),
        (
            replace(navigation(6), places=places_in_box(range(6), np.array([[-900.0] * 3, [900.0] * 3]))),
            "the source of a view",
        ),
    ],
)
def test_withheld_with_the_reason(problem: PlacementProblem, reason: str) -> None:
    told = certify_layout(problem, every_terms(problem), present_choice(problem))
    assert told.lower_bound_mm is None
    assert told.gap_percent is None
    assert reason in told.statement
    with pytest.raises(NoBound):
        net_of(problem, first_term(problem))


def test_a_loss_does_not_hold_it_back() -> None:
    """Of what must hold after a loss nothing is said, and the bound is that with all fiducials."""
    problem = replace(navigation(7), survival=Survival(1, requirement(1.0)))
    choice = Choice(layouts(problem, np.random.default_rng(0), 1)[0], np.zeros(0), np.zeros((0, 3)))
    told = certify_layout(problem, every_terms(problem), choice)
    assert told.quantile_mm == pytest.approx(quantile_at(problem, choice.fiducials_mm))
    assert told.gap_percent == pytest.approx(100 * (told.quantile_mm / told.lower_bound_mm - 1))
    assert "Proven." in told.statement


def test_before_anything_is_solved_a_design_hears_what_no_layout_reaches() -> None:
    """oracle: the demo as drawn cannot keep 1 mm by its layout, and no layout found by the optimiser is below; at its
    smallest half-widths all could."""
    design = load_design(DEMO)
    (told,), _ = bound_layouts(design)
    assert told.tightest_bound_mm < 1.0 < told.lower_bound_mm < 1.1437 == pytest.approx(told.quantile_mm, abs=1e-4)
    assert "none keeps the limit of 1 mm; it may with every free half-width at its smallest" in told.statement
    (tight,), _ = bound_layouts(load_design(replaced(DEMO, ("requirements", 0, "limit_mm"), 0.3)))
    assert "none keeps the limit of 0.3 mm, nor with every free half-width at its smallest" in tight.statement


UP, ASIDE = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.8, 0.0])
FACE = Mesh(np.array([[0.0, 0, 0], [60, 0, 10], [0, 50, -10], [60, 50, 0]]), np.array([[0, 1, 2], [1, 3, 2]]))
REGIONS: dict[str, Shape] = {
    "box": BoxRegion(*BOX_MM),
    "plane": BoxRegion(np.array([0.0, -40, 3]), np.array([30.0, 40, 3])),
    "shell": Ball(np.array([5.0, 0, -30]), 45.0, 42.0),
    "tube": Cylinder(np.array([0.0, 0, -60]), ASIDE, 80.0, 40.0, 38.0),
    "disc": Cylinder(np.array([0.0, 0, -60]), ASIDE, 0.0, 40.0),
    "narrow sector": Cylinder(np.array([0.0, 0, -60]), UP, 50.0, 40.0, 30.0, ASIDE, 0.4),
    "wide sector": Cylinder(np.array([0.0, 0, -60]), UP, 50.0, 40.0, 0.0, ASIDE, 2.5),
    "near a surface": NearSurface(FACE, 3.0, 1.0),
}


@pytest.mark.parametrize("region", REGIONS.values(), ids=REGIONS.keys())
def test_every_point_of_a_region_lies_in_a_cell(region: Shape) -> None:
    """sampled: never wrong of cells that cover; beside a box, cells that the region does not reach are none."""
    information = information_of(navigation(6), first_term(navigation(6)))
    cells = cells_of(information, information.beads[0]._replace(region=region))
    points = sample(region, np.random.default_rng(0), 2000, 0.5) - bounding_box(region).mean(axis=0)
    away = np.abs(points[:, None] - cells.centres) - cells.half
    assert (away.max(axis=2).min(axis=1) <= 1e-9).all()
    if not isinstance(region, BoxRegion):
        assert len(cells.centres) < np.round(cells.reach / np.where(cells.half > 0, cells.half, 1)).clip(1).prod()

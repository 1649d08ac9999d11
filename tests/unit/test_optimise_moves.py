"""Fiducials that may stand for one another: what an optimum moves is told by the assignment with the least movement."""

from __future__ import annotations

import json
from itertools import permutations
from math import dist, exp, radians
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

from optimise_documents import BOX, document, moving, optimised, positions
from plain_data import EXAMPLES, read_cases
from tailstack.design import load_design
from tailstack.geometry.arrays import Array
from tailstack.optimisation.exact_law import exact_ratios
from tailstack.optimisation.matching import Places, match
from tailstack.optimisation.problem import SMOOTH_MM, Choice, Homes
from tailstack.optimisation.request import label_places, read_request
from tailstack.optimisation.search import Control, prepare_search
from tailstack.optimisation.terms import every_terms
from tailstack.results import Optimisation, Score
from tailstack.scoring import score

LOW, HIGH = np.array(BOX["min_mm"]), np.array(BOX["max_mm"])


def least_of_all(now: Array, before: Array, kinds: tuple[int, ...], size: int = 1) -> float:
    """Brute force: every permutation of groups of ``size``, each begun with any of its copies."""
    groups, best = len(now) // size, np.inf
    for order in permutations(range(groups)):
        total = 0.0
        for a, b in enumerate(order):
            ways = []
            for turn in range(size):
                own = [a * size + (turn + k) % size for k in range(size)]
                there = [b * size + k for k in range(size)]
                if all(kinds[i] == kinds[j] for i, j in zip(own, there, strict=True)):
                    ways.append(float(np.linalg.norm(now[own] - before[there], axis=1).sum()))
            total += min(ways, default=np.inf)
        best = min(best, total)
    return best


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("case", range(4))
def test_nothing_moves_less_than_what_is_matched(size: int, case: int, run_seed: int) -> None:
    """brute force: all permutations of six points in groups, of two kinds in every other case."""
    rng = np.random.default_rng([run_seed, size, case])
    now, before = rng.uniform(-50, 50, (2, 6, 3))
    kinds = tuple(int(i // size) % 2 for i in range(6)) if case % 2 else (0,) * 6
    groups = [tuple(range(k, k + size)) for k in range(0, 6, size)]
    matched = match(Places(now, groups, kinds), Places(before, groups, kinds))
    assert sorted(matched) == sorted(matched.values()) == list(range(6))
    assert all(kinds[i] == kinds[j] for i, j in matched.items())
    moved = sum(float(np.linalg.norm(now[i] - before[j])) for i, j in matched.items())
    assert moved == pytest.approx(least_of_all(now, before, kinds, size), rel=1e-12)


def test_what_is_left_out_is_what_would_have_gone_farthest(run_seed: int) -> None:
    """brute force: four of six, and six of four."""
    rng = np.random.default_rng(run_seed)
    few, many = rng.uniform(-50, 50, (4, 3)), rng.uniform(-50, 50, (6, 3))
    least = min(
        sum(float(np.linalg.norm(few[i] - many[j])) for i, j in enumerate(order)) for order in permutations(range(6), 4)
    )
    own, more = (Places(at, [(i,) for i in range(len(at))], [0] * len(at)) for at in (few, many))
    fewer = sum(float(np.linalg.norm(few[i] - many[j])) for i, j in match(own, more).items())
    newer = sum(float(np.linalg.norm(many[i] - few[j])) for i, j in match(more, own).items())
    assert fewer == pytest.approx(least, rel=1e-12)
    assert newer == pytest.approx(least, rel=1e-12)


def shuffled(data: dict[str, Any]) -> tuple[str, ...]:
    """Labels that a layout gets which is the design's own, its first two fiducials and its last two exchanged."""
    request = read_request(load_design(data))
    layout = request.problem.system.fiducials_mm[[1, 0, 2, 3, 5, 4]]
    return label_places(request, request.problem, layout)


@pytest.mark.parametrize(("apart", "labels"), read_cases("optimise", "alike"))
def test_only_what_is_alike_may_stand_for_one_another(apart: dict[str, Any], labels: str) -> None:
    """F1 has a loss probability, a place or a region of its own; in a mirrored pair either may be the first."""
    section = moving(**{field: apart[field] for field in ("fixed", "symmetry") if field in apart})
    if "region" in apart:
        regions = [{"fiducials": ["F1"], "box": BOX | {"min_mm": [-45, -45, -86]}}]
        section = moving(box=None, regions=[*regions, {"fiducials": ["F2", "F3", "F4", "F5", "F6"], "box": BOX}])
    data = document(6, **section)
    if "loss_probability" in apart:
        data["fiducials"]["points"][0] |= apart
    assert shuffled(data) == tuple(labels.split())


def test_a_fiducial_that_a_view_lists_is_not_exchanged_with_one_that_it_does_not() -> None:
    data = document(8, **moving())
    data["views"][0]["sees"] = ["F1", "F3", "F4", "F5", "F6", "F7"]
    request = read_request(load_design(data))
    layout = request.problem.system.fiducials_mm[[1, 0, 7, 3, 4, 5, 6, 2]]
    assert label_places(request, request.problem, layout) == ("F1", "F2", "F3", "F4", "F5", "F6", "F7", "F8")
    layout = request.problem.system.fiducials_mm[[0, 7, 2, 3, 4, 5, 6, 1]]
    assert label_places(request, request.problem, layout) == ("F1", "F8", "F3", "F4", "F5", "F6", "F7", "F2")


def test_a_permutation_of_fiducials_changes_no_objective(run_seed: int) -> None:
    """The exact quantile of every demand, to rounding; and what costs nothing else does not change at all."""
    request = read_request(load_design(document(8, **moving())))
    problem = request.problem
    rng = np.random.default_rng(run_seed)
    layout, widths = rng.uniform(LOW, HIGH, (8, 3)), problem.lower * 3
    one, other = (Choice(at, widths, np.zeros((0, 3))) for at in (layout, layout[rng.permutation(8)]))
    terms = every_terms(problem)
    np.testing.assert_allclose(exact_ratios(problem, terms, one), exact_ratios(problem, terms, other), rtol=1e-9)


@pytest.mark.long
def test_an_optimum_is_told_by_what_moves_least() -> None:
    """brute force: no permutation of the six places moves less than the record says."""
    data = document(6, **moving())
    result = optimised(data)
    before, now = (np.array(list(positions(each).values())) for each in (result.design_before, result.design))
    told = [np.subtract(entry.after_mm or (), entry.before_mm or ()) for entry in result.moved]
    np.testing.assert_array_equal(told, now - before)
    moved = float(np.linalg.norm(told, axis=1).sum())
    assert moved == pytest.approx(least_of_all(now, before, (0,) * 6), rel=1e-12)


# --- a price of moving, and a bound of it ------------------------------------------------------------------


def test_the_smooth_price_has_a_slope_at_home_and_is_never_more_than_the_true_one() -> None:
    """closed form: sqrt(d^2 + s^2) - s lies between d - s and d, and is d^2 / 2 s near 0."""
    homes = Homes(np.array([[0.0, 0.0, 0.0], [np.nan] * 3]), cost_per_mm=3.0)
    for way in (0.0, 1e-3, 0.04, 0.3, 2.0, 70.0):
        smooth = homes.price_smoothly(np.array([[0.6 * way, 0.0, -0.8 * way], [9.0, 9.0, 9.0]]), np.sqrt) / 3
        assert max(0.0, way - SMOOTH_MM) - 1e-12 <= smooth <= way + 1e-12
        if way < 0.01:
            assert smooth == pytest.approx(way**2 / (2 * SMOOTH_MM), rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("stay", [{"at_most_mm": 7.0}, {"cost_per_mm": 2.0}])
def test_starts_are_within_reach_and_give_places_to_the_nearest(stay: dict[str, Any]) -> None:
    problem = read_request(load_design(document(8, **moving(stay=stay)))).problem
    home, wanted = problem.system.fiducials_mm, problem.stay
    assert (wanted.cost_per_mm, wanted.at_most_mm) == (stay.get("cost_per_mm", 0.0), stay.get("at_most_mm", np.inf))
    kinds, groups = [0] * 8, [(i,) for i in range(8)]
    for start in prepare_search(problem, starts=3, seed=4, control=Control(threads=1)).starts:
        layout = (LOW + HIGH) / 2 + (HIGH - LOW) / 2 * start.x[:24].reshape(8, 3)  # scaled to the one box of all
        ways = np.linalg.norm(layout - home, axis=1)
        assert (layout >= LOW - 1e-9).all()
        assert (layout <= HIGH + 1e-9).all()
        assert ways.max() <= stay.get("at_most_mm", np.inf)
        matched = match(Places(layout, groups, kinds), Places(home, groups, kinds))
        least = sum(float(np.linalg.norm(layout[i] - home[j])) for i, j in matched.items())
        assert "at_most_mm" in stay or ways.sum() == pytest.approx(least, rel=1e-9)


def cost_with_moves(result: Optimisation, cost_per_mm: float) -> float:
    """From the documents as written: c / half-width over the rotations that were free, and every way."""
    before, now = (positions(each) for each in (result.design_before, result.design))
    ways = sum(float(np.linalg.norm(np.subtract(now[label], before[label]))) for label in now)
    return sum(1 / radians(entry.after_half_width) for entry in result.tolerances) + cost_per_mm * ways


SHIPPED = {"demo.yaml": 2.0, "first_carrier.yaml": 4.0, "reworked_carrier.yaml": 3.0}


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED)
def test_with_a_price_of_moving_the_answer_beats_the_plain_optimum_as_written(name: str) -> None:
    data = yaml.safe_load((EXAMPLES / name).read_text(encoding="utf-8"))
    data["optimise"] |= {"starts": 4, "stay": {"cost_per_mm": SHIPPED[name]}}
    stayed = optimised(data)
    del data["optimise"]["stay"]
    plain = optimised(data)
    paid, free_of_charge = (cost_with_moves(each, SHIPPED[name]) for each in (stayed, plain))
    assert stayed.cost_after == pytest.approx(paid, rel=1e-9)
    assert stayed.cost_of_moves > 0
    assert plain.cost_of_moves == 0
    assert paid < 0.97 * free_of_charge
    assert stayed.certificate.kkt_residual < 1e-5
    assert stayed.cost_exact_law is not None
    # what stays does so exactly, and what moves goes further than the price is round
    ways = [float(np.linalg.norm(np.subtract(e.after_mm or (), e.before_mm or ()))) for e in stayed.moved]
    assert all(way == 0 or way > SMOOTH_MM for way in ways)
    # the same price at twice as much moves less
    dearer = optimised(data | {"optimise": data["optimise"] | {"stay": {"cost_per_mm": 3 * SHIPPED[name]}}})
    assert dearer.cost_of_moves / (3 * SHIPPED[name]) < stayed.cost_of_moves / SHIPPED[name]


@pytest.mark.long
def test_no_fiducial_by_itself_would_be_cheaper_elsewhere_or_at_home() -> None:
    """independent: costs by the score, the free half-widths scaled by one factor to the same P95, the ways added."""
    data = yaml.safe_load((EXAMPLES / "first_carrier.yaml").read_text(encoding="utf-8"))
    data["optimise"] |= {"starts": 4, "stay": {"cost_per_mm": 1.0}}
    result = optimised(data)
    design = json.loads(json.dumps(result.design))
    home, now = positions(result.design_before), positions(result.design)

    def total(places: dict[str, Any]) -> float | None:
        """None where beads are too near to one another, in space or in an image."""
        design["fiducials"]["points"] = [{"label": label, "position_mm": list(at)} for label, at in places.items()]
        apart = [dist(places[one], places[other]) for one in places for other in places if one < other]

        def scored(log_factor: float) -> Score:
            for entry in result.tolerances:
                width = min(entry.after_half_width * exp(log_factor), 0.5)
                design["interfaces"][entry.contributor]["tolerances"][entry.component]["half_width_deg"] = width
            return score(load_design(design))

        if min(apart) < 12 - 1e-3 or min(view.closest_pair_px for view in scored(0.0).views) < 25 - 0.01:
            return None
        factor = brentq(lambda x: scored(x).targets[0].p95_mm - result.p95_after_mm, -0.5, 0.5, xtol=1e-7)
        widths = (min(entry.after_half_width * exp(factor), 0.5) for entry in result.tolerances)
        return sum(1 / radians(width) for width in widths) + sum(dist(places[label], home[label]) for label in places)

    here = total(now)
    assert here == pytest.approx(result.cost_after, rel=1e-6)
    tried = 0
    for label in now:
        steps = np.array(now[label]) + 1.5 * np.vstack([np.eye(3), -np.eye(3)])
        for place in (*np.clip(steps, LOW, HIGH).tolist(), home[label]):
            there = total(now | {label: place}) if place != now[label] else None
            tried += there is not None
            assert there is None or there > here * (1 - 2e-5), (label, place)
    assert tried > 30


@pytest.mark.long
@pytest.mark.parametrize("objective", ["cost", "quantile"])
def test_nothing_moves_further_than_it_may(objective: str) -> None:
    """As written, in every digit; and the bound is told where it holds the answer back."""
    free = {} if objective == "cost" else {"rotation_bounds": None}
    data = document(6, **moving(stay={"at_most_mm": 6.0}, **free))
    result = optimised(data)
    ways = [float(np.linalg.norm(np.subtract(e.after_mm or (), e.before_mm or ()))) for e in result.moved]
    assert max(ways) <= 6.0
    assert max(ways) > 5.9
    assert any("end of its way, 6 mm" in words for words in result.binding)
    loose = optimised(document(6, **moving(stay={"at_most_mm": 6.5}, **free)))
    (price,) = [each for each in result.shadow_prices if each.name == "at_most_mm"]
    here, there = (each.cost_exact_law or each.p95_after_mm for each in (result, loose))
    assert there - here == pytest.approx(price.cost_per_unit * 0.5, rel=0.15)


@pytest.mark.long
def test_what_moving_buys_is_what_the_optimiser_finds_without_it() -> None:
    """independent: the same design with its layout fixed, and with all but the named fiducials fixed."""
    told = optimised(document(6, **moving(starts=4)))
    result = optimised(document(6, **moving(starts=4, fewest_moves=True)))
    moves = result.moves
    assert (told.moves.alone, told.moves.needed, told.moves.evaluations) == ((), (), 0)
    assert "fewest_moves: true" in told.moves.sentence
    assert (
        "is, as the search approximates it before its check, " in told.moves.sentence
    )  # the cost that holds is another
    assert (result.cost_after, positions(result.design)) == (told.cost_after, positions(told.design))
    left = optimised(document(6, **moving(box=None, min_spacing_mm=None)))
    assert moves.objective_left == pytest.approx(left.cost_closed_form, rel=1e-4)
    fixed = [f"F{k}" for k in range(1, 7) if f"F{k}" not in moves.needed]
    few = optimised(document(6, **moving(starts=4, fixed=fixed)))
    assert moves.objective_left - few.cost_closed_form >= 0.9 * (moves.objective_left - moves.objective_moved)
    assert 0.9 <= moves.kept_fraction <= 1 + 1e-9
    assert len(moves.alone) == 6
    best = min((each.objective, each.label) for each in moves.alone if each.objective is not None)
    alone = optimised(document(6, **moving(starts=4, fixed=[f"F{k}" for k in range(1, 7) if f"F{k}" != best[1]])))
    assert alone.cost_closed_form <= best[0] * (1 + 1e-4)
    assert f"{moves.evaluations} optima" in moves.sentence

"""Values of a drawing as what the optimiser chooses from: fits and zones, priced one by one or by grade."""

from __future__ import annotations

import copy
import itertools
from typing import Any

import numpy as np
import pytest

from plain_data import EVERY, problems_of, replaced
from tailstack import score
from tailstack.design import load_design
from tailstack.design.iso286 import find_grade
from tailstack.optimisation import optimise
from tailstack.optimisation.exact_law import exact_ratios
from tailstack.optimisation.problem import Choice, present_choice
from tailstack.optimisation.request import read_request
from tailstack.optimisation.terms import every_terms

SEAT = EVERY["dowelled_seat"]
FREED: list[dict[str, Any]] = [
    {"interface": "structure_connector", "component": "face flatness",
     "grades": [{"zone_mm": 0.02, "price": 30}, {"zone_mm": 0.05, "price": 15}, {"zone_mm": 0.1, "price": 9}]},
    {"interface": "structure_connector", "component": "pin 1 fit", "also": ["pin 2 fit"],
     "grades": [{"fit": "H7/g6", "price": 40}, {"fit": "H8/e8", "price": 26}, {"fit": "H11/d9", "price": 20}]},
    {"interface": "connector_flange", "component": "pin fit",
     "grades": [{"fit": "H7/g6", "price": 25}, {"fit": "H9/d9", "price": 12}]},
    {"interface": "connector_flange", "component": "spigot fit",
     "grades": [{"fit": "H7/h6", "price": 60}, {"fit": "H7/f7", "price": 38}, {"fit": "H9/e9", "price": 22}]},
]  # fmt: skip
FIELD = {"flatness": "flatness_mm", "fit": "fit", "position": "true_position_mm"}


def asking(limit_mm: float = 0.7, **optimise: Any) -> Any:
    data = replaced(SEAT, ("requirements", 0, "limit_mm"), limit_mm)
    return data | {"optimise": {"tolerances": FREED, **optimise}}


def redrawn(grades: tuple[dict[str, Any], ...]) -> tuple[dict[str, Any], float]:
    """The document with these values written into it by hand, and what they cost."""
    data, cost = copy.deepcopy(SEAT), 0.0
    for free, grade in zip(FREED, grades, strict=False):
        cost += grade["price"]
        for name in (free["component"], *free.get("also", ())):
            feature, _, item = name.rpartition(" ")
            own = data["interfaces"][free["interface"]]["features"]
            next(each for each in own if each["name"] == feature)[FIELD[item]] = grade.get("fit", grade.get("zone_mm"))
    return data, cost


def every_choice(freed: Any = FREED) -> list[tuple[dict[str, Any], ...]]:
    return list(itertools.product(*(free["grades"] for free in freed)))


def test_a_search_sees_the_law_of_every_value_as_a_score_does() -> None:
    """independent: P95 of the documents written by hand, one of which holds a zone that grows with its fit."""
    problem = read_request(load_design(asking())).problem
    terms, here = every_terms(problem), present_choice(problem)
    for grades in every_choice()[::11]:
        named = {free["component"]: str(next(iter(grade.values()))) for free, grade in zip(FREED, grades, strict=True)}
        ladders = [{each.name: each.half_width for each in free.price.grades} for free in problem.half_widths]
        sizes = [each[named[free.component]] for each, free in zip(ladders, problem.half_widths, strict=True)]
        choice = Choice(here.fiducials_mm, np.array(sizes), here.pivots_mm)
        (ratio,) = exact_ratios(problem, terms, choice)
        assert ratio * 0.7 == pytest.approx(score(load_design(redrawn(grades)[0])).targets[0].p95_mm, rel=1e-9)


@pytest.mark.parametrize(("limit_mm", "count"), [(0.27, 2), pytest.param(0.4, 4, marks=pytest.mark.long)])
def test_what_comes_back_are_the_cheapest_values_of_all(limit_mm: float, count: int) -> None:
    """independent: every choice, scored as a document; the check keeps 0.5 % of the limit."""
    choices = [redrawn(grades) for grades in every_choice(FREED[:count])]
    each = [(cost, score(load_design(data)).targets[0].p95_mm) for data, cost in choices]
    within = [min(cost for cost, p95 in each if p95 <= part * limit_mm) for part in (1.0, 0.995)]
    found = optimise(load_design(asking(limit_mm, tolerances=FREED[:count])))
    assert within[0] <= found.cost_after <= within[1]
    assert score(load_design(found.design)).targets[0].p95_mm == pytest.approx(found.p95_after_mm, rel=1e-12)
    chosen = {entry.component: (entry.before_drawn, entry.grade) for entry in found.tolerances}
    assert [before for before, _ in chosen.values()] == ["0.02", "H7/g6", "H7/g6", "H7/h6"][:count]
    made: Any = found.design
    seat = made["interfaces"]["structure_connector"]["features"]
    assert [seat[1]["fit"], seat[2]["fit"]] == [chosen["pin 1 fit, pin 2 fit"][1]] * 2
    assert f"{seat[0]['flatness_mm']:g}" == chosen["face flatness"][1]


@pytest.mark.long
def test_values_are_chosen_together_with_a_layout() -> None:
    """A freer layout is no dearer; the answer keeps its limit by a simulation."""
    fixed = optimise(load_design(asking(0.27)))
    box = {"min_mm": [-50, -50, -80], "max_mm": [50, 50, 15]}
    found = optimise(load_design(asking(0.27, box=box, starts=2)))
    assert found.cost_after <= fixed.cost_after
    assert found.certificate.verification.verdict.status == "pass"


def test_a_zone_costs_as_the_coarsest_grade_that_is_as_narrow() -> None:
    """published: ISO 286-1, IT5 to IT9 of 80 mm are 13, 19, 30, 46 and 74 um."""
    grades = range(5, 10)
    assert [find_grade(um / 1000, 80, grades) for um in (12, 13, 18, 19, 30, 45, 46, 74, 500)] == [
        None, 5, 5, 6, 7, 7, 8, 9, 9,
    ]  # fmt: skip
    free = {"interface": "connector_flange", "component": "flange flatness", "grades": [{"zone_mm": 0.017}]}
    fit = {"interface": "connector_flange", "component": "spigot fit", "grades": [{"fit": "H7/g6"}]}
    prices = {"IT6": 60.0, "IT7": 35.0, "IT5": 100.0}
    problem = read_request(load_design(asking(tolerances=[free, fit], grade_prices=prices))).problem
    assert [half_width.price.grades[0].price for half_width in problem.half_widths] == [60.0, 95.0]  # 50 mm: IT6 is 16


@pytest.mark.parametrize(
    ("change", "code", "word"),
    [
        ({"component": "face height"}, "unknown-name", "face flatness"),
        ({"component": "pin 2"}, "unknown-name", "pin 1 fit"),
        ({"also": ["pin 3 fit"]}, "unknown-name", "pin 2 fit"),
        ({"grades": [{"fit": "H7/g6", "price": 1}]}, "missing-field", "each with its zone_mm"),
        ({"grades": [{"zone_mm": 0.05}]}, "missing-field", "has no price"),
        ({"component": "pin 1 fit", "grades": [{"fit": "H7/m6", "price": 1}]}, "no-such-value", "larger than the hole"),
        ({"interface": "connector_flange", "component": "pin position"}, "unknown-name", "pin fit"),
        ({"component": "pin 1 fit", "also": ["pin 1 fit"], "grades": FREED[1]["grades"]}, "duplicate-name", "twice"),
        ({"grades": None, "min_mm": 0.01, "max_mm": 0.1}, "missing-field", "each with its zone_mm"),
        ({"grades": [{"zone_mm": 0.05, "price": 1}] * 2}, "duplicate-name", "0.05"),
        ({"grades": [{"zone_mm": 0.05, "half_width_mm": 0.1}]}, "one-of", "zone_mm"),
    ],
)
def test_what_cannot_be_chosen_from_is_refused_with_the_cure(change: dict[str, Any], code: str, word: str) -> None:
    free = {name: value for name, value in (FREED[0] | change).items() if value is not None}
    problem = next(each for each in problems_of(lambda: load_design(asking(tolerances=[free]))) if each.code == code)
    assert problem.pointer.startswith("/optimise/tolerances/0")
    assert word in f"{problem.detail} {problem.hint}"

"""What was given is a candidate of every search: the answer is never worse, and where it was outside, that is said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from optimise_documents import BOX, document, free, moving, optimised
from optimise_scenes import oracle_problem
from tailstack.design import load_design
from tailstack.errors import NotConvergedError, Problem
from tailstack.optimisation import course, optimise
from tailstack.optimisation.present import bring_inside, present_design
from tailstack.optimisation.problem import present_choice
from tailstack.optimisation.request import read_request
from tailstack.results import Optimisation

Data = dict[str, Any]
ROTATIONS = {"min_deg": 0.01, "max_deg": 0.5}
GRADES = [
    {"name": f"IT{k}", "half_width_deg": h, "price": p} for k, h, p in ((5, 0.02, 200), (7, 0.1, 50), (9, 0.3, 9))
]
SECTIONS: dict[str, Data] = {
    "tolerances alone": {"rotation_bounds": ROTATIONS},
    "tolerances and layout": moving(),
    "layout alone": {"box": BOX, "min_spacing_mm": 12.0},
    "least error": moving(objective="quantile", cost_limit=2500.0),
    "one factor": {"objective": "scaling", "rotation_bounds": ROTATIONS},
    "a front": moving(objective="pareto", front={"points": 3}),
    "one may be lost": moving(survive={"lost": 1, "limit_mm": 1.6}),
    "grades": {"tolerances": [free("structure_connector", c, grades=GRADES) for c in ("rx", "ry")]},
    "a number of fiducials": moving(count={"min": 6, "max": 7, "cost_per_fiducial": 20.0}),
    "views": moving(views=[{"view": "LAT", "cone_deg": 20.0}]),
    "per unit": moving(),
}


def asked(name: str) -> Data:
    data = document(7, 0.8, **SECTIONS[name])
    if name == "per unit":
        data["requirements"][0] |= {"risk": "per_unit", "min_yield": 0.9}
    return data


def objective_of(data: Any, answer: Optimisation, before: bool = False) -> float:
    """What is made least, of the design before or after: a cost, or P95 where no cost is minimised."""
    least_error = data["optimise"].get("objective") == "quantile" or "rotation_bounds" not in str(data["optimise"])
    if least_error and "grades" not in str(data["optimise"]):
        return float(answer.p95_before_mm or np.inf) if before else answer.p95_after_mm
    return float(answer.cost_before or np.inf) if before else answer.cost_after


@pytest.mark.long(*(name for name in SECTIONS if name not in ("tolerances alone", "grades")))
@pytest.mark.parametrize("name", SECTIONS)
def test_an_optimum_that_is_optimised_again_is_never_worse(name: str) -> None:
    """A check of 2^20 trials passes an optimum in 5 of 6 draws: with seed 78 some are left open, and four times the
    trials decide them."""
    data = asked(name)
    first = optimised(data)
    for seed in (77, 78):
        again = optimise(load_design(first.design), starts=1, seed=seed)
        assert objective_of(data, again) <= objective_of(data, again, before=True)
        assert again.verdict_status == "pass"


def find_worse(monkeypatch: pytest.MonkeyPatch, refuse: bool) -> None:
    """Searches end in an optimum with one half-width at half of what it may be, or in none."""
    true = course.take_first_verified

    def found(*given: Any) -> Any:
        if refuse:
            raise NotConvergedError(Problem("/optimise", "not-verified", "nothing was found", ""))
        optimum = true(*given)
        at = "/interfaces/connector_flange/tolerances/rx/half_width_deg"
        return replace(optimum, design=optimum.design.with_value(at, 0.05))

    monkeypatch.setattr(course, "take_first_verified", found)


@pytest.mark.parametrize("refuse", [False, True])
def test_the_design_as_it_stands_is_kept_where_the_search_finds_no_better(
    monkeypatch: pytest.MonkeyPatch, refuse: bool
) -> None:
    first = optimised(asked("tolerances alone"))
    find_worse(monkeypatch, refuse)
    again = optimise(load_design(first.design), starts=1, seed=77)
    assert again.design == first.design
    assert again.cost_after == again.cost_before == first.cost_after
    assert again.as_it_stood == "The design as it stands is kept: nothing better was found."
    assert again.certificate.stopped.endswith("none was better than the design as it stood")
    assert again.verdict_status == "pass"


def placed(fiducials: int = 6, **section: Any) -> Data:
    return document(fiducials, 2.0, **{"objective": "quantile", "box": BOX} | section)


def toleranced(low_deg: float, high_deg: float, **section: Any) -> Data:
    return document(6, 2.0, rotation_bounds={"min_deg": low_deg, "max_deg": high_deg}, **section)


SHORTER = {"min_mm": [-40.0, -45.0, -85.0], "max_mm": BOX["max_mm"]}
HIGHER = {"min_mm": [0.0, 0.0, -140.0], "max_mm": [0.0, 0.0, -120.0]}
CLAMP = {"name": "clamp", "ball": {"centre_mm": [-42.0, -40.0, -80.0], "radius_mm": 5.0}}
COARSE = [free("structure_connector", "rx", grades=GRADES[2:])]
OUTSIDE: dict[str, tuple[Data, str]] = {
    "a half-width": (toleranced(0.01, 0.05), "seat rx is ±0.1 deg, above the largest half-width, 0.05 deg"),
    "too fine": (toleranced(0.2, 0.5), "flange ry is ±0.1 deg, below the smallest half-width, 0.2 deg"),
    "a fiducial": (placed(box=SHORTER), "F1 is 2 mm away from its region"),
    "spacing": (placed(8, min_spacing_mm=30.0), "spacing of F7 and F8 is 29.39 mm, below 30 mm"),
    "images": (placed(min_projected_spacing_px=90.0), "images of F4 and F6 in AP are 27.12 px apart, below 90 px"),
    "the border": (placed(image_margin_px=300.0), "of the image outside (margin 300 px)"),
    "the cost": (
        toleranced(0.01, 0.5, objective="quantile", cost_limit=2000.0), "it costs 2292, cost_limit is 2000"
    ),
    "a pivot": (
        document(6, 2.0, pivots=[{"interface": "connector_flange", "box": HIGHER}]),
        "the pivot of flange is 5 mm outside its box",
    ),
    "keep-out": (placed(keep_out=[CLAMP]), "F1 is in the keep-out zone 'clamp'"),
    "grades": (document(6, 2.0, tolerances=COARSE), "seat rx is ±0.1 deg, below the smallest half-width, 0.3 deg"),
}  # fmt: skip


@pytest.mark.parametrize("name", OUTSIDE)
def test_where_a_design_lies_outside_is_said_with_how_much(name: str) -> None:
    """By hand, from the numbers of the document."""
    data, words = OUTSIDE[name]
    problem = read_request(load_design(data)).problem
    here = present_design(problem)
    assert words in "; ".join(here.outside)
    again = bring_inside(problem, here.choice)
    assert np.allclose(again.fiducials_mm, here.choice.fiducials_mm, atol=1e-9)
    assert np.allclose(again.half_width, here.choice.half_width, rtol=1e-9)


def test_the_first_sentence_says_what_lies_outside_and_what_that_costs() -> None:
    """closed form: four half-widths of 0.05 instead of 0.1 deg cost twice as much."""
    data, words = OUTSIDE["a half-width"]
    answer = optimised(data)
    assert answer.as_it_stood.startswith(f"The design as it stands lies outside of what is asked for: {words};")
    assert answer.as_it_stood.endswith("Within it, cost goes from 2292 to 4584 (+100 %).")
    assert answer.outline().sentence.startswith(answer.as_it_stood)


def test_nothing_is_said_of_a_design_inside_that_was_made_better() -> None:
    assert optimised(asked("tolerances alone")).as_it_stood == ""


def test_a_design_that_costs_less_and_misses_its_limit_is_no_answer() -> None:
    data = document(6, 0.5, rotation_bounds=ROTATIONS)
    told = optimised(data).as_it_stood
    assert told.startswith("The design as it stands does not keep what is asked for (by estimate it is at 1.26")
    assert "cost goes from 2292 to" in told


def test_what_is_inside_stays_as_it_is() -> None:
    problem = oracle_problem()
    loose = present_choice(problem)
    again = bring_inside(problem, loose)
    assert (again.fiducials_mm == loose.fiducials_mm).all()

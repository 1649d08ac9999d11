"""Views whose direction and distance the optimiser may choose.

Expected values are plain optimisations of documents in which a view is turned by hand, with SciPy's rotations.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from math import hypot, inf, radians
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optimise_documents import document, moving, optimised
from plain_data import problems_of, read_cases
from tailstack.design import Design, load_design
from tailstack.errors import DesignError, InfeasibleError
from tailstack.optimisation import optimise
from tailstack.optimisation.offer import weigh_offer
from tailstack.optimisation.search import ALONE
from tailstack.results import Relaxation, ViewOffer
from tailstack.studies.views import study_views

BEAM, UP = np.array([0.42261826, 0.90630779, 0.0]), np.array([0.0, 0.0, 1.0])  # LAT, only 25 deg from AP


def poor(limit_mm: float = 0.6, **changes: Any) -> dict[str, Any]:
    """Six fixed fiducials, rotations to be budgeted, and two views that see nearly the same."""
    data = document(limit_mm=limit_mm, **moving(box=None, starts=1, **changes))
    data["views"][1].pop("orientation")
    return turned(data, 0.0, 0.0)


def turned(data: dict[str, Any], right_deg: float, up_deg: float) -> dict[str, Any]:
    """The second view turned about its isocentre, its image with it."""
    data = copy.deepcopy(data)
    right = np.cross(BEAM, UP)
    turn = Rotation.from_rotvec(radians(right_deg) * np.cross(BEAM, right) + radians(up_deg) * np.cross(BEAM, UP))
    data["views"][1] |= {"beam_direction": turn.apply(BEAM).tolist(), "up_direction": turn.apply(UP).tolist()}
    return data


def plain_cost(data: dict[str, Any]) -> float:
    try:
        return optimised(data).cost_after
    except InfeasibleError:
        return inf


def with_views(data: dict[str, Any], *views: dict[str, Any]) -> dict[str, Any]:
    return data | {"optimise": data["optimise"] | {"views": list(views)}}


@pytest.mark.long
def test_turning_a_view_is_worth_what_the_plain_optimiser_finds_in_every_direction() -> None:
    """independent: 13 directions on a grid of 15 deg, each written by hand and optimised with its views fixed."""
    base = poor()
    grid = [(a, b) for a in (-30.0, -15.0, 0.0, 15.0, 30.0) for b in (-30.0, -15.0, 0.0, 15.0, 30.0)]
    costs = {at: plain_cost(turned(base, *at)) for at in grid if hypot(*at) <= 30}
    found = optimised(with_views(base, {"view": "LAT", "cone_deg": 30.0}))
    assert found.cost_after <= min(costs.values()) * (1 + 5e-4)
    assert found.cost_after < 0.81 * costs[0.0, 0.0]
    (view,) = found.aimed.views
    beam = np.array(found.design["views"][1]["beam_direction"])  # type: ignore[index]
    assert view.turn_deg == pytest.approx(np.degrees(np.arccos(beam @ BEAM)), abs=1e-3)
    assert view.turn_deg <= 30 + 1e-3
    assert found.aimed.solved <= 25
    assert f"best of {found.aimed.solved} ways" in found.aimed.sentence
    assert "not proven" in found.aimed.sentence
    assert found.p95_before_mm == pytest.approx(optimised(base).p95_before_mm, rel=1e-12)
    assert found.design_before["views"][1]["beam_direction"] == list(BEAM)  # type: ignore[index]


@pytest.mark.long
def test_the_new_design_is_that_of_the_plain_optimiser_with_the_views_written_in() -> None:
    """independent: the views of the answer in the first document, no view free."""
    base = poor()
    found = optimised(with_views(base, {"view": "LAT", "cone_deg": 20.0, "source_isocentre_mm": [650.0, 800.0]}))
    written = optimised(base | {"views": found.design["views"]})
    assert found.cost_after == written.cost_after
    assert found.tolerances == written.tolerances
    assert 650 <= found.aimed.views[0].source_isocentre_mm <= 800
    assert found.aimed.objective_as_aimed == pytest.approx(optimised(base).cost_closed_form, rel=1e-6)


def test_a_limit_out_of_reach_as_the_views_are_aimed_is_kept_by_turning_one() -> None:
    """independent: the plain optimiser refuses the limit where the view stands."""
    base = poor(limit_mm=0.42)
    with pytest.raises(InfeasibleError):
        optimised(base)
    found = optimised(with_views(base, {"view": "LAT", "cone_deg": 30.0}))
    assert found.verdict_status == "pass"
    assert found.aimed.objective_as_aimed is None


@pytest.mark.long
def test_a_limit_out_of_reach_wherever_a_view_looks_is_refused_with_what_the_best_direction_can_do() -> None:
    """independent: study views over the same grid says which that is; it is written by hand for the plain optimiser."""
    base = poor(limit_mm=0.01)
    best = study_views(load_design(base)).views[1].best
    turned_by_hand = copy.deepcopy(base)
    turned_by_hand["views"][1] |= {"beam_direction": best.beam_direction, "up_direction": best.up_direction}
    free = with_views(base, {"view": "LAT", "cone_deg": 30.0})
    told, by_hand, as_it_stands = (
        problems_of(optimised, data, error=InfeasibleError)[0].detail for data in (free, turned_by_hand, base)
    )
    assert told == by_hand != as_it_stands


MATRIX = {
    "name": "AP", "fiducial_noise_px": 0.3, "target_noise_px": 0.3,
    "intrinsics": {"focal_px": [5000.0, 5000.0], "principal_point_px": [500.0, 500.0]},
    "pose": {"rotation_deg": [90.0, 0.0, 0.0], "translation_mm": [0.0, 0.0, 700.0]},
}  # fmt: skip


# --- a view at a price ------------------------------------------------------------------------------------


OBLIQUE = {"add": "OBL", "like": "AP"}


def with_one_more(data: dict[str, Any], beam: Any, up: Any) -> dict[str, Any]:
    """The document with a copy of AP written into it by hand."""
    copied = {field: value for field, value in data["views"][0].items() if field != "orientation"}
    new = copied | {"name": "by hand", "beam_direction": list(beam), "up_direction": list(up)}
    return data | {"views": [*data["views"], new]}


@dataclass(frozen=True)
class Proof:
    """What no design undercuts, as far as it is known."""

    cheapest: Relaxation | None


@dataclass(frozen=True)
class Optimum:
    """What is asked of the cheapest design with a view more, or without it."""

    design: Any
    cost_after: float
    cost_exact_law: float
    aimed: Any
    certificate: Proof
    objective: str = "cost"
    view_offer: ViewOffer | None = None


@pytest.mark.parametrize(("price", "costs"), [(2.0, (6.0, 5.5)), (7.0, (10.0, 9.0))])
def test_the_price_of_a_view_that_is_added_is_in_both_costs(price: float, costs: tuple[float, float]) -> None:
    """By an optimiser that knows what each design costs: 4 with the view and 10 without it."""
    design = load_design(with_views(poor(), OBLIQUE | {"price": price}))
    added = design.document.optimise.added_view

    def know(each: Design, aims: Any, rest: Any, added: Any = None) -> Any:
        aim = SimpleNamespace(view="OBL", beam_direction=tuple(BEAM), source_isocentre_mm=700.0)
        cost, least = ((10.0, 9.0), 9.5) if added is None else ((4.0, 3.5), 3.9)
        proof = Proof(Relaxation("any layout", cost[0], least, None, f"Not below {least:g}."))
        return Optimum(each.source.data, *cost, SimpleNamespace(views=(aim,)), proof)

    found = weigh_offer(design, added, know, ALONE)
    assert (found.cost_after, found.cost_exact_law) == costs
    assert (found.view_offer.cost_without, found.view_offer.cost_with, found.view_offer.worth) == (10.0, 4.0, 6.0)
    bound = found.certificate.cheapest
    assert (bound.cost, bound.lower_bound) == (costs[0], min(9.5, 3.9 + price))
    assert bound.gap_percent == pytest.approx(100 * (costs[0] / min(9.5, 3.9 + price) - 1))
    assert f"with OBL for {price:g} or without it" in bound.statement


@pytest.fixture(scope="module")
def worth() -> tuple[float, float]:
    """independent: cost of the plain optimiser without the view, and with it written by hand where it was aimed."""
    offer = optimised(with_views(poor(), OBLIQUE | {"price": 1.0})).view_offer
    return plain_cost(poor()), plain_cost(with_one_more(poor(), offer.beam_direction, offer.up_direction))


@pytest.mark.long
def test_a_view_is_added_below_the_price_that_is_the_difference_of_two_plain_optima(worth: tuple[float, float]) -> None:
    without, by_hand = worth
    assert without > 1.3 * by_hand
    price = 0.9999 * (without - by_hand)
    found = optimised(with_views(poor(), OBLIQUE | {"price": price}))
    offer = found.view_offer
    assert offer.added
    assert (offer.cost_without, offer.cost_with) == (without, by_hand)
    assert offer.worth == pytest.approx(without - by_hand, rel=1e-12)
    assert found.cost_after == pytest.approx(by_hand + price, rel=1e-12)
    # What the check's margin costs is what it costs without a price: the price is in both costs.
    alone = optimised(with_one_more(poor(), offer.beam_direction, offer.up_direction))
    margin = alone.cost_after - alone.cost_exact_law
    assert 0 < margin < 0.1 * alone.cost_after
    assert found.cost_after - found.cost_exact_law == pytest.approx(margin, rel=1e-6)
    assert found.verdict_status == "pass"
    views: Any = found.design["views"]
    assert [view["name"] for view in views] == ["AP", "LAT", "OBL"]
    assert tuple(views[2]["beam_direction"]) == offer.beam_direction
    assert views[2]["fiducial_noise_px"] == views[0]["fiducial_noise_px"]
    assert [view["name"] for view in found.design_before["views"]] == ["AP", "LAT"]  # type: ignore[attr-defined]
    again = load_design(found.design).document.optimise
    assert [free.view for free in again.free_views] == ["OBL"]
    assert again.added_view is None


@pytest.mark.long
def test_a_view_is_left_out_above_that_price(worth: tuple[float, float]) -> None:
    without, by_hand = worth
    price = 1.0001 * (without - by_hand)
    found = optimised(with_views(poor(), OBLIQUE | {"price": price}))
    offer, plain = found.view_offer, optimised(poor())
    assert not offer.added
    assert f"worth a price of up to {without - by_hand:.5g}" in offer.sentence
    assert found.cost_after == without
    assert found.tolerances == plain.tolerances
    assert found.design["views"] == plain.design["views"]
    assert found.aimed is None
    again = load_design(found.design).document.optimise
    assert again.added_view.price == price


@pytest.mark.long
def test_the_view_is_added_where_neither_study_views_nor_a_search_by_hand_finds_a_cheaper_direction(
    worth: tuple[float, float],
) -> None:
    """independent: the study's best direction and four turns by 45 deg, written by hand, turned by SciPy."""
    best = study_views(load_design(poor()))
    directions = [(best.further.best.beam_direction, best.further.best.up_direction)]
    beam, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    right = np.cross(beam, up)
    for right_deg, up_deg in ((45.0, 0.0), (-45.0, 0.0), (0.0, 45.0), (0.0, -45.0)):
        about = radians(right_deg) * np.cross(beam, right) + radians(up_deg) * np.cross(beam, up)
        turn = Rotation.from_rotvec(about)
        directions.append((tuple(turn.apply(beam)), tuple(turn.apply(up))))
    assert worth[1] <= min(plain_cost(with_one_more(poor(), *each)) for each in directions)
    offer = optimised(with_views(poor(), OBLIQUE | {"price": 1.0})).view_offer
    assert offer.p95_without_mm == pytest.approx(best.p95_mm, rel=1e-6)
    assert offer.p95_with_mm <= best.further.best.p95_mm * 1.01  # type: ignore[operator]


@pytest.mark.long
def test_a_limit_out_of_reach_without_the_view_adds_it_whatever_its_price() -> None:
    """independent: the plain optimiser refuses the limit with the two views."""
    base = poor(limit_mm=0.42)
    plain = problems_of(optimised, base, error=InfeasibleError)[0]
    found = optimised(with_views(base, OBLIQUE | {"price": 1e8}))
    offer = found.view_offer
    assert offer.added
    assert offer.cost_without is None
    assert found.verdict_status == "pass"
    assert "whatever its price" in offer.sentence
    assert "is 0.4549 mm" in plain.detail
    assert "is 0.4549 mm" in offer.sentence


def test_a_limit_out_of_reach_with_the_view_too_is_refused_for_both_designs() -> None:
    base = poor(limit_mm=0.01)
    plain = problems_of(optimised, base, error=InfeasibleError)[0]
    alone, with_it = problems_of(optimised, with_views(base, OBLIQUE | {"price": 1.0}), error=InfeasibleError)
    assert alone.detail == plain.detail
    assert with_it.pointer == "/optimise/views/0"
    assert with_it.detail.startswith("nor is there one with the view: the smallest P95")


def test_a_search_that_is_stopped_before_the_view_was_tried_says_so() -> None:
    stops = iter([False] * 2)
    asked: list[str] = []

    def follow(stage: str, _done: int, _total: int, _least: float | None) -> None:
        asked.append(stage)

    found = optimise(
        load_design(with_views(poor(), OBLIQUE | {"price": 1.0})), progress=follow, stop=lambda: next(stops, True)
    )
    offer = found.view_offer
    assert not offer.added
    assert offer.cost_with is None
    assert "stopped on request" in offer.sentence
    assert set(asked) == {"view"}


@pytest.mark.long
def test_a_search_that_is_stopped_while_the_view_is_tried_says_so() -> None:
    steps: list[int] = []

    def follow(stage: str, done: int, _total: int, _least: float | None) -> None:
        if stage == "view":
            steps.append(done)

    design = load_design(with_views(poor(), OBLIQUE | {"price": 1.0}))
    found = optimise(
        design, progress=follow, stop=lambda: bool(steps) and steps[-1] >= 28
    )  # 25 are for the half without
    assert found.view_offer.cost_with is not None
    assert "stopped on request" in found.view_offer.sentence
    assert "stopped on request" in found.aimed.sentence


REFUSED = {name: row for name, *row in read_cases("views", "views")}


@pytest.mark.parametrize("name", REFUSED)
def test_views_that_cannot_be_aimed_or_added_are_refused_where_they_stand(name: str) -> None:
    entries, section, pointer, says = REFUSED[name]
    data = with_views(poor(**section), *entries)
    if name == "not aimed":
        data["views"][0] = MATRIX
    (problem,) = problems_of(load_design, data, error=DesignError)
    assert problem.pointer == f"/optimise{pointer}"
    assert says in f"{problem.detail} {problem.hint}"


def test_the_hash_of_a_design_with_free_views_stays() -> None:
    """pinned: computed by the version that has no locator_spacing any more."""
    data = with_views(poor(), {"view": "LAT", "cone_deg": 20.0, "source_isocentre_mm": [650.0, 800.0]})
    assert load_design(data).sha256 == "84e1a888ea9e2a946043823c4d83fdc304673323b5429c00ec1e66d04bd5c85f"

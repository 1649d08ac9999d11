"""From document to document: what ``optimise`` returns scores and verifies as promised, and what it says beforehand.

What was given is a candidate of every search: the answer is never worse, and where it was outside, that is said.
"""

from __future__ import annotations

import copy
import json
import re
from dataclasses import asdict, replace
from functools import cache
from math import radians
from typing import Any

import numpy as np
import pytest

from optimise_documents import BOX, document, free, moving, normal, optimised
from plain_data import EXAMPLES, problems_of
from tailstack.design import compile_design, design_to_data, load_design
from tailstack.errors import DesignError, NotConvergedError, Problem
from tailstack.optimisation import course, influence, optimise
from tailstack.optimisation.present import bring_inside, present_design
from tailstack.optimisation.request import read_request
from tailstack.results import Finding, Optimisation
from tailstack.scoring import score

DEMO = EXAMPLES / "demo.yaml"
DEG = {"min_deg": 0.01, "max_deg": 0.5}


@cache
def demo_result() -> Optimisation:
    return optimise(load_design(DEMO), starts=2, threads=2)


def test_the_layout_keeps_what_it_was_told() -> None:
    result = demo_result()
    system = compile_design(load_design(result.design))
    layout = system.fiducials_mm
    assert (layout >= np.array([-45, -45, -85])).all()
    assert (layout <= np.array([45, 45, 15])).all()
    first, second = np.triu_indices(len(layout), 1)
    assert np.linalg.norm(layout[first] - layout[second], axis=1).min() >= 12 - 1e-5
    assert [entry.label for entry in result.moved] == list(system.fiducial_labels)
    np.testing.assert_array_equal([entry.after_mm for entry in result.moved], layout)
    views = score(load_design(result.design), losses=False).views
    assert all(view.smallest_margin_px is not None and view.smallest_margin_px >= 20 - 0.01 for view in views)
    assert all(view.closest_pair_px >= 25 - 0.01 for view in views)


def test_the_record_is_plain_and_explains_itself() -> None:
    result = demo_result()
    json.dumps(asdict(result), allow_nan=False)
    assert result.p95_before_mm == pytest.approx(score(load_design(DEMO), losses=False).targets[0].p95_mm, rel=1e-9)
    by_name = {(item.contributor, item.component): item for item in result.tolerances}
    # closed form: lever from the pivot at z = -95 mm to the tip at z = 70 mm, bias of 0.05 deg neglected
    turned = by_name["structure_connector", "rx"]
    assert turned.at_target_mm == pytest.approx(165 * radians(turned.after_half_width), rel=1e-3)
    assert result.certificate.kkt_residual < 1e-5  # 1e-6 where the worst vertex of bounded sources is unique
    assert result.certificate.converged_starts == result.certificate.starts == 2
    assert "P95 at target 'tip', limit 1 mm (tip-accuracy)" in result.binding
    assert "carrier on connector, two dowel pins rz at its largest half-width, 0.5 deg" in result.binding
    limit = next(price for price in result.shadow_prices if price.name == "limit")
    assert limit.cost_per_unit < 0
    assert limit.sentence.startswith("0.1 mm more on the limit of 1 mm saves ")
    for price in result.shadow_prices:  # a sentence says what its unit, or a tenth of the limit, is worth
        step = 0.1 if price is limit else 1
        assert f" {100 * step * abs(price.cost_per_unit) / result.cost_exact_law:.3g} %" in price.sentence


@pytest.mark.long
def test_same_seed_same_document_whatever_the_threads() -> None:
    """Starts side by side, symmetry and a count: the new document and the sampled check to the last digit."""
    data = document(**moving(starts=3, symmetry={"mirror": {"normal": [1, 1, 0]}}, count={"min": 6, "max": 8}))
    one, two = (optimise(load_design(data), threads=threads) for threads in (1, 2))
    assert one.design == two.design
    assert one.certificate == two.certificate
    assert one.counts == two.counts


@pytest.mark.long
def test_another_seed_another_search_of_the_same_design() -> None:
    one = optimised(document(**moving()))  # seed 1
    data = document(**moving(seed=5))
    # what is asked for in the call comes before the document
    other, same = optimised(data), optimise(load_design(document(**moving(starts=7))), seed=5, starts=2)
    assert (one.certificate.seed, other.certificate.seed) == (1, 5)
    assert one.certificate.verification.seed != other.certificate.verification.seed
    assert other.cost_after == pytest.approx(one.cost_after, rel=0.005)
    assert same.design["fiducials"] == other.design["fiducials"]
    assert same.certificate.verification.targets == other.certificate.verification.targets


def test_only_what_is_free_changes() -> None:
    data = document(tolerances=[free("connector_flange", "rx", min_deg=0.01, max_deg=0.4)])
    result = optimised(data)
    assert not result.moved
    assert [(t.contributor, t.component) for t in result.tolerances] == [("connector_flange", "rx")]
    before, after = (design_to_data(load_design(d)) for d in (data, result.design))
    assert after["interfaces"]["connector_flange"]["tolerances"].pop("rx") != before["interfaces"]["connector_flange"][
        "tolerances"
    ].pop("rx")
    assert after == before


@pytest.mark.long
def test_a_flat_structure_is_cured() -> None:
    """A layout without an answer of its own can still be optimised; there is no quantile before."""
    data = document(**moving())
    for point in data["fiducials"]["points"]:
        point["position_mm"][2] = -40.0
    result = optimised(data)
    assert result.p95_before_mm is None
    assert 0.98 < result.p95_after_mm <= 1.0


class Enough(Exception):
    pass


def test_progress_reports_every_start_and_may_stop_the_work() -> None:
    seen: list[tuple[str, int, int]] = []

    def watch(stage: str, done: int, total: int, least: float | None) -> None:
        seen.append((stage, done, total))
        if (stage, done) == ("start", 2):
            assert least is not None
            raise Enough

    with pytest.raises(Enough):
        optimise(load_design(document(**moving(starts=4))), progress=watch, threads=2)
    assert seen == [("programme", 1, 1), ("start", 1, 4), ("start", 2, 4)]


@pytest.mark.long
def test_stopped_it_returns_the_best_so_far_verified() -> None:
    """Stopped in the second of three counts: what was found by then, checked; the third is not tried."""
    seen: list[tuple[str, int, int]] = []

    def watch(stage: str, done: int, total: int, least: float | None) -> None:
        seen.append((stage, done, total))

    data = document(**moving(starts=3, count={"min": 6, "max": 8, "cost_per_fiducial": 100.0}))
    result = optimise(load_design(data), progress=watch, stop=lambda: ("start", 4, 9) in seen, threads=1)
    assert [step for step in seen if step[0] == "start"][:4] == [("start", k, 9) for k in (1, 2, 3, 4)]
    assert not {("start", 7, 9), ("start", 8, 9), ("start", 9, 9)} & set(seen)
    assert [entry.note for entry in result.counts][2] == "not tried: stopped on request"
    assert result.counts[2].cost is None
    assert ("check", 1, 6) in seen
    checks = result.certificate.verification.verdict.checks
    assert result.status == "verified"
    assert max(item.interval[1] for item in checks) <= 1.0
    assert score(load_design(result.design), losses=False).targets[0].p95_mm == pytest.approx(
        result.p95_after_mm, rel=1e-9
    )


@pytest.mark.long
@pytest.mark.parametrize(("starts", "until", "said"), [(2, 0, "1 of 2 starts"), (6, 2, "")])
def test_stopped_among_the_starts_it_says_after_how_many(starts: int, until: int, said: str) -> None:
    """Stopped at once it still solves one."""
    seen: list[int] = []

    def watch(stage: str, done: int, total: int, least: float | None) -> None:
        if stage == "start":
            seen.append(done)

    data = document(**moving(starts=starts))
    certificate = optimise(load_design(data), progress=watch, stop=lambda: len(seen) >= until, threads=1).certificate
    assert certificate.stopped.startswith(f"stopped on request after {said}")
    assert certificate.converged_starts < certificate.starts == starts
    assert certificate.verification.verdict.status == "pass"


SEAT, FLANGE = "structure_connector", "connector_flange"


def findings(data: dict[str, Any], rule: str) -> list[Finding]:
    return [finding for finding in influence(load_design(data)) if finding.rule == rule]


def without_noise(data: dict[str, Any]) -> dict[str, Any]:
    """Perfect fiducials, and perfect images of them (to a thousandth of a thousandth of a pixel)."""
    data = copy.deepcopy(data)
    for view in data["views"]:
        view["fiducial_noise_px"] = 1e-6
    del data["fiducials"]["manufacturing"]
    return data


def test_a_layout_that_hardly_matters_is_a_warning() -> None:
    """closed form: seats a hundred times worse than the images leave the layout less than 0.5 %."""
    data = document(limit_mm=20.0, **moving())
    for axis in ("rx", "ry"):
        data["interfaces"][FLANGE]["tolerances"][axis] = normal("deg", 4.0)
    (finding,) = findings(data, "layout-influence")
    assert finding.severity == "warning"
    floor = score(load_design(without_noise(data)), losses=False).targets[0].p95_mm
    assert floor / score(load_design(data), losses=False).targets[0].p95_mm > 0.995
    assert finding.value == pytest.approx(floor, rel=1e-5)


def test_findings_are_in_the_record_and_nothing_is_said_of_what_acts_or_was_made_better() -> None:
    data = document(**moving())
    assert optimised(data).influence == influence(load_design(data))
    pivot = {"interface": FLANGE, "box": {"min_mm": [0, 0, -145], "max_mm": [0, 0, -60]}}
    assert influence(load_design(document(pivots=[pivot], rotation_bounds=DEG))) == ()
    assert optimised(asked("tolerances alone")).as_it_stood == ""


def test_a_half_width_without_lever_goes_to_its_loosest() -> None:
    """closed form: a rotation about the axis through pivot and target does not move the target."""
    data = document(rotation_bounds=DEG)
    data["interfaces"][FLANGE]["tolerances"]["rz"] = normal("deg", 0.1)
    (finding,) = findings(data, "no-lever")
    assert finding.message.startswith("flange rz does not matter for any limit")
    assert (finding.severity, finding.pointer) == ("note", "/optimise/rotation_bounds")
    result = optimised(data)
    (item,) = [item for item in result.tolerances if item.component == "rz"]
    assert (item.after_half_width, item.at_target_mm) == (0.5, pytest.approx(0, abs=1e-9))


def test_the_flange_does_not_act_on_localisation() -> None:
    """Interface 2 comes after localisation: free alone it is refused, beside others it is loosest."""
    alone = document(tolerances=[free(FLANGE, axis, **DEG) for axis in ("rx", "ry")])
    alone["requirements"][0]["error"] = "localisation"
    for call in (influence, optimise):
        (problem,) = problems_of(call, load_design(alone), error=DesignError)
        assert (problem.pointer, problem.code) == ("/optimise", "no-influence")
        assert "flange rx" in problem.detail
        assert "at the tool" in problem.hint
    both = document(rotation_bounds=DEG)
    both["requirements"][0]["error"] = "localisation"
    assert {re.match(r"flange r[xy]", finding.message) is not None for finding in findings(both, "no-lever")} == {True}
    result = optimised(both)
    assert {item.after_half_width for item in result.tolerances if item.contributor == "connector_flange"} == {0.5}


def test_an_idle_pivot_is_said_and_alone_refused() -> None:
    """Nothing turns about the pivot of a seat that only slides."""
    pivot = {"interface": SEAT, "box": {"min_mm": [0, 0, -95], "max_mm": [0, 0, -60]}}
    data = document(pivots=[pivot], tolerances=[free(FLANGE, axis, **DEG) for axis in ("rx", "ry")])
    data["interfaces"][SEAT]["tolerances"] = {"tx": normal("mm", 0.03)}
    (finding,) = findings(data, "no-lever")
    assert (finding.severity, finding.pointer) == ("warning", "/optimise/pivots/0")
    assert "the pivot of seat" in finding.message
    del data["optimise"]["tolerances"]
    with pytest.raises(DesignError, match="nothing that is free acts"):
        influence(load_design(data))


def test_an_undetermined_layout_has_no_influence_to_compare() -> None:
    """All fiducials in one plane: there is no quantile before, and the rest is still said."""
    data = document(**moving())
    for point in data["fiducials"]["points"]:
        point["position_mm"][2] = -40.0
    assert findings(data, "layout-influence") == []


Data = dict[str, Any]
GRADES = [
    {"name": f"IT{k}", "half_width_deg": h, "price": p} for k, h, p in ((5, 0.02, 200), (7, 0.1, 50), (9, 0.3, 9))
]
SECTIONS: dict[str, Data] = {
    "tolerances alone": {"rotation_bounds": DEG},
    "tolerances and layout": moving(),
    "layout alone": {"box": BOX, "min_spacing_mm": 12.0},
    "least error": moving(objective="quantile", cost_limit=2500.0),
    "one factor": {"objective": "scaling", "rotation_bounds": DEG},
    "a front": moving(objective="pareto", front={"points": 3}),
    "one may be lost": moving(survive={"lost": 1, "limit_mm": 1.6}),
    "grades": {"tolerances": [free("structure_connector", c, grades=GRADES) for c in ("rx", "ry")]},
    "a number of fiducials": moving(count={"min": 6, "max": 7, "cost_per_fiducial": 20.0}),
    "views": moving(views=[{"view": "LAT", "cone_deg": 20.0}], starts=1),
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


@pytest.mark.long(but=["tolerances alone", "grades"])
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
    "the target": (placed(target_clearance_px=600.0), "F4 and of target 'tip' in AP are 552 px apart, below 600 px"),
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


def test_a_design_that_costs_less_and_misses_its_limit_is_no_answer() -> None:
    data = document(6, 0.5, rotation_bounds=DEG)
    told = optimised(data).as_it_stood
    assert told.startswith("The design as it stands does not keep what is asked for (by estimate it is at 1.26")
    assert "cost goes from 2292 to" in told

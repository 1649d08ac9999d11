"""Two designs side by side: the difference and its interval, what changed, the job, the pages."""

from __future__ import annotations

import io
import json
from typing import Any

import httpx
import numpy as np
import openpyxl
import pytest
from jsonschema import Draft202012Validator
from scipy.stats import norm
from service_scenes import check_problem, coplanar_design, limited
from work_driver import run_job

from tailstack import load_design, verify
from tailstack_service.documents import to_json
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.rendering import document_of, render
from tailstack_service.problems import RequestError
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.comparing import FEWEST, MOST, changes_of, compute_comparison, estimate_difference
from tailstack_service.report.records import Comparison
from tailstack_service.schemas import json_schema

TRIALS = 20_000


def quieter() -> dict[str, Any]:
    """The small design with quieter images and a tolerance that was not there."""
    design = limited(0.9, name="quieter")
    for view in design["views"]:
        view["fiducial_noise_px"] = 0.15
    design["interfaces"]["structure_connector"]["tolerances"]["tz"] = {"half_width_mm": 0.01, "distribution": "uniform"}
    return design


@pytest.fixture(scope="module")
def found() -> Comparison:
    pair = [load_design(data) for data in (limited(0.9), quieter())]
    return compute_comparison(pair[0], pair[1], ReportContents(trials=TRIALS, seed=3))


# --- the interval ---------------------------------------------------------------------------------


def test_the_interval_holds_as_often_as_it_says() -> None:
    """closed_form: P95 of lognormal laws, dependent samples.  400 repetitions, seed 5: 95 % within three standard
    errors of a proportion, 3.3 % (a true 95 % fails once in 370 runs; the seed is fixed)."""
    rng = np.random.default_rng(5)
    z = norm.ppf(0.95)
    true = np.exp(0.3 * z) - np.exp(0.4 * z)
    held = 0
    for _ in range(400):
        shared, own = rng.standard_normal((2, 8192))
        first = np.exp(0.4 * shared)
        second = np.exp(0.3 * (0.9 * shared + np.sqrt(1 - 0.81) * own))
        low, high = estimate_difference(first, second, 0.95, 0.95).interval
        held += low <= true <= high
    assert abs(held / 400 - 0.95) < 0.033


def test_what_is_shared_cancels() -> None:
    """sampled: a shift of every trial is found exactly; of independent samples the interval is many times as wide."""
    rng = np.random.default_rng(6)
    first, other = np.exp(rng.standard_normal((2, FEWEST)))
    shifted = estimate_difference(first, first + 0.25, 0.95, 0.95)
    assert shifted.value == pytest.approx(0.25, abs=1e-12)
    assert shifted.interval[1] - shifted.interval[0] < 1e-9
    apart = estimate_difference(first, other, 0.95, 0.95)
    assert apart.interval[1] - apart.interval[0] > 0.3


@pytest.mark.long
def test_too_few_trials_have_no_interval() -> None:
    with pytest.raises(ValueError, match="at least"):
        estimate_difference(np.ones(FEWEST - 1), np.ones(FEWEST - 1), 0.95, 0.95)
    with pytest.raises(ValueError, match="one length"):
        estimate_difference(np.ones(FEWEST), np.ones(FEWEST + 1), 0.95, 0.95)
    pair = [load_design(data) for data in (limited(0.9), quieter())]
    few = compute_comparison(pair[0], pair[1], ReportContents(trials=500))
    assert few.compared_trials is None
    assert few.differences[0].basis == "first order"


# --- the record -----------------------------------------------------------------------------------


@pytest.mark.long
def test_the_difference_is_that_of_the_two_checks(found: Comparison) -> None:
    checks = [verify(load_design(data), trials=TRIALS, seed=3) for data in (limited(0.9), quieter())]
    (difference,) = found.differences
    assert [report.verification for report in (found.first, found.second)] == checks
    p95 = [check.targets[0].p95_mm for check in checks]
    assert [difference.first_p95_mm, difference.second_p95_mm] == p95
    assert difference.interval_mm is not None
    assert difference.interval_mm[0] < difference.difference_mm < difference.interval_mm[1] < 0
    assert difference.conclusion == "smaller"
    assert f"{abs(difference.difference_mm):.3f} mm" in found.headline.sentence
    assert found.headline.status == found.second.headline.status


@pytest.fixture(scope="module")
def uneven() -> tuple[list[dict[str, Any]], Comparison]:
    """Two designs whose checks stop after different numbers of trials: the second is so near to its limit that a look
    more is taken to decide it."""
    pair = [limited(0.9), {**quieter(), "requirements": [{"name": "tip-accuracy", "limit_mm": 0.644}]}]
    designs = [load_design(data) for data in pair]
    alone = [verify(design, precision=0.02, seed=3).trials for design in designs]
    assert alone[0] < alone[1], alone
    made = compute_comparison(designs[0], designs[1], ReportContents(precision=0.02, seed=3))
    assert [report.verification.trials for report in (made.first, made.second) if report.verification] == [alone[1]] * 2
    return pair, made


@pytest.mark.long
def test_a_design_has_one_p95_though_its_check_alone_would_stop_sooner(
    uneven: tuple[list[dict[str, Any]], Comparison],
) -> None:
    pair, made = uneven
    assert made.first.verification is not None
    (difference,) = made.differences
    shown = (difference.first_p95_mm, difference.second_p95_mm)
    assert shown == (made.first.headline.value, made.second.headline.value)
    assert difference.difference_mm == shown[1] - shown[0]
    fixed = verify(load_design(pair[0]), trials=made.first.verification.trials, seed=3)
    assert shown[0] == fixed.targets[0].p95_mm, "the same trials, asked for by their number"
    assert made.first.verification.precision_requested == 0.02
    page = document_of("comparison", to_json(made))
    for number, value in zip(page.numbers, shown, strict=False):
        assert number.value == f"{value:.3f} mm"
    (figure,) = page.figures
    assert all(f"P95 {value:.3f} mm" in figure.svg for value in shown)


@pytest.mark.long
def test_a_job_draws_on_as_the_comparison_here_does(uneven: tuple[list[dict[str, Any]], Comparison]) -> None:
    pair, made = uneven
    request = {
        "first": pair[0], "second": pair[1], "parts": ["score", "verification"], "trials": None, "precision": 0.02,
        "seed": 3,
    }  # fmt: skip
    outcome, recorded = run_job("comparison", request, shuffle=4)
    assert outcome.answer == to_json(made)
    assert {json.loads(unit.spec)["of"] for unit in recorded} == {"first", "second"}
    Draft202012Validator(json_schema("comparison")).validate(json.loads(to_json(made)))


@pytest.mark.long
def test_of_long_checks_the_interval_is_that_of_the_first_trials(
    found: Comparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tailstack_service.report import comparing

    pair = [load_design(data) for data in (limited(0.9), quieter())]
    monkeypatch.setattr(comparing, "MOST_COMPARED", 4096)
    made = compute_comparison(pair[0], pair[1], ReportContents(trials=TRIALS, seed=3))
    (all_of_them,), (part,) = found.differences, made.differences
    assert (part.first_p95_mm, part.difference_mm) == (all_of_them.first_p95_mm, all_of_them.difference_mm)
    assert part.interval_mm is not None
    assert all_of_them.interval_mm is not None
    assert sum(part.interval_mm) / 2 == pytest.approx(part.difference_mm, abs=1e-12)
    assert part.interval_mm[1] - part.interval_mm[0] > all_of_them.interval_mm[1] - all_of_them.interval_mm[0]
    assert made.compared_trials == 4096
    text = render("comparison", to_json(made), "html").decode()
    assert f"{TRIALS:,} trials each" in text
    assert f"P95 is that of all {TRIALS:,}; the first 4,096, whose interval is wider" in text


@pytest.mark.long
def test_a_design_against_itself_differs_by_nothing() -> None:
    design = load_design(limited(0.9))
    same = compute_comparison(design, design, ReportContents(trials=TRIALS))
    assert same.differences[0].difference_mm == 0.0
    assert same.differences[0].conclusion == "not decided"
    assert not same.changes
    assert "No difference" in same.headline.sentence


OTHER = limited(0.9, targets=[{"name": "elsewhere", "position_mm": [0.0, 0.0, 60.0]}])


@pytest.mark.long(
    "sent0-422-invalid-request-", "sent1-422-invalid-design-/second", "sent2-422-ill-posed-geometry-/first/fiducials"
)
@pytest.mark.parametrize(
    ("sent", "status", "slug", "pointer"),
    [
        ({"first": limited(0.9)}, 422, "invalid-request", ""),
        ({"first": limited(0.9), "second": 3}, 422, "invalid-design", "/second"),
        ({"first": coplanar_design(), "second": limited(0.9)}, 422, "ill-posed-geometry", "/first/fiducials"),
        ({"first": limited(0.9), "second": OTHER}, 422, "invalid-design", "/second/targets"),
        (
            {"first": limited(0.9), "second": limited(0.9), "parts": ["optimisation"]},
            422, "invalid-request", "/parts/0",
        ),
        (
            {"first": limited(0.9), "second": limited(0.9), "trials": 10, "precision": 0.1},
            422, "invalid-request", "/precision",
        ),
        ({"first": limited(0.9), "second": limited(0.9), "trials": 10**9}, 422, "limit-exceeded", "/trials"),
        ({"first": limited(0.9), "second": limited(0.9), "third": 1}, 422, "invalid-request", "/third"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused(
    client: httpx.Client, sent: Any, status: int, slug: str, pointer: str
) -> None:
    document = check_problem(client.post("/v1/comparisons", json=sent), status, slug)
    assert document["errors"][0]["pointer"].startswith(pointer)
    assert client.get("/v1/jobs").json()["jobs"] == []


# --- what changed ---------------------------------------------------------------------------------


def test_changes_are_told_by_names_with_units(found: Comparison) -> None:
    told = {change.name: change for change in found.changes}
    noise = told["views AP fiducial_noise_px"]
    assert (noise.kind, noise.unit, noise.first, noise.second) == ("changed", "px", "0.3", "0.15")
    assert noise.pointer == "/views/0/fiducial_noise_px"
    added = told["interfaces structure_connector tolerances tz"]
    assert added.kind == "added"
    assert added.first is None
    assert json.loads(added.second or "")["half_width_mm"] == 0.01
    assert set(told) == {
        "name", "views AP fiducial_noise_px", "views LAT fiducial_noise_px",
        "interfaces structure_connector tolerances tz",
    }  # fmt: skip


def test_elements_are_matched_by_name_whatever_their_order() -> None:
    first = {"points": [{"label": "A", "x": 1}, {"label": "B", "x": 2}]}
    second = {"points": [{"label": "B", "x": 2}, {"label": "C", "x": 3}, {"label": "A", "x": 5}]}
    changes, left_out = changes_of(first, second)
    assert left_out == 0
    assert [(c.kind, c.name, c.pointer) for c in changes] == [
        ("added", "points C", "/points/1"),
        ("changed", "points A x", "/points/2/x"),
    ]
    removed, _ = changes_of(second, first)
    assert [(c.kind, c.name, c.pointer) for c in removed] == [
        ("changed", "points A x", "/points/0/x"),
        ("removed", "points C", "/points/1"),
    ]


def test_long_lists_of_changes_are_cut_and_say_so() -> None:
    first = {f"k{number}": 0 for number in range(MOST + 7)}
    changes, left_out = changes_of(first, dict.fromkeys(first, 1))
    assert (len(changes), left_out) == (MOST, 7)


# --- pages ----------------------------------------------------------------------------------------


def test_a_requirement_stands_once_for_each_design(found: Comparison) -> None:
    table = document_of("comparison", to_json(found)).requirements
    assert table is not None
    titles = [column.title for column in table.columns]
    rows = [dict(zip(titles, row.cells, strict=True)) for row in table.rows]
    checks = [report.verification.targets[0] for report in (found.first, found.second) if report.verification]
    assert [(row["Design"], row["Requirement"], row["Value"]) for row in rows] == [
        ("First", "tip-accuracy", checks[0].p95_mm), ("Second", "tip-accuracy", checks[1].p95_mm),
    ]  # fmt: skip


@pytest.mark.long
def test_the_pages_show_both(found: Comparison) -> None:
    body = to_json(found)
    page = render("comparison", body, "html").decode()
    for word in ("second:", "views AP fiducial_noise_px", "Budgets at target tip", "Student", "The first design"):
        assert word in page
    book = openpyxl.load_workbook(io.BytesIO(render("comparison", body, "xlsx")))
    assert {"Provenance", "Differences", "Changes", "Budgets", "Record"} <= set(book.sheetnames)
    cells = [cell.value for row in book["Differences"].iter_rows(min_row=3) for cell in row]
    assert any(
        isinstance(cell, float) and cell == pytest.approx(found.differences[0].difference_mm, rel=1e-15)
        for cell in cells
    )
    assert render("comparison", body, "html").decode() == page


@pytest.mark.long
def test_a_design_with_missed_beads_is_reported_and_compared() -> None:
    """By its score, and by a simulation that has them missed: the estimated curve beside its bars is of both."""
    missed = limited(0.9)
    missed["fiducials"]["loss_probability"] = 0.02
    options = ReportContents(parts=("score",))
    report = compute_report(load_design(missed), options)
    mixture = report.score.losses[0].mixture
    assert mixture is not None
    assert mixture.value is not None
    page = render("report", to_json(report), "html").decode()
    assert f"with each bead missed in 2 % of shots, 95 % of all shots are within {mixture.value:.3f} mm" in page
    assert compute_comparison(load_design(missed), load_design(limited(0.9)), options).differences
    missed["fiducials"]["loss_probability"] = 0.05
    whole = ReportContents(trials=TRIALS)
    compared = compute_comparison(load_design(limited(0.9)), load_design(missed), whole)
    assert compared.differences[0].conclusion == "larger"
    drawn = compared.second
    assert drawn.verification is not None
    assert drawn.verification.losses is not None
    (shown,) = drawn.distributions
    assert shown.sampled is not None
    apart = np.abs(np.cumsum(shown.sampled) - np.cumsum(shown.first_order)).max()
    assert apart < 0.03  # of the estimate without losses it is 0.1
    page = render("comparison", to_json(compared), "html").decode()
    assert "of the shots drawn a fiducial or more is missed" in page
    assert "estimate of such shots, with and without" in " ".join(
        OPERATIONS["verification"].write(drawn.verification).split()
    )
    alone = render("report", to_json(drawn), "html").decode()
    assert "Trials with a fiducial missed" in alone


@pytest.mark.long
def test_sections_without_a_bound_are_no_difference() -> None:
    """3.9 % of shots have no answer: P95 of all has a bound, that of one section in 32 has none."""
    missed = limited(0.9)
    missed["fiducials"]["points"] = missed["fiducials"]["points"][:7]
    missed["fiducials"]["loss_probability"] = 0.048
    with pytest.raises(RequestError, match="no answer"):
        compute_comparison(load_design(limited(0.9)), load_design(missed), ReportContents(trials=TRIALS))

"""Whole jobs by the in-memory driver, against the library called in process: the same bytes.

The driver computes each round's units in a shuffled order (the seeds are in the tests) and takes every look twice,
but for looks that take seconds.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from service_scenes import EXAMPLES
from work_driver import run_job

from optimise_documents import BOX, document
from tailstack import TailstackError, load_design, optimise, score_batch, verify
from tailstack.design import design_to_data
from tailstack.errors import NotConvergedError, Problem
from tailstack.sweeping import read_axes, sweep
from tailstack_service.documents import to_json
from tailstack_service.operations.content import canonical
from tailstack_service.operations.example import EXAMPLE_DESIGN
from tailstack_service.operations.perform import perform
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.units import optimisation as units
from tailstack_service.processes.task import ADVANCE, Estimated, RawRequest, Task
from tailstack_service.schemas import read_record
from tailstack_service.settings import Settings

ROTATIONS = {"min_deg": 0.01, "max_deg": 0.5}


def example(name: str) -> dict[str, Any]:
    return design_to_data(load_design(EXAMPLES / f"{name}.yaml"))


# --- tables of designs ----------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("column", "rows"), [("p95_mm", 1700), ("verdict", 80)])
def test_a_table_in_units_is_that_of_the_library(column: str, rows: int) -> None:
    """Compiled rows and rows in full, one of them refused; what is sent over HTTP becomes the same request."""
    table = {
        "/views/0/fiducial_noise_px": [0.1 + k / 1000 for k in range(rows)],
        "fiducials.points.0.position_mm.2": [-80.0 + k / 100 if k != 7 else 1e6 for k in range(rows)],
    }
    body = {"design": EXAMPLE_DESIGN, "table": table, "columns": [column]}
    operation = OPERATIONS["batch"]
    assert operation.body is not None
    read = operation.body.receive(RawRequest("json", canonical(body), as_job=True), Settings())
    assert isinstance(read, Estimated)
    reception = read.compute()
    assert reception.job is not None
    outcome, recorded = run_job("batch", json.loads(reception.job.content), shuffle=5)
    record = read_record("batch", outcome.answer)
    found = score_batch(load_design(EXAMPLE_DESIGN), table, columns=[column])
    for name, cells in found.columns.items():
        assert record.columns[name] == tuple(None if cell != cell else cell for cell in cells.tolist())
    assert record.columns["reason"] == tuple(found.reasons)
    assert (record.rows, record.refused, len(recorded)) == (rows, 1, 3)


# --- verification ---------------------------------------------------------------------------------


@pytest.mark.long("locators_321-options3", "missed beads-options6")
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("demo", {"precision": None, "trials": None, "seed": 3}),
        ("demo", {"trials": 2**18 + 1, "seed": 4, "method": "plain"}),
        ("demo", {"method": "radial", "seed": 5}),
        ("locators_321", {"precision": 0.02, "seed": 6, "max_trials": 50_000}),
        ("slicer_markups", {"precision": 0.01, "seed": 2**63 - 1}),
        ("small_cluster_far_target", {"trials": 20_000, "seed": 8}),
        ("missed beads", {"trials": 2**18 + 1, "seed": 4}),
    ],
)
def test_a_check_in_units_is_the_check_in_process(name: str, options: dict[str, Any]) -> None:
    """Adaptive, fixed and radial; seats with locators, many targets, trials that are redone by SVD, missed beads."""
    data = example("demo" if name == "missed beads" else name)
    if name == "missed beads":
        data["fiducials"]["loss_probability"] = 0.03
    outcome, recorded = run_job("verification", {"design": data, **options}, shuffle=17)
    assert outcome.answer == to_json(verify(load_design(data), **options))
    assert len(recorded) > (name == "missed beads")
    losses = json.loads(outcome.answer or b"")["losses"]
    assert (losses or {}).get("trials_with_losses", 0) > 2**16 or name != "missed beads"


def test_a_check_that_goes_on_asks_ahead_for_what_it_will_need() -> None:
    """Half a million trials are needed for 0.2 %: after the first look they are asked for at once, not look by look."""
    request = {"design": example("demo"), "precision": 0.002, "seed": 1, "max_trials": 2**20}
    first = perform(Task("verification", canonical(request), ADVANCE))
    assert len(first.more) == 1
    assert first.remaining > 0
    outcome, recorded = run_job("verification", request)
    assert json.loads(outcome.answer or b"")["trials"] == 2**20
    spans = [json.loads(unit.spec) for unit in sorted(recorded, key=lambda unit: unit.index)]
    assert [span["first"] for span in spans] == [0, *(2**k for k in range(14, 20)), 2**19 + 2**18]


# --- optimisation ---------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    "request_",
    [
        {"design": document(8, box=BOX, rotation_bounds=ROTATIONS), "starts": 6, "seed": 2},
        {"design": document(8, rotation_bounds=ROTATIONS), "starts": None, "seed": None},
        {"design": document(6, box=BOX, rotation_bounds=ROTATIONS, stay={"cost_per_mm": 2.0}), "starts": 5, "seed": 3,
         "gap": 0.3},
    ],
    ids=["placement", "budgets", "moves that cost, near enough"],
)  # fmt: skip
def test_an_optimisation_in_units_is_the_optimisation_in_process(request_: dict[str, Any]) -> None:
    options = {name: request_.get(name) for name in ("seed", "starts", "gap")}
    outcome, recorded = run_job("optimisation", request_, shuffle=3, twice="box" not in request_["design"]["optimise"])
    assert outcome.answer == to_json(optimise(load_design(request_["design"]), threads=2, **options))
    assert len(recorded) == (2 if "box" in request_["design"]["optimise"] else 0)


@pytest.mark.long("starts")
@pytest.mark.parametrize("layout", [{"box": BOX, "starts": 5}, {}], ids=["starts", "tolerances alone"])
def test_the_points_of_a_front_are_units(layout: dict[str, Any]) -> None:
    """Two groups of starts, three points, that of the tightest limit out of reach; a layout that stays is not started
    from several places."""
    front = {"points": 3, "min_limit_mm": 0.1, "max_limit_mm": 2.0}
    data = document(6, rotation_bounds=ROTATIONS, objective="pareto", front=front, **layout)
    outcome, recorded = run_job("optimisation", {"design": data}, shuffle=8, twice=False)
    assert outcome.answer == to_json(optimise(load_design(data), threads=2))
    whats = [json.loads(unit.spec)["what"] for unit in sorted(recorded, key=lambda unit: unit.index)]
    assert whats == ["starts"] * (2 if layout else 0) + ["front"] * 3
    statuses = [point["status"] for point in json.loads(outcome.answer or b"")["front"]]
    assert statuses[0] == "out of reach"
    assert statuses.count("verified") >= 1


@pytest.mark.long
@pytest.mark.parametrize("kind", ["verification", "optimisation"])
def test_what_is_refused_in_process_is_refused_in_units(kind: str) -> None:
    """A radial check that does not hold; a search that is refused before any start is solved, whose units come to
    nothing: the last look says why."""
    data = document(6, 0.1, box=BOX, rotation_bounds=ROTATIONS)
    run: Any = optimise
    options: dict[str, Any] = {}
    if kind == "verification":
        data, run, options = example("small_cluster_far_target"), verify, {"method": "radial", "seed": 1}
        data["views"] = [{**view, "fiducial_noise_px": 8.0} for view in data["views"]]
    with pytest.raises(TailstackError) as refused:
        run(load_design(data), **options)
    outcome, recorded = run_job(kind, {"design": data, **options})
    problem = json.loads(outcome.problem or b"")
    assert problem["type"] == f"/v1/problems/{refused.value.slug}"
    assert problem["errors"][0]["detail"] == refused.value.problems[0].detail
    assert problem["errors"][0]["pointer"].startswith("/design/optimise") or kind == "verification"
    assert len(recorded) == 1 or kind == "verification"


def test_a_bound_that_cannot_be_told_refuses_its_search_and_not_the_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in process, where the other numbers of fiducials are still tried."""

    def fail(*_: object) -> float:
        raise NotConvergedError(Problem("", "tail-not-converged", "no quantile", "report this law"))

    monkeypatch.setattr(units, "enough_for", fail)
    request = {"design": document(6, 1.0, box=BOX), "starts": 2, "gap": 0.25}
    spec = {"what": "starts", "position": 0, "first": 0, "count": 4}
    assert units.compute(request, spec) == units._bytes([])


# --- sweep ----------------------------------------------------------------------------------------

AXES: list[dict[str, Any]] = [
    {"pointer": "/views/*/fiducial_noise_px", "start": 0.1, "stop": 0.5, "count": 9},
    {"pointer": "/interfaces/structure_connector/tolerances/rz/half_width_deg", "values": [0.1, 0.2, -1.0]},
]


@pytest.mark.long("options1")
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"check": "verification", "trials": 30_000, "seed": 4},
        {"check": "verification", "seed": 4, "max_trials": 2**14},
    ],
)
def test_a_sweep_in_units_is_the_sweep_in_process(options: dict[str, Any]) -> None:
    """27 points, a third of them refused."""
    data = example("demo")
    design = load_design(data)
    outcome, recorded = run_job("sweep", {"design": data, "axes": AXES, **options}, shuffle=5)
    assert outcome.answer == to_json(sweep(design, read_axes(design, AXES), **options))
    assert len(recorded) > 1


# --- any kind -------------------------------------------------------------------------------------


def test_a_defect_is_raised_and_not_told_to_the_user() -> None:
    with pytest.raises(KeyError):
        perform(Task("verification", canonical({"no design": 1}), ADVANCE))


def test_canonical_bytes_do_not_depend_on_the_order_of_fields() -> None:
    assert canonical({"b": [1.5, None], "a": "é"}) == canonical({"a": "é", "b": [1.5, None]})
    assert canonical({"a": "é", "b": [1.5, None]}) == '{"a":"é","b":[1.5,null]}'.encode()
    with pytest.raises(ValueError, match="JSON"):
        canonical({"a": float("nan")})

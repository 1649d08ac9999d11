"""Tables of designs: every row against the score of a document written by hand, whichever way it was computed."""

from __future__ import annotations

import copy
from itertools import pairwise
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plain_data import EXAMPLES, places_of, problems_of, read_cases, replaced, value_at
from random_designs import random_design
from tailstack import load_design, score, score_batch
from tailstack.batch import COLUMNS, COMPILED, IN_FULL, Batch
from tailstack.effects import EFFECTS
from tailstack.errors import TailstackError
from tailstack.sweeping import SweepError
from typical import declare_all

DEMO = load_design(EXAMPLES / "demo.yaml")
NOISE, BEAD = "/views/0/fiducial_noise_px", "/fiducials/points/2/position_mm/1"
CLOSE = 1e-12


def of_normal_laws(document: dict[str, Any]) -> dict[str, Any]:
    """The document with every tolerance normal."""
    for place in places_of(document):
        if "distribution" in place[-1:]:
            document = replaced(document, place, "normal")
    return document


NORMAL = load_design(of_normal_laws(DEMO.source.data))
POSE = load_design({**NORMAL.source.data, "model": {"estimator": "pose"}})
BOUNDED = DEMO.with_value("interfaces.connector_flange.tolerances.tz.distribution", "bounded")
PIVOT = "/interfaces/connector_flange/pivot_mm/2"


def numbers_of(document: dict[str, Any]) -> list[tuple[Any, ...]]:
    """Where a document has numbers."""
    every = ((place, value_at(document, place)) for place in places_of(document))
    return [place for place, value in every if isinstance(value, int | float) and not isinstance(value, bool)]


def written(document: dict[str, Any], places: list[tuple[Any, ...]], values: list[float]) -> dict[str, Any]:
    """The document with these numbers, by plain assignment."""
    for place, value in zip(places, values, strict=True):
        document = replaced(document, place, value)
    return document


def scored(document: dict[str, Any]) -> dict[str, Any] | None:
    """Every column of the document's own score; None where it has none."""
    try:
        found = score(load_design(document))
    except TailstackError:
        return None
    cells: dict[str, Any] = {"verdict": found.verdict.status}
    for target in found.targets:
        cells[f"p95_mm:{target.name}"] = target.p95_mm
        cells[f"mean_norm_mm:{target.name}"] = target.mean_norm_mm
        cells[f"bias_norm_mm:{target.name}"] = float(np.linalg.norm(target.bias_mm))
        cells[f"localisation_p95_mm:{target.name}"] = target.localisation.p95_mm
    for check in found.verdict.checks:
        cells[f"value:{check.requirement}:{check.target}"] = check.value
    kept = [check.value <= check.limit for check in found.verdict.checks]
    cells["within_limits"] = ("yes" if all(kept) else "no") if kept else "no requirement"
    return cells


def compare(document: dict[str, Any], places: list[tuple[Any, ...]], rows: np.ndarray, columns: Any) -> Any:
    """A batch, after each row was compared with its own score."""
    pointers = ["/" + "/".join(map(str, place)) for place in places]
    batch = score_batch(load_design(document), dict(zip(pointers, rows.T, strict=True)), columns=columns)
    for k, row in enumerate(rows.tolist()):
        expected = scored(written(document, places, row))
        if expected is None:
            assert batch.reasons[k], (k, row)
            assert all(column[k] == "" or isnan(column[k]) for column in batch.columns.values())
            continue
        assert not batch.reasons[k]
        for name, column in batch.columns.items():
            if isinstance(expected[name], str):
                assert column[k] == expected[name], name
            else:
                assert column[k] == pytest.approx(expected[name], rel=CLOSE, abs=1e-12), (name, k, row)
    return batch


def draw_rows(rng: np.random.Generator, document: dict[str, Any], places: list[tuple[Any, ...]], count: int) -> Any:
    """Numbers near those that are there, now and then far away, or out of range."""
    base = np.array([value_at(document, place) for place in places])
    near = base + (0.02 * np.abs(base) + 0.05) * rng.standard_normal((count, len(base)))
    named = [isinstance(place[-1], str) for place in places]
    near[:, named] = np.abs(near[:, named])
    return np.where(rng.random(near.shape) < 0.03, near * rng.choice([-1.0, 30.0, 1e7], near.shape), near)


@pytest.mark.long("0", "1", "4", "12", "16")
@pytest.mark.parametrize("seed", range(24))
def test_rows_of_random_designs_are_their_scores(seed: int) -> None:
    """independent: the document of each row, written by assignment and scored alone."""
    rng = np.random.default_rng([17, seed])
    document = random_design(
        rng, int(rng.integers(2, 5)), int(rng.choice([6, 8, 12])), bool(rng.random() < 0.2), (0.005, 0.1)
    )
    if seed % 2:
        document = of_normal_laws(document)
    p95 = score(load_design(document)).targets[0].p95_mm
    document["requirements"] = [
        {"name": "tip", "limit_mm": 1.02 * p95},
        {"name": "seen", "limit_mm": 2 * p95, "error": "localisation", "quantile": 0.9},
    ][: int(rng.integers(0, 3))]
    known = [place for place in numbers_of(document) if place[0] != "requirements"]
    if seed % 4 < 3:
        known = [place for place in known if "projection" not in place]
    if seed % 8 == 1:
        known = [place for place in known if "bias" not in place and "pivot_mm" not in place and place[0] != "targets"]
    if seed % 6 == 1:  # a view that sees some of the beads
        labels = [f"F{k}" for k in range(1, len(document["fiducials"]["points"]) + 1)]
        document["views"][0]["sees"] = sorted(rng.choice(labels, max(6, len(labels) - 2), replace=False).tolist())
    chosen = [known[k] for k in rng.choice(len(known), int(rng.integers(1, 6)), replace=False)]
    columns = [name for name in COLUMNS if seed % 8 not in (1, 5) or name != "verdict"]
    compare(document, chosen, draw_rows(rng, document, chosen, 6), columns)


@pytest.mark.parametrize(
    ("design", "paths", "way"),
    [
        (NORMAL, [BEAD, NOISE, "interfaces.connector_flange.tolerances.rz.half_width_deg"], COMPILED),
        (NORMAL, [PIVOT, "/targets/0/position_mm/1"], COMPILED),
        (DEMO, [BEAD, PIVOT, NOISE], COMPILED),
        (NORMAL, ["/views/0/source_isocentre_mm"], IN_FULL),
        (POSE, [BEAD], COMPILED),
        (BOUNDED, [BEAD], IN_FULL),
    ],
)
def test_a_batch_says_which_way_its_rows_went_and_why(design: Any, paths: list[str], way: str) -> None:
    rng = np.random.default_rng(3)
    places = [place_of(design, path) for path in paths]
    base = np.array([value_at(design.source.data, place) for place in places])
    found = compare(design.source.data, places, base * (1 + 0.01 * rng.random((4, len(base)))), COLUMNS[:6])
    assert found.ways[way] == 4
    assert (found.why == "") == (way == COMPILED)


def test_all_that_keeps_rows_from_the_fastest_way_is_told_at_once_and_no_more() -> None:
    """Each reason is taken away by itself; with the last one gone rows are compiled, whatever laws there are."""
    document = copy.deepcopy(BOUNDED.source.data)
    document["requirements"].append({"name": "units", "limit_mm": 3.0, "risk": "per_unit", "min_yield": 0.5})
    declared = {**DEMO.source.data, "requirements": document["requirements"]}
    pooled = {**declared, "requirements": document["requirements"][:1]}
    source = "/views/0/source_isocentre_mm"
    told = [
        Batch(load_design(each), paths, ("p95_mm", "within_limits", *columns)).why.split("; ")
        for each, paths, columns in (
            (document, (BEAD, source), ("verdict",)), (document, (BEAD,), ("verdict",)),
            (declared, (BEAD,), ("verdict",)), (declared, (BEAD,), ()), (pooled, (BEAD,), ()),
        )
    ]  # fmt: skip
    assert [len(reasons) for reasons in told[:4]] == [4, 3, 2, 1]
    assert all(set(fewer) < set(more) for more, fewer in pairwise(told[:4]))
    assert told[4] == [""]
    words = " ".join(told[0])
    for named in (source, "connector_flange: bounded", "verdict", "installed unit"):
        assert named in words
    places = [place_of(DEMO, path) for path in (NOISE, BEAD)]
    found = compare(pooled, places, np.array([[0.2, 29.0], [0.31, 28.0]]), COLUMNS[:6])
    assert found.ways == {COMPILED: 2, IN_FULL: 0}


PRIOR = {"focal_rel_sd": 0.01, "principal_point_px_sd": 8.0}


@pytest.mark.parametrize("model", read_cases("design", "batch_models"), ids=str)
@pytest.mark.parametrize("effects", [False, True])
def test_rows_of_every_estimator_and_effect_are_their_scores(model: dict[str, str], effects: bool) -> None:
    """independent: the document of each row, written by assignment and scored alone; all numbers that may move do."""
    document = copy.deepcopy(DEMO.source.data)
    if effects:
        declare_all(document, np.random.default_rng(39))
    document["model"] = {**document.get("model", {}), **model}
    if model.get("estimator") == "pose_with_prior":
        for view in document["views"]:
            view["intrinsics_prior"] = PRIOR
    paths = [
        BEAD, NOISE, PIVOT, "/targets/0/position_mm/1", "/interfaces/structure_connector/pivot_mm/0",
        "/fiducials/manufacturing/half_width_mm", "/interfaces/connector_flange/tolerances/rx/half_width_deg",
    ]  # fmt: skip
    places = [place_of(DEMO, path) for path in paths]
    if effects:  # every half-width of each that there is
        own = {name for kind in EFFECTS for name in kind.section.model_fields}
        places += [each for each in numbers_of(document) if own & set(each) and _names_a_half_width(each)]
    base = np.array([value_at(document, place) for place in places])
    rows = base + (0.01 * np.abs(base) + 0.01) * np.random.default_rng(5).random((3, len(base)))
    found = compare(document, places, rows, COLUMNS[:6])
    assert found.ways == {COMPILED: 3, IN_FULL: 0}


def _names_a_half_width(place: tuple[Any, ...]) -> bool:
    return next(step for step in reversed(place) if isinstance(step, str)).startswith("half_width")


WARM = {
    "difference_k": 30,
    "half_width_k": 5,
    "distribution": "normal",
    "structure_expansion_um_per_m_k": 47,
    "connector_expansion_um_per_m_k": 23,
}


@pytest.mark.parametrize("design", [DEMO, NORMAL])
@pytest.mark.parametrize("path", read_cases("values", "executed"))
@pytest.mark.parametrize("warm", [False, True])
def test_a_number_of_the_execution_or_of_a_warm_seat_is_not_passed_over(design: Any, path: str, warm: bool) -> None:
    """What acts on several axes at once, and the seats about which a warm structure grows."""
    document = {**design.source.data, **({"temperature": WARM} if warm else {})}
    place = place_of(design, path)
    rows = np.array([[value_at(document, place)], [value_at(document, place) + 5.0]])
    found = compare(document, [place], rows, COLUMNS[:4])
    assert not found.ways[IN_FULL]
    assert found.columns["p95_mm:tip"][1] != found.columns["p95_mm:tip"][0]


def test_a_half_width_whose_half_the_document_refuses_is_a_column_like_any_other() -> None:
    """The smallest number there is: its half is zero, which no grade may be."""
    document = copy.deepcopy(load_design(EXAMPLES / "tube_carrier.yaml").source.data)
    document["optimise"]["tolerances"][0]["grades"][0]["half_width_deg"] = 5e-324
    found = score_batch(load_design(document), {"optimise.tolerances.0.grades.0.half_width_deg": [0.02, 0.0]})
    assert found.columns["p95_mm:tip"][0] > 0.0
    assert not found.reasons[0]
    assert "half-width above zero" in found.reasons[1]


def place_of(design: Any, path: str) -> tuple[Any, ...]:
    steps = path.strip("/").replace(".", "/").split("/")
    return tuple(int(step) if step.isdigit() else step for step in steps)


def test_bytes_do_not_depend_on_threads_or_on_where_a_table_is_cut() -> None:
    rng = np.random.default_rng(8)
    rows = np.column_stack([rng.uniform(0.1, 0.5, 2500), -40 + rng.standard_normal(2500)])
    table = {NOISE: rows[:, 0], BEAD: rows[:, 1]}
    whole = score_batch(NORMAL, table, threads=1)
    again = score_batch(NORMAL, table, threads=3)
    batch = Batch(NORMAL, list(table))
    pieces = [batch.score_rows(rows[start : start + 7]) for start in range(0, 70, 7)]
    for k, (name, column) in enumerate(whole.columns.items()):
        assert column.tobytes() == again.columns[name].tobytes() or column.tolist() == again.columns[name].tolist()
        assert np.concatenate([piece.columns[k] for piece in pieces]).tolist() == column[:70].tolist()
    assert whole.reasons == again.reasons


def test_a_row_that_cannot_be_scored_keeps_its_place_and_says_why() -> None:
    found = score_batch(NORMAL, {NOISE: [0.3, -1.0, float("nan"), 0.3], BEAD: [-30.0, -30.0, -30.0, 4e4]})
    assert [bool(reason) for reason in found.reasons] == [False, True, True, True]
    assert "/views/0/fiducial_noise_px" in found.reasons[1]
    assert np.isnan(found.columns["p95_mm:tip"]).tolist() == [False, True, True, True]
    assert found.columns["within_limits"].tolist()[1:] == ["", "", ""]


def test_beads_that_stand_in_a_file_have_places(tmp_path: Path) -> None:
    points = [point["position_mm"] for point in DEMO.source.data["fiducials"]["points"]]
    lines = ["label,x_mm,y_mm,z_mm", *(f"B{k},{x},{y},{z}" for k, (x, y, z) in enumerate(points))]
    (tmp_path / "beads.csv").write_text("\n".join(lines))
    document = copy.deepcopy(NORMAL.source.data)
    document["fiducials"].pop("points")
    document["fiducials"]["file"] = "beads.csv"
    design = load_design(document, base_directory=tmp_path)
    found = score_batch(design, {"fiducials.points.B2.position_mm.1": [points[2][1] + 3.0]})
    expected = scored(written(NORMAL.source.data, [place_of(design, BEAD)], [points[2][1] + 3.0]))
    assert found.columns["p95_mm:tip"][0] == pytest.approx(expected["p95_mm:tip"], rel=CLOSE)


@pytest.mark.parametrize(
    ("table", "columns", "pointer", "said"),
    [
        ({"/views/0/fiducial_noise": [1.0]}, ["p95_mm"], "/table", "nothing at"),
        ({NOISE: [1.0], "views.*.fiducial_noise_px": [1.0]}, ["p95_mm"], "/table", "same number"),
        ({NOISE: [1.0], BEAD: [1.0, 2.0]}, ["p95_mm"], "/table", "same length"),
        ({}, ["p95_mm"], "/table", "at least one"),
        ({NOISE: [1.0]}, ["p95"], "/columns/0", "known: p95_mm"),
    ],
)
def test_refusals_of_a_table_name_what_is_wrong(table: Any, columns: list[str], pointer: str, said: str) -> None:
    [problem] = problems_of(score_batch, DEMO, table, columns=columns, error=SweepError)
    assert problem.pointer.startswith(pointer)
    assert said in problem.detail + problem.hint

"""Many designs at once on the workbench: the sequence, costs, what is kept, the picture's counts, and their use.

Each is held against what shares no code with it: SciPy's Sobol, the optimiser's price, NumPy, ``score`` of designs that
are written by hand."""

from __future__ import annotations

import csv
import io
import os
import random
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from browsing import DEMO, asked, playing, used
from page_in_node import call_page
from scipy.stats import qmc
from served import Served, served
from service_scenes import EXAMPLES

from plain_data import replaced, value_at
from tailstack import load_design, score
from tailstack.optimisation.present import merit_as_written
from tailstack.optimisation.request import read_request
from waiting import LIMIT_SECONDS

SCRIPT = """
const page = require("./sample.js");
answer(asked.map(({ call, given }) => ({
  sobol: ([count, dimensions, seed]) => page.sobol(count, dimensions, seed).map((column) => [...column]),
  cost: ([data, other]) => page.costOf(data)?.(new Map(Object.entries(other))) ?? null,
  axes: ([data, widths, ...others]) => page.axesOf(data, widths).map((axis) => ({ ...axis, here: axis.place(axis.now),
    read: others.map((other) => axis.read(other)),
    drawn: [0, 0.3, 0.999].map((at) => page.valueOf(axis, at)), placed: axis.place(page.valueOf(axis, 0.3)) })),
  kept: ([columns, ranges]) => [...page.keptBy(columns.map((column) => Float64Array.from(column, (v) => v ?? NaN)),
    ranges.map((range) => range && range.map((end, k) => end ?? (k ? Infinity : -Infinity))))],
  picture: ([xs, height, lines, masks]) => {
    const of = (rows) => new page.Crossings(xs, height, lines.map((line) => Int16Array.from(rows, (row) => line[row])));
    const rows = lines[0].map((_, row) => row), picture = of(rows);
    return masks.map((mask) => {
      picture.show(Uint8Array.from(mask));
      const anew = of(rows.filter((row) => mask[row])).all;
      return [anew.every((count, k) => count === picture.kept[k]), anew.reduce((sum, count) => sum + count, 0)];
    });
  },
}[call](given))));
"""
MOST_AXES = 16
POINTER = "/interfaces/connector_flange/tolerances/rx/half_width_deg"


def path_of(pointer: str) -> list[str | int]:
    return [int(name) if name.isdigit() else name for name in pointer.split("/")[1:]]


def called(folder: Path, call: str, *given: Any) -> list[Any]:
    return call_page(folder, ("sample", "document"), SCRIPT, [{"call": call, "given": each} for each in given])


# --- arithmetic -------------------------------------------------------------------------------------------------------


def test_the_sequence_is_sobols_and_a_seed_shifts_it_within_its_strata(tmp_path: Path) -> None:
    """independent: SciPy has the same directions.  A shift of digits leaves one of 2^m points in each of 2^m strata."""
    plain, one, other = called(tmp_path, "sobol", *([1024, MOST_AXES, seed] for seed in (0, 1, 2)))
    expected = qmc.Sobol(MOST_AXES, scramble=False).random(1024).T
    assert np.abs(np.array(plain) - expected).max() < 2.0**-30
    for columns in (one, other):
        for column in columns:
            assert sorted(int(1024 * at) for at in column) == list(range(1024))
    assert not np.array_equal(one, other)


def priced() -> Iterator[dict[str, Any]]:
    """Designs that state what half-widths cost, in each of the ways."""
    demo = yaml.safe_load(DEMO)
    yield demo
    yield yaml.safe_load((EXAMPLES / "locators_321.yaml").read_text(encoding="utf-8"))
    square, steep = {"curve": "reciprocal_square", "weight": 0.2}, {"curve": "exponential", "weight": 300.0}
    curves = {
        "rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5, "cost": {**steep, "scale_deg": 0.1}},
        "translation_bounds": {"min_mm": 0.01, "max_mm": 0.5, "cost": square},
        "tolerances": [
            {"interface": "connector_flange", "component": "rz", "min_deg": 0.1, "max_deg": 1.0, "cost_weight": 3.0}
        ],
        "count": {"min": 8, "max": 16, "cost_per_fiducial": 20.0},
    }
    yield {**demo, "optimise": {**demo["optimise"], **curves}}
    grades = [{"name": str(h), "half_width_deg": h, "price": 10 / h} for h in (0.05, 0.1, 0.2)]
    graded = [{"interface": "connector_flange", "component": c, "grades": grades} for c in ("rx", "ry")]
    section = {key: value for key, value in demo["optimise"].items() if key != "rotation_bounds"}
    yield {**demo, "optimise": {**section, "tolerances": graded}}


def price(data: dict[str, Any]) -> float:
    return merit_as_written(read_request(load_design(data)))


def test_a_cost_is_what_the_optimiser_counts(tmp_path: Path) -> None:
    cases = []
    for data in priced():
        seat = data["interfaces"]["structure_connector"]
        at = "/interfaces/structure_connector/" + (
            "locators/0/half_width_mm" if "locators" in seat else "tolerances/rx/half_width_deg"
        )
        cases += [(data, {}), (data, {at: 0.7 * value_at(data, path_of(at))})]
    found = called(tmp_path, "cost", *cases)
    for (data, other), cost in zip(cases, found, strict=True):
        for pointer, value in other.items():
            data = replaced(data, path_of(pointer), value)
        assert cost == pytest.approx(price(data), rel=1e-9)
    without = {key: value for key, value in yaml.safe_load(DEMO).items() if key != "optimise"}
    assert called(tmp_path, "cost", [without, {}]) == [None]


def test_axes_have_the_designs_bounds_and_grades_and_move_what_they_are_called_after(tmp_path: Path) -> None:
    *_, graded = priced()
    widths = [{"path": POINTER.split("/")[1:], "label": "flange, rx", "unit": "°"}]
    demo = yaml.safe_load(DEMO)
    places = np.array([point["position_mm"] for point in demo["fiducials"]["points"]])
    middle, moved = places.mean(axis=0), places.copy()
    moved[1, 1] += 0.1
    larger = (1.2 * (places - middle) + middle).round(3)
    layouts = [[{"position_mm": at} for at in each.tolist()] for each in (larger, moved)]
    others = [demo, *({**demo, "fiducials": {**demo["fiducials"], "points": each}} for each in layouts)]
    others.append(replaced(demo, ["views", 0, "fiducial_noise_px"], 0.4))
    plain, grades = called(tmp_path, "axes", [demo, widths, *others], [graded, widths])
    of = {axis["key"]: axis for axis in plain}
    assert [of[POINTER]["low"], of[POINTER]["high"], of[POINTER]["now"]] == [0.01, 0.5, 0.2]
    noise = of["/views/*/fiducial_noise_px"]
    assert noise["paths"] == [["views", k, "fiducial_noise_px"] for k in (0, 1)]
    assert [of["/targets/0/position_mm/2"][end] for end in ("low", "now", "high")] == [50, 70, 90]
    for axis in plain:
        assert all(axis["low"] <= value <= axis["high"] for value in axis["drawn"])
    size = of["size"]
    assert np.array_equal(np.reshape(size["here"], (-1, 3)), places)
    assert size["read"] == [size["now"], pytest.approx(1.2 * size["now"], abs=2e-3), None, size["now"]]
    assert noise["read"] == [0.3, 0.3, 0.3, None]  # one of two is no value of both
    placed = np.reshape(size["placed"], (-1, 3))
    assert max(np.linalg.norm(placed[:, None] - placed[None], axis=2).flat) == pytest.approx(size["drawn"][1], abs=2e-3)
    assert placed.mean(axis=0) == pytest.approx(middle, abs=1e-3)
    assert {axis["key"]: axis for axis in grades}[POINTER]["drawn"] == [0.05, 0.05, 0.2]


def test_what_is_kept_is_in_every_range_and_the_picture_counts_just_that(tmp_path: Path) -> None:
    """Each mask after another one; expected counts of the picture are those of a picture of these rows alone."""
    draw = random.Random(5)
    columns = [[draw.choice([None, draw.uniform(-1, 1)]) for _ in range(200)] for _ in range(3)]
    ranges = [[-0.5, None], None, [None, 0.25]]
    (kept,) = called(tmp_path, "kept", [columns, ranges])
    a, b, c = np.array(columns, dtype=float)
    assert kept == ((a >= -0.5) & np.isfinite(b) & (c <= 0.25)).astype(int).tolist()
    lines = [[draw.choice([-1, *range(40)]) for _ in range(200)] for _ in range(3)]
    masks = [[int(draw.random() < part) for _ in range(200)] for part in (1, 0.5, 0.45, 0.02, 0, 0.9, 1)]
    (pictures,) = called(tmp_path, "picture", [[4, 30, 41], 40, lines, masks])
    assert all(same for same, _ in pictures)
    assert pictures[4][1] == 0 < pictures[3][1] < pictures[0][1]


# --- in a browser -----------------------------------------------------------------------------------------------------


def seen(service: Served, scenario: str, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, DEMO, script="many.mjs", **more)


def rows_of(text: str) -> list[dict[str, float]]:
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(io.StringIO(text))]


def scored(row: dict[str, float]) -> float:
    """P95 of the demo with a row's numbers in it."""
    data = yaml.safe_load(DEMO)
    for pointer, value in row.items():
        if pointer.startswith("/"):
            names = [pointer.replace("*", str(k)) for k in (0, 1)] if "*" in pointer else [pointer]
            for name in names:
                data = replaced(data, path_of(name), value)
    return score(load_design(data), losses=False).targets[0].p95_mm


P95, COST = "P95 of tip-accuracy, mm", "cost"


def test_a_sample_is_scored_brushed_by_typed_numbers_and_one_of_it_taken(service: Served) -> None:
    found = seen(service, "typed", count=200, cost=8000, p95=1.05, axe=True)
    rows = rows_of(found["csv"])
    assert found["kept"] == f"{len(rows)} of 200 kept" != found["first"]
    assert all(row[COST] <= 8000 and row[P95] <= 1.05 for row in rows)
    assert [row[COST] for row in rows] == sorted(row[COST] for row in rows)
    for row in rows[:: len(rows) // 3]:
        assert row[P95] == pytest.approx(scored(row), rel=1e-6)
    assert found["sorted"] == "ascending"
    assert [found["steps"], found["undone"], found["present"], found["old"]] == [1, True, 1, 0]
    taken = load_design(found["text"])
    assert found["p95"] == pytest.approx(score(taken).targets[0].p95_mm, rel=1e-6)
    assert found["p95"] == pytest.approx(rows[0][P95], rel=1e-6)
    assert price(yaml.safe_load(found["text"])) == pytest.approx(rows[0][COST])
    assert float(found["now"]) == pytest.approx(rows[0][COST], rel=1e-3)  # "Now" is all of one design
    assert found["axes"][0] == found["axes"][1]
    assert found["axe"] == []
    assert found["watched"]["messages"] == []


def test_an_answer_that_comes_when_nobody_waits_for_it_any_more_is_no_error(service: Served) -> None:
    found = seen(service, "left")
    assert found["rest"] >= 2
    assert found["watched"]["messages"] == []


@pytest.mark.long
def test_a_brush_is_dragged_and_a_line_pressed_and_another_change_makes_all_of_it_grey(service: Served) -> None:
    axis = "structure connector, rx"
    found = seen(service, "pointer", count=500, axis=axis)
    assert found["all"] == "500 of 500 kept"
    (low, high), kept, redrawn = found["middle"]
    assert [float(low), float(high)] == pytest.approx([0.01 * 50**0.25, 0.01 * 50**0.75], rel=0.05)
    assert float(re.match(r"\d+", kept)[0]) == pytest.approx(250, abs=20)  # type: ignore[index]
    assert redrawn
    assert found["limit"][0] == ["", "1"]
    assert found["pressed"][0] == ["", ""]
    steps, p95, old = found["taken"]
    assert [steps, old] == [1, 0]
    assert float(re.search(r"tip-accuracy ([\d.]+) mm", found["near"])[1]) == pytest.approx(p95, rel=1e-3)  # type: ignore[index]
    assert found["other"] == [1, 1, True, []]


@pytest.mark.long
def test_places_of_a_target_make_a_map_and_a_place_without_an_answer_says_why(service: Served) -> None:
    found = seen(service, "where", count=400, axes=["tip, x", "tip, y"], far=4000)
    rows = rows_of(found["csv"])
    assert found["none"] == 1
    assert rows
    for row in rows[:: len(rows) // 3]:
        assert row[P95] == pytest.approx(scored(row), rel=1e-6)
    (why,) = found["whys"]
    assert why.startswith(f"{400 - len(rows)} could not be scored")
    assert "outside view" in why
    assert found["map"] > 0
    assert "tip, x" in found["caption"]
    assert [found["axe"], found["wide"], found["wrong"]] == [[], 0, "true"]


@pytest.mark.long
def test_a_kill_in_the_middle_is_said_and_a_change_of_the_design_stops_it(tmp_path: Path, browser: None) -> None:
    with served(tmp_path) as running, ExitStack() as stack:
        page = stack.enter_context(playing("many.mjs", **asked(running.url, "killed", count=20_000)))
        assert page.said() == "kill"
        os.kill(running.pid, signal.SIGKILL)
        running.process.wait(LIMIT_SECONDS)
        assert page.said() == "told"
        stack.enter_context(running.again())
        found = page.found()
    assert found["problems"] == 0
    assert found["stopped"] == [1, 0]

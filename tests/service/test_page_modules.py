"""Modules of the page that need no browser, run by Node, say what Python says.

Whichever C-arm is offered, an ordinary table of beads gets a first design that scores: the command's and the
page's; and what an edit on the page takes off the list of what nobody stated.
"""

from __future__ import annotations

import copy
import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from page_in_node import SOURCES as PAGE
from page_in_node import call_page

from plain_data import DEMO, places_of, replaced, value_at
from tailstack import load_design, score
from tailstack.design import check_design
from tailstack.design.loading import follow_changes, list_assumed
from tailstack.design.presets import PRESETS, list_presets
from tailstack_service.first_design import Beads, design_of_beads

TABLES = [(kind, size_mm) for kind in ("cube", "plate", "tube", "tower", "away") for size_mm in (40, 60, 80, 100, 120)]


def table(kind: str, size_mm: int) -> Beads:
    """Eight beads as carriers have them: on a cube, a plate of two levels, a tube, a tower, and far from the origin."""
    draw = random.Random(f"{kind} {size_mm}")
    sides = {"plate": (1, 1, 0.35), "tube": (0.6, 0.6, 1), "tower": (0.5, 0.4, 1)}.get(kind, (1, 1, 1))
    shift = (130.0, -45.0, 260.0) if kind == "away" else (0.0, 0.0, 0.0)
    corners = [((k & 1) - 0.5, (k >> 1 & 1) - 0.5, (k >> 2 & 1) - 0.5) for k in range(8)]
    points = []
    for corner in corners:
        axes = zip(corner, sides, shift, strict=True)
        points.append(tuple(round(size_mm * s * c * draw.uniform(0.7, 1.0) + d, 2) for c, s, d in axes))
    labels = tuple(f"B{k}" for k in range(1, 9))
    return Beads(labels, points, "beads.csv")  # type: ignore[arg-type]


def judged(text: str) -> None:
    """A full answer: everything is imaged, and a verdict with a number comes back."""
    design = load_design(text)
    _, findings, views = check_design(design)
    assert not [view.outside for view in views if view.outside]
    assert not [finding for finding in findings if finding.rule in ("implausible-distance", "outside-view")]
    target = score(design).targets[0]
    assert 0 < target.p95_mm < 10


@pytest.mark.parametrize("preset", PRESETS)
def test_every_c_arm_answers_every_ordinary_table(preset: str) -> None:
    for kind, size_mm in TABLES:
        judged(design_of_beads(table(kind, size_mm), preset))


SCRIPT = """
const { firstDesign } = require("./first");
answer(asked.map(({ points, stated, ...wishes }) =>
  firstDesign(points, "beads.csv", { ...wishes, stated: new Set(stated) })));
"""


def page_texts(folder: Path, asked: list[dict[str, Any]]) -> list[str]:
    return call_page(folder, ("first",), SCRIPT, asked)


def wish(beads: Beads, arm: dict[str, Any], *stated: str, limit_mm: float = 1.0) -> dict[str, Any]:
    rows = zip(beads.labels, beads.positions_mm, strict=True)
    points = [{"label": label, "position_mm": list(at)} for label, at in rows]
    return {"points": points, "arm": arm, "limit_mm": limit_mm, "stated": list(stated)}


def test_the_page_writes_what_the_command_writes_for_every_c_arm_and_table(tmp_path: Path) -> None:
    cases = [(arm, table(kind, size_mm)) for arm in list_presets() for kind, size_mm in TABLES]
    for (arm, beads), text in zip(cases, page_texts(tmp_path, [wish(beads, arm) for arm, beads in cases]), strict=True):
        made, wanted = yaml.safe_load(text), yaml.safe_load(design_of_beads(beads, arm["name"]))
        assert made.pop("name") == "first design of beads.csv"
        del wanted["name"]
        assert made == wanted, (arm["name"], beads)


def test_ones_own_c_arm_answers_and_what_was_typed_is_not_assumed(tmp_path: Path) -> None:
    own = {"source_detector_mm": 1080, "source_isocentre_mm": 610, "pixel_mm": 0.4, "image_size_px": [768, 600]}
    cases = [(table(kind, size_mm), tuple(own)[:typed]) for kind, size_mm in TABLES for typed in (0, 4)]
    texts = page_texts(tmp_path, [wish(beads, own, "arm", "limit_mm", *typed, limit_mm=1.5) for beads, typed in cases])
    for (_, typed), text in zip(cases, texts, strict=True):
        judged(text)
        data = yaml.safe_load(text)
        assert "/requirements/0/limit_mm" not in data["assumed"]
        for field in own:
            as_typed = data["views"][0][field] == own[field]
            assert as_typed or field == "source_isocentre_mm", "only where the structure stands may be moved"
            assert (f"/views/0/{field}" in data["assumed"]) == (not typed or not as_typed)


def test_the_place_of_the_module_is_alone() -> None:
    """The page's text is a function of what it is given: its source imports nothing but types."""
    source = Path(PAGE / "src" / "first.ts").read_text(encoding="utf-8")
    assert [line for line in source.splitlines() if line.startswith("import ") and "import type" not in line] == []


# --- what an edit takes off the list of what nobody stated ----------------------------------------


LISTS = (
    ["/views", "/interfaces", "/targets/0/position_mm"],
    ["/fiducials", "/views/1/fiducial_noise_px"],
    ["/execution"],
)
SCRIPT_OF_LISTS = """
const { stating, confirming, listAssumed } = require("./assumed"), { withEdits } = require("./document");
answer(asked.map(({ data, edits, confirm }) => {
  const after = withEdits(data, confirm ? confirming(data, confirm) : stating(data, edits));
  return { after, listed: listAssumed(after) };
}));
"""


def test_every_edit_of_the_page_takes_off_what_the_library_takes_off(tmp_path: Path) -> None:
    """Each number of the demo set anew, and each said again as it is, under three lists."""
    asked, wanted = [], []
    for pointers in LISTS:
        data = {**DEMO, "assumed": pointers}
        for path in places_of(DEMO):
            value = value_at(DEMO, path)
            if isinstance(value, dict | list):
                continue
            pointer = "".join(f"/{step}" for step in path)
            for new in {value, value + 0.125 if isinstance(value, float | int) else "other"}:
                asked.append({"data": data, "edits": [{"path": path, "value": new}]})
                wanted.append(follow_changes(data, replaced(data, path, new), pointer))
    found = call_page(tmp_path, ("assumed", "document"), SCRIPT_OF_LISTS, asked)
    assert [each["after"] for each in found] == wanted
    assert [each["listed"] for each in found] == [list(list_assumed(each)) for each in wanted]
    assert len({str(each.get("assumed")) for each in wanted}) > 60


def test_an_item_that_goes_leaves_the_others_assumed_where_they_are_then(tmp_path: Path) -> None:
    """independent: values are told by what they are, which is different everywhere."""
    data = copy.deepcopy(DEMO)
    for k, view in enumerate(data["views"]):
        view["fiducial_noise_px"] = 0.5 + k
    data["views"].append({**data["views"][1], "name": "third", "fiducial_noise_px": 2.5})
    data["assumed"] = ["/views/0/fiducial_noise_px", "/views/1/fiducial_noise_px", "/views/2", "/fiducials/points"]
    asked = [{"data": data, "edits": [{"path": ["views", k]}]} for k in range(3)]
    asked.append({"data": data, "edits": [{"path": ["fiducials", "points", 0]}]})
    for k, found in enumerate(call_page(tmp_path, ("assumed", "document"), SCRIPT_OF_LISTS, asked)):
        after, listed = found["after"], found["listed"]
        assert list(list_assumed(after)) == listed
        noises = {
            after["views"][int(at.split("/")[2])]["fiducial_noise_px"] for at in listed if at.endswith("l_noise_px")
        }
        assert noises == {0.5, 1.5, 2.5} - ({0.5 + k} if k < 3 else set())
        assert sum(at.startswith("/fiducials/points") for at in listed) == len(after["fiducials"]["points"])


def test_a_word_that_it_is_so_takes_off_one_value_and_changes_nothing_else(tmp_path: Path) -> None:
    data = {**DEMO, "assumed": LISTS[0]}
    values = list(list_assumed(data))
    found = call_page(
        tmp_path, ("assumed", "document"), SCRIPT_OF_LISTS, [{"data": data, "confirm": at} for at in values]
    )
    for at, each in zip(values, found, strict=True):
        assert each["listed"] == [other for other in values if other != at]
        assert {**each["after"], "assumed": None} == {**data, "assumed": None}


WRITTEN = """
const { writeEdits, writeYaml } = require("./document");
const json = JSON.stringify(asked.data), name = [{ path: ["name"], value: asked.name }];
answer([writeYaml({ ...asked.data, name: asked.name }), writeEdits(json, name).text]);
"""
UNSEEN = "".join(map(chr, (0x61C, 0x200E, 0x202A, 0x202E, 0x2066, 0x2069, 0xFEFF)))


def test_a_sign_that_is_not_shown_is_written_so_that_it_can_be_read_again(tmp_path: Path) -> None:
    data = {**DEMO, "description": f'it says "{UNSEEN}"'}
    asked = {"data": data, "name": f"{UNSEEN} carrier"}
    for text in call_page(tmp_path, ("document",), WRITTEN, asked):
        assert load_design(text).source.data == {**data, "name": asked["name"]}

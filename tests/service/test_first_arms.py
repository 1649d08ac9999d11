"""Whichever C-arm is offered, an ordinary table of beads gets a first design that scores: the command's and the page's.

The page's text is made by its own source; that of the command in this process, and both say the same.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from page_modules import PAGE, call_page

from tailstack import load_design, score
from tailstack.design import check_design
from tailstack.design.presets import PRESETS, list_presets
from tailstack_service.first_design import Beads, design_of_beads

TABLES = [(kind, size_mm) for kind in ("cube", "plate", "tube", "tower", "away") for size_mm in (40, 60, 80, 100, 120)]


def table(kind: str, size_mm: int, count: int = 8) -> Beads:
    """Beads as carriers have them: on a cube, a plate of two levels, a tube, a tower, and far from the origin."""
    draw = random.Random(f"{kind} {size_mm}")
    sides = {"plate": (1, 1, 0.35), "tube": (0.6, 0.6, 1), "tower": (0.5, 0.4, 1)}.get(kind, (1, 1, 1))
    shift = (130.0, -45.0, 260.0) if kind == "away" else (0.0, 0.0, 0.0)
    corners = [((k & 1) - 0.5, (k >> 1 & 1) - 0.5, (k >> 2 & 1) - 0.5) for k in range(count)]
    points = []
    for corner in corners:
        axes = zip(corner, sides, shift, strict=True)
        points.append(tuple(round(size_mm * s * c * draw.uniform(0.7, 1.0) + d, 2) for c, s, d in axes))
    labels = tuple(f"B{k}" for k in range(1, count + 1))
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
    texts: list[str] = call_page(folder, ("first",), SCRIPT, asked)
    return texts


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

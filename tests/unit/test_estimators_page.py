"""What docs/estimators.md and docs/layouts.md say in numbers is what is computed, and is named in the changelog."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_chain import run
from scenes import cube_fiducials, system_of, with_intrinsics, with_noise
from tailstack import load_design, score
from tailstack.propagation.linear import linearise
from tailstack.studies.estimators import study_estimators
from tailstack.system import Estimator, System

ROOT = Path(__file__).resolve().parents[2]
PAGE = " ".join((ROOT / "docs" / "estimators.md").read_text(encoding="utf-8").split())


def told(system: System, estimator: Estimator, prior: tuple[float, float] | None, bias: float = 0.0) -> System:
    """Under an estimator that is told so much of the intrinsics, and is wrong by it."""
    system = replace(system, estimator=estimator)
    if not (prior or bias):
        return system
    wide = [prior[0], prior[1], prior[1]] if prior else (0.0, 0.0, 0.0)
    return with_intrinsics(system, wide, [bias, 0.0, 0.0], prior=prior)


def p95(system: System) -> float:
    return score(system).targets[0].p95_mm


@pytest.mark.parametrize("half", [50, 30, 20, 10])
def test_a_row_of_the_table_is_what_is_computed(half: int) -> None:
    cube = system_of(cube_fiducials(half), views=with_noise(0.5))
    rough, good = (0.01, 10.0), (0.002, 2.0)
    found = [
        p95(told(cube, Estimator.DLT, None)),
        p95(told(cube, Estimator.REPROJECTION, None)),
        p95(told(cube, Estimator.POSE_WITH_PRIOR, rough)),
        p95(told(cube, Estimator.POSE_WITH_PRIOR, good)),
        p95(told(cube, Estimator.POSE, None)),
    ]
    wrong = told(cube, Estimator.POSE, None, bias=0.01)
    off = float(np.linalg.norm(linearise(wrong, wrong.targets[0]).tcp_bias_mm))
    row = "".join(f" {value:.4f} |" for value in found)
    assert f"| {half} |{row} {off:.3f} |" in PAGE
    if half == 50:
        estimated = float(np.linalg.norm(run(wrong, wrong.targets[0], {})["tcp"]))
        assert f"is {off:.4f} mm off by this, and {estimated:.4f} mm by estimating" in PAGE
        perfect = told(system_of(cube_fiducials(half), views=with_noise(1e-6, 0.5)), Estimator.POSE, None)
        assert f"Target pixels alone make {p95(perfect):.3f}." in PAGE


def test_what_knowing_is_worth_to_the_drill_guide_is_what_the_study_says() -> None:
    study = study_estimators(load_design(ROOT / "examples" / "demo.yaml"))
    dlt, prior = (next(case for case in study.cases if case.estimator == name) for name in ("dlt", "pose_with_prior"))
    assert f"The drill guide goes from {dlt.p95_mm:.3f} to {prior.p95_mm:.3f} mm" in PAGE
    assert f"Its structure of {study.extent_mm:.0f} mm could shrink to {prior.same_size_mm:.0f} mm" in PAGE


def test_the_changelog_quotes_the_layouts_that_the_page_shows() -> None:
    """The two statements that hold for dlt alone now, in the numbers of the last table of layouts."""
    table = (ROOT / "docs" / "layouts.md").read_text(encoding="utf-8").partition("## 8.")[2]
    rows, estimator = {}, ""
    for cells in re.findall(r"^\|(.+)\|$", table, re.MULTILINE):
        first, edge, *values = (cell.strip() for cell in cells.split("|"))
        estimator = first or estimator
        if edge.isdecimal():
            rows[estimator.split("`")[1], int(edge)] = [float(re.findall(r"[\d.]+", value)[0]) for value in values]
    changes = " ".join((ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split())
    small = rows["dlt", 30][0], rows["pose_with_prior", 30][0]
    assert f"a box of 30 mm goes from {small[0]:.2f} to {small[1]:.2f} mm with known intrinsics" in changes
    optimal, _, careless, *_ = rows["pose", 100]
    assert f"under `pose` {100 * (careless / optimal - 1):.0f} % at 100 mm" in changes

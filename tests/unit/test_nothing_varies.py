"""Designs in which nothing varies: a covariance of zero is an answer, and what determines nothing is still found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from scenes import cube_fiducials, mount, read_only, system_of, with_noise
from tailstack import load_design, score, verify
from tailstack.design import compile_design

DEMO = yaml.safe_load((Path(__file__).parents[2] / "examples" / "demo.yaml").read_text())
SHIFT = (0.0, 0.0, 0.0, 0.07, 0.0, 0.0)


def still(bias=(0.0,) * 6, points=None, **changes):
    """Eight beads or others, exact images, exact beads, and a seat that is only known to be off."""
    points = cube_fiducials() if points is None else points
    seat = mount("structure_connector", (0.0, 0.0, -95.0), bias=bias)
    return system_of(points, views=with_noise(0.0), structure_connector=seat, **changes)


@pytest.mark.parametrize(("bias", "moved"), [(SHIFT, 0.07), ((0.0,) * 6, 0.0)])
def test_a_loss_leaves_the_error_what_it_is(bias, moved):
    """closed_form: the structure is 0.07 mm off, and six or seven beads without noise find that as eight do."""
    (line,) = score(still(bias)).losses
    assert line.value_mm == pytest.approx(moved, abs=1e-9)
    for loss in (line.single, line.double):
        assert loss.reason == ""
        assert loss.value_mm == pytest.approx(moved, abs=1e-9)


def test_what_determines_nothing_is_found_though_nothing_varies():
    """closed_form: of a plane of seven and two beads above it, without either of the two the others say nothing."""
    flat = [(x, y, 0.0) for x, y in ((-40, -40), (40, -35), (-35, 40), (40, 40), (0, 10), (20, -5), (-10, 25))]
    points = read_only(np.array([*flat, (5.0, 5.0, 40.0), (-20.0, 10.0, 35.0)]) - [0, 0, 60])
    (line,) = score(still(SHIFT, points)).losses
    assert line.single.value_mm is None
    assert line.single.lost in (("F8",), ("F9",))
    assert "lie in one plane" in line.single.reason


def test_shots_with_missed_beads_have_an_answer():
    """closed_form: 0.98^8 of the shots miss nothing, and all that keep six beads or more err by the bias."""
    system = still(SHIFT, loss_probability=(0.02,) * 8)
    (line,) = score(system).losses
    assert line.mixture.value_mm == pytest.approx(0.07, abs=1e-9)
    found = verify(system, trials=2000).targets[0]
    assert found.p95_mm == pytest.approx(0.07, abs=1e-9)


def test_a_design_that_says_so_in_its_document():
    views = [view | {"fiducial_noise_px": 0, "target_noise_px": 0} for view in DEMO["views"]]
    seat = {
        "pivot_mm": [0, 0, -95],
        "bias": {"tx_mm": 0.07},
        "tolerances": {"tx": {"half_width_mm": 0, "distribution": "uniform"}},
    }
    data = {name: DEMO[name] for name in ("schema", "name", "targets")} | {
        "views": views,
        "fiducials": {"points": DEMO["fiducials"]["points"]},
        "interfaces": {"structure_connector": seat},
    }
    (line,) = score(replace(compile_design(load_design(data)), requirements=())).losses
    assert [line.single.value_mm, line.double.value_mm] == pytest.approx([0.07, 0.07], abs=1e-9)

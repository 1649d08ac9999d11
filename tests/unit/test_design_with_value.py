"""A design with another value: checked anew, refused with a pointer, and the first one stays as it is."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from plain_data import EXAMPLES, problems_of
from tailstack import DesignError, load_design, score
from tailstack.sweeping import read_axes, sweep

DEMO = load_design(EXAMPLES / "demo.yaml")


@pytest.mark.parametrize(
    "path", ["/views/0/fiducial_noise_px", "views.AP.fiducial_noise_px", "views.0.fiducial_noise_px"]
)
def test_a_pointer_and_a_path_of_names_change_the_same_number(path: str) -> None:
    changed = DEMO.with_value(path, 0.7)
    assert [view.fiducial_noise_px for view in changed.document.views] == [0.7, 0.3]
    assert [view.fiducial_noise_px for view in DEMO.document.views] == [0.3, 0.3]
    text = (EXAMPLES / "demo.yaml").read_text().replace("fiducial_noise_px: 0.3", "fiducial_noise_px: 0.7", 1)
    assert changed.sha256 == load_design(text).sha256 != DEMO.sha256


def test_a_star_changes_every_element() -> None:
    changed = DEMO.with_value("views.*.target_noise_px", np.float64(0.1))
    assert [view.target_noise_px for view in changed.document.views] == [0.1, 0.1]


def test_what_the_document_leaves_to_its_default_can_be_set() -> None:
    assert "model" not in yaml.safe_load((EXAMPLES / "demo.yaml").read_text())
    assert DEMO.with_value("model.rotation", "small_angle").document.model.rotation == "small_angle"


def test_lists_and_mappings_can_be_set() -> None:
    moved = DEMO.with_value("fiducials.points.0.position_mm", (-41.0, 30, -60))
    assert moved.fiducials.positions_mm[0] == (-41.0, 30.0, -60.0)
    tighter = DEMO.with_value("requirements", [{"name": "tip-accuracy", "limit_mm": 0.5}])
    assert score(tighter).verdict.checks[0].limit_mm == 0.5


@pytest.mark.parametrize(
    ("path", "value", "pointer", "code", "words"),
    [
        ("views.AP.fiducial_noise_px", -1.0, "/views/0/fiducial_noise_px", "out-of-range", "0"),
        ("views.AP.fiducial_noise_px", "0.3", "/views/0/fiducial_noise_px", "wrong-type", "number"),
        ("views.AP.fiducial_noise_mm", 0.3, "/views/0/fiducial_noise_mm", "unknown-field", "fiducial_noise_px"),
        ("view.0.fiducial_noise_px", 0.3, "/view/0/fiducial_noise_px", "not-found", "views.AP.fiducial_noise_px"),
        ("view", [], "/view", "unknown-field", "views"),
        ("/views/7/fiducial_noise_px", 0.3, "/views/7/fiducial_noise_px", "not-found", "in views there is AP, LAT"),
        ("views.OBLIQUE.fiducial_noise_px", 0.3, "/views/OBLIQUE/fiducial_noise_px", "not-found", "there is AP, LAT"),
        ("name.x", 1, "/name/x", "not-found", "no /name/x"),
        ("schema", "tailstack/design/9", "/schema", "unsupported-schema", "tailstack/design/1"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_with_its_pointer(
    path: str, value: object, pointer: str, code: str, words: str
) -> None:
    problem = problems_of(DEMO.with_value, path, value, error=DesignError)[0]
    assert (problem.pointer, problem.code) == (pointer, code)
    assert words in f"{problem.detail} {problem.hint}"


def test_fiducials_from_a_file_stay_and_say_where_they_are() -> None:
    design = load_design(EXAMPLES / "small_cluster_far_target.yaml")
    changed = design.with_value("views.AP.fiducial_noise_px", 0.4)
    assert changed.fiducials.positions_mm == design.fiducials.positions_mm
    with pytest.raises(DesignError, match="the points stand in a file"):
        design.with_value("fiducials.points.0.position_mm", [0, 0, 0])


def test_a_sweep_takes_values_by_path() -> None:
    """independent: the same axis read as the command reads it."""
    by_path = sweep(DEMO, {"views.AP.fiducial_noise_px": np.array([0.1, 0.5])})
    axes = read_axes(DEMO, [{"pointer": "/views/0/fiducial_noise_px", "values": [0.1, 0.5]}])
    assert by_path == sweep(DEMO, axes)
    alone = score(DEMO.with_value("views.AP.fiducial_noise_px", 0.5)).targets[0].p95_mm
    assert by_path.points[1].targets[0].p95_mm == alone

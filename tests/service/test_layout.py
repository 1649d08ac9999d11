"""Where everything is: images against a pinhole written here, and against what a score says of them."""

from __future__ import annotations

import copy
from itertools import combinations
from math import dist

import numpy as np
import pytest
import yaml
from service_scenes import ROOT, client_with

from tailstack.design import load_design
from tailstack.errors import IllPosedError
from tailstack.scoring import score
from tailstack_service.documents import to_json
from tailstack_service.operations.layout import lay_out
from tailstack_service.report.scene import scene_data, scene_of

DEMO = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text(encoding="utf-8"))


def without_bias():
    design = copy.deepcopy(DEMO)
    del design["interfaces"]["structure_connector"]["bias"]
    return design


def test_images_are_those_of_a_pinhole():
    """AP of the example: source 700 mm from the isocentre on one axis of con, detector at 1020 mm, pitch 0.194 mm."""
    found = lay_out(load_design(without_bias()))
    for view in found.views:
        source = np.array(view.source_mm)
        assert np.linalg.norm(source) == pytest.approx(700)
        axis = -source / 700
        for point, image in zip(found.fiducials, view.fiducials, strict=True):
            along = (np.array(point.position_mm) - source) @ axis
            across = np.linalg.norm(np.array(point.position_mm) - source - along * axis)
            centre = np.array([1536, 1536]) / 2
            radius = across / along * 1020 / 0.194
            assert abs(np.linalg.norm(np.array(image.image_px) - centre) - radius) < 1.0  # the centre is 767.5 or 768
    axes = [np.array(view.source_mm) / 700 for view in found.views]
    assert axes[0] @ axes[1] == pytest.approx(0, abs=1e-12)


def test_projections_image_the_points_that_are_listed():
    found = lay_out(load_design(DEMO))
    for view in found.views:
        for matrix, points, images in (
            (view.projection, found.fiducials, view.fiducials),
            (view.target_projection, found.targets, view.targets),
        ):
            for point, image in zip(points, images, strict=True):
                u, v, w = np.array(matrix) @ [*point.position_mm, 1]
                assert image.image_px == pytest.approx((u / w, v / w), abs=1e-9)


def test_a_known_bias_moves_fiducials_and_not_targets():
    plain, biased = lay_out(load_design(without_bias())), lay_out(load_design(DEMO))
    for before, after in zip(plain.views, biased.views, strict=True):
        assert before.targets == after.targets
        assert all(dist(a.image_px, b.image_px) > 1e-3 for a, b in zip(before.fiducials, after.fiducials, strict=True))


def test_images_agree_with_what_a_score_says_of_them():
    design = load_design(DEMO)
    found, record = lay_out(design), score(design)
    for view, check in zip(found.views, record.views, strict=True):
        closest = min(combinations(view.fiducials, 2), key=lambda pair: dist(pair[0].image_px, pair[1].image_px))
        assert {point.label for point in closest} == set(check.closest_pair)
        assert dist(closest[0].image_px, closest[1].image_px) == pytest.approx(check.closest_pair_px)


def test_a_bead_outside_the_image_is_said_to_be_where_a_score_refuses():
    design = copy.deepcopy(DEMO)
    design["fiducials"]["points"][2]["position_mm"] = [-26, 29, -120]
    with pytest.raises(IllPosedError, match="F3 is imaged at"):
        score(load_design(design))
    found = lay_out(load_design(design), scene=True)
    for view in found.views:
        assert [point.label for point in view.fiducials if not point.inside] == ["F3"]
    assert {item["layer"] for item in found.scene["items"]} & {"fiducials"}


@pytest.mark.long
def test_over_http_it_is_the_same():
    with client_with() as client:
        answer = client.post("/v1/layouts", json={"design": DEMO, "scene": True})
    assert answer.status_code == 200
    assert answer.content == to_json(lay_out(load_design(DEMO), scene=True))
    assert answer.json()["scene"]["items"]


@pytest.mark.parametrize("name", ["demo.yaml", "gallery/third_view.yaml"])
def test_the_errors_in_space_are_those_of_the_score(name):
    """To the last digit, though the layout leaves out most of what a score computes."""
    design = load_design(ROOT / "examples" / name)
    whole = scene_data(scene_of(design, score(design), design.name))
    assert lay_out(design, scene=True).scene == whole

"""Designs to begin with and published geometries, as a page offers them, and where everything of a design is."""

from __future__ import annotations

from itertools import combinations
from math import dist

import httpx
import numpy as np
import pytest
from service_scenes import EXAMPLES, check_problem, small_design

from plain_data import DEMO, REMOVED, replaced
from tailstack import load_design
from tailstack.errors import IllPosedError
from tailstack.scoring import score
from tailstack_service.documents import to_json
from tailstack_service.report.chapters.coordinates import lay_out
from tailstack_service.report.scene import scene_data, scene_of


def test_what_no_layout_undercuts_is_told_where_it_is_asked_for(client: httpx.Client) -> None:
    body = {"design": client.get("/v1/examples/demo").json(), "bound": True}
    answer = client.post("/v1/validations", json=body)
    assert answer.status_code == 200, answer.text
    assert [bound["requirement"] for bound in answer.json()["bounds"]] == ["tip-accuracy"]
    assert answer.json()["cheapest"]["statement"].startswith("To first order, no layout of 12 fiducials")
    told = client.post("/v1/validations", json=body | {"bound": False}).json()
    assert (told["bounds"], told["cheapest"]) == ([], None)


def test_every_example_is_answered_as_it_was_written(client: httpx.Client) -> None:
    listed = client.get("/v1/examples").json()["examples"]
    assert {"demo", "gallery-flat_plate", "paper-c_arm", "slicer_markups"} <= {entry["name"] for entry in listed}
    for entry in listed:
        path = EXAMPLES / f"{entry['name'].replace('-', '/', 1)}.yaml"
        data = client.get(entry["url"]).json()
        assert data["name"] == entry["title"], entry["name"]
        answer = client.get(entry["url"], headers={"Accept": "application/yaml"})
        assert (answer.headers["content-type"], answer.headers["vary"]) == ("application/yaml", "Accept")
        design = load_design(answer.text)
        assert design.sha256 == load_design(data).sha256 == load_design(path).sha256, entry["name"]
        assert design.document.fiducials.file is None
        wanted = [line for line in path.read_text(encoding="utf-8").splitlines() if line.lstrip().startswith("# ")]
        assert [line for line in answer.text.splitlines() if line.lstrip().startswith("# ")] == wanted[
            wanted[0].startswith("# yaml-language-server") :
        ], entry["name"]


def test_an_example_says_what_it_shows_and_an_unknown_one_which_there_are(client: httpx.Client) -> None:
    words = {entry["name"]: entry["description"] for entry in client.get("/v1/examples").json()["examples"]}
    assert words["gallery-flat_plate"] == "The classic mistake: ten beads on one plate."
    assert not [name for name, text in words.items() if "yaml-language-server" in text]
    assert all(text for name, text in words.items() if name.startswith("gallery-"))
    problem = check_problem(client.get("/v1/examples/demo.yaml"), 404, "not-found")
    assert "demo" in problem["errors"][0]["hint"]


def test_a_view_of_any_preset_with_what_it_must_state_is_valid(client: httpx.Client) -> None:
    stated = {"source_isocentre_mm": 600.0, "pixel_mm": 0.3, "image_size_px": [1024, 1024]}
    presets = client.get("/v1/presets").json()["presets"]
    assert "siemens-cios-fusion" in [preset["name"] for preset in presets]
    for preset in presets:
        views = [
            {"name": name, "preset": preset["name"], "orientation": name, "fiducial_noise_px": 0.3,
             "target_noise_px": 0.3, **{field: stated[field] for field in preset["view_must_state"]}}
            for name in ("AP", "LAT")
        ]  # fmt: skip
        answer = client.post("/v1/layouts", json={"design": small_design(views=views)})
        assert answer.status_code == 200, (preset["name"], answer.text)
        size = preset["image_size_px"] or stated["image_size_px"]
        assert answer.json()["views"][0]["image_size_px"] == size, preset["name"]


# --- where everything is --------------------------------------------------------------------------


WITHOUT_BIAS = replaced(DEMO, ("interfaces", "structure_connector", "bias"), REMOVED)


def test_images_are_those_of_a_pinhole():
    """AP of the example: source 700 mm from the isocentre on one axis of con, detector at 1020 mm, pitch 0.194 mm."""
    found = lay_out(load_design(WITHOUT_BIAS))
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
    plain, biased = lay_out(load_design(WITHOUT_BIAS)), lay_out(load_design(DEMO))
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
    design = replaced(DEMO, ("fiducials", "points", 2, "position_mm"), [-26, 29, -120])
    with pytest.raises(IllPosedError, match="F3 is imaged at"):
        score(load_design(design))
    found = lay_out(load_design(design), scene=True)
    for view in found.views:
        assert [point.label for point in view.fiducials if not point.inside] == ["F3"]
    assert {item["layer"] for item in found.scene["items"]} & {"fiducials"}


@pytest.mark.long
def test_over_http_it_is_the_same(client: httpx.Client) -> None:
    answer = client.post("/v1/layouts", json={"design": DEMO, "scene": True})
    assert answer.status_code == 200
    assert answer.content == to_json(lay_out(load_design(DEMO), scene=True))
    assert answer.json()["scene"]["items"]


@pytest.mark.parametrize("name", ["demo.yaml", "gallery/third_view.yaml", "pedicle_screw.yaml", "mean_and_tail.yaml"])
def test_the_errors_in_space_are_those_of_the_score(name):
    """To the last digit, though the layout leaves out most of what a score computes."""
    design = load_design(EXAMPLES / name)
    whole = scene_data(scene_of(design, score(design), design.name))
    assert lay_out(design, scene=True).scene == whole

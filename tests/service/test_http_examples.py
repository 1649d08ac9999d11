"""Designs to begin with and published geometries, as a page offers them."""

from __future__ import annotations

import httpx
import pytest
import yaml
from service_scenes import EXAMPLES, check_problem, small_design

from tailstack import load_design


@pytest.mark.long
def test_every_example_scores_as_it_is_answered(client: httpx.Client) -> None:
    listed = client.get("/v1/examples").json()["examples"]
    assert {"demo", "gallery-flat_plate", "paper-c_arm", "slicer_markups"} <= {entry["name"] for entry in listed}
    for entry in listed:
        design = client.get(entry["url"]).json()
        assert design["name"] == entry["title"], entry["name"]
        answer = client.post("/v1/validations", json={"design": design})
        assert answer.status_code == 200, (entry["name"], answer.text)
        path = EXAMPLES / f"{entry['name'].replace('-', '/', 1)}.yaml"
        assert answer.json()["design_sha256"] == load_design(path).sha256, entry["name"]


def test_every_example_is_answered_as_it_was_written(client: httpx.Client) -> None:
    for entry in client.get("/v1/examples").json()["examples"]:
        path = EXAMPLES / f"{entry['name'].replace('-', '/', 1)}.yaml"
        answer = client.get(entry["url"], headers={"Accept": "application/yaml"})
        assert (answer.headers["content-type"], answer.headers["vary"]) == ("application/yaml", "Accept")
        design = load_design(answer.text)
        assert design.sha256 == load_design(path).sha256, entry["name"]
        assert design.document.fiducials.file is None
        wanted = [line for line in path.read_text(encoding="utf-8").splitlines() if line.lstrip().startswith("# ")]
        assert [line for line in answer.text.splitlines() if line.lstrip().startswith("# ")] == wanted[
            wanted[0].startswith("# yaml-language-server") :
        ], entry["name"]


def test_an_example_says_what_it_shows(client: httpx.Client) -> None:
    words = {entry["name"]: entry["description"] for entry in client.get("/v1/examples").json()["examples"]}
    assert words["gallery-flat_plate"] == "The classic mistake: ten beads on one plate."
    assert not [name for name, text in words.items() if "yaml-language-server" in text]
    assert all(text for name, text in words.items() if name.startswith("gallery-"))


def test_an_unknown_example_is_404_with_the_names_that_there_are(client: httpx.Client) -> None:
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


@pytest.mark.long
def test_a_patch_of_an_example_is_laid_out(client: httpx.Client) -> None:
    """A page's first steps: an example, its score, a bead moved, where everything is then."""
    design = client.get("/v1/examples/demo").json()
    name = client.post("/v1/scores", json={"design": design}).json()["provenance"]["design_sha256"]
    points = [dict(point) for point in design["fiducials"]["points"]]
    points[0]["position_mm"] = [value + 1.0 for value in points[0]["position_mm"]]
    body = {"design_sha256": name, "patch": {"fiducials": {"points": points}}}
    layout = client.post("/v1/layouts", json=body).json()
    assert layout["fiducials"][0]["position_mm"] == points[0]["position_mm"]
    changed = yaml.safe_load((EXAMPLES / "demo.yaml").read_text(encoding="utf-8"))
    changed["fiducials"]["points"] = points
    whole = client.post("/v1/layouts", json={"design": changed})
    assert whole.json()["provenance"]["design_sha256"] == layout["provenance"]["design_sha256"]

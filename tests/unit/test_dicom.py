"""Views from headers of C-arm images: the geometry, what is missing or broken, and that nothing of a patient is read.

Expected: ``independent``; a point is projected here by meeting the detector's plane with its ray, the arm turned by
rotations of scipy, the image turned and flipped as an array is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from pydicom import uid
from scipy.spatial.transform import Rotation

from dicom_files import GEOMETRY, PATIENT, write_image
from plain_data import EXAMPLES, problems_of
from tailstack import load_design
from tailstack.design.compile import compile_design
from tailstack.errors import DesignError, TailstackError
from tailstack.integrations.dicom import NEEDED, TAGS, convert_shots, read_shot

DEMO = EXAMPLES / "demo.yaml"


def project(points: np.ndarray, tags: Mapping[str, Any]) -> np.ndarray:
    """(N, 2) column and row in the stored image of points (N, 3), mm about the isocentre, LPS."""
    arm = Rotation.from_euler("xz", [-float(tags["PositionerSecondaryAngle"]), float(tags["PositionerPrimaryAngle"])],
                              degrees=True).as_matrix()  # fmt: skip
    left, front, head = arm @ [1.0, 0, 0], arm @ [0, -1.0, 0], arm @ [0, 0, 1.0]  # of the detector, seen from it
    reach, focus = float(tags["DistanceSourceToDetector"]), float(tags["DistanceSourceToPatient"])
    source = -focus * front
    rays = points - source
    hits = rays * (reach / (rays @ front))[:, None]
    pitch, turns = float(tags["ImagerPixelSpacing"][0]), int(tags.get("FieldOfViewRotation", 0)) // 90
    height, width = tags["Rows"], tags["Columns"]
    if turns % 2:
        height, width = width, height
    column, row = hits @ left / pitch + (width - 1) / 2, (height - 1) / 2 - hits @ head / pitch
    for _ in range(turns):  # clockwise: the first column becomes the first row, read from below
        column, row, height, width = height - 1 - row, column, width, height
    if tags.get("FieldOfViewHorizontalFlip") == "YES":
        column = width - 1 - column
    return np.column_stack((column, row))


ACQUISITIONS: list[dict[str, Any]] = [
    {},
    {"PositionerPrimaryAngle": "0", "PositionerSecondaryAngle": "0"},
    {"PositionerPrimaryAngle": "90", "PositionerSecondaryAngle": "0", "FieldOfViewHorizontalFlip": "NO"},
    {"PositionerPrimaryAngle": "-90", "FieldOfViewHorizontalFlip": "YES"},
    {"PositionerPrimaryAngle": "-45.5", "PositionerSecondaryAngle": "90"},
    {"PositionerPrimaryAngle": "180", "PositionerSecondaryAngle": "-30", "Rows": 512, "Columns": 512},
    {"PositionerPrimaryAngle": "-135.25", "FieldOfViewRotation": "90"},
    {"PositionerSecondaryAngle": "41.875", "FieldOfViewRotation": "180", "ImagerPixelSpacing": ["0.154", "0.154"]},
    {"FieldOfViewRotation": "270", "FieldOfViewHorizontalFlip": "YES", "DistanceSourceToDetector": "1195.5"},
    {"DistanceSourceToPatient": "613.25", "FieldOfViewRotation": "90", "FieldOfViewHorizontalFlip": "YES"},
]
SYNTAXES = [uid.ExplicitVRLittleEndian, uid.ImplicitVRLittleEndian, uid.JPEGLosslessSV1, uid.ExplicitVRBigEndian]


def test_ten_acquisitions_give_the_projections_that_made_them() -> None:
    points = np.random.default_rng(1).uniform(-60, 60, (20, 3))
    files = [(write_image(SYNTAXES[k % 4], **changes), f"{k}.dcm") for k, changes in enumerate(ACQUISITIONS)]
    base = load_design(DEMO)
    made = convert_shots(files, "design.yaml", base)
    views = compile_design(load_design(made.text)).views
    isocentre = np.array(base.document.views[0].model_dump()["isocentre_mm"])
    assert len(views) == len(ACQUISITIONS)
    for k, (view, changes) in enumerate(zip(views, ACQUISITIONS, strict=True)):
        tags = GEOMETRY | changes
        middle = isocentre if k < len(base.document.views) else np.zeros(3)
        images = np.column_stack((points + middle, np.ones(len(points)))) @ view.projection.T
        images = images[:, :2] / images[:, 2:]
        if tags.get("FieldOfViewHorizontalFlip") != "YES":
            images[:, 0] = tags["Columns"] - 1 - images[:, 0]
        np.testing.assert_allclose(images, project(points, tags), rtol=1e-9, atol=1e-9)
        assert view.image_size_px == (tags["Columns"], tags["Rows"])


def test_an_image_in_other_encodings_is_the_same_shot() -> None:
    shots = [read_shot(write_image(syntax)[: 4000 if k else None], "a.dcm") for k, syntax in enumerate(SYNTAXES)]
    assert shots == shots[:1] * len(SYNTAXES)


@pytest.mark.parametrize("missing", [*([keyword] for keyword in NEEDED), [*NEEDED]])
def test_missing_tags_are_named_at_once_and_not_guessed(missing: list[str]) -> None:
    problems = problems_of(read_shot, write_image(**dict.fromkeys(missing)), "a.dcm", error=DesignError)
    for keyword, problem in zip(missing, problems, strict=True):
        number = f"({TAGS[keyword] >> 16:04X},{TAGS[keyword] & 0xFFFF:04X})"
        assert (problem.detail, problem.file) == (f"{keyword} {number} is missing", "a.dcm")
        assert NEEDED[keyword][2] in problem.hint


def raw(keyword: str, value: bytes) -> bytes:
    """A file in which the text of a tag, six characters in ours, was overwritten."""
    changes: dict[str, Any] = {keyword: "777777"}
    file = write_image(**changes)
    assert file.count(b"777777") == 1
    return file.replace(b"777777", value)


REFUSED: dict[str, tuple[bytes, str]] = {
    "deflated": (write_image(uid.DeflatedExplicitVRLittleEndian), r"deflated.* dcmconv \+te"),
    "enhanced": (write_image(sop="1.2.840.10008.5.1.4.1.1.12.1.1"), "frame by frame.* one file for each frame"),
    "a structure set": (write_image(sop="1.2.840.10008.5.1.4.1.1.481.3", **dict.fromkeys(GEOMETRY)), "Rows .* missing"),
    "text": (b"views:\n  - name: AP\n", "DICM is not at byte 128"),
    "empty": (b"", "DICM is not at byte 128"),
    "no data": (b"\0" * 128 + b"DICM", "missing"),
    "cut": (write_image()[:400], "missing|broken"),
    "a word": (raw("DistanceSourceToDetector", b"far   "), r"DistanceSourceToDetector \(0018,1110\) is not one number"),
    "no number": (raw("DistanceSourceToDetector", b"nan   "), "is not one number"),
    "endless": (raw("PositionerPrimaryAngle", b"1e999 "), "is not one number"),
    "two": (raw("PositionerPrimaryAngle", b"1\\22  "), "is not one number"),
    "no ascii": (raw("PositionerPrimaryAngle", b"12\xb0   "), "PositionerPrimaryAngle .* is broken"),
    "isocentre": (write_image(DistanceSourceToPatient="1100"), "not between 0 and DistanceSourceToDetector"),
    "angle": (write_image(PositionerSecondaryAngle="91"), "not within -90 to 90"),
    "oblong": (write_image(ImagerPixelSpacing=["0.2", "0.3"]), "differs along rows and columns: .* intrinsics"),
    "turn": (write_image(FieldOfViewRotation="45"), "none of 0, 90, 180, 270"),
    "tilted": (write_image(DetectorPrimaryAngle="2"), r"DetectorPrimaryAngle \(0018,1530\) is not 0"),
    "column": (write_image(PositionerType="COLUMN"), "PositionerType .* is not CARM"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused_with_its_cure(case: str) -> None:
    content, words = REFUSED[case]
    with pytest.raises(DesignError, match=words) as refusal:
        read_shot(content, "a.dcm")
    assert all(problem.hint for problem in refusal.value.problems)
    assert PATIENT not in str(refusal.value)


def test_shots_that_disagree_or_that_no_design_takes_are_named() -> None:
    files = [(write_image(), "a.dcm"), (write_image(Rows=512, PositionerPrimaryAngle="-60"), "b.dcm")]
    assert any("of one C-arm" in note for note in convert_shots(files, "new.yaml", load_design(DEMO)).notes)
    files[1] = write_image(DistanceSourceToDetector="1e9"), "b.dcm"
    with pytest.raises(DesignError, match="100000") as refusal:
        convert_shots(files, "new.yaml", load_design(DEMO))
    assert refusal.value.problems[0].file == "b.dcm"


def test_what_is_to_be_looked_at_is_said() -> None:
    shot = read_shot(
        write_image(PositionerMotion="DYNAMIC", TableMotion="DYNAMIC", FieldOfViewDimensions=["300"],
                FieldOfViewShape="ROUND"), "a.dcm"
    )  # fmt: skip
    said = " ".join(shot.doubts)
    assert "the C-arm moved" in said
    assert "the table moved" in said
    assert "FieldOfViewDimensions says 300 mm, pixels times ImagerPixelSpacing 204.8 mm" in said
    assert "corners" in said
    assert read_shot(write_image(FieldOfViewDimensions=["205", "180"]), "a.dcm").doubts == ()


@pytest.mark.hostile
def test_mutated_files_are_read_or_refused(capfd: pytest.CaptureFixture[str], run_seed: int) -> None:
    """2,000 files with bytes changed, cut out or doubled; no answer is wrong at any seed, so the error rate is 0."""
    generator = np.random.default_rng(run_seed)
    said: list[str] = []
    originals = [write_image(syntax) for syntax in SYNTAXES]
    for k in range(2_000):
        content = bytearray(originals[k % 4])
        for _ in range(generator.integers(1, 6)):
            at, count = int(generator.integers(128, 900)), int(generator.integers(1, 9))
            kind = generator.integers(3)
            if kind == 0:
                content[at : at + count] = generator.integers(0, 256, count, dtype=np.uint8).tobytes()
            elif kind == 1:
                del content[at : at + count]
            else:
                content[at:at] = content[at : at + 40 * count]
        try:
            read_shot(bytes(content), "a.dcm")
        except TailstackError as error:
            said.append(str(error))
    assert 0 < len(said) < 2_000
    assert not [words for words in said if PATIENT in words]
    assert capfd.readouterr() == ("", "")

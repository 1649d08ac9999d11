"""Poses, lengths, frames and parts of them that are written in another way: what is said settles it when it is obeyed.

The scene: two calibrated cameras 700 mm from con's origin, eight beads and a target about it.  What was meant is known
here, and the camera that it is, by plain matrices; beads and cameras are rebuilt from public reports in own numbers.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from plain_data import DEMO, EXAMPLES, problems_of, replaced
from tailstack.design import check_design, load_design
from tailstack.design.plausibility import PLAUSIBILITY
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


def scene(change=lambda pose: pose, **intrinsics):
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
    problems = problems_of(check_design, load_design(data), error=IllPosedError)
    return [p.hint for p in problems if p.pointer.count("/") == 2 and p.hint]


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
    return lambda pose: np.column_stack([pose[:, :3], pose[:, 3] * [factor, factor, factor, 1]])


FLIP = np.diag([1.0, -1, -1, 1])
WRITTEN = {
    "camera to con": (np.linalg.inv, {}, "its inverse, which maps the camera to con"),
    "OpenGL": (lambda pose: FLIP @ pose, {}, "the camera axes turned"),
    "OpenGL, camera to con": (lambda pose: np.linalg.inv(FLIP @ pose), {}, "its inverse"),
    "camera to con in metres": (lambda pose: scaled_shift(1e-3)(np.linalg.inv(pose)), {}, "its translation in metres"),
    "negative focal lengths": (lambda pose: FLIP @ pose, {"focal_px": [-FOCAL, -FOCAL]}, "the camera axes turned"),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_pose_in_another_convention_is_refused_with_the_one_that_works(name):
    """independent: what is told to be written gives the pixels of the true camera, K [R | t]; where signs of focal
    lengths were written on purpose, those that the numbers gave as they stood."""
    change, intrinsics, words = WRITTEN[name]
    data = scene(change, **intrinsics)
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
    whole = scene()
    right = score(load_design(whole)).targets[0].p95_mm
    for view, rotation in zip(whole["views"], TRUE.values(), strict=True):
        del view["intrinsics"], view["pose"]
        view["projection"] = (-(K @ pose_of(rotation)[:3])).tolist()
    assert score(load_design(whole)).targets[0].p95_mm == pytest.approx(right, rel=1e-9)


@pytest.mark.parametrize(("unit", "factor"), [("metres", 1000), ("centimetres", 10), ("inches", 25.4)])
def test_a_translation_in_another_unit(unit, factor):
    data = scene(scaled_shift(1 / factor))
    for view in data["views"]:
        pose = np.array(view["pose"])
        view["pose"] = {"rotation": pose[:3, :3].tolist(), "translation_mm": pose[:3, 3].tolist()}
    hints = hints_of(data)
    assert all(f"its translation in {unit}" in hint and "translation_mm: [0, 0, 700]" in hint for hint in hints)
    check_design(load_design(obey(data, hints)))


def test_micrometres_are_named_where_they_are_written():
    """closed_form: 70 mm are 70,000 µm, which no view shows; a source 700,000 µm away is beyond all fields."""
    data = scene()
    data["targets"] = [{"name": "tip", "position_mm": [0, 0, 70_000]}]
    assert all("with the targets in micrometres" in hint and "by 0.001" in hint for hint in hints_of(data))
    for view in (data := scene())["views"]:
        view["pose"] = {"rotation": np.array(view["pose"])[:3, :3].tolist(), "translation_mm": [0, 0, 700_000]}
    assert problems_of(load_design, data, error=DesignError)[0].hint == "it is in mm: 700000 µm is 700 mm"


def test_where_no_unit_fits_none_is_stated() -> None:
    hints = hints_of(scene(scaled_shift(0.01)))  # decimetres
    assert all("do not show everything either" in hint and "write" not in hint for hint in hints)
    assert not any("isocentre" in hint for hint in hints)  # these views have none
    # closed_form: a thousandth of any place is in sight of everything, and says nothing about its unit.
    data = scene()
    data["targets"] = [{"name": "tip", "position_mm": [0, 0, 150]}]
    assert all("unit" not in hint and "micrometres" not in hint for hint in hints_of(data))


def test_a_projection_of_metres():
    data = scene()
    for view, rotation in zip(data["views"], TRUE.values(), strict=True):
        del view["intrinsics"], view["pose"]
        view["projection"] = (K @ pose_of(rotation, (0, 0, AWAY / 1000))[:3]).tolist()
    hints = hints_of(data)
    assert all("lengths in metres" in hint for hint in hints)
    check_design(load_design(obey(data, hints)))


def test_beads_in_inches_or_centimetres_are_asked_about():
    """closed_form: 90.7 mm are 3.57 inches, and 3.57 cm would fit into the images as well."""
    data = scene()
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


CON, TCP = ("transforms", "T_flange_con"), ("transforms", "T_tcp_flange")


def remarks(document):
    findings = check_design(load_design(document))[1]
    return {each.rule: each for each in findings if each.rule in PLAUSIBILITY}


# --- the tool ---------------------------------------------------------------------------------------------

SHIFTS = {"metres": 1e-3, "centimetres": 0.1, "inches": 1 / 25.4, "its inverse": -1.0}


@pytest.mark.parametrize("words", SHIFTS)
@pytest.mark.parametrize(("path", "z"), [(CON, 145), (TCP, -215)])
def test_a_transform_in_another_unit_or_inverted_is_remarked_with_the_one_that_meets_the_target(path, z, words):
    """independent: the demo's tip is 215 mm before the flange, which is 145 mm behind con; its target is at 70."""
    written = replaced(DEMO, (*path, "translation_mm"), [0, 0, z * SHIFTS[words]])
    met = remarks(written)["target-off-tool"]
    assert met.pointer == "/" + "/".join(path)
    assert words in met.message
    meant = yaml.safe_load(re.search(rf"{path[1]}: translation_mm: (\[.*?\])", met.message)[1])
    np.testing.assert_allclose(meant, [0, 0, z], atol=1e-6)
    assert not remarks(replaced(written, (*path, "translation_mm"), meant))


def test_both_inverted():
    inverted = replaced(replaced(DEMO, (*CON, "translation_mm"), [0, 0, -145]), (*TCP, "translation_mm"), [0, 0, 215])
    met = remarks(inverted)["target-off-tool"]
    assert "both transforms" in met.message
    assert (
        "T_flange_con: translation_mm: [0, 0, 145] and write T_tcp_flange: translation_mm: [0, 0, -215]" in met.message
    )


def test_targets_and_a_pivot_of_the_flange_in_another_unit() -> None:
    for factor in (10, 1000, 25.4):  # centimetres, metres, inches
        met = remarks(replaced(DEMO, ("targets", 0, "position_mm"), [0, 0, 70 / factor]))["target-off-tool"]
        assert (met.pointer, f"multiply the targets by {factor:g}" in met.message) == ("/targets", True)
    # independent: the flange's face is 145 mm behind con.
    for unit, factor in (("centimetres", 10), ("inches", 25.4)):
        at = ("interfaces", "connector_flange", "pivot_mm")
        met = remarks(replaced(DEMO, at, [0, 0, -145 / factor]))["pivot-off-flange"]
        assert met.pointer == "/" + "/".join(at)
        assert f"with the pivot in {unit}, it lies 0 mm from it: multiply pivot_mm by {factor:g}" in met.message


@pytest.mark.parametrize("whole", [True, False])
def test_a_turned_transform_that_is_inverse_in_a_part(whole):
    """independent: SciPy's rotations; a flange that is turned and aside of con, the tool's tip at the target."""
    rotation, shift = Rotation.from_euler("XYZ", [20, -35, 80], degrees=True).as_matrix(), np.array([40, -25, 145])
    there = rotation @ [0, 0, 70] + shift
    wrong = pose_of(rotation.T, -rotation.T @ shift) if whole else pose_of(rotation, -rotation.T @ shift)
    document = replaced(replaced(DEMO, CON, wrong.tolist()), TCP, {"translation_mm": (-there).tolist()})
    met = remarks(document)["target-off-tool"]
    meant = yaml.safe_load(re.search(r"write T_flange_con: (\[\[.*?\]\])", met.message)[1])
    np.testing.assert_allclose(meant, pose_of(rotation, shift), atol=1e-6)


@pytest.mark.parametrize("order", ["roll, pitch and yaw", "KUKA", "rotation vector", "radians", "scalar last"])
def test_angles_of_another_order(order):
    """independent: SciPy; a tool that is turned against its flange, written as another robot writes it."""
    turn = Rotation.from_euler("XYZ", [25, 50, -70], degrees=True)
    written = {
        "roll, pitch and yaw": {"rotation_deg": turn.as_euler("ZYX", degrees=True)[::-1].tolist()},
        "KUKA": {"rotation_deg": turn.as_euler("ZYX", degrees=True).tolist()},
        "rotation vector": {"rotation_deg": turn.as_rotvec(degrees=True).tolist()},
        "radians": {"rotation_deg": turn.as_euler("XYZ").tolist()},
        "scalar last": {"quaternion_wxyz": turn.as_quat().tolist()},
    }[order]
    shift = -turn.apply([0, 0, 215])
    met = remarks(replaced(DEMO, TCP, written | {"translation_mm": shift.tolist()}))["target-off-tool"]
    assert order in met.message
    meant = yaml.safe_load(re.search(r"write T_tcp_flange: (\[\[.*?\]\])", met.message)[1])
    np.testing.assert_allclose(meant, pose_of(turn.as_matrix(), shift), atol=1e-6)


def test_only_a_target_further_from_the_tool_than_any_tool_is_long_is_remarked() -> None:
    met = remarks(replaced(DEMO, (*TCP, "translation_mm"), [310, 170, -215]))["target-off-tool"]
    assert "score says where each lies in tcp" in met.message
    # A drill guide's tcp is its sleeve; the flange itself may be the tool.
    assert "target-off-tool" not in remarks(replaced(DEMO, (*TCP, "translation_mm"), [0, 0, -130]))
    assert "target-off-tool" not in remarks(
        replaced(DEMO, ("transforms",), {"T_flange_con": DEMO["transforms"][CON[1]]})
    )


def test_a_score_says_where_each_target_lies_in_tcp():
    """independent: the homogeneous products."""
    document = yaml.safe_load((EXAMPLES / "locators_321.yaml").read_text())
    found = {each.name: each.position_tcp_mm for each in score(load_design(document)).targets}
    turn = Rotation.from_euler("z", 45, degrees=True).as_matrix()
    np.testing.assert_allclose(found["centre"], [0, 0, -15], atol=1e-12)
    np.testing.assert_allclose(found["workspace[0]"], turn @ [-15, -15, 35 + 130] - [0, 0, 190], atol=1e-12)


# --- quaternions ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("last", [1.0, -1.0, 0.9995])
def test_the_identity_with_its_scalar_last_is_half_a_turn_and_is_said_to_be(last):
    written = [0, 0, (1 - last**2) ** 0.5, last]
    met = remarks(replaced(DEMO, CON, {"quaternion_wxyz": written, "translation_mm": [0, 0, 145]}))["quaternion-order"]
    assert "half a turn about z" in met.message
    meant = yaml.safe_load(re.search(r"write (\[.*?\]);", met.message)[1])
    np.testing.assert_allclose(Rotation.from_quat(written).as_quat(), np.roll(meant, -1), atol=1e-3)
    assert not remarks(replaced(DEMO, CON, {"quaternion_wxyz": meant, "translation_mm": [0, 0, 145]}))


# --- principal points -------------------------------------------------------------------------------------

FEET = {  # as written, of an image of 1536 px with pixels of 0.194 mm, and what is meant
    "in millimetres": ([148.9, 148.9], [767.5, 767.5]),
    "from the middle of the image": ([3, -2], [770.5, 765.5]),
    "with the other sign": ([-767.5, -767.5], [767.5, 767.5]),
    "with the other sign of one": ([767.5, -767.5], [767.5, 767.5]),
}


@pytest.mark.parametrize("words", FEET)
@pytest.mark.parametrize("aimed", [True, False])
def test_a_principal_point_in_another_convention_is_named_with_what_is_meant(words, aimed):
    foot, meant = FEET[words]
    if aimed:
        document = replaced(DEMO, ("views",), [view | {"principal_point_px": foot} for view in DEMO["views"]])
    else:
        document = scene(principal_point_px=foot)
    problems = problems_of(check_design, load_design(document), error=IllPosedError)
    hints = [problem.hint for problem in problems if problem.pointer.count("/") == 2 and problem.hint]
    assert len(hints) == 2
    for hint in hints:
        assert "isocentre_mm" not in hint
        written = yaml.safe_load(re.search(r"write principal_point_px: (\[.*?\])", hint)[1])
        np.testing.assert_allclose(written, meant, atol=1)
    inner = "" if aimed else "/intrinsics"
    places = [problem.pointer for problem in problems if problem.code == "principal-point"]
    assert places == [f"/views/{k}{inner}/principal_point_px" for k in (0, 1)]


def test_a_principal_point_that_nothing_explains_is_named_all_the_same():
    problems = problems_of(check_design, load_design(scene(principal_point_px=[1700, 90])), error=IllPosedError)
    outside = [problem.hint for problem in problems if problem.code == "outside-view"]
    assert outside
    assert all("check principal_point_px first" in hint for hint in outside)


def test_a_focal_length_in_millimetres():
    met = remarks(scene(focal_px=[1020, 1020]))["cone-too-wide"]
    assert met.pointer.endswith("/intrinsics/focal_px")


# --- poses in a part --------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrong", [(0, 1), (0,), (1,)])
def test_a_translation_that_is_the_camera_s_place_gets_its_cure_in_every_view_that_has_it(wrong):
    """independent: the pose itself, R and -R c."""
    document = scene()
    for index in wrong:
        pose = np.array(document["views"][index]["pose"])
        centre = -pose[:3, :3].T @ pose[:3, 3]
        document["views"][index]["pose"] = {"rotation": pose[:3, :3].tolist(), "translation_mm": centre.tolist()}
    hints = hints_of(document)
    assert len(hints) == len(wrong)
    for hint in hints:
        np.testing.assert_allclose(yaml.safe_load(hint.partition("translation_mm: ")[2]), [0, 0, 700], atol=1e-6)


# --- isocentres -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("detector", "isocentre"), [(1020, 700), (1259.65, 742.5), (1148, 809.89), (1085.6, 595)])
def test_an_isocentre_measured_from_the_detector(detector, isocentre):
    """The presets' own distances; ten beads in 30 mm, which every detector shows."""
    document = yaml.safe_load((EXAMPLES / "gallery/small_carrier.yaml").read_text())
    arm = {"source_detector_mm": detector, "pixel_mm": 0.3, "image_size_px": [1536, 1536], "isocentre_mm": [0, 0, 0]}
    for view in document["views"]:
        for field in ("preset", "principal_point_px"):
            view.pop(field, None)
        view |= arm | {"source_isocentre_mm": detector - isocentre}
    said, hints = doubts(document)
    cure = f"write source_isocentre_mm: {isocentre:g}"
    assert len(said) == len(document["views"])
    assert all(cure in each and "530 to 810 mm" in each for each in said)
    assert all(cure in hint for hint in hints)


def doubts(document):
    """What is said of the sources, and the first hint where it is refused."""
    try:
        return [each.message for each in check_design(load_design(document))[1] if each.rule == "source-distance"], []
    except IllPosedError as error:
        said = [each.detail for each in error.problems if each.code == "source-distance"]
        return said, [error.problems[0].hint]

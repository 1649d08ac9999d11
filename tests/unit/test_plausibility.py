"""Values that are allowed and hardly ever meant: each rule has a design that meets it and a neighbour that does not;
forty designs that people mean, of which none has a number that is remarked."""

from __future__ import annotations

import csv
from itertools import product
from typing import Any

import numpy as np
import pytest

from plain_data import DEMO, EVERY, EXAMPLES, REMOVED, problems_of, read_cases, replaced
from tailstack.design import check_design, load_design
from tailstack.design.plausibility import PLAUSIBILITY
from tailstack.design.presets import PRESETS
from tailstack.errors import IllPosedError
from tailstack.scoring import score

EVERYDAY = sorted(path for path in EXAMPLES.rglob("*.yaml") if "schema: tailstack/design/1" in path.read_text())
LOCATORS = EVERY["locators_321"]
SEAT = ("interfaces", "structure_connector")


def remarks(document, **options):
    """(rule, pointer) of what is remarked as implausible, and the sentences."""
    found = [each for each in check_design(load_design(document, **options))[1] if each.rule in PLAUSIBILITY]
    assert all(each.severity == "warning" for each in found)
    return [(each.rule, each.pointer) for each in found], " ".join(each.message for each in found)


def doubted(document):
    """What is remarked as implausible of a document that is refused for what comes of it."""
    return [each for each in problems_of(remarks, document, error=IllPosedError) if each.code in PLAUSIBILITY]


def scaled(factor):
    """The demo with its structure in another unit: positions multiplied, and what rests on them left out."""
    points = DEMO["fiducials"]["points"]
    smaller = [point | {"position_mm": [factor * x for x in point["position_mm"]]} for point in points]
    return replaced(replaced(DEMO, ("optimise",), REMOVED), ("fiducials", "points"), smaller)


@pytest.mark.parametrize("path", EVERYDAY, ids=lambda path: path.stem)
def test_everyday_designs_have_none(path):
    assert remarks(path) == ([], "")


@pytest.mark.parametrize("preset", PRESETS)
def test_published_c_arms_have_none(preset):
    known = PRESETS[preset]
    view = {"preset": preset, "fiducial_noise_px": 0.3, "target_noise_px": 0.3}
    view |= {field: {"source_isocentre_mm": 700, "pixel_mm": 0.4}[field] for field in known.view_must_state}
    document = replaced(DEMO, ("views",), [view | {"name": side, "orientation": side} for side in ("AP", "LAT")])
    del document["optimise"]
    try:
        assert remarks(document) == ([], "")
    except IllPosedError as error:  # its image is too small for this structure; that is no slip of unit
        assert not {problem.code for problem in error.problems} & set(PLAUSIBILITY)  # noqa: PT017


WARM = {"difference_k": 10, "structure_expansion_um_per_m_k": 47, "connector_expansion_um_per_m_k": 0}
THEATRE = replaced(replaced(DEMO, ("temperature",), WARM), ("fiducials", "diameter_mm"), 3)
THEATRE = replaced(THEATRE, ("views", 1, "intrinsics_prior"), {"focal_rel_sd": 0.01, "principal_point_px_sd": 10})
THEATRE["views"][1]["intrinsics_error"] = {"focal": {"bias_rel": 0, "half_width_rel": 0.01, "distribution": "normal"}}
ARM = {"joints": [{"name": "turn"}], "joints_imaging_deg": [0], "joints_executing_deg": [0]}
THEATRE = replaced(THEATRE, ("execution", "robot"), ARM)
CASES = read_cases("design", "implausible")


@pytest.mark.parametrize(("rule", "path", "value", "neighbour", "words"), CASES)
def test_a_slip_is_remarked_and_its_neighbour_is_not(rule, path, value, neighbour, words):
    found, sentences = remarks(replaced(THEATRE, path, value))
    assert found == [(rule, "/" + "/".join(map(str, path)))]
    assert words in sentences
    assert remarks(replaced(THEATRE, path, neighbour)) == ([], "")


def test_a_target_in_a_bead():
    """There is no tool there either; 1.6 mm from the bead it is clear of it."""
    for z, rules in (-53, ["target-off-tool", "target-in-bead"]), (-52.4, ["target-off-tool"]):
        found, sentences = remarks(replaced(THEATRE, ("targets", 0, "position_mm"), [-12, 6, z]))
        assert [rule for rule, _ in found] == rules
        assert ("centre of fiducial F9" in sentences) == (len(rules) == 2)


def test_locators_are_held_to_the_same_ladder_and_hand_eye_is_no_seat() -> None:
    path = (*SEAT, "locators", 0, "half_width_mm")
    assert remarks(replaced(LOCATORS, path, 2.0))[0] == [("half-width-too-wide", "/" + "/".join(map(str, path)))]
    # Calibrations of hand to eye scatter by more than a clip: 0.65 mm standard deviation were measured.
    assert remarks(replaced(DEMO, ("execution", "hand_eye", "tolerances", "tx", "half_width_mm"), 1.3))[0] == []


def test_a_structure_in_centimetres_is_remarked_and_one_in_micrometres_refused() -> None:
    """The demo's widest pair is 93 mm apart; ten times smaller it is smaller than its beads."""
    found, sentences = remarks(scaled(0.1))
    assert found == [("structure-size", "/fiducials/points")]
    assert "In centimetres (92.91 mm) they lie in all images: multiply by 10" in sentences
    assert remarks(scaled(10 * 0.1))[0] == []  # obeyed
    assert remarks(scaled(0.2))[0] == []
    first, *_, last = problems_of(remarks, scaled(1000), error=IllPosedError)
    assert first.code != "structure-size"  # it lies behind the source: that comes first
    assert (last.code, last.pointer) == ("structure-size", "/fiducials/points")
    assert "micrometres" in last.detail


def test_sources_in_metres_are_refused_with_the_distance_that_is_meant():
    metres = [view | {"source_detector_mm": 1.2, "source_isocentre_mm": 1.0} for view in DEMO["views"]]
    problems = problems_of(remarks, replaced(DEMO, ("views",), metres), error=IllPosedError)
    found = [problem for problem in problems if problem.code == "source-distance"]
    assert [problem.pointer for problem in found] == [
        f"/views/{view}/{field}" for view in (0, 1) for field in ("source_detector_mm", "source_isocentre_mm")
    ]
    obeyed = {"source_detector_mm": 1200, "source_isocentre_mm": 1000}
    for said in (found[0].detail, problems[0].hint):
        assert "in metres" in said
        assert ", ".join(f"{field}: {value}" for field, value in obeyed.items()) in said
    assert remarks(replaced(DEMO, ("views",), [view | obeyed for view in metres])) == ([], "")


def test_a_calibrated_view_in_metres_is_refused_with_its_pose():
    pose = ("views", 0, "pose", "translation_mm")
    found = doubted(replaced(LOCATORS, pose, [0, 0, 0.7]))
    assert ("source-distance", "/views/0/pose") in [(p.code, p.pointer) for p in found]


def with_detector(**numbers):
    """The demo, its detector otherwise than the preset's."""
    return replaced(DEMO, ("views",), [view | numbers for view in DEMO["views"]])


def test_a_binned_image_on_a_preset_is_remarked_with_both_widths_and_is_right_when_obeyed():
    """closed_form: 768 px of 0.3 mm are 230 mm, the preset's 1536 of 0.194 mm 298; of 0.388 mm they are 298."""
    found, sentences = remarks(with_detector(image_size_px=[768, 768], pixel_mm=0.3))
    assert found == [("detector-width", f"/views/{index}/image_size_px") for index in (0, 1)]
    assert "230.4 mm wide (768 px of 0.3 mm)" in sentences
    assert "298 mm (1536 px of 0.194 mm)" in sentences
    assert "binned 2 x 2, has pixel_mm: 0.388" in sentences
    assert "a crop" in sentences
    assert remarks(with_detector(image_size_px=[768, 768], pixel_mm=0.388)) == ([], "")
    refused = doubted(with_detector(image_size_px=[768, 768]))  # half as wide, it does not show everything
    assert "detector-width" in [problem.code for problem in refused]


def test_pixels_of_another_pitch_alone_make_another_detector():
    found, sentences = remarks(with_detector(pixel_mm=0.388))
    assert found == [("detector-width", f"/views/{index}/pixel_mm") for index in (0, 1)]
    assert "596 mm wide" in sentences
    assert "has image_size_px: [768, 768]" in sentences
    assert remarks(with_detector(pixel_mm=0.194, image_size_px=[1536, 1530])) == ([], "")  # a rim that is not read


def test_a_detector_of_another_shape_or_a_larger_one_gets_no_cure_that_is_wrong():
    """closed_form: 768 rows of 0.194 mm are half as high; pixels of 0.388 mm would make 1536 columns twice as wide."""
    found = doubted(with_detector(image_size_px=[1536, 768]))
    [said] = {p.detail.partition(": ")[2] for p in found if p.code == "detector-width"}
    assert "149 mm high" in said
    assert "pixel_mm:" not in said
    assert "Of a crop" in said
    _, sentences = remarks(with_detector(image_size_px=[3072, 3072]))
    assert "has pixel_mm: 0.097." in sentences
    assert "crop" not in sentences  # no crop is larger than what it was cut from


def test_a_target_at_the_pivot():
    pivot = (*SEAT, "pivot_mm")
    for place, rules in ([0, 0, 68], ["no-lever-arm"]), ([0, 0, 66], []):
        assert [rule for rule, _ in remarks(replaced(DEMO, pivot, place))[0]] == rules
    still = replaced(DEMO, SEAT, {"pivot_mm": [0, 0, 70]})  # a seat that does not turn needs no lever
    assert remarks(still)[0] == []
    for radius, rules in (1.0, ["no-lever-arm"]), (10.0, []):
        ball = {"name": "tip", "region": {"sphere": {"centre_mm": [0, 0, 70], "radius_mm": radius}}}
        assert [rule for rule, _ in remarks(replaced(DEMO | {"targets": [ball]}, pivot, [0, 0, 70]))[0]] == rules


def test_every_rule_is_met_above_and_says_where_its_numbers_come_from():
    met = {case[0] for case in CASES} | {"structure-size", "source-distance", "no-lever-arm", "detector-width"}
    met |= {"target-in-bead", "target-off-tool"}
    assert met | {"principal-point", "cone-too-wide", "quaternion-order"} == set(PLAUSIBILITY)  # test_meanings
    assert all(rule.numbers and rule.title for rule in PLAUSIBILITY.values())


def test_remarks_stand_in_the_verdict_of_a_score():
    document = replaced(DEMO, ("views", 0, "fiducial_noise_px"), 0.0)
    assert "noise-too-small" in [finding.rule for finding in score(load_design(document)).verdict.findings]


# Forty designs that people mean, far apart in size and kind; distances are those of published devices where there are
# any.  half_width_mm is of the structure, reach_mm from con to the target, tool_mm beyond the flange.
with (EXAMPLES.parent / "tests" / "data" / "honest_designs.csv").open(encoding="utf-8") as file:
    ROWS = list(csv.DictReader(file))


def build(row: dict[str, str], number: int) -> dict[str, Any]:
    """The design of a row; every second or third has one of the other things that a design can declare."""
    name, *numbers = row.values()
    detector, isocentre, pixel, width, half, reach, tool, noise, beads, turn, shift, repeats, limit = map(
        float, numbers
    )
    rng = np.random.default_rng(number)
    signs = np.array([*product((-1, 1), repeat=3), (0.3, -0.2, 0.1), (-0.4, 0.5, -0.3)])
    points = (half * (signs + rng.uniform(-0.08, 0.08, (10, 3))) - [0, 0, half]).round(2)
    middle = round((reach - 2 * half) / 2, 1)
    arm: dict[str, Any] = {"source_detector_mm": detector, "source_isocentre_mm": isocentre, "pixel_mm": pixel}
    arm |= {"image_size_px": [int(width), int(width)], "isocentre_mm": [0, 0, middle]}
    arm |= {"fiducial_noise_px": noise, "target_noise_px": 2 * noise}
    views: list[dict[str, Any]] = [arm | {"name": side, "orientation": side} for side in ("AP", "LAT")]
    seat = -2.2 * half - 5.0
    law = {"distribution": "normal"} if number % 2 else {"distribution": "uniform"}
    tolerances = {axis: {"half_width_deg": turn, **law} for axis in ("rx", "ry", "rz")}
    tolerances |= {axis: {"half_width_mm": shift, **law} for axis in ("tx", "ty", "tz")}
    behind = max(20.0 - seat, float(tool - reach))
    sleeve = 0.0 if "sleeve" not in name else 60.0
    document: dict[str, Any] = {
        "schema": "tailstack/design/1",
        "name": name,
        "views": views,
        "fiducials": {
            "points": [{"position_mm": place} for place in points.tolist()],
            "manufacturing": {"half_width_mm": beads, **law},
        },
        "interfaces": {
            "structure_connector": {"pivot_mm": [0, 0, seat], "tolerances": tolerances},
            "connector_flange": {"pivot_mm": [0, 0, -behind], "tolerances": tolerances},
        },
        "transforms": {
            "T_flange_con": {"rotation_deg": [0, 0, 30 * (number % 4)], "translation_mm": [0, 0, behind]},
            "T_tcp_flange": {"translation_mm": [0, 0, sleeve - behind - reach]},
        },
        "execution": {"repeatability": {"std_mm": repeats}},
        "targets": [{"name": "tip", "position_mm": [0, 0, reach]}],
        "requirements": [{"name": "tip", "limit_mm": limit}],
    }
    if not number % 5:  # a tool that leans: its tip is where the target is all the same
        document["transforms"]["T_tcp_flange"] = {"rotation_deg": [0, 12.5, 0], "translation_mm": lean(behind + reach)}
    EXTRAS[number % len(EXTRAS)](document, half, limit)
    return document


def lean(depth: float) -> list[float]:
    turn = np.radians(12.5)
    return [round(-depth * np.sin(turn), 4), 0.0, round(-depth * np.cos(turn), 4)]


def _compliant(document: dict[str, Any], half: float, limit: float) -> None:
    matrix = [[0.004, 0.0004, 0], [0.0004, 0.006, 0], [0, 0, 0.0005]]
    load = {"load_n": [0.2, 0, -1.5], "load_half_width_n": [0.2, 0.2, 0.5], "distribution": "uniform"}
    document["execution"]["compliance"] = {"matrix_mm_per_n": matrix, **load}


def _calibrated(document: dict[str, Any], half: float, limit: float) -> None:
    tolerances = {"tx": {"half_width_mm": 0.2, "distribution": "normal"}}
    tolerances["rx"] = {"half_width_deg": 0.02, "distribution": "normal"}  # type: ignore[dict-item]
    bias = {"tx_mm": 0.0004, "ty_mm": -0.12, "rz_deg": 0.05, "rx_deg": 0.0008}  # two came out small by chance
    document["execution"]["hand_eye"] = {"pivot_mm": [0, 0, 12.5], "bias": bias, "tolerances": tolerances}


def _warm(document: dict[str, Any], half: float, limit: float) -> None:
    document["temperature"] = {
        "difference_k": 15, "half_width_k": 3, "distribution": "uniform",
        "structure_expansion_um_per_m_k": 23, "connector_expansion_um_per_m_k": 1.2,
    }  # fmt: skip


def _moving(document: dict[str, Any], half: float, limit: float) -> None:
    tolerances = {"tz": {"half_width_mm": 0.05 * limit, "distribution": "normal"}}
    document["views"][1]["motion"] = {"pivot_mm": [0, 0, 0], "tolerances": tolerances}
    document["interfaces"]["structure_connector"]["bias"] = {"rz_deg": 0.006, "tz_mm": 0.004}


def _pose(document: dict[str, Any], half: float, limit: float) -> None:
    document["model"] = {"estimator": "pose_with_prior"}
    for view in document["views"]:
        view["intrinsics_prior"] = {"focal_rel_sd": 0.001, "principal_point_px_sd": 1.5}
        view["detector_tilt"] = {"about_u": {"half_width_deg": 0.1, "distribution": "normal"}}


def _optimised(document: dict[str, Any], half: float, limit: float) -> None:
    document["optimise"] = {
        "box": {"min_mm": [-1.2 * half, -1.2 * half, -2.2 * half], "max_mm": [1.2 * half, 1.2 * half, 0]},
        "min_spacing_mm": 0.2 * half,
        "rotation_bounds": {"min_deg": 0.002, "max_deg": 0.5},
        "views": [{"view": "LAT", "cone_deg": 15}],
        "starts": 2,
    }


def _dropping(document: dict[str, Any], half: float, limit: float) -> None:
    document["fiducials"]["loss_probability"] = 0.005
    document["fiducials"]["diameter_mm"] = min(3.0, 0.15 * half)


EXTRAS = (_compliant, _calibrated, _warm, _moving, _pose, _optimised, _dropping)


def test_there_are_forty_designs_and_none_is_remarked() -> None:
    assert len(ROWS) == len({row["what"] for row in ROWS}) == 40
    for number in range(40):
        findings = check_design(load_design(build(ROWS[number], number)))[1]
        assert [(each.rule, each.message) for each in findings if each.rule in PLAUSIBILITY] == []

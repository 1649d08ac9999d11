"""Forty designs that people mean, far apart in size and kind: none of their numbers is remarked as implausible.

Each is a row of what it is made of; distances are those of published devices where there are any.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from tailstack.design import check_design, load_design
from tailstack.design.plausibility import PLAUSIBILITY

# what, source to detector and to isocentre, pixel, width px; half width of the structure, place of the target on z,
# length of the tool beyond the flange; noise px; half-widths of beads mm, seats deg and mm, repeatability mm, limit mm
ROWS: list[tuple[Any, ...]] = [
    ("mobile C-arm, spine", 1020, 700, 0.194, 1536, 30, 70, 215, 0.3, 0.05, 0.1, 0.03, 0.03, 1.0),
    ("mobile C-arm, nearest tube", 1020, 530, 0.194, 1536, 20, 40, 150, 0.3, 0.05, 0.1, 0.03, 0.05, 1),
    ("generic mobile C-arm, hip", 1259.65, 742.5, 0.3, 1440, 50, 110, 320, 0.5, 0.1, 0.2, 0.05, 0.1, 2.0),
    ("large C-arm on the ceiling", 1300, 785, 0.308, 1344, 60, 90, 260, 0.4, 0.05, 0.1, 0.05, 0.05, 1.5),
    ("angiography, long arm", 1200, 765, 0.154, 2480, 50, 80, 240, 0.3, 0.05, 0.1, 0.03, 0.03, 1.0),
    ("O-shaped arm", 1147, 647, 0.388, 1024, 35, 60, 200, 0.3, 0.05, 0.1, 0.03, 0.05, 1.0),
    ("image intensifier", 1000, 600, 0.45, 512, 25, 40, 150, 0.8, 0.1, 0.3, 0.1, 0.1, 2.0),
    ("mini C-arm, hand surgery", 450, 350, 0.1, 1300, 12, 25, 90, 0.4, 0.03, 0.1, 0.02, 0.02, 0.5),
    ("mini C-arm, foot", 364, 280, 0.075, 1536, 10, 20, 60, 0.4, 0.02, 0.1, 0.02, 0.02, 0.4),
    ("dental cone beam", 690, 480, 0.2, 1000, 15, 30, 80, 0.3, 0.02, 0.05, 0.02, 0.02, 0.3),
    ("dental, half a fan", 600, 400, 0.15, 1400, 14, 20, 60, 0.3, 0.02, 0.05, 0.02, 0.02, 0.3),
    ("ear, nose, throat", 700, 420, 0.254, 1024, 15, 40, 120, 0.3, 0.02, 0.05, 0.02, 0.01, 0.5),
    ("cochlea", 1020, 700, 0.194, 1536, 12, 30, 100, 0.1, 0.01, 0.02, 0.005, 0.005, 0.15),
    ("small animal, micro-CT", 300, 150, 0.05, 2000, 8, 6, 30, 0.2, 0.005, 0.02, 0.005, 0.002, 0.1),
    ("mouse brain", 250, 120, 0.05, 2048, 8, 3, 25, 0.1, 0.003, 0.01, 0.003, 0.002, 0.05),
    ("preclinical irradiator", 645, 307, 0.2, 1024, 12, 20, 80, 0.3, 0.02, 0.05, 0.02, 0.05, 0.5),
    ("industrial, large parts", 1500, 500, 0.2, 2048, 38, 30, 150, 0.2, 0.01, 0.02, 0.005, 0.02, 0.2),
    ("industrial, small parts", 800, 200, 0.127, 3072, 12, 15, 60, 0.1, 0.002, 0.01, 0.002, 0.005, 0.03),
    ("industrial, microfocus", 700, 120, 0.1, 4000, 9, 8, 40, 0.1, 0.001, 0.005, 0.001, 0.001, 0.02),
    ("accelerator with a panel", 1500, 1000, 0.388, 1024, 50, 60, 200, 0.4, 0.1, 0.1, 0.05, 0.1, 1.0),
    ("biplane", 1100, 750, 0.2, 1900, 40, 70, 210, 0.25, 0.05, 0.08, 0.03, 0.03, 0.8),
    ("robot of 5 um", 1020, 700, 0.194, 1536, 30, 60, 200, 0.1, 0.005, 0.005, 0.002, 0.0017, 0.2),
    ("hexapod of 1 um", 600, 400, 0.1, 2000, 15, 20, 60, 0.05, 0.002, 0.003, 0.0005, 0.0006, 0.05),
    ("tool of 400 mm", 1259.65, 742.5, 0.3, 1440, 30, 90, 400, 0.4, 0.05, 0.05, 0.03, 0.05, 1.5),
    ("biopsy needle", 1020, 700, 0.194, 1536, 25, 80, 280, 0.4, 0.05, 0.2, 0.1, 0.1, 3.0),
    ("drill guide, sleeve before the target", 1020, 700, 0.194, 1536, 25, 80, 110, 0.3, 0.05, 0.1, 0.05, 0.05, 1.5),
    ("clip-on carrier", 1020, 700, 0.194, 1536, 30, 60, 180, 0.5, 0.2, 0.8, 0.5, 0.1, 5.0),
    ("printed carrier", 1020, 700, 0.194, 1536, 30, 60, 180, 0.5, 0.3, 0.5, 0.3, 0.1, 4.0),
    ("kinematic coupling", 1020, 700, 0.194, 1536, 30, 60, 180, 0.2, 0.01, 0.002, 0.0002, 0.02, 0.6),
    ("clicked by hand", 1085.6, 595, 0.40625, 512, 20, 40, 120, 2.0, 0.1, 0.2, 0.1, 0.1, 5.0),
    ("low dose", 1148, 809.89, 0.5, 512, 25, 40, 140, 1.5, 0.1, 0.2, 0.1, 0.1, 3.0),
    ("coarse and quick", 1175, 720, 0.6, 512, 35, 50, 160, 1.0, 0.1, 0.2, 0.1, 0.1, 3.0),
    ("very fine noise", 1020, 700, 0.194, 1536, 30, 60, 180, 0.02, 0.005, 0.01, 0.005, 0.01, 0.2),
    ("wide cage", 1300, 800, 0.43, 1024, 90, 40, 250, 0.5, 0.1, 0.1, 0.05, 0.05, 1.0),
    ("beside the target", 1020, 700, 0.194, 1536, 30, 5, 120, 0.3, 0.05, 0.1, 0.03, 0.03, 0.8),
    ("far target", 1259.65, 742.5, 0.3, 1440, 20, 120, 300, 0.3, 0.02, 0.05, 0.02, 0.03, 2.0),
    ("retina, forces of millinewtons aside", 450, 300, 0.05, 2400, 8, 10, 50, 0.1, 0.003, 0.01, 0.002, 0.002, 0.05),
    ("veterinary", 1100, 700, 0.28, 1024, 35, 70, 220, 0.5, 0.1, 0.2, 0.1, 0.1, 2.0),
    ("pedicle screws", 1050, 650, 0.2, 1500, 28, 75, 230, 0.3, 0.05, 0.08, 0.03, 0.05, 2.0),
    ("binned detector", 1020, 700, 0.388, 768, 30, 60, 190, 0.3, 0.05, 0.1, 0.03, 0.03, 1.0),
]  # fmt: skip


def build(row: tuple[Any, ...], number: int) -> dict[str, Any]:
    """The design of a row; every second or third has one of the other things that a design can declare."""
    name, detector, isocentre, pixel, width, half, reach, tool, noise, beads, turn, shift, repeats, limit = row
    rng = np.random.default_rng(number)
    signs = np.array([*product((-1, 1), repeat=3), (0.3, -0.2, 0.1), (-0.4, 0.5, -0.3)])
    points = (half * (signs + rng.uniform(-0.08, 0.08, (10, 3))) - [0, 0, half]).round(2)
    middle = round((reach - 2 * half) / 2, 1)
    arm = {"source_detector_mm": detector, "source_isocentre_mm": isocentre, "pixel_mm": pixel}
    arm |= {"image_size_px": [width, width], "isocentre_mm": [0, 0, middle]}
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


def test_there_are_forty_and_each_kind_of_extra_is_among_them():
    assert len(ROWS) == len({row[0] for row in ROWS}) == 40


@pytest.mark.parametrize("number", range(40), ids=[row[0] for row in ROWS])
def test_none_is_remarked(number):
    findings = check_design(load_design(build(ROWS[number], number)))[1]
    assert [(each.rule, each.message) for each in findings if each.rule in PLAUSIBILITY] == []

"""A name that means something else than a field's: what is said of it is obeyed, and gives the number that was meant.

What one unit is of another is taken from ``scipy.constants``, rotations from ``scipy.spatial``: neither is used there.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import yaml
from scipy import constants
from scipy.spatial.transform import Rotation

from cure_walk import refused
from plain_data import EXAMPLES, problems_of, read_cases
from records import examples_with, fields_of, records_below, words_of
from tailstack.cures import ask_meant
from tailstack.design import load_design
from tailstack.design.document import DesignDocument
from tailstack.errors import DesignError, Problem
from tailstack.field_names import NOTHING, cure_name, read_name
from tailstack.laws import RANDOM

RECORDS = records_below(DesignDocument)
PER_MM = {  # how many of a unit are one mm
    "m": 1e-3, "metres": 1e-3, "cm": 0.1, "dm": 0.01, "um": 1e3, "microns": 1e3, "\N{MICRO SIGN}m": 1e3, "nm": 1e6,
    "in": constants.milli / constants.inch, "inch": constants.milli / constants.inch,
    "mil": constants.milli / constants.mil, "thou": constants.milli / constants.mil,
    "ft": constants.milli / constants.foot,
}  # fmt: skip
PER_DEG = {
    "rad": constants.degree, "radians": constants.degree, "mrad": 1e3 * constants.degree,
    "urad": 1e6 * constants.degree,
    "arcmin": constants.degree / constants.arcmin,
    "arcsec": constants.degree / constants.arcsec,
    "gon": 400 / 360, "grad": 400 / 360, "rev": 1 / 360, "turns": 1 / 360,
}  # fmt: skip
PER_N = {"kn": 1e-3, "mn": 1e3, "lbf": 1 / constants.lbf, "kgf": 1 / constants.kgf}
PER_K = {"c": 1.0, "celsius": 1.0, "mk": 1e3, "f": 1 / constants.degree_Fahrenheit}
PER_MM_PER_N = {"m_per_n": 1e-3, "um_per_n": 1e3, "mm_per_kn": 1e3, "in_per_lbf": 1e-3 / constants.inch * constants.lbf}
PER_PPM_PER_K = {"ppm_per_k": 1.0, "per_k": 1e-6, "mm_per_m_k": 1e-3, "um_per_m_per_c": 1.0,
                 "ppm_per_f": constants.degree_Fahrenheit}  # fmt: skip
UNITS = {"mm": PER_MM, "deg": PER_DEG, "n": PER_N, "k": PER_K, "mm_per_n": PER_MM_PER_N, "um_per_m_k": PER_PPM_PER_K}
COMPOUND = {"n": "per_n", "k": "per_m_k", "mm": "mm_per"}


def obey(problem: Problem, data: dict[str, Any]) -> dict[str, Any]:
    """The record after its fix, whose new line is that of the hint."""
    (removed, added) = problem.fix
    assert (removed.op, removed.path, added.op) == ("remove", problem.pointer, "add")
    written = yaml.safe_load("{" + problem.hint[problem.hint.rindex(added.path[1:] + ": ") :] + "}")
    assert written[added.path[1:]] == pytest.approx(np.array(added.value), rel=1e-12)
    return {key: value for key, value in data.items() if key != removed.path[1:]} | {added.path[1:]: added.value}


SLIPS = [  # a record, its field, a name that states another unit, an example, and how many of the unit one of ours is
    (record, field, re.sub(rf"(^|_){unit}(?=_|$)", rf"\1{other}", field), value, factor)
    for record in RECORDS
    for unit, others in UNITS.items()
    for field, value in examples_with(record, unit)
    if COMPOUND.get(unit, "-") not in field
    for other, factor in others.items()
]


def test_every_number_under_a_name_of_another_unit_is_converted() -> None:
    """Each field of each record of the document, each unit of its kind: obeyed, the number is what it was."""
    assert {slip[1] for slip in SLIPS} >= {"half_width_deg", "limit_mm", "load_n", "matrix_mm_per_n"}
    for record, field, name, value, factor in SLIPS:
        data = {name: (factor * np.array(value)).tolist()}
        problem = next(each for each in refused(record, data) if each.pointer == f"/{name}")
        assert field in problem.hint, (record, name, problem.hint)
        after = obey(problem, data)
        assert np.array(after[field]) == pytest.approx(np.array(value), rel=1e-9), (record, name, problem.hint)
        left = [each for each in refused(record, after) if each.code == "unknown-field"]
        assert not left, left


def test_a_number_whose_unit_measures_something_else_is_never_renamed() -> None:
    """A length for an angle, newtons for a length: it is said that it cannot be converted, and no line is printed."""
    for record in RECORDS:
        for unit, others in (("mm", ("deg", "rad", "n", "k", "s")), ("deg", ("mm", "um", "px", "n", "hz"))):
            for field, value in examples_with(record, unit):
                for other in others:
                    name = re.sub(rf"(^|_){unit}(?=_|$)", rf"\1{other}", field)
                    alike = [each for each in fields_of(record) if read_name(each).stem == read_name(field).stem]
                    if name in fields_of(record) or COMPOUND.get(unit, "-") in field or len(alike) > 1:
                        continue
                    problem = next(each for each in refused(record, {name: value}) if each.pointer == f"/{name}")
                    assert problem.fix == (), (record, name, problem)
                    assert "cannot" in problem.hint or problem.hint.startswith("fields known here") or (
                        other in ("px", "hz") and "convert" not in problem.hint
                    ), (record, name, problem.hint)  # fmt: skip
                    assert f"{field}: " not in problem.hint.partition("fields known here")[0]


def test_a_name_without_its_unit_is_told_the_unit() -> None:
    for record in RECORDS:
        for unit in ("mm", "deg", "px", "n", "k"):
            for field, value in examples_with(record, unit):
                name = re.sub(rf"_{unit}$", "", field)
                if name == field or COMPOUND.get(unit, "-") in field or name in fields_of(record):
                    continue
                problem = next(each for each in refused(record, {name: value}) if each.pointer == f"/{name}")
                said = problem.hint.startswith(f"did you mean {field}? If its numbers are in ")
                assert said or " or " in problem.hint, (record, name, problem.hint)


@pytest.mark.parametrize("spell", [
    lambda name: re.sub(r"_(\w)", lambda found: found[1].upper(), name), lambda name: name.replace("_", "-"),
    str.upper, lambda name: name.replace("_", " "), lambda name: name.replace("_", ""),
], ids=["camelCase", "hyphens", "capitals", "spaces", "together"])  # fmt: skip
def test_a_name_that_is_only_spelt_otherwise_keeps_its_value(spell: Any) -> None:
    for record in RECORDS:
        for field, info in fields_of(record).items():
            name = spell(field)
            if name in fields_of(record) or not info.examples:
                continue
            value = info.examples[0]
            problem = next(each for each in refused(record, {name: value}) if each.code == "unknown-field")
            assert problem.hint == f"did you mean {field}?", (record, name, problem.hint)
            assert problem.fix[1].value == value


def cured(name: str, fields: list[str], value: Any, **around: Any) -> Any:
    text, renaming = cure_name(name, fields, value, {}, around)
    assert renaming is not None, text
    return renaming.field, renaming.value


POSE = ["rotation_deg", "rotation", "quaternion_wxyz", "translation_mm"]
TURN = Rotation.from_rotvec([0.3, -0.5, 0.9])


@pytest.mark.parametrize(("name", "value"), [
    ("quaternion_xyzw", TURN.as_quat().tolist()), ("quat_xyzw", TURN.as_quat().tolist()),
    ("rotvec_deg", TURN.as_rotvec(degrees=True).tolist()), ("rotation_vector_rad", TURN.as_rotvec().tolist()),
    ("rodrigues_rad", TURN.as_rotvec().tolist()),
    ("rpy_deg", TURN.as_euler("xyz", degrees=True).tolist()), ("rpy_rad", TURN.as_euler("xyz").tolist()),
    ("ypr_deg", TURN.as_euler("ZYX", degrees=True).tolist()),
])  # fmt: skip
def test_a_rotation_in_another_form_is_the_same_rotation(name: str, value: list[float]) -> None:
    field, found = cured(name, POSE, value)
    assert field == "quaternion_wxyz"
    assert Rotation.from_quat(np.roll(found, -1)).as_matrix() == pytest.approx(TURN.as_matrix(), abs=1e-11)


@pytest.mark.parametrize(("name", "fields", "value", "around", "line"), [
    ("fiducial_noise_mm", ["fiducial_noise_px"], 0.0582, {"pixel_mm": 0.194}, ("fiducial_noise_px", 0.3)),
    ("fiducial_noise_um", ["fiducial_noise_px"], 58.2, {"pixel_mm": 0.194}, ("fiducial_noise_px", 0.3)),
    ("fiducial_noise_var_px2", ["fiducial_noise_px"], 0.09, {}, ("fiducial_noise_px", 0.3)),
    ("image_size_mm", ["image_size_px"], [300.0, 200.0], {"pixel_mm": 0.2}, ("image_size_px", [1500, 1000])),
    ("image_shape_px", ["image_size_px"], [1000, 1500], {}, ("image_size_px", [1500, 1000])),
    ("pixels_per_mm", ["pixel_mm"], 4, {}, ("pixel_mm", 0.25)),
    ("isocentre_detector_mm", ["source_detector_mm", "source_isocentre_mm"], 320, {"source_detector_mm": 1020},
     ("source_isocentre_mm", 700)),
    ("matrix_n_per_mm", ["matrix_mm_per_n"], [[500, 0, 0], [0, 250, 0], [0, 0, 2000]], {},
     ("matrix_mm_per_n", [[0.002, 0, 0], [0, 0.004, 0], [0, 0, 0.0005]])),
    ("matrix_n_per_m", ["matrix_mm_per_n"], [[5e5, 0, 0], [0, 2.5e5, 0], [0, 0, 2e6]], {},
     ("matrix_mm_per_n", [[0.002, 0, 0], [0, 0.004, 0], [0, 0, 0.0005]])),
    ("std_mm", ["half_width_mm"], 0.05, {"distribution": "normal"}, ("half_width_mm", 0.1)),
    ("sigma_mm", ["half_width_mm"], 0.05, {"distribution": "normal", "coverage_factor": 3}, ("half_width_mm", 0.15)),
    ("std_mm", ["half_width_mm"], 0.1, {"distribution": "uniform"}, ("half_width_mm", 0.1 * 3**0.5)),
    ("std_mm", ["half_width_mm"], 0.1, {"distribution": "triangular"}, ("half_width_mm", 0.1 * 6**0.5)),
    ("full_width_mm", ["half_width_mm"], 0.1, {}, ("half_width_mm", 0.05)),
    ("diameter_mm", ["radius_mm"], 20, {}, ("radius_mm", 10)),
    ("radius_um", ["diameter_mm"], 1500, {}, ("diameter_mm", 3)),
    ("half_size_mm", ["centre_mm", "size_mm"], [1, 2, 3], {}, ("size_mm", [2, 4, 6])),
    ("variance_mm2", ["std_mm"], 0.04, {}, ("std_mm", 0.2)),
    ("T_con_flange", ["T_flange_con"], [[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 100], [0, 0, 0, 1]], {},
     ("T_flange_con", [[0, 1, 0, 0], [-1, 0, 0, 5], [0, 0, 1, -100], [0, 0, 0, 1]])),
    ("rotation_transposed", POSE, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], {},
     ("rotation", [[0, -1, 0], [1, 0, 0], [0, 0, 1]])),
    ("quantile_percent", ["quantile"], 95, {}, ("quantile", 0.95)),
    ("half_width_mm_per_m", ["half_width_deg"], 5, {}, ("half_width_deg", np.degrees(0.005))),
    ("compliance_um_per_n", ["matrix_mm_per_n"], [[5, 0, 0], [0, 5, 0], [0, 0, 1]], {},
     ("matrix_mm_per_n", [[0.005, 0, 0], [0, 0.005, 0], [0, 0, 0.001]])),
    ("focal_percent_sd", ["focal_rel_sd"], 1, {}, ("focal_rel_sd", 0.01)),
    ("stiffness_knm_per_rad", ["stiffness_nm_per_rad"], [40, 1], {}, ("stiffness_nm_per_rad", [4e4, 1000])),
    ("stiffness_nm_per_deg", ["stiffness_nm_per_rad"], [100], {}, ("stiffness_nm_per_rad", [18000 / np.pi])),
])  # fmt: skip
def test_what_a_name_means_is_converted(
    name: str, fields: list[str], value: Any, around: dict[str, Any], line: tuple[str, Any]
) -> None:
    field, found = cured(name, fields, value, **around)
    assert field == line[0]
    assert np.array(found) == pytest.approx(np.array(line[1]), rel=1e-9)


@pytest.mark.parametrize(("name", "fields", "around", "words"), read_cases("names", "unknown"))
def test_what_cannot_be_known_is_said_and_no_line_is_to_be_carried_out(
    name: str, fields: list[str], around: dict[str, Any], words: str
) -> None:
    text, renaming = cure_name(name, fields, 0.1, {}, around)
    assert renaming is None
    assert words.lower() in text.lower()


@pytest.mark.parametrize(("name", "fields"), read_cases("names", "apart"))
def test_a_name_of_something_else_is_not_offered(name: str, fields: list[str]) -> None:
    assert cure_name(name, fields, 1.0, otherwise="none") == ("none", None)


def test_a_field_that_stands_there_already_is_not_written_twice() -> None:
    text, renaming = cure_name("limit_um", ["limit_mm"], 500, {"limit_mm": 0.5}, {"limit_mm": 0.5})
    assert renaming is None
    assert "stands there, too" in text


BESIDE = ("un", "non_", "not_", "half_", "log_", "semi_", "anti_", "inverse_", "truncated_", "multi_", "quasi_", "no_")


def test_no_word_of_a_choice_is_offered_for_one_of_another_meaning() -> None:
    """Each choice of each record: its words with another meaning, and words of the trade that are near by letters."""
    choices = {
        tuple(words)
        for record in RECORDS
        for info in fields_of(record).values()
        if (words := words_of(info.annotation))
    }
    assert RANDOM in choices
    for known in choices:
        for word in known:
            for near in (*(before + word for before in BESIDE), f"{word}_without_prior", f"{word}2", f"{word}_inverse"):
                if near in known:
                    continue
                assert f"did you mean {word}?" not in ask_meant(near, known), near
            assert ask_meant(word.upper(), known) == f"did you mean {word}?"
            assert ask_meant(word.replace("_", " "), known) == f"did you mean {word}?"


OTHERS = {tuple(known): words for known, *words in read_cases("names", "others")}


@pytest.mark.parametrize("known", OTHERS, ids="/".join)
def test_words_of_the_trade_that_mean_something_else(known: tuple[str, ...]) -> None:
    for word in OTHERS[known]:
        assert "did you mean" not in ask_meant(word, known), word


def test_another_law_is_told_what_comes_nearest() -> None:
    laws = ["normal", "uniform", "triangular"]
    for word in OTHERS["normal", "uniform", "triangular", "bounded"][:11]:
        if word not in ("abnormal",):
            assert ask_meant(word, laws), word
            assert "bounded" not in ask_meant(word, laws)  # which is not to be had there
    assert ask_meant("Gaussian", laws) == ask_meant("normal distribution", laws) == "did you mean normal?"


def test_a_design_with_noise_in_mm_is_cured_by_its_pixels() -> None:
    """The view's own pitch, of its preset; the required field is not told an example of another size beside it."""
    text = (EXAMPLES / "demo.yaml").read_text()
    slipped = text.replace("fiducial_noise_px: 0.3 ", "fiducial_noise_mm: 0.0582 ", 1)
    (problem,) = problems_of(load_design, slipped, error=DesignError)
    assert problem.hint.endswith("divide by pixel_mm, 0.194: fiducial_noise_px: 0.3")
    cure = problem.hint.rpartition(": fiducial")[2]
    mended = slipped.replace("fiducial_noise_mm: 0.0582", f"fiducial{cure}")
    assert load_design(mended).sha256 == load_design(text).sha256


def test_names_are_read_alike_however_they_are_written() -> None:
    for name in ("half_width_mm", "halfWidthMm", "half width (mm)", "half-width [mm]", "mm_half_width", "halfwidth_mm"):
        reading = read_name(name)
        assert (reading.stem, reading.spread, str(reading.unit)) == ((), "half-width", "mm"), name
    assert cure_name("half_width_um", ["half_width_mm"], NOTHING)[0].endswith(
        "convert the number, do not only rename it"
    )

"""What a wrong or impossible ``optimise`` section is told: pointer, code and words, by the reader or by the optimiser.

The JSON Schema must accept what the reader accepts, and refuse what is wrong with the structure alone.
"""

from __future__ import annotations

import copy
from typing import Any

import jsonschema
import pytest

from optimise_documents import BOX, document, free, moving, normal
from plain_data import problems_of
from tailstack.design import design_json_schema, load_design
from tailstack.errors import DesignError, InfeasibleError, Problem, TailstackError
from tailstack.optimisation import optimise

VALIDATOR = jsonschema.Draft202012Validator(design_json_schema())

SEAT, FLANGE = "structure_connector", "connector_flange"
DEG = {"min_deg": 0.01, "max_deg": 0.5}
MM = {"min_mm": 0.002, "max_mm": 0.2}
GRADES = [{"name": "fine", "half_width_deg": 0.02, "price": 9.0}, {"name": "rough", "half_width_deg": 0.2, "price": 1}]
RX = free(SEAT, "rx", **DEG)
CYLINDER = {"base_mm": [0, 0, -85], "height_mm": 100.0, "radius_mm": 45.0}
BALL = {"centre_mm": [0, 0, -35], "radius_mm": 50.0}
PIVOT = {"interface": FLANGE, "box": {"min_mm": [0, 0, -145], "max_mm": [0, 0, -60]}}


def section(**fields: Any) -> dict[str, Any]:
    return fields


def graded(*changes: dict[str, Any]) -> list[dict[str, Any]]:
    """The table with the grades changed in turn."""
    return [grade | change for grade, change in zip(copy.deepcopy(GRADES), changes, strict=True)]


# section, pointer of the first problem below /optimise, its code, words in it.  Refused by the reader; those in
# STRUCTURE by the JSON Schema too.
STRUCTURE: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "unknown field": (section(boxes=BOX), "/boxes", "unknown-field", "box"),
    "unknown interface": (
        section(tolerances=[RX | {"interface": "flange"}]), "/tolerances/0/interface", "unknown-value",
        "structure_connector",
    ),
    "unknown objective": (section(box=BOX, objective="price"), "/objective", "unknown-value", "pareto"),
    "two shapes": (section(region={"box": BOX, "ball": BALL}), "/region", "one-of", "box and ball"),
    "no shape": (section(region={}), "/region", "one-of", "none"),
    "five fiducials": (section(box=BOX, count={"min": 5, "max": 8}), "/count/min", "out-of-range", "6"),
    "mm for degrees": (section(rotation_bounds=MM), "/rotation_bounds/min_deg", "missing-field", "required"),
    "unknown curve": (
        section(rotation_bounds=DEG | {"cost": {"curve": "linear"}}), "/rotation_bounds/cost/curve", "unknown-value",
        "exponential",
    ),
    "three pivots": (section(pivots=[PIVOT] * 3), "/pivots", "too-long", "at most 2"),
    "negative seed": (section(box=BOX, seed=-1), "/seed", "out-of-range", "-1"),
    "two ways to stay": (
        section(box=BOX, rotation_bounds=DEG, stay={"cost_per_mm": 1, "at_most_mm": 5}), "/stay", "one-of", "both",
    ),
    "no way to stay": (section(box=BOX, stay={}), "/stay", "one-of", "neither"),
    "paid for moving": (
        section(box=BOX, rotation_bounds=DEG, stay={"cost_per_mm": -1}), "/stay/cost_per_mm", "out-of-range", "-1",
    ),
    "nowhere to go": (section(box=BOX, stay={"at_most_mm": 0}), "/stay/at_most_mm", "out-of-range", "0.01"),
}  # fmt: skip

MEANING: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "unknown component": (
        section(tolerances=[free(SEAT, "rw", **MM)]), "/tolerances/0/component", "unknown-name", "rx",
    ),
    "undeclared component": (
        section(tolerances=[free(FLANGE, "tx", **MM)]), "/tolerances/0", "unknown-name", "its law is not known",
    ),
    "unknown fixed": (section(box=BOX, fixed=["F1", "F99"]), "/fixed/1", "unknown-name", "F9"),
    "unknown in a group": (
        section(regions=[{"fiducials": ["F1", "G"], "box": BOX}]), "/regions/0/fiducials/1", "unknown-name", "G",
    ),
    "in two groups": (
        section(regions=[{"fiducials": ["F1"], "box": BOX}, {"fiducials": ["F1"], "ball": BALL}]),
        "/regions/1/fiducials/0", "duplicate-name", "F1",
    ),
    "fixed in a group": (
        section(regions=[{"fiducials": ["F1"], "box": BOX}], fixed=["F1"]), "/regions/0/fiducials/0",
        "fixed-and-free", "F1",
    ),
    "unknown requirement": (section(box=BOX, requirement="accurate"), "/requirement", "unknown-name", "accuracy"),
    "unknown among requirements": (
        section(box=BOX, requirement=["accuracy", "speed"]), "/requirement/1", "unknown-name", "accuracy",
    ),
    "a requirement twice": (
        section(box=BOX, requirement=["accuracy", "accuracy"]), "/requirement/1", "duplicate-name", "accuracy",
    ),
    "crossed box": (section(box=BOX | {"min_mm": [0, 50, 0]}), "/box/min_mm", "empty-box", "along y"),
    "empty tube": (
        section(region={"cylinder": CYLINDER | {"inner_radius_mm": 46}}), "/region/cylinder/inner_radius_mm",
        "empty-region", "46",
    ),
    "empty shell": (
        section(regions=[{"fiducials": ["F1"], "ball": BALL | {"inner_radius_mm": 51}}]),
        "/regions/0/ball/inner_radius_mm", "empty-region", "51",
    ),
    "no axis": (
        section(region={"cylinder": CYLINDER | {"axis": [0, 0, 0]}}), "/region/cylinder/axis", "zero-direction",
        "[0, 0, 0]",
    ),
    "no normal": (
        section(box=BOX, symmetry={"mirror": {"normal": [0, 0, 0]}}), "/symmetry", "zero-direction", "[0, 0, 0]",
    ),
    "two symmetries": (
        section(box=BOX, symmetry={"mirror": {"normal": [1, 0, 0]}, "rotation": {"order": 2}}), "/symmetry", "one-of",
        "both",
    ),
    "no symmetry": (section(box=BOX, symmetry={}), "/symmetry", "one-of", "neither"),
    "group without its third": (
        section(box=BOX, fixed=["F1"], symmetry={"rotation": {"order": 3}}), "/symmetry", "incomplete-group", "5 free",
    ),
    "region without its second": (
        section(regions=[{"fiducials": ["F1", "F2", "F3"], "box": BOX}], symmetry={"mirror": {"normal": [1, 1, 0]}}),
        "/regions/0/fiducials", "incomplete-group", "groups of 2",
    ),
    "box and region": (section(box=BOX, region={"ball": BALL}), "/region", "one-of", "box and region"),
    "zone without region": (
        section(tolerances=[RX], keep_out=[{"name": "a", "ball": BALL}]), "/keep_out", "unused-field", "region",
    ),
    "symmetry without region": (
        section(tolerances=[RX], symmetry={"rotation": {"order": 2}}), "/symmetry", "unused-field", "region",
    ),
    "count without region": (section(tolerances=[RX], count={"min": 6, "max": 8}), "/count", "unused-field", "region"),
    "nothing that could stay": (
        section(tolerances=[RX], stay={"at_most_mm": 5}), "/stay", "unused-field", "region",
    ),
    "moves of nothing": (section(tolerances=[RX], fewest_moves=True), "/fewest_moves", "unused-field", "region"),
    "a price of moving without a cost": (
        section(box=BOX, stay={"cost_per_mm": 1}), "/stay/cost_per_mm", "unsupported", "at_most_mm instead",
    ),
    "a price of moving along a front": (
        section(box=BOX, rotation_bounds=DEG, objective="pareto", stay={"cost_per_mm": 1}), "/stay/cost_per_mm",
        "unsupported", "pareto weighs no cost",
    ),
    "a price of moving with grades": (
        section(box=BOX, tolerances=[free(SEAT, "rx", grades=GRADES)], stay={"cost_per_mm": 1}), "/stay/cost_per_mm",
        "unsupported", "one by one",
    ),
    "crossed count": (section(box=BOX, count={"min": 9, "max": 8}), "/count/min", "out-of-range", "above max"),
    "count with regions": (
        section(regions=[{"fiducials": ["F1"], "box": BOX}], count={"min": 6, "max": 8}), "/count", "one-of",
        "one region for all",
    ),
    "count of fixed ones": (
        section(box=BOX, count={"min": 6, "max": 8}, fixed=["F1", "F2", "F3", "F4", "F5", "F6"]), "/count",
        "nothing-free", "every fiducial is fixed",
    ),
    "crossed degrees": (
        section(rotation_bounds={"min_deg": 0.5, "max_deg": 0.1}), "/rotation_bounds/min_deg", "out-of-range", "0.5",
    ),
    "crossed millimetres": (
        section(translation_bounds={"min_mm": 0.5, "max_mm": 0.1}), "/translation_bounds/min_mm", "out-of-range",
        "0.5",
    ),
    "crossed bounds of one": (
        section(tolerances=[free(SEAT, "tx", min_mm=0.2, max_mm=0.1)]), "/tolerances/0/min_mm", "out-of-range", "0.2",
    ),
    "min_mm of a rotation": (
        section(tolerances=[RX | {"min_mm": 0.1}]), "/tolerances/0/min_mm", "unused-field", "rx is in deg",
    ),
    "max_deg of a translation": (
        section(tolerances=[free(SEAT, "tx", **MM, max_deg=0.1)]), "/tolerances/0/max_deg", "unused-field",
        "tx is in mm",
    ),
    "one bound": (
        section(tolerances=[free(SEAT, "rx", min_deg=0.1)]), "/tolerances/0", "missing-field", "max_deg",
    ),
    "freed twice": (section(tolerances=[RX, RX]), "/tolerances/1", "duplicate-name", "structure_connector.rx"),
    "pivot twice": (section(pivots=[PIVOT, PIVOT]), "/pivots/1", "duplicate-name", "connector_flange"),
    "grades with bounds": (
        section(tolerances=[RX | {"grades": GRADES}]), "/tolerances/0/grades", "one-of", "both",
    ),
    "grades with a curve": (
        section(tolerances=[free(SEAT, "rx", grades=GRADES, cost={"curve": "reciprocal"})]), "/tolerances/0/grades",
        "one-of", "both",
    ),
    "two grades of one name": (
        section(tolerances=[free(SEAT, "rx", grades=graded({"name": "a"}, {"name": "a"}))]),
        "/tolerances/0/grades/1/name", "duplicate-name", "'a'",
    ),
    "grade in mm": (
        section(tolerances=[free(SEAT, "rx", grades=[{"name": "a", "half_width_mm": 0.1, "price": 1}])]),
        "/tolerances/0/grades/0", "missing-field", "half_width_deg",
    ),
    "grade in both": (
        section(tolerances=[free(SEAT, "rx", grades=graded({}, {"half_width_mm": 0.1}))]), "/tolerances/0/grades/1",
        "one-of", "half_width_mm",
    ),
    "grade of nothing": (
        section(tolerances=[free(SEAT, "rx", grades=graded({}, {"half_width_deg": 0.0}))]), "/tolerances/0/grades/1",
        "out-of-range", "above zero",
    ),
    "grades beside bounds": (
        section(tolerances=[free(FLANGE, "ry", **DEG), free(SEAT, "rx", grades=GRADES)]), "/tolerances/1",
        "unsupported", "give the others grades too",
    ),
    "grades beside bounds for all": (
        section(tolerances=[free(SEAT, "rx", grades=GRADES)], rotation_bounds=DEG), "/tolerances/0", "unsupported",
        "chosen from grades, or none",
    ),
    "grades under scaling": (
        section(objective="scaling", tolerances=[free(SEAT, "rx", grades=GRADES)]), "/tolerances/0", "unsupported",
        "scaling",
    ),
    "weight and curve": (
        section(rotation_bounds=DEG | {"cost_weight": 1, "cost": {}}), "/rotation_bounds/cost_weight", "one-of",
        "both",
    ),
    "exponential without scale": (
        section(rotation_bounds=DEG | {"cost": {"curve": "exponential"}}), "/rotation_bounds/cost", "missing-field",
        "scale_deg",
    ),
    "scale of a power": (
        section(rotation_bounds=DEG | {"cost": {"scale_deg": 0.1}}), "/rotation_bounds/cost/scale_deg",
        "unused-field", "exponential",
    ),
    "scale in mm of a rotation": (
        section(rotation_bounds=DEG | {"cost": {"curve": "exponential", "scale_mm": 0.1}}),
        "/rotation_bounds/cost/scale_mm", "unused-field", "scale_deg",
    ),
    "cost limit missing": (
        section(objective="quantile", tolerances=[RX]), "", "missing-field", "cost_limit",
    ),
    "cost limit unused": (section(tolerances=[RX], cost_limit=100), "/cost_limit", "unused-field", "quantile"),
    "cost limit without tolerances": (section(box=BOX, cost_limit=100), "/cost_limit", "unused-field", "tolerances"),
    "front unused": (section(tolerances=[RX], front={"points": 3}), "/front", "unused-field", "pareto"),
    "crossed front": (
        section(objective="pareto", tolerances=[RX], front={"min_limit_mm": 2.0, "max_limit_mm": 1.0}),
        "/front/min_limit_mm", "out-of-range", "not below",
    ),
    "cost of nothing": (section(box=BOX, objective="cost"), "", "nothing-free", "free tolerances"),
    "nothing free": (section(starts=3), "", "nothing-free", "nothing may change"),
    "no translation declared": (
        section(translation_bounds=MM), "/translation_bounds", "nothing-free", "translational",
    ),
}  # fmt: skip


def with_section(optimise_section: dict[str, Any]) -> dict[str, Any]:
    """Rotations alone: the seat varies about x and y, the flange about x and y."""
    data = document()
    del data["interfaces"][SEAT]["tolerances"]["tx"]
    return data | {"optimise": optimise_section}


def refusal(data: dict[str, Any], error: type[TailstackError] = TailstackError) -> tuple[Problem, ...]:
    return problems_of(lambda: optimise(load_design(data)), error=error)


@pytest.mark.parametrize("name", [*STRUCTURE, *MEANING])
def test_the_reader_names_place_rule_and_cure(name: str) -> None:
    wrong, pointer, code, words = (STRUCTURE | MEANING)[name]
    data = with_section(wrong)
    if "tx" in str(wrong) and FLANGE not in str(wrong):
        data["interfaces"][SEAT]["tolerances"]["tx"] = normal("mm", 0.03)
    problem = problems_of(load_design, data, error=DesignError)[0]
    assert (problem.pointer, problem.code) == (f"/optimise{pointer}", code)
    assert words in str(problem)


@pytest.mark.parametrize("name", STRUCTURE)
def test_the_schema_refuses_the_same_structure(name: str) -> None:
    """independent: the jsonschema library on the published schema; the same document without the mistake is valid."""
    assert not VALIDATOR.is_valid(with_section(STRUCTURE[name][0]))
    assert VALIDATOR.is_valid(with_section({"box": BOX}))


def test_locators_are_named_and_have_no_pivot_to_move() -> None:
    data = with_section({"tolerances": [free(SEAT, "A9", **MM)]})
    rest = [([-40, -30], [0, 0, 1]), ([40, -30], [0, 0, 1]), ([0, 35], [0, 0, 1]), ([-35, -40], [0, 1, 0]),
            ([35, -40], [0, 1, 0]), ([-50, 0], [1, 0, 0])]  # fmt: skip
    data["interfaces"][SEAT] = {
        "pivot_mm": [0, 0, -80],
        "locators": [
            {"name": f"A{k}", "position_mm": [*at, -80], "normal": way, "half_width_mm": 0.01,
             "distribution": "uniform"}
            for k, (at, way) in enumerate(rest)
        ],
    }  # fmt: skip
    assert [(p.pointer, p.code) for p in refusal(data)] == [("/optimise/tolerances/0/component", "unknown-name")]
    data["optimise"] = {"pivots": [PIVOT | {"interface": SEAT}]}
    (problem,) = refusal(data)
    assert (problem.pointer, problem.code) == ("/optimise/pivots/0/interface", "no-pivot")
    assert "free its locators" in problem.hint
    data["optimise"] = {"rotation_bounds": DEG, "pivots": [PIVOT]}
    del data["interfaces"][FLANGE]
    assert {p.pointer for p in refusal(data)} == {
        "/optimise/rotation_bounds", "/optimise/pivots/0/interface"
    }  # fmt: skip


# Only the optimiser can tell: changes of the document, pointer, code, words.
IMPOSSIBLE: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "zone that swallows the box": (
        moving(keep_out=[{"name": "shell", "ball": {"centre_mm": [0, 0, -35], "radius_mm": 70}, "clearance_mm": 15}]),
        "/box", "kept-out", "shell",
    ),
    "spacing that cannot fit": (moving(min_spacing_mm=200.0), "/min_spacing_mm", "does-not-fit", "200"),
    "box out of view": (
        moving(box={"min_mm": [150, -10, -10], "max_mm": [170, 10, 10]}), "/box", "outside-view", "AP",
    ),
    "box behind the source": (
        moving(box={"min_mm": [-10, -800, -10], "max_mm": [10, 800, 10]}), "/box", "behind-source", "source",
    ),
    "no whole groups": (
        moving(symmetry={"rotation": {"order": 3}}, count={"min": 7, "max": 8}), "/count", "incomplete-group",
        "groups of 3",
    ),
    "cost limit below the least": (
        section(objective="quantile", cost_limit=400.0, rotation_bounds=DEG), "/cost_limit", "cost-out-of-reach",
        "458.367",  # 4 half-widths of 0.5 degrees
    ),
    "no common factor": (
        section(objective="scaling", rotation_bounds=DEG,
                tolerances=[free(SEAT, "rx", min_deg=0.3, max_deg=0.5), free(SEAT, "ry", min_deg=0.01, max_deg=0.2)]),
        "/tolerances/0", "no-common-factor", "seat ry",
    ),
    "fixed too near each other": (moving(fixed=["F1", "F2"], min_spacing_mm=85.0), "/fixed", "spacing-of-fixed", "F1"),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_the_optimiser_names_what_cannot_be(name: str) -> None:
    wrong, pointer, code, words = IMPOSSIBLE[name]
    problem = refusal(with_section(wrong))[0]
    assert (problem.pointer, problem.code) == (f"/optimise{pointer}", code)
    assert words in str(problem)
    assert problem.hint


def test_the_tightest_grades_may_not_do() -> None:
    grades = graded({"half_width_deg": 0.09}, {})
    tolerances = [free(interface, axis, grades=grades) for interface in (SEAT, FLANGE) for axis in ("rx", "ry")]
    (problem,) = refusal(document(limit_mm=0.35, tolerances=tolerances), InfeasibleError)
    assert (problem.pointer, problem.code) == ("/optimise", "limit-out-of-reach")


SECTIONS: dict[str, dict[str, Any]] = {
    "everything about the layout": moving(
        box=None, region={"cylinder": CYLINDER | {"axis": [0, 0, 1], "inner_radius_mm": 20}}, fixed=["F1"],
        keep_out=[{"name": "a", "clearance_mm": 1, "box": BOX}, {"name": "b", "ball": BALL}],
        count={"min": 6, "max": 10, "cost_per_fiducial": 2}, min_projected_spacing_px=30, image_margin_px=10,
        target_clearance_px=5, requirement=["accuracy"],
    ),
    "regions and a mirror": section(
        regions=[{"fiducials": ["F1", "F2"], "ball": BALL}, {"fiducials": ["F3", "F4"], "box": BOX}],
        symmetry={"mirror": {"normal": [1, 1, 0], "point_mm": [0, 0, 0]}}, requirement="accuracy",
    ),
    "turned": section(box=BOX, symmetry={"rotation": {"order": 3, "axis": [0, 0, 1], "point_mm": [0, 0, 0]}}),
    "curves": section(
        rotation_bounds=DEG | {"cost": {"curve": "exponential", "weight": 3, "scale_deg": 0.1}},
        translation_bounds=MM | {"cost": {"curve": "reciprocal_square"}}, tolerances=[RX | {"cost_weight": 2}],
    ),
    "grades": section(tolerances=[free(interface, "rx", grades=GRADES) for interface in (SEAT, FLANGE)]),
    "pivot": section(pivots=[PIVOT], starts=4, seed=9),
    "quantile": section(objective="quantile", cost_limit=900, rotation_bounds=DEG),
    "front": section(
        objective="pareto", front={"points": 4, "min_limit_mm": 0.5, "max_limit_mm": 2}, tolerances=[RX]
    ),
    "factor": section(objective="scaling", rotation_bounds=DEG),
}  # fmt: skip


@pytest.mark.parametrize("name", SECTIONS)
def test_schema_and_reader_accept_the_same(name: str) -> None:
    data = document()
    data["optimise"] = SECTIONS[name]
    VALIDATOR.validate(data)
    load_design(data)

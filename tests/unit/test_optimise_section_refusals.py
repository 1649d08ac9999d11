"""What a wrong or impossible ``optimise`` section is told: pointer, code and words, by the reader or by the optimiser.

The JSON Schema must accept what the reader accepts, and refuse what is wrong with the structure alone.
"""

from __future__ import annotations

from typing import Any

import jsonschema
import pytest
import yaml

from optimise_documents import document, free, normal
from plain_data import EXAMPLES, problems_of
from tailstack.design import design_json_schema, load_design
from tailstack.errors import DesignError, InfeasibleError, Problem, TailstackError
from tailstack.optimisation import optimise

VALIDATOR = jsonschema.Draft202012Validator(design_json_schema())

TABLES = yaml.safe_load((EXAMPLES.parent / "tests" / "data" / "optimise_sections.yaml").read_text(encoding="utf-8"))
STRUCTURE, MEANING, IMPOSSIBLE, SOUND = (TABLES[name] for name in ("structure", "meaning", "impossible", "sound"))
BOX, DEG, GRADES, PIVOT = (TABLES["names"][k] for k in (0, 3, 5, 7))
SEAT, FLANGE = "structure_connector", "connector_flange"


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
    data = with_section({"tolerances": [free(SEAT, "A9", min_mm=0.002, max_mm=0.2)]})
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


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_the_optimiser_names_what_cannot_be(name: str) -> None:
    wrong, pointer, code, words = IMPOSSIBLE[name]
    problem = refusal(with_section(wrong))[0]
    assert (problem.pointer, problem.code) == (f"/optimise{pointer}", code)
    assert words in str(problem)
    assert problem.hint


def test_the_tightest_grades_may_not_do() -> None:
    grades = [GRADES[0] | {"half_width_deg": 0.09}, GRADES[1]]
    tolerances = [free(interface, axis, grades=grades) for interface in (SEAT, FLANGE) for axis in ("rx", "ry")]
    (problem,) = refusal(document(limit_mm=0.35, tolerances=tolerances), InfeasibleError)
    assert (problem.pointer, problem.code) == ("/optimise", "limit-out-of-reach")


@pytest.mark.parametrize("name", SOUND)
def test_schema_and_reader_accept_the_same(name: str) -> None:
    data = document()
    data["optimise"] = SOUND[name]
    VALIDATOR.validate(data)
    load_design(data)

"""The published schema: valid itself, complete, and as strict as the reader where JSON Schema can say it."""

from __future__ import annotations

import copy

import jsonschema
import pytest

from plain_data import DEMO
from tailstack.design import check_design, design_json_schema, load_design
from tailstack.errors import DesignError

SCHEMA = design_json_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def records():
    yield "design", SCHEMA
    yield from SCHEMA["$defs"].items()


def test_schema_is_a_schema_without_null():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert "null" not in str(SCHEMA)


@pytest.mark.parametrize(("name", "record"), [pair for pair in records() if "properties" in pair[1]])
def test_every_field_is_described_and_every_plain_one_has_an_example(name, record):
    assert record["additionalProperties"] is False
    assert record.get("description")
    for field, spec in record["properties"].items():
        assert spec.get("description"), f"{name}.{field} has no description"
        plain = spec.get("type") in ("number", "integer", "string") or "prefixItems" in spec
        assert not plain or spec.get("examples"), f"{name}.{field} has no example"


@pytest.mark.parametrize(("name", "record"), [pair for pair in records() if "properties" in pair[1]])
def test_examples_in_the_schema_are_valid(name, record):
    for field, spec in record["properties"].items():
        for example in spec.get("examples", ()):
            validator = VALIDATOR.evolve(schema={**spec, "$defs": SCHEMA["$defs"]})
            assert validator.is_valid(example), f"{name}.{field}: {example!r}"


# A design written from the schema alone: each required field with its own first example.
def minimal(record):
    made = {}
    for field in record.get("required", ()):
        spec = record["properties"][field]
        made[field] = spec["examples"][0] if "examples" in spec else None
    return made


def test_a_design_made_from_the_schema_alone():
    definitions = SCHEMA["$defs"]
    preset = {**minimal(definitions["PresetView"]), "source_isocentre_mm": 700.0}
    points = [[x, y, z] for x in (-40, 40) for y in (-38, 42) for z in (-80, 0)]
    design = {
        **minimal(SCHEMA),
        "views": [
            {**preset, "orientation": "AP"},
            {**preset, "name": "LAT", "orientation": "LAT"},
        ],
        "fiducials": {"points": [{"position_mm": point} for point in points]},
        "targets": [{**minimal(definitions["TargetDocument"]), "position_mm": [0.0, 0.0, 70.0]}],
        "requirements": [minimal(definitions["RequirementDocument"])],
    }
    VALIDATOR.validate(design)
    system, _, _ = check_design(load_design(design))
    assert system.requirements[0].limit_mm == 2.0


BOTH_REFUSE = {
    "unknown field": lambda d: d.update(colour=1),
    "text for number": lambda d: d["views"][0].update(fiducial_noise_px="0.3"),
    "negative": lambda d: d["views"][0].update(fiducial_noise_px=-0.3),
    "two directions": lambda d: d["views"][0].update(beam_direction=[0, 1, 0]),
    "unknown preset": lambda d: d["views"][0].update(preset="none"),
    "mixed geometry": lambda d: d["views"][0].update(projection=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
    "one view": lambda d: d["views"].pop(),
    "points and file": lambda d: d["fiducials"].update(file="a.csv"),
    "short vector": lambda d: d["targets"][0].update(position_mm=[1, 2]),
    "no target": lambda d: d["targets"].clear(),
    "law": lambda d: d["interfaces"]["structure_connector"]["tolerances"]["rx"].update(distribution="gauss"),
    "no law": lambda d: d["interfaces"]["structure_connector"]["tolerances"]["rx"].pop("distribution"),
    "five locators": lambda d: d["interfaces"]["structure_connector"].update(locators=[]),
    "version": lambda d: d.update(schema="tailstack/design/9"),
    "matrix": lambda d: d["transforms"].update(T_flange_con=[[1, 0], [0, 1]]),
}


@pytest.mark.parametrize("mistake", BOTH_REFUSE)
def test_schema_and_reader_refuse_the_same(mistake):
    data = copy.deepcopy(DEMO)
    assert VALIDATOR.is_valid(data)
    BOTH_REFUSE[mistake](data)
    assert not VALIDATOR.is_valid(data)
    with pytest.raises(DesignError):
        load_design(data)

"""Records that leave the program as JSON, by name, and their published schemas.

The records are the frozen dataclasses of :mod:`tailstack.results` and of this package; pydantic is used
on them only to write JSON Schemas and to turn them into plain data.  A number that is not finite never leaves:
JSON has no such number, and a result that holds one is a defect to be reported, not shipped.
"""

from __future__ import annotations

import ast
import inspect
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, Literal

from pydantic import ConfigDict, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from tailstack.design import Design, check_design, design_json_schema, list_presets
from tailstack.json_text import write_json
from tailstack.results import Finding, Optimisation, Score, Verification, ViewCheck
from tailstack.results.older import in_words_of_today
from tailstack.results.sweep import Sweep
from tailstack.studies.bench.compare import StudyComparison
from tailstack.studies.coupling import StudyCoupling
from tailstack.studies.linearity import StudyLinearity
from tailstack.studies.paper.reproduce import StudyPaper

from .gate.records import GateRecord
from .job_document import JobDocument, JobPage
from .problems import ProblemDocument
from .report.records import Comparison, Report

DIALECT = "https://json-schema.org/draft/2020-12/schema"


@dataclass(frozen=True, slots=True)
class Validation:
    """A design that was read and checked, and what it holds.  Nothing was computed."""

    schema: Literal["tailstack/validation/1"]
    """Name and version of this record's schema."""
    valid: Literal[True]
    """A design that is not valid is answered with a problem document."""
    name: str
    """Name of the design."""
    design_sha256: str
    """SHA-256 of the design's canonical content, fiducials included."""
    views: tuple[str, ...]
    """Names of the views."""
    fiducials: int
    """Number of fiducials."""
    targets: tuple[str, ...]
    """Names of the targets, regions expanded to their samples."""
    requirements: tuple[str, ...]
    """Names of the requirements."""
    visibility: tuple[ViewCheck, ...]
    """Visibility of the fiducials in each view."""
    findings: tuple[Finding, ...]
    """Remarks about the design's geometry."""
    notes: tuple[str, ...]
    """What was done to the design's numbers on the way, and what it leaves open."""


def validate(design: Design) -> Validation:
    """Compile the design, check its geometry and count what it holds.  Raises DesignError and IllPosedError."""
    system, findings, visibility = check_design(design)
    return Validation(
        schema="tailstack/validation/1",
        valid=True,
        name=design.name,
        design_sha256=design.sha256,
        views=tuple(view.name for view in system.views),
        fiducials=len(system.fiducials_mm),
        targets=tuple(target.name for target in system.targets),
        requirements=tuple(requirement.name for requirement in system.requirements),
        visibility=visibility,
        findings=findings,
        notes=system.notes,
    )


@dataclass(frozen=True, slots=True)
class ConvertedPoint:
    label: str
    """Label of the fiducial."""
    position_mm: tuple[float, float, float]
    """Position, con (LPS), mm."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """A fiducial file or a design in another format, and the fiducials in it."""

    schema: Literal["tailstack/conversion/1"]
    """Name and version of this record's schema."""
    format: Literal["csv", "fcsv", "mrk.json", "yaml", "json"]
    """Format of `content`."""
    content: str
    """The converted text."""
    fiducials: tuple[ConvertedPoint, ...]
    """The fiducials in it."""
    notes: tuple[str, ...]
    """What was done to the numbers on the way."""


RECORDS: dict[str, type] = {
    "score": Score,
    "verification": Verification,
    "optimisation": Optimisation,
    "sweep": Sweep,
    "study-paper": StudyPaper,
    "study-linearity": StudyLinearity,
    "study-coupling": StudyCoupling,
    "study-comparison": StudyComparison,
    "validation": Validation,
    "gate": GateRecord,
    "report": Report,
    "comparison": Comparison,
    "conversion": Conversion,
    "job": JobDocument,
    "jobs": JobPage,
    "problem": ProblemDocument,
}


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    """Made when first needed: all of them together take a noticeable part of a start."""
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


_WRITERS: dict[type, TypeAdapter[Any]] = {}


def _writer(kind: type) -> TypeAdapter[Any]:
    """Of a tuple of one record: a dataclass has no place to say that a number that is none stays what it is."""
    if kind not in _WRITERS:
        _WRITERS[kind] = TypeAdapter(tuple[kind], config=ConfigDict(ser_json_inf_nan="constants"))  # type: ignore[valid-type]
    return _WRITERS[kind]


def plain(record: Any) -> Any:
    """A record as JSON's own types; a whole number in a field of floats is a float, as it is when read back."""
    return _writer(type(record)).dump_python((record,), mode="json")[0]


def to_json(record: Any) -> bytes:
    """A record as it leaves the program, by command and over HTTP alike: what is stored, hashed and compared.

    Compact UTF-8, fields in their declared order.  Raises ValueError if it holds a number that JSON cannot hold.
    """
    return write_json(plain(record)).encode()


def read_record(name: str, content: bytes) -> Any:
    """The record of a published document: what :func:`to_json` of this version or an older one wrote.

    Raises ValueError, of which pydantic's ValidationError is one.
    """
    return from_plain(name, json.loads(content))


def from_plain(name: str, data: Any) -> Any:
    """The record of a published document given as plain data.  Raises pydantic's ValidationError."""
    return _adapter(RECORDS[name]).validate_python(in_words_of_today(data))


def record_json_schema(record: type) -> dict[str, Any]:
    """The JSON Schema of a record as it is written, each property with the text that stands below its field."""
    schema = _adapter(record).json_schema(mode="serialization", schema_generator=_DescribedSchema)
    _require_all(schema)
    for definition in schema.get("$defs", {}).values():
        _require_all(definition)
    return schema


class _DescribedSchema(GenerateJsonSchema):
    """Pydantic's schema, where each property of a record is described by the text below its field in the source."""

    def dataclass_schema(self, schema: Any) -> dict[str, Any]:
        made = super().dataclass_schema(schema)
        for name, words in _texts_below_fields(schema["cls"].__module__).get(schema["cls"].__name__, {}).items():
            if name in made.get("properties", {}):
                made["properties"][name]["description"] = words
        return made


@cache
def _texts_below_fields(module: str) -> dict[str, dict[str, str]]:
    """By class and field, the string literals that stand below the fields of a module's classes."""
    found: dict[str, dict[str, str]] = {}
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    for kind in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        for field, below in pairwise(kind.body):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    found.setdefault(kind.name, {})[name] = " ".join(words.split())
    return found


def _require_all(schema: dict[str, Any]) -> None:
    """Answers always carry every field, and no other."""
    if "properties" in schema:
        schema["required"] = list(schema["properties"])
        schema["additionalProperties"] = False


def _preset_schema() -> dict[str, Any]:
    """Every name that the field ``preset`` of a view takes, with its numbers and source."""

    def entry(preset: dict[str, Any]) -> dict[str, Any]:
        size = preset["image_size_px"]
        numbers = [
            f"source-detector {preset['source_detector_mm']:g} mm",
            f"source-isocentre {preset['source_isocentre_mm']:g} mm" if preset["source_isocentre_mm"] else "",
            f"pixel {preset['pixel_mm']:g} mm" if preset["pixel_mm"] else "",
            f"image {size[0]} x {size[1]} px" if size else "",
            f"the view must state {', '.join(preset['view_must_state'])}" if preset["view_must_state"] else "",
        ]
        words = "; ".join(part for part in numbers if part) + f". Source: {preset['source']}."
        remark = preset["remark"]
        return {
            "const": preset["name"],
            "title": preset["title"],
            "description": words + (f" {remark[0].upper()}{remark[1:]}." if remark else ""),
        }

    return {
        "title": "Preset",
        "description": "Published C-arm geometries: the names that the field `preset` of a view takes.",
        "type": "string",
        "oneOf": [entry(preset) for preset in list_presets()],
    }


_TITLES = {
    "design": "the design document: what a user writes",
    "score": "answer of score: first-order bias, covariance, tail, budget",
    "verification": "answer of verify: Monte Carlo on the full chain",
    "optimisation": "answer of optimise: the new design and its certificate",
    "sweep": "answer of sweep: every point of a grid of designs",
    "study-paper": "answer of study paper: the published tables cell by cell, printed and reproduced",
    "study-linearity": "answer of study linearity: first order over Monte Carlo, point by point of a grid",
    "study-comparison": "answer of study compare: bench measurements against prediction",
    "study-coupling": "answer of study coupling: the tail together against its parts, with intervals",
    "validation": "answer of validate over HTTP",
    "gate": "answer of gate: verdict, exit code, findings at their places",
    "report": "score, check and optimisation of one design in one record; html, pdf and xlsx are made from it",
    "comparison": "two designs reported with one seed and what sets them apart",
    "policy": "what a gate judges by: rules, limits, classes of designs",
    "waivers": "findings that a gate accepts for now",
    "conversion": "answer of convert over HTTP",
    "job": "a computation that was accepted over HTTP: state, progress, problem, links",
    "jobs": "a page of jobs, newest first",
    "problem": "every refusal (RFC 9457), over HTTP and with --json",
    "presets": "published C-arm geometries, the names that `preset` takes",
}


def schema_names() -> dict[str, str]:
    """Name and one-line description of every published schema."""
    return dict(_TITLES)


@cache
def _schema_text(name: str) -> str:
    from .gate.rules import policy_json_schema
    from .gate.waivers import waivers_json_schema

    makers: dict[str, Callable[[], dict[str, Any]]] = {
        "design": design_json_schema,
        "presets": _preset_schema,
        "policy": policy_json_schema,
        "waivers": waivers_json_schema,
    }
    body = makers[name]() if name in makers else record_json_schema(RECORDS[name])
    head = {"$schema": DIALECT, "$id": f"urn:tailstack:schema:{name}:1"}
    return write_json({**head, **{key: value for key, value in body.items() if key not in head}})


def json_schema(name: str) -> dict[str, Any]:
    """The published JSON Schema (draft 2020-12) of a document.  Raises KeyError for a name that is not published."""
    if name not in _TITLES:
        raise KeyError(name)
    schema: dict[str, Any] = json.loads(_schema_text(name))
    return schema

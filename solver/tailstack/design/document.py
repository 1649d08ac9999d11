"""The design document, ``tailstack/design/1``: what a user writes, field by field.

Angles are in degrees and lengths in millimetres here and nowhere else; :mod:`.compile` converts once.
The published JSON Schema is generated from these classes, so every field carries its description, its
unit (in its name), its default and an example.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from ..system import Reading, RotationForm, Triangulation
from .fields import (
    COVERAGE_WORDS,
    LAW_WORDS,
    CoverageFactor,
    HalfWidth,
    HalfWidths,
    Length,
    Name,
    Point,
    RandomLaw,
    Record,
    check_coverage,
    exactly_one,
    one_of,
    refusal,
    shared,
)
from .mount_document import Execution, Interfaces
from .optimise_document import Optimise
from .view_document import Transform, ViewDocument

SCHEMA_NAME = "tailstack/design/1"

_Side = Annotated[float, Field(ge=0, le=1e5)]
_Sides = Annotated[tuple[_Side, _Side, _Side], Field(strict=False)]
_Count = Annotated[int, Field(ge=1, le=20)]
_Counts = Annotated[tuple[_Count, _Count, _Count], Field(strict=False)]


class FiducialPoint(Record):
    """One fiducial."""

    label: Name | None = Field(
        default=None, description="Name; default F1, F2, ... by position in the list.", examples=["F1"]
    )
    position_mm: Point = Field(description="Nominal position in con, mm.", examples=[[-40.0, 30.0, -60.0]])


class Manufacturing(Record):
    """How far each fiducial may sit from its nominal position, per coordinate, independently."""

    half_width_mm: HalfWidth | HalfWidths = Field(
        description="Half-width, mm: one number for the three axes, or [x, y, z].", examples=[0.05]
    )
    distribution: RandomLaw = Field(description=LAW_WORDS + ".", examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    @model_validator(mode="after")
    def _coverage(self) -> Manufacturing:
        check_coverage(self.distribution, self.coverage_factor)
        return self


class FiducialOrigin(Record):
    """Where inlined points were read from, and what was done to them on the way.

    Written when a fiducial file is read into a design (convert, optimise, report), so that results go on saying it.
    """

    file: Annotated[str, Field(min_length=1, max_length=400)] = Field(
        description="Name of the fiducial file, as the design named it.", examples=["fiducials/phantom.mrk.json"]
    )
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] = Field(
        description="SHA-256 of the file's bytes, 64 hexadecimal digits.", examples=["0" * 64]
    )
    coordinate_system: Literal["LPS", "RAS"] = Field(
        description="What the file held. The points here are LPS: of RAS, x and y changed their sign.",
        examples=["RAS"],
    )
    coordinate_system_stated: bool = Field(
        default=True, description="false: the file did not say, and was read as its format was written then.",
        examples=[True],
    )  # fmt: skip
    coordinate_unit: Literal["um", "mm", "cm", "m"] = Field(
        default="mm", description="Unit of the coordinates in the file. The points here are in mm.", examples=["mm"]
    )
    left_out: list[Name] = Field(
        default_factory=list,
        description="Points of the file that are no fiducials here, as their position was not defined: their labels.",
        examples=[["P10"]],
    )
    changed: bool = Field(
        default=False,
        description="true: the points are no longer those of the file (the optimiser moved or left out some).",
        examples=[False],
    )


class Fiducials(Record):
    """The fiducials of the structure, in the document or in a file beside it."""

    model_config = ConfigDict(json_schema_extra=exactly_one("points", "file"))

    points: Annotated[list[FiducialPoint], Field(min_length=1)] | None = Field(
        default=None, description="The fiducials, at least six. Either this or file."
    )
    file: Annotated[str, Field(min_length=1, max_length=400)] | None = Field(
        default=None,
        description="Fiducial file beside the design (relative path): .csv with units in the header "
        "(label,x_mm,y_mm,z_mm), 3D Slicer .mrk.json or .fcsv. RAS coordinates are converted to LPS.",
        examples=["fiducials/demo.csv"],
    )
    origin: FiducialOrigin | None = Field(
        default=None,
        description="Only with points that were read from a fiducial file: which one, and what was done to them. "
        "Results note it; it changes no number, nor the hash of the design.",
    )
    manufacturing: Manufacturing | None = Field(
        default=None, description="Manufacturing tolerance of the fiducials' positions. Absent: perfect."
    )

    @model_validator(mode="after")
    def _one_list(self) -> Fiducials:
        if (self.points is None) == (self.file is None):
            given = "both" if self.file is not None else "neither"
            raise refusal("one-of", f"give exactly one of points and file; {given} arrived")
        if self.file is not None and self.origin is not None:
            words = "origin belongs to points that were read from a file; here the file itself is named"
            raise refusal("unused-field", words, "remove origin", "origin")
        return self


class Transforms(Record):
    """From the connector to the tool; each is rigid and the identity when absent."""

    T_flange_con: Transform | None = Field(
        default=None,
        description="Maps con coordinates to the flange frame. 4x4 matrix (mm) or rotation and translation_mm.",
    )
    T_tcp_flange: Transform | None = Field(
        default=None,
        description="Maps flange coordinates to the tcp frame. 4x4 matrix (mm) or rotation and translation_mm.",
    )


class Box(Record):
    """A grid of targets in an axis-parallel box."""

    centre_mm: Point = Field(description="Centre in con, mm.", examples=[[0.0, 0.0, 60.0]])
    size_mm: _Sides = Field(description="Full edge lengths along x, y, z, mm.", examples=[[30.0, 20.0, 10.0]])
    points_per_axis: _Count | _Counts = Field(
        default=2,
        description="Grid points along each axis, ends included; 1 is the centre. Default 2: the corners.",
        examples=[2],
    )


class Sphere(Record):
    """A ball sampled by its centre, its 6 axis points and 8 diagonal points."""

    centre_mm: Point = Field(description="Centre in con, mm.", examples=[[0.0, 0.0, 60.0]])
    radius_mm: Length = Field(description="Radius, mm.", examples=[10.0])


class Region(Record):
    """A target region, by exactly one shape."""

    model_config = ConfigDict(json_schema_extra=exactly_one("box", "sphere"))

    box: Box | None = Field(default=None, description="Axis-parallel box.")
    sphere: Sphere | None = Field(default=None, description="Ball.")

    @model_validator(mode="after")
    def _one_shape(self) -> Region:
        if (self.box is None) == (self.sphere is None):
            raise refusal("one-of", "a region is exactly one of box and sphere")
        return self


class TargetDocument(Record):
    """A target point, or a region that is expanded to points called name[0], name[1], ..."""

    model_config = ConfigDict(json_schema_extra=exactly_one("position_mm", "region"))

    name: Name = Field(description="Name, unique.", examples=["tip"])
    position_mm: Point | None = Field(
        default=None, description="Position in con, mm. Either this or region.", examples=[[0.0, 0.0, 70.0]]
    )
    region: Region | None = Field(default=None, description="Target region in con.")

    @model_validator(mode="after")
    def _one_place(self) -> TargetDocument:
        if (self.position_mm is None) == (self.region is None):
            given = "both" if self.region is not None else "neither"
            raise refusal("one-of", f"a target has exactly one of position_mm and region; {given} arrived")
        return self


class RequirementDocument(Record):
    """What the design promises."""

    name: Name = Field(description="Name, unique.", examples=["tip-accuracy"])
    error: Literal["tcp", "localisation"] = Field(
        default="tcp",
        description="tcp: error at the tool, everything included. localisation: of the reconstructed target in con.",
        examples=["tcp"],
    )
    quantile: Annotated[float, Field(ge=0.5, le=0.9999)] = Field(
        default=0.95, description="Quantile of the error's norm that is limited. Default 0.95.", examples=[0.95]
    )
    limit_mm: Length = Field(description="The quantile must not exceed this, mm.", examples=[2.0])
    confidence: Annotated[float, Field(ge=0.5, le=0.9999)] = Field(
        default=0.95,
        description="Confidence of the interval the Monte Carlo verdict is taken from. Default 0.95.",
        examples=[0.95],
    )
    targets: Literal["all"] | Annotated[list[Name], Field(min_length=1)] = Field(
        default="all", description="all, or a list of names of targets and regions. Default all.", examples=["all"]
    )
    risk: Literal["pooled", "per_unit"] = Field(
        default="pooled",
        description="pooled: over installed units and shots together. per_unit: each unit on its own; see min_yield.",
        examples=["pooled"],
    )
    min_yield: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        default=None,
        description="per_unit only, required there: fraction of installed units whose own quantile meets the limit.",
        examples=[0.95],
    )

    @model_validator(mode="after")
    def _yield(self) -> RequirementDocument:
        if self.risk == "pooled" and self.min_yield is not None:
            raise refusal("unused-field", "min_yield is read only with risk: per_unit", at="min_yield")
        if self.risk == "per_unit" and self.min_yield is None:
            raise refusal("missing-field", "risk: per_unit needs min_yield", "min_yield: 0.95")
        return self


class Model(Record):
    """Choices of the model; the defaults are what a real structure does."""

    installation_reading: Annotated[Reading, one_of(Reading)] = Field(
        default=Reading.PHYSICAL,
        description="physical: an installation error moves the structure and its images. eq18: it moves the "
        "coordinates the estimator is told (Eq 18 of the paper). Default physical.",
        examples=["physical"],
    )
    rotation: Annotated[RotationForm, one_of(RotationForm)] = Field(
        default=RotationForm.FULL, description="full: Rx Ry Rz. small_angle: I + [w]x. Default full.", examples=["full"]
    )
    triangulation: Annotated[Triangulation, one_of(Triangulation)] = Field(
        default=Triangulation.NORMALISED,
        description="normalised: in the fiducials' Hartley frame. published: in plain con mm. Default normalised.",
        examples=["normalised"],
    )


class DesignDocument(Record):
    """A reference structure on a robot, seen by two or more X-ray views."""

    schema_: Literal["tailstack/design/1"] = Field(
        alias="schema", description="Version of this document.", examples=["tailstack/design/1"]
    )
    name: Name = Field(description="Name of the design.", examples=["drill-guide reference, rev C"])
    description: Annotated[str, Field(max_length=4000)] = Field(
        default="", description="Free text.", examples=["12 beads of 3 mm on a PEEK carrier"]
    )
    views: Annotated[list[ViewDocument], Field(min_length=2)] = Field(description="The X-ray views, two or more.")
    fiducials: Fiducials = Field(description="The fiducials the views are resected from.")
    interfaces: Interfaces = Field(
        default_factory=shared(Interfaces()),
        description="Installation errors. Absent: both interfaces are perfect.",
    )
    transforms: Transforms = Field(
        default_factory=shared(Transforms()),
        description="From the connector to the tool. Absent: identity.",
    )
    execution: Execution = Field(
        default_factory=shared(Execution()),
        description="Errors of the robot and the tool. Absent: none.",
    )
    targets: Annotated[list[TargetDocument], Field(min_length=1)] = Field(
        description="Where the tool has to go: named points or regions, in con."
    )
    requirements: list[RequirementDocument] = Field(default=[], description="What is promised. Default nothing.")
    model: Model = Field(default_factory=shared(Model()), description="Choices of the model.")
    optimise: Optimise | None = Field(default=None, description="Freedom of the optimiser. Absent: it refuses.")


SCHEMA_ID = "urn:tailstack:schema:design:1"


def design_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/design/1``; every field with description, unit, default and example.

    An optional field is left out rather than null, so the null alternatives that pydantic writes are dropped.
    Rules across fields (unique names, references, coverage factors) are in the descriptions.
    """
    schema = without_null(DesignDocument.model_json_schema(by_alias=True))
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": "tailstack design, version 1",
        "description": "A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in "
        "degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, "
        "interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are "
        "half-widths. Unknown fields, NaN and infinities are refused.",
    }
    return {**head, **{key: value for key, value in schema.items() if key not in head}}


def without_null(node: Any) -> Any:
    """A schema of pydantic's without the null alternatives: an optional field is left out, not null."""
    if isinstance(node, list):
        return [without_null(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: without_null(value) for key, value in node.items() if not (key == "default" and value is None)}
    options = node.get("anyOf")
    if isinstance(options, list) and {"type": "null"} in options:
        rest = [option for option in options if option != {"type": "null"}]
        del node["anyOf"]
        node = {**(rest[0] if len(rest) == 1 else {"anyOf": rest}), **node}
    return node

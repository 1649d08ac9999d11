"""Field types of the design document: every number has a unit in its name and a range it must lie in.

Ranges are generous (a hundred metres, half a turn) and exist so that no finite input can overflow the
arithmetic behind it.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from itertools import pairwise
from math import hypot, inf
from threading import Lock
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from .cures import ask_meant
from .laws import LAWS, RANDOM
from .laws import Distribution as Distribution
from .ranges import COVERAGE, DIRECTION, IMAGE_PX, MATRIX, NOISE_PX, PIXEL_MM, PLACE_MM, TURN_DEG

LEAST_LENGTH, LENGTH = 1e-6, 1e5  # mm
# The interfaces of the chain, called everywhere as in the design document, in the order of the chain
INTERFACES = ("structure_connector", "connector_flange")
PARSING = Lock()  # two threads in ast.parse count their depth in one place, and it ends with a SystemError (gh-106905)
_Record = TypeVar("_Record", bound="Record")


class Record(BaseModel):
    """A mapping whose fields are all known: unknown ones are refused, values are not converted."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        hide_input_in_errors=True,
        use_enum_values=False,
        defer_build=True,  # the document's validator holds those of all its parts: each need not have one of its own
    )

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        made = handler(core_schema)
        properties = handler.resolve_ref_schema(made)["properties"]
        for name, field in describe_fields(cls).items():
            properties[field.alias or name].setdefault("description", field.description)
        return made


def describe_fields(record: type[BaseModel]) -> dict[str, FieldInfo]:
    """Its fields by their names, described by the text that stands below each."""
    for name, words in read_texts(record).items():
        field = record.model_fields[name]
        field.description = field.description or words
    return record.model_fields


def read_texts(record: type) -> dict[str, str]:
    """By field of a record, or of those that it extends: the text that stands below it in the source, in one line."""
    texts: dict[str, str] = {}
    for base in reversed(record.__mro__):
        if base.__module__ not in ("builtins", "pydantic.main"):
            texts |= _read_module(base.__module__).get(base.__name__, {})
    return texts


@cache
def _read_module(module: str) -> dict[str, dict[str, str]]:
    """Texts by class and field.  The source is read when it is first asked for."""
    with PARSING:
        statements = ast.parse(inspect.getsource(sys.modules[module])).body
    classes = (each for each in statements if isinstance(each, ast.ClassDef))
    return {
        each.name: {
            field.target.id: " ".join(text.value.value.split())
            for field, text in pairwise(each.body)
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
        }
        for each in classes
    }


@dataclass(frozen=True, slots=True)
class Typical:
    """What is typical of a number, within its domain, which the bounds of its type are.  Random designs, fuzzing and
    the calibration of first order draw each number of an effect from it: sizes, above 0, alike in their logarithm."""

    low: float
    high: float
    of: str = ""  # the field that is meant where it stands beside a whole record


def domain_of(kind: Any) -> tuple[float, float]:
    """What a field of this type takes: least and largest; (inf, -inf) where its type has no such bounds."""
    bounds = {type(each).__name__: each for part in get_args(kind) for each in (part, *getattr(part, "metadata", ()))}
    if {"Ge", "Le"} <= bounds.keys():
        return float(bounds["Ge"].ge), float(bounds["Le"].le)
    return max((domain_of(part) for part in get_args(kind)), key=lambda pair: pair[1] - pair[0], default=(inf, -inf))


def leave_out_later(*later: str) -> Any:
    """The serializer of a record that leaves out the fields that came ``later`` where they have their default: the
    hashes of designs, and of their sections, that were made before stay what they were."""

    @cache
    def usual(record: type[Record]) -> dict[str, Any]:
        return {name: record.model_fields[name].get_default(call_default_factory=True) for name in later}

    @model_serializer(mode="wrap")
    def write_as_before(self: Record, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = write(self)
        for name, least in usual(type(self)).items():
            if name in data and data[name] == least:
                del data[name]
        return data

    return write_as_before


def share(record: _Record) -> Callable[[], _Record]:
    """The default of a field: one record for every document that leaves it out, as records do not change."""
    return lambda: record


def refusal(code: str, message: str, hint: str = "", at: str = "") -> PydanticCustomError:
    """A refusal from a validator of ours; ``at`` names the field below the record that it is about."""
    # braces in the message would be taken for a format; ours never hold any
    return PydanticCustomError(code, message.replace("{", "(").replace("}", ")"), {"hint": hint, "at": at})


def refuse_repeated(names: Sequence[str], what: str, at: str, hint: str = "") -> None:
    """Raises a refusal of a name that stood before; ``at`` has {} for its place."""
    for index, name in enumerate(names):
        if name in names[:index]:
            raise refusal("duplicate-name", f"two {what} are called {name!r}", hint, at.format(index))


KEEP_ONE = "keep one of them"


def only_one(*names: str, needed: str | None = None, cure: str = KEEP_ONE) -> Any:
    """The validator of a record that has one of some fields at most; ``needed``: just one, and what to write where none
    is there."""

    def check(record: Record) -> Record:
        given = [name for name in names if getattr(record, name) is not None]
        if len(given) > 1 or (needed is not None and not given):
            words = "one" if needed is None else "exactly one"
            detail = f"give {words} of {', '.join(names[:-1])} and {names[-1]}; {' and '.join(given) or 'none'} arrived"
            at = given[1] if given and needed is None else ""
            raise refusal("one-of", detail, cure if given else needed or "", at)
        return record

    return model_validator(mode="after")(check)


def exactly_one(*names: str, needed: str = "") -> Any:
    """The configuration and the validator of a record that has one of some fields; needed: the cure where all lack."""
    schema: dict[str, Any] = {"oneOf": [{"required": [name]} for name in names]}
    return ConfigDict(json_schema_extra=schema), only_one(*names, needed=needed)


def not_both(first: str, second: str) -> Any:
    """JSON Schema: two fields exclude each other."""
    return {"not": {"required": [first, second]}}


def one_of(kind: type[StrEnum]) -> Any:
    """Texts of an enumeration, refused in our words."""

    members: dict[str, StrEnum] = {member.value: member for member in kind}

    def check(value: Any) -> Any:
        member = members.get(value) if isinstance(value, str) else None
        if member is not None:
            return member
        raise refusal("unknown-value", f"must be {', '.join(kind)}", ask_meant(str(value), kind))

    return BeforeValidator(check, json_schema_input_type=kind)


Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")]
Coordinate = Annotated[float, Field(ge=-LENGTH, le=LENGTH)]
Length = Annotated[float, Field(ge=LEAST_LENGTH, le=LENGTH)]
Distance = Annotated[float, Field(ge=1, le=LENGTH)]  # of a source
PixelPitch = Annotated[float, Field(ge=1e-4, le=100), PIXEL_MM]
HalfWidth = Annotated[float, Field(ge=0, le=1e3)]
Degrees = Annotated[float, Field(ge=-360, le=360)]
HalfWidthDegrees = Annotated[float, Field(ge=0, le=45)]
Pixels = Annotated[float, Field(ge=0, le=1e3), NOISE_PX]
Unit = Annotated[float, Field(ge=-1e6, le=1e6)]  # a component of a direction or a rotation
Entry = Annotated[float, Field(ge=-1e12, le=1e12)]  # of a projection matrix

# Lists arrive as lists; strictness stays on for what they hold.
_lenient = Field(strict=False)
Point = Annotated[tuple[Coordinate, Coordinate, Coordinate], _lenient, PLACE_MM]
_Row = Annotated[tuple[Unit, Unit, Unit], _lenient, DIRECTION]


def _refuse_none(way: tuple[float, float, float]) -> tuple[float, float, float]:
    """Raises a refusal of a direction that is none."""
    if max(map(abs, way)) < 1e-9:
        detail = f"a direction has a length; [{', '.join(f'{each:g}' for each in way)}] arrived"
        raise refusal("zero-direction", detail, "give one of any length, as [0, 0, 1]")
    return way


Direction = Annotated[_Row, AfterValidator(_refuse_none)]
Rotation3 = Annotated[tuple[_Row, _Row, _Row], _lenient, MATRIX]
HalfWidths = Annotated[tuple[HalfWidth, HalfWidth, HalfWidth], _lenient]
Force = Annotated[tuple[Coordinate, Coordinate, Coordinate], _lenient]
Angles = Annotated[tuple[Degrees, Degrees, Degrees], _lenient, TURN_DEG]
Quaternion = Annotated[tuple[Unit, Unit, Unit, Unit], _lenient, MATRIX]
_Side = Annotated[int, Field(ge=2, le=100_000)]
ImageSize = Annotated[tuple[_Side, _Side], _lenient, IMAGE_PX]
_Place = Annotated[float, Field(ge=-1e6, le=1e6)]
ImagePoint = Annotated[tuple[_Place, _Place], _lenient]
Row4 = Annotated[tuple[Entry, Entry, Entry, Entry], _lenient]
Matrix34 = Annotated[tuple[Row4, Row4, Row4], _lenient, MATRIX]
Matrix44 = Annotated[tuple[Row4, Row4, Row4, Row4], _lenient, PLACE_MM]  # that of its fourth column


class Pose(Record):
    """A rigid transform as one rotation, in one of three forms, and a translation."""

    rotation_deg: Angles | None = Field(default=None, examples=[[0.0, 0.0, 90.0]])
    """[rx, ry, rz] in degrees, composed as R = Rx(rx) Ry(ry) Rz(rz)."""
    rotation: Rotation3 | None = Field(default=None, examples=[[[1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    """Rotation matrix, row by row."""
    quaternion_wxyz: Quaternion | None = Field(default=None, examples=[[1.0, 0.0, 0.0, 0.0]])
    """Unit quaternion, scalar first."""
    translation_mm: Point = Field(default=(0.0, 0.0, 0.0), examples=[[0.0, 0.0, 120.0]])
    """Added after the rotation, mm."""

    _one_rotation = only_one("rotation_deg", "rotation", "quaternion_wxyz")


def _pose_kind(value: Any) -> str | None:
    if isinstance(value, list | tuple):
        return "<matrix>"
    return "<pose>" if isinstance(value, dict | Pose) else None


Transform = Annotated[
    Annotated[Matrix44, Tag("<matrix>")] | Annotated[Pose, Tag("<pose>")],
    Discriminator(
        _pose_kind,
        custom_error_type="wrong-type",
        custom_error_message="a transform is a 4x4 matrix or a mapping with a rotation and translation_mm",
    ),
]

AnyLaw = Annotated[Distribution, one_of(Distribution)]
if TYPE_CHECKING:
    RandomLaw = str
else:
    RandomLaw = Literal[tuple(law.value for law in RANDOM)]
CoverageFactor = Annotated[float, Field(ge=0.1, le=10), Typical(1, 3), COVERAGE]

LAW_WORDS = "Law of the deviation within the half-width h. " + "; ".join(f"{law}: {LAWS[law].words}" for law in RANDOM)
BOUNDED_WORDS = f"{LAW_WORDS}; bounded: {LAWS[Distribution.BOUNDED].words}."
COVERAGE_WORDS = (
    "normal only: how many standard deviations the half-width stands for (2: about 95 % of parts lie within it, "
    "3: 99.7 %). Default 2."
)


def are_parallel(a: tuple[float, float, float], b: tuple[float, float, float]) -> bool:
    """Whether two directions are the same line to 1e-6 rad, or one of them is none."""
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return hypot(*cross) <= 1e-6 * hypot(*a) * hypot(*b)


def with_law(width: str, usual: str = "uniform") -> Any:
    """The validator of a record whose ``distribution`` and ``coverage_factor`` are of the half-width in a field.

    One above 0 needs a law, and a law a half-width that is stated: of 0, so that it can be varied.  A coverage factor
    is refused where no law reads it.
    """

    def check(record: Any) -> Any:
        law, factor = record.distribution, record.coverage_factor
        given = [name for name, value in (("distribution", law), ("coverage_factor", factor)) if value is not None]
        if getattr(record, width) and law is None:
            raise refusal("missing-field", f"{width} needs a distribution", f"distribution: {usual}")
        missing = width if width not in record.model_fields_set else "distribution" if law is None else ""
        if given and missing:
            detail, cure = f"{given[0]} is read only with {missing}", f"state {missing}, or leave {given[0]} out"
            raise refusal("unused-field", detail, cure, at=given[0])
        if factor is not None and law != "normal":
            detail = f"coverage_factor only means something for distribution: normal; the distribution here is {law}"
            raise refusal("unused-field", detail, "remove coverage_factor", "coverage_factor")
        return record

    return model_validator(mode="after")(check)

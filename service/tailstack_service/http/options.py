"""Options beside the design, field by field; unknown ones are refused."""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from tailstack.design.reading import Vast, shown
from tailstack.errors import LimitError, Problem
from tailstack.json_text import write_json
from tailstack.precision import FINEST_PRECISION

from ..problems import RequestError
from ..settings import Settings, variable

Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


class Options(BaseModel):
    """Known fields only, nothing converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, hide_input_in_errors=True)

    @classmethod
    def in_query(cls) -> dict[str, str]:
        """Options that the query gives under another name and may repeat: name in the query, option."""
        return {}

    @classmethod
    def from_query(cls, option: str, given: list[str]) -> Any:
        """The value of such an option.  Raises RequestError."""
        raise NotImplementedError(option)


class ValidationOptions(Options):
    """No options."""


class ScoreOptions(Options):
    second_order: bool = Field(False, description="Add the second-order correction where it holds.")


class CheckOptions(Options):
    """How much a Monte Carlo check samples."""

    trials: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Number of trials. Either this or precision; neither: the solver's own precision."
    )
    precision: Annotated[float, Field(ge=FINEST_PRECISION, lt=1)] | None = Field(
        None, description="Half-width of the confidence interval of P95, relative, at which sampling stops."
    )
    seed: Seed = Field(0, description="Seed; one seed is one answer, whatever workers and threads.")

    @model_validator(mode="after")
    def _one_size(self) -> CheckOptions:
        if self.trials is not None and self.precision is not None:
            raise PydanticCustomError("one-of", "give trials or precision; both arrived", {"at": "/precision"})
        return self


class VerificationOptions(CheckOptions):
    method: Literal["plain", "radial"] = Field(
        "plain", description="plain: order statistics of the trials. radial: conditional on the direction."
    )


class OptimisationOptions(Options):
    seed: Seed | None = Field(None, description="Seed of the starts; absent: optimise/seed of the design.")
    starts: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Number of starts; absent: optimise/starts of the design."
    )


class Axis(Options):
    """One number of the design and the values that it takes: a list, or a range."""

    pointer: Annotated[str, Field(min_length=1, max_length=500)] = Field(
        description="JSON pointer to a number of the design as it was sent, /views/0/fiducial_noise_px, or a path of "
        "names, views.AP.fiducial_noise_px; * stands for every element.",
        examples=["/views/0/fiducial_noise_px"],
    )
    values: Annotated[list[float], Field(min_length=1)] | None = Field(
        None, description="The values, in this order.", examples=[[0.1, 0.2, 0.4]]
    )
    start: float | None = Field(None, description="First value of a range.")
    stop: float | None = Field(None, description="Last value of a range, included.")
    count: Annotated[int, Field(ge=1)] | None = Field(None, description="Number of values of a range, evenly spaced.")

    @model_validator(mode="after")
    def _one_form(self) -> Axis:
        parts = (self.start, self.stop, self.count)
        whole_range, any_of_range = None not in parts, parts != (None, None, None)
        if (self.values is None) != whole_range or (self.values is not None and any_of_range):
            raise PydanticCustomError("one-of", "give values, or start, stop and count", {"at": ""})
        return self

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.values) if self.values is not None else self.count or 0


class SweepOptions(Options):
    axes: Annotated[list[Axis], Field(min_length=1, max_length=6)] = Field(
        description="Numbers of the design that vary; every combination of their values is a point.",
        examples=[[{"pointer": "/views/0/fiducial_noise_px", "values": [0.1, 0.2, 0.4]}]],
    )
    check: Literal["score", "verification"] = Field("score", description="What is computed at each point.")
    trials: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Trials at each point, for check verification; absent: to the solver's own precision."
    )
    seed: Seed = Field(
        0, description="Seed of every check: one for all points, which then differ by their designs alone."
    )

    @model_validator(mode="after")
    def _trials_of_a_check(self) -> SweepOptions:
        if self.trials is not None and self.check == "score":
            raise PydanticCustomError("no-trials", "a score draws no trials", {"at": "/trials"})
        return self

    @classmethod
    def in_query(cls) -> dict[str, str]:
        return {"set": "axes"}

    @classmethod
    def from_query(cls, option: str, given: list[str]) -> Any:
        return [_axis(text) for text in given]


def _axis(text: str) -> dict[str, Any]:
    """``PATH=START:STOP:COUNT`` or ``PATH=VALUE,VALUE,...`` as in ``tailstack sweep --set``."""
    pointer, found, said = text.rpartition("=")
    try:
        if not found or not pointer:
            raise ValueError
        if ":" in said:
            start, stop, count = said.split(":")
            return {"pointer": pointer, "start": float(start), "stop": float(stop), "count": int(count)}
        return {"pointer": pointer, "values": [float(value) for value in said.split(",")]}
    except ValueError:
        detail = f"set is PATH=START:STOP:COUNT or PATH=VALUE,VALUE,...; got {text[:80]!r}"
        hint = "for example set=/views/0/fiducial_noise_px=0.1:0.5:5"
        raise RequestError(Problem("/set", "bad-parameter", detail, hint)) from None


Part = Literal["score", "verification", "optimisation"]
SIDES = ("first", "second")  # the designs of a comparison


class ReportOptions(CheckOptions):
    parts: Annotated[list[Part], Field(min_length=1, max_length=3)] = Field(
        ["score", "verification"],
        description="What the record holds, each once; optimisation: before and after.",
        examples=[["score", "verification"]],
    )

    @model_validator(mode="after")
    def _each_once(self) -> ReportOptions:
        if len(set(self.parts)) < len(self.parts):
            named = ", ".join(self.parts)
            raise PydanticCustomError("given-twice", f"each part is named once; got {named}", {"at": "/parts"})
        return self

    @classmethod
    def in_query(cls) -> dict[str, str]:
        return {"part": "parts"}

    @classmethod
    def from_query(cls, option: str, given: list[str]) -> Any:
        return given


class ComparisonOptions(CheckOptions):
    """How both designs are checked."""

    parts: Annotated[list[Literal["score", "verification"]], Field(min_length=1, max_length=2)] = Field(
        ["score", "verification"], description="What is computed of both; score alone: to first order."
    )


ConversionFormat = Literal["csv", "fcsv", "mrk.json", "yaml", "json"]


class ConversionOptions(Options):
    """The content and what to make of it."""

    format: ConversionFormat = Field(description="What the content is; yaml and json are designs.")
    content: Annotated[str, Field(min_length=1)] = Field(
        description="The text of the file.", examples=["label,x_mm,y_mm,z_mm\nF1,0,0,0\n"]
    )
    to: ConversionFormat = Field("yaml", description="What to make of it; a design becomes a design, or its fiducials.")


O = TypeVar("O", bound=Options)  # noqa: E741


def options_of(kind: type[O], data: dict[str, Any]) -> O:
    """Options from everything in the body but the design.  Raises RequestError."""
    try:
        return kind.model_validate({key: value for key, value in data.items() if key != "design"})
    except ValidationError as error:
        known = ["design", *kind.model_fields]
        problems = [_translated(entry, known, kind) for entry in error.errors(include_url=False)]
        problems.sort(key=lambda problem: problem.code != "unknown-field")  # a slip in a name explains what is missing
        raise RequestError(problems[:25]) from None


_WANTED = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "a text",
    "list_type": "a list",
    "model_type": "a mapping of fields",
}


def _translated(entry: Any, known: list[str], options: type[Options]) -> Problem:
    context, kind, value = entry.get("ctx", {}), entry["type"], entry.get("input")
    pointer = "".join("/" + str(step).replace("~", "~0").replace("/", "~1") for step in entry["loc"])
    pointer += str(context.get("at", ""))
    if kind == "extra_forbidden":
        name = str(entry["loc"][-1])
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
        return Problem(pointer, "unknown-field", f"there is no option {shown(name)[9:]}", hint)
    if kind == "missing":
        detail = f"the field {str(entry['loc'][-1])!r} is required"
        return Problem(pointer.rpartition("/")[0], "missing-field", detail, "GET /openapi.json describes it")
    if isinstance(value, Vast):
        return Problem(pointer, "out-of-range", f"the number is too large; got {shown(value)}")
    if kind in _WANTED:
        return Problem(pointer, "wrong-type", f"expected {_WANTED[kind]}; got {shown(value)}")
    if kind == "finite_number":
        return Problem(pointer, "not-finite", f"must be a finite number; got {shown(value)}")
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        word = {"greater_than": "above", "greater_than_equal": "at least", "less_than": "below"}.get(kind, "at most")
        limit = next(context[key] for key in ("gt", "ge", "lt", "le") if key in context)
        return Problem(pointer, "out-of-range", f"must be {word} {limit}; got {shown(value)}")
    if kind == "literal_error":
        return Problem(pointer, "unknown-value", f"must be {context['expected']}; got {shown(value)}")
    if kind in ("too_short", "too_long"):
        word, bound = ("at least", "min_length") if kind == "too_short" else ("at most", "max_length")
        many = f"{context[bound]} {'entry' if context[bound] == 1 else 'entries'}"
        detail = f"needs {word} {many}; got {shown(value)}"
        return Problem(pointer, kind.replace("_", "-"), detail, _example(entry["loc"], options))
    if kind in ("string_too_short", "string_too_long"):
        bound = "must not be empty" if kind == "string_too_short" else f"has at most {context['max_length']} characters"
        return Problem(pointer, "bad-text", f"the text {bound}; got {shown(value)}", _example(entry["loc"], options))
    return Problem(pointer, kind.replace("_", "-"), f"{entry['msg']}")


def _example(path: tuple[str | int, ...], options: type[Options]) -> str:
    """The example of the field at an error's path, to be typed."""
    name = [step for step in path if isinstance(step, str)][-1]
    examples = {**Axis.model_fields, **options.model_fields}[name].examples
    return f"for example: {write_json({name: examples[0]})}" if examples else ""


def within(value: int | None, setting: str, settings: Settings, pointer: str) -> None:
    """Refuse a count above its limit.  Raises LimitError that states the limit, what arrived and the setting."""
    limit = getattr(settings, setting)
    if value is not None and value > limit:
        raise LimitError(
            Problem(
                pointer,
                "too-many",
                f"at most {limit} {pointer.strip('/').rpartition('/')[2]} are accepted; got {value}",
                f"ask for fewer, or start the service with a higher {variable(setting)}",
            )
        )

"""Options beside the design, field by field; unknown ones are refused."""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from tailstack.design.reading import shown
from tailstack.errors import LimitError, Problem

from ..problems import RequestError
from ..settings import Settings, variable

Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


class Options(BaseModel):
    """Known fields only, nothing converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, hide_input_in_errors=True)


class ValidationOptions(Options):
    """No options."""


class ScoreOptions(Options):
    second_order: bool = Field(False, description="Add the second-order correction where it holds.")


class VerificationOptions(Options):
    trials: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Number of trials. Either this or precision; neither: the solver's own precision."
    )
    precision: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        None, description="Half-width of the confidence interval of P95, relative, at which sampling stops."
    )
    seed: Seed = Field(0, description="Seed; one seed is one answer, whatever batch size and threads.")
    method: Literal["plain", "radial"] = Field(
        "plain", description="plain: order statistics of the trials. radial: conditional on the direction."
    )

    @model_validator(mode="after")
    def _one_size(self) -> VerificationOptions:
        if self.trials is not None and self.precision is not None:
            raise PydanticCustomError("one-of", "give trials or precision; both arrived", {"at": "/precision"})
        return self


class OptimisationOptions(Options):
    seed: Seed | None = Field(None, description="Seed of the starts; absent: optimise/seed of the design.")
    starts: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Number of starts; absent: optimise/starts of the design."
    )


O = TypeVar("O", bound=Options)  # noqa: E741


def options_of(kind: type[O], data: dict[str, Any]) -> O:
    """Options from everything in the body but the design.  Raises RequestError."""
    try:
        return kind.model_validate({key: value for key, value in data.items() if key != "design"})
    except ValidationError as error:
        known = ["design", *kind.model_fields]
        raise RequestError([_translated(entry, known) for entry in error.errors(include_url=False)][:25]) from None


_WANTED = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "a text",
}


def _translated(entry: Any, known: list[str]) -> Problem:
    context, kind, value = entry.get("ctx", {}), entry["type"], entry.get("input")
    pointer = "".join("/" + str(step).replace("~", "~0").replace("/", "~1") for step in entry["loc"])
    pointer += str(context.get("at", ""))
    if kind == "extra_forbidden":
        name = str(entry["loc"][-1])
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
        return Problem(pointer, "unknown-field", f"there is no option {shown(name)[9:]}", hint)
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
    return Problem(pointer, kind.replace("_", "-"), f"{entry['msg']}")


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

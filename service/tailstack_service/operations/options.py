"""Options beside a design: known fields only, nothing converted, each with its meaning and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from tailstack.errors import LimitError, Problem
from tailstack.precision import FINEST_PRECISION

from ..names import variable
from ..problems import RequestError

if TYPE_CHECKING:
    from ..settings import Settings
    from .sent import Request

Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


class Options(BaseModel):
    """The options of an operation; this one has none."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, hide_input_in_errors=True)

    exclusive: ClassVar[tuple[str, ...]] = ()  # of these, one at most

    @classmethod
    def in_query(cls) -> dict[str, str]:
        """Options that the query gives under another name and may repeat: name in the query, option."""
        return {}

    @classmethod
    def from_query(cls, option: str, given: list[str]) -> Any:
        """The value of such an option.  Raises RequestError."""
        raise NotImplementedError(option)

    @classmethod
    def query_item(cls, option: str) -> dict[str, Any]:
        """The JSON Schema of such an option, given once."""
        return {"type": "string"}


class CheckOptions(Options):
    """How much a Monte Carlo check samples."""

    exclusive = ("trials", "precision")

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


def check_trials(request: Request, settings: Settings) -> None:
    """Trials within the limit, designs that determine an answer.  Raises Placed, LimitError."""
    from tailstack.design import check_design

    within(request.options.trials, "max_trials", settings, "/trials")
    for which in range(len(request.designs)):
        request.refuse_by(check_design, which)


def refuse_unknown_target(name: str | None, names: Sequence[str], pointer: str = "") -> None:
    """Raises RequestError for a target that the design does not have; None: no target was named."""
    if name is not None and name not in names:
        detail = f"no target is called {name!r}; there are {', '.join(names[:20])}"
        raise RequestError(Problem(pointer, "unknown-target", detail))


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

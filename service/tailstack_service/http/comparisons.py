"""``POST /v1/comparisons``: two designs checked alike, with one seed, and what sets them apart; always a job."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

from tailstack.design import check_design
from tailstack.errors import DesignError, Problem, TailstackError

from ..settings import Settings
from ..work.requests import canonical
from .asked import refuse_query
from .bodies import Placed, content_kind, design_of, parse_json, read_body
from .operations import in_short_lane
from .options import CheckOptions, options_of, within
from .posting import Posted, submitted
from .preferences import idempotency_key
from .service import service_of

SIDES = ("first", "second")


class ComparisonOptions(CheckOptions):
    """How both designs are checked."""

    parts: Annotated[list[Literal["score", "verification"]], Field(min_length=1, max_length=2)] = Field(
        ["score", "verification"], description="What is computed of both; score alone: to first order."
    )


async def create_comparison(request: Request) -> Response:
    """202 with the job, or its result.  Raises TransportError, MalformedError, RequestError, LimitError, Placed."""
    settings = service_of(request).settings
    content_kind(request, yaml=False)
    body = await read_body(request, settings)
    refuse_query(request, (), "options go into the body, beside the designs")
    data = parse_json(body, settings)
    options = options_of(ComparisonOptions, {key: value for key, value in data.items() if key not in SIDES})
    key = idempotency_key(request)
    return await submitted(request, await in_short_lane(request, lambda: _posted(data, options, settings)), key)


def _posted(data: dict[str, Any], options: ComparisonOptions, settings: Settings) -> Posted:
    """The job, both designs checked.  Raises RequestError, LimitError, Placed."""
    within(options.trials, "max_trials", settings, "/trials")
    designs, systems = {}, {}
    for side in SIDES:
        designs[side] = design_of(data, settings, side)
        try:
            systems[side], _, _ = check_design(designs[side])
        except TailstackError as error:
            raise Placed(error, f"/{side}") from None
    names = [{target.name for target in systems[side].targets} for side in SIDES]
    if not names[0] & names[1]:
        detail = "the two designs have no target of the same name: there is nothing to compare"
        problem = Problem("/targets", "no-common-target", detail, "give the targets the same names")
        raise Placed(DesignError(problem), "/second")
    content = {**{side: data[side] for side in SIDES}, **options.model_dump(), "max_trials": settings.max_trials}
    name = f"{designs['second'].name} against {designs['first'].name}"
    return Posted("comparison", canonical(content), name)

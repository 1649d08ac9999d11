"""The cheapest half-widths that keep a limit at the layout as it is."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ..console.command_line import FAIL, PASS
from ..console.flags import Flag
from .operation import LateImport, Operation, Options, run_function

LOCK = Flag(
    "a half-width that stays: CONTRIBUTOR.COMPONENT, or all of a CONTRIBUTOR; may be repeated",
    name="lock", metavar="NAME", repeats=True, in_query="lock",
)  # fmt: skip


class AllocationOptions(Options):
    """Which limit, and what stays."""

    limit: Annotated[float, Field(gt=0)] | None = None
    """Limit to keep, in the unit of the requirement's measure (mm); absent: the design's own."""
    requirement: str | None = None
    """Requirement whose limit that is; it can be left out where the section has one."""
    locked: Annotated[Annotated[list[str], Field(max_length=100)], LOCK] = Field([])
    """Half-widths that stay as they are: CONTRIBUTOR.COMPONENT, or all of a CONTRIBUTOR."""


OPERATION = Operation(
    name="allocation",
    verb="allocate",
    path="/v1/allocations",
    summary="Cheapest half-widths that keep a limit, the layout as it is",
    description="The half-widths that the design's section optimise frees, at least cost within the limits, to first "
    "order, with layout, pivots and views as they are. Says what moved most and which limits hold the cost up; where "
    "no half-widths keep a limit, how low it can be and which contributor holds it. Takes milliseconds. Tables of "
    "grades are refused.",
    title="answer of allocate: the cheapest half-widths at the layout as it is",
    options=AllocationOptions,
    example={"limit": 0.9, "locked": ["structure_connector.rx"]},
    record=LateImport("tailstack.optimisation.half_widths", "Allocation").load,
    run=run_function(LateImport("tailstack", "allocate")),
    immediate=True,
    document=LateImport("..report.chapters.allocation", "allocation_document"),
    exit_code=lambda record: PASS if record.status == "kept" else FAIL,
)

"""Waivers, ``tailstack/waivers/1``: findings that somebody accepts, for a reason, up to a value and a date."""

from __future__ import annotations

import re
from datetime import date
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from tailstack.design.fields import Name, Record, refusal

from .policy_document import Patterns

WAIVERS_SCHEMA = "tailstack/waivers/1"
LONGEST_DAYS = 180


def _calendar_day(value: Any) -> date:
    if not isinstance(value, str) or not re.fullmatch(r"\d{4}-\d{2}-\d{2}", value):
        raise refusal("bad-date", "a date is written YYYY-MM-DD", "expires: 2027-01-31")
    try:
        return date.fromisoformat(value)
    except ValueError as error:
        raise refusal("bad-date", f"there is no such day: {error}") from None


Day = Annotated[date, BeforeValidator(_calendar_day, json_schema_input_type=str)]


class Waiver(Record):
    """One accepted finding."""

    rule: Name = Field(description="Id of the rule.", examples=["p95"])
    designs: Patterns | None = Field(
        default=None,
        description="Patterns (* and ?) of file names or of designs' names. Absent: every design.",
        examples=[["waived.yaml"]],
    )
    target: Name | None = Field(default=None, description="Only at this target. Absent: at all.", examples=["tip"])
    owner: Name = Field(description="Who answers for it.", examples=["J. Doe, systems"])
    reason: Annotated[str, Field(min_length=1, max_length=2000)] = Field(
        description="Why it is accepted.", examples=["first article only; seat is reworked in rev C"]
    )
    max_value: float | None = Field(
        default=None,
        description="Accepted up to this value of the finding (for an error, the upper end of its interval); for "
        "rules where more is worse.",
        examples=[1.2],
    )
    min_value: float | None = Field(
        default=None, description="Accepted down to this value; for rules where less is worse.", examples=[0.9]
    )
    expires: Day = Field(
        description=f"Last day on which it counts, YYYY-MM-DD, at most {LONGEST_DAYS} days ahead.",
        examples=["2027-01-31"],
    )

    @field_validator("owner", "reason")
    @classmethod
    def _says_something(cls, text: str) -> str:
        if not text.strip():
            raise refusal("too-short", "somebody answers for a waiver, for a reason; this is blank")
        return text


class Waivers(Record):
    """What is accepted for now."""

    schema_: Literal["tailstack/waivers/1"] = Field(
        alias="schema", description="Version of this document.", examples=["tailstack/waivers/1"]
    )
    waivers: Annotated[list[Waiver], Field(max_length=1000)] = Field(description="The waivers.")

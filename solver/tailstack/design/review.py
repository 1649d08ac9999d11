"""What a review leaves in a design document: earlier versions by name, and comments pinned to what they are about.

No number depends on it, nor the hash of the design: a simulation stays that of the design it was drawn of.
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from ..fields import Name, Record, leave_out_later, refusal, refuse_repeated

Prose = Annotated[str, Field(max_length=2000)]
Moment = Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}(T\d{2}:\d{2}(:\d{2})?Z)?$")]


class NamedVersion(Record):
    """The design as it was, by a name."""

    name: Name = Field(examples=["A"])
    """What it is called; unique."""
    note: Prose = Field(default="", examples=["as drawn, before the review"])
    """What it is for."""
    date: Moment | None = Field(default=None, examples=["2026-11-28"])
    """When it was kept, YYYY-MM-DD or YYYY-MM-DDThh:mmZ."""
    text: Annotated[str, Field(min_length=1, max_length=500_000)] = Field(
        examples=["schema: tailstack/design/1\nname: drill guide\n"]
    )
    """Its document, YAML or JSON, without a review of its own. Read when it is asked for."""


class Comment(Record):
    """A remark on a fiducial, on a line of the budget, or on the design."""

    text: Annotated[str, Field(min_length=1, max_length=2000)] = Field(examples=["too near to the screw"])
    """What is said."""
    bead: Name | None = Field(default=None, examples=["F3"])
    """Label of the fiducial that it is about. Absent: of none."""
    contributor: Name | None = Field(default=None, examples=["structure_connector"])
    """Name of the line of the budget that it is about, as results have it. Absent: of none."""
    component: Name | None = Field(default=None, examples=["rx"])
    """With contributor: its component. Absent: all of it."""
    author: Annotated[str, Field(max_length=80)] = Field(default="", examples=["A. Okafor"])
    """Who says it."""
    date: Moment | None = Field(default=None, examples=["2026-11-28"])
    """When, YYYY-MM-DD or YYYY-MM-DDThh:mmZ."""
    resolved: bool = Field(default=False, examples=[True])
    """true: it is settled. Default false."""

    @model_validator(mode="after")
    def _one_pin(self) -> Self:
        if self.bead is not None and self.contributor is not None:
            detail = "a comment is about a bead or about a line of the budget; both arrived"
            raise refusal("one-of", detail, "write two comments", "contributor")
        if self.component is not None and self.contributor is None:
            raise refusal("unused-field", "component is read only beside contributor", at="component")
        return self


class Review(Record):
    """Versions and comments.  A comment stays when what it is about is gone."""

    versions: Annotated[list[NamedVersion], Field(max_length=50)] = Field(default=[])
    """Earlier versions, oldest first. Default none."""
    comments: Annotated[list[Comment], Field(max_length=500)] = Field(default=[])
    """Comments, oldest first. Default none."""

    _as_before = leave_out_later("versions", "comments")

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        refuse_repeated([version.name for version in self.versions], "versions", "versions/{}/name")
        return self

    def version(self, name: str) -> NamedVersion | None:
        """The version of that name; None where there is none."""
        return next((version for version in self.versions if version.name == name), None)

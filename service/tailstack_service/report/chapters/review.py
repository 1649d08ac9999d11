"""What a review left in a design: its comments, those that are open first, and its versions."""

from __future__ import annotations

from typing import Any

from tailstack.design.review import Comment, Review
from tailstack.results.tables import LONG_TABLE, Column, tabulate

from ...rendering.blocks import Block, Section


def review_sections(design: dict[str, Any]) -> tuple[Section, ...]:
    """The chapter of a design document; none where nobody has commented or kept a version."""
    review = Review.model_validate(design.get("review") or {})
    blocks: list[Block] = []
    if review.comments:
        listed = sorted(review.comments, key=lambda comment: comment.resolved)
        count = sum(not comment.resolved for comment in listed)
        columns = (
            Column("On", of=_pin), Column("Comment", of=lambda comment: comment.text),
            Column("By", of=lambda comment: comment.author), Column("When", of=lambda comment: comment.date or ""),
            Column("State", of=lambda comment: "resolved" if comment.resolved else "open"),
        )  # fmt: skip
        blocks.append(tabulate("Comments", f"Comments, {count} of them open", columns, listed, most=LONG_TABLE))
    if review.versions:
        kept: tuple[Column, ...] = (
            Column("Version", of=lambda version: version.name), Column("Note", of=lambda version: version.note),
            Column("Kept", of=lambda version: version.date or ""),
        )  # fmt: skip
        blocks.append(tabulate("Versions", "Versions kept in the design document", kept, review.versions))
    return (Section("Review", tuple(blocks)),) if blocks else ()


def _pin(comment: Comment) -> str:
    if comment.bead is not None:
        return f"bead {comment.bead}"
    return " ".join(filter(None, (comment.contributor, comment.component))) or "the design"

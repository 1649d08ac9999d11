"""A remark about a document that a gate was given beside its designs, at the place it is about."""

from __future__ import annotations

from tailstack.design.refusals import place
from tailstack.errors import Problem

from .reading import ReadBaseline, ReadPolicy, ReadWaivers
from .records import GateFinding


def finding_at(
    document: ReadPolicy | ReadWaivers | ReadBaseline, pointer: str, rule: str, severity: str, message: str
) -> GateFinding:
    """The finding with the file of the document, and the line and column where the pointer leads."""
    placed = place(Problem(pointer, rule, message), document.source)
    return GateFinding(
        rule=rule,
        severity=severity,  # type: ignore[arg-type]
        file=document.file,
        line=placed.line,
        column=placed.column,
        pointer=pointer,
        message=message,
        value=None,
        limit=None,
        suppressed_by=None,
    )

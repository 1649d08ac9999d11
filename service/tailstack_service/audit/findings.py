"""What an audit found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Answer = Literal["same", "different", "not compared", "trusted"]
SAME: Final = "same"
DIFFERENT: Final = "different"
NOT_COMPARED: Final = "not compared"


@dataclass(frozen=True, slots=True)
class AuditCheck:
    """One thing that was looked at."""

    what: str  # record, design, pages, numbers, ...
    answer: Answer
    words: str
    details: tuple[str, ...] = ()  # what differs


@dataclass(frozen=True, slots=True)
class Audit:
    """Everything that was looked at in one file."""

    file: str
    title: str
    schema: str
    written_by: str
    questions: tuple[AuditCheck, ...]

    @property
    def verdict(self) -> Literal["verified", "differs", "not verified"]:
        """``not verified``: nothing differs, but something that should have been compared could not be."""
        answers = {question.answer for question in self.questions}
        return "differs" if DIFFERENT in answers else "not verified" if NOT_COMPARED in answers else "verified"


def audit_text(audit: Audit) -> str:
    """The audit for people."""
    wide = max(len(question.what) for question in audit.questions)
    lines = [f"{audit.file}: {audit.title}", f"  {audit.schema}, written by tailstack {audit.written_by}"]
    for question in audit.questions:
        mark = {"same": " ", "different": "!", "not compared": "?", "trusted": "-"}[question.answer]
        lines.append(f"{mark} {question.what:{wide}}  {question.words}")
        lines += [f"  {'':{wide}}  {detail}" for detail in question.details]
    return "\n".join([*lines, audit.verdict]) + "\n"

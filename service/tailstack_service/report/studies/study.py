"""What the documents of all studies share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tailstack.results import Provenance
from tailstack.results.tables import IN_DETAIL

from ...rendering.blocks import Block, Bullets, Document, Figure, KeyNumber, Listing, Paragraph, Section, Tone
from ..chapters.tables import closing_sections, provenance_facts

REPRODUCTION = (
    "design.yaml is the design of the hash named on the first page; the record of a study does not hold it. The same "
    "version of tailstack gives the same digits, whatever the number of threads, workers or machines."
)


def compose_study(
    study: Any, sha256: str, kind: str, *, question: str, method: str, sentences: Sequence[str],
    numbers: Sequence[KeyNumber], sections: Sequence[Section], command: str, about: Sequence[Block] = (),
    figure: tuple[str, Callable[[], str], str] | None = None, tone: Tone = "neutral", status: str = "study",
    ending: str = "",
) -> Document:  # fmt: skip
    """The document of a study of one design.

    question, method: below the design's name in a terminal.  sentences: what the study says, the first of them the
    answer.  about: how it was done.  figure: name, what draws it, caption.  command: that repeats it.
    """
    made: Provenance = study.provenance
    return Document(
        kind=f"Study: {kind}",
        title=made.design_name,
        tone=tone,
        status=status,
        sentence=sentences[0],
        numbers=tuple(numbers),
        matters=tuple(sentences[1:4]),
        figures=() if figure is None else (Figure(*figure),),
        sections=(
            Section("In words", (Bullets(tuple(sentences)),)),
            *sections,
            Section("Method and assumptions", tuple(about), on=IN_DETAIL, reader="auditor"),
            *closing_sections(made, Listing(command), Paragraph(REPRODUCTION)),
        ),
        provenance=provenance_facts(made, sha256, study.schema),
        made=made,
        question=question,
        method=method,
        ending=ending,
        captions=True,
    )

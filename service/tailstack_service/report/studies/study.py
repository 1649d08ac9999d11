"""What the documents of all studies share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tailstack.results.tables import IN_DETAIL

from ...rendering.blocks import Block, Bullets, Document, Figure, Listing, Paragraph, Section
from ..chapters.tables import compose_document

REPRODUCTION = (
    "design.yaml is the design of the hash named on the first page; the record of a study does not hold it. The same "
    "version of tailstack gives the same digits, whatever the number of threads, workers or machines."
)


def compose_study(
    study: Any, sha256: str, kind: str, *, sentences: Sequence[str], sections: Sequence[Section], command: str,
    about: Sequence[Block] = (), figure: tuple[str, Callable[[], str], str] | None = None, **own: Any,
) -> Document:  # fmt: skip
    """The document of a study of one design.

    sentences: what the study says, the first of them the answer.  about: how it was done.  figure: name, what draws it,
    caption.  command: that repeats it.  own: further fields of the document.
    """
    return compose_document(
        study,
        sha256,
        (
            Section("In words", (Bullets(tuple(sentences)),)),
            *sections,
            Section("Method and assumptions", tuple(about), on=IN_DETAIL, reader="auditor"),
        ),
        Listing(command),
        Paragraph(REPRODUCTION),
        kind=f"Study: {kind}",
        sentence=sentences[0],
        matters=tuple(sentences[1:4]),
        figures=() if figure is None else (Figure(*figure),),
        captions=True,
        **({"status": "study"} | own),
    )

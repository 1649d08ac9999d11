"""A document as a terminal shows it: what is asked, the sections in their order, what is not included."""

from __future__ import annotations

from collections.abc import Callable

from tailstack.results.tables import On, Table

from ..report.blocks import Block, Bullets, Document, Facts, Listing, Paragraph
from .page import current
from .tables import fold, paint, prose_width, wrap, write_table
from .verdict import findings_text, heading, join_blocks, more_text, provenance_text

TONE = {"neutral": "no requirement"}  # the role of its colour, where it is called otherwise


def document_text(document: Document) -> str:
    """Its text on the page that is being written."""
    made = document.made
    named = "\n".join([*fold(document.title, prose_width()), wrap(document.question)])
    return join_blocks(
        named if made is None else heading(made, document.question, document.method),
        *(
            _write_block(block)
            for section in document.of(On.DETAIL if current().details else On.PLAIN).sections
            for block in section.blocks
        ),
        findings_text(document.findings),
        "" if made is None else provenance_text(made),
        more_text(),
        paint(document.ending, TONE.get(document.tone, document.tone)) if document.ending else "",
    )


def _write_block(block: Block) -> str:
    write: Callable[..., str] | None = _WRITERS.get(type(block))
    return "" if write is None else write(block)


def _write_captioned(table: Table) -> str:
    """The table below its caption, and its note."""
    parts = (wrap(table.caption), write_table(table), wrap(table.note) if table.note else "")
    return "\n".join(part for part in parts if part)


def _write_bullets(block: Bullets) -> str:
    marks = [f"{k}. " if block.numbered else "* " for k in range(1, len(block.items) + 1)]
    return "\n".join(
        wrap(item, first=mark, indent=" " * len(mark)) for mark, item in zip(marks, block.items, strict=True)
    )


def _write_facts(block: Facts) -> str:
    return "\n".join(wrap(meaning, first=f"{word}: ", indent="  ") for word, meaning in block.pairs)


_WRITERS: dict[type, Callable[..., str]] = {
    Table: _write_captioned,
    Paragraph: lambda block: wrap(block.text),
    Bullets: _write_bullets,
    Facts: _write_facts,
    Listing: lambda block: block.text,
}

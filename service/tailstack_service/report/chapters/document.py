"""What the documents of all results share: how they are composed, and what they end with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from tailstack.results import Provenance, Verdict
from tailstack.results.tables import IN_DETAIL, PAPER, Cell, Column, On, Table, tabulate
from tailstack.results.verdicts import assumed_sentence, checks_table, findings_table

from ...rendering.document import Block, Bullets, Document, Facts, Figure, Listing, Paragraph, Section

if TYPE_CHECKING:
    from ...gate.records import GateProvenance


def compose_document(
    record: Any, sha256: str, sections: Sequence[Section], *reproduction: Block, design: Any = None, **own: Any
) -> Document:
    """The document of a record of one design: its sections, and what every report ends with.

    sha256: of the record.  reproduction: how to have it again.  design: its document, where the record holds it.  own:
    further fields of the document, before what the record gives.
    """
    made: Provenance = record.provenance
    facts = provenance_facts(made, sha256, record.schema)
    known: dict[str, Any] = {"title": made.design_name, "tone": "neutral", "provenance": facts, "made": made}
    return Document(sections=(*sections, *closing_sections(made, *reproduction, design=design)), **(known | own))


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


def provenance_facts(provenance: Provenance, sha256: str, schema: str, which: str = "design") -> Facts:
    """What the numbers come from; ``which`` design they are of."""
    return Facts(
        "Provenance",
        (
            ("Design", provenance.design_name),
            (f"SHA-256 of the {which}", provenance.design_sha256 or "not known"),
            ("SHA-256 of this record", sha256),
            ("Record", schema),
            ("Computed by", f"tailstack {provenance.tailstack_version}"),
            (
                "Installation error",
                f"{provenance.reading} reading, {provenance.rotation_form.replace('_', ' ')} rotation",
            ),
            ("Estimator of a view", provenance.estimator.replace("_", " ")),
            ("Triangulation", provenance.triangulation),
        ),
    )


def closing_sections(
    provenance: Provenance | GateProvenance, *reproduction: Block, design: dict[str, Any] | None = None
) -> tuple[Section, ...]:
    """What a report ends with: what nobody stated, errors that no number in it includes, and how to have it again.

    design: its document, where the record holds it.
    """
    assumed = getattr(provenance, "assumed", ())  # a gate has several designs, each with its own
    return (
        Section("What nobody stated", (_assumed_table(assumed, design),), on=PAPER),
        Section("What is not included", (Bullets(tuple(provenance.not_included)),), on=PAPER, reader="auditor"),
        Section("Reproduction", reproduction, on=PAPER, reader="auditor"),
    )


def _assumed_table(assumed: Sequence[str], design: dict[str, Any] | None) -> Table:
    """Each assumed value: by name and as it is where the design is known."""
    from tailstack.design.pointers import find_places, name_of, value_at

    def as_assumed(pointer: str) -> Cell:
        places = find_places(design, pointer)
        value = value_at(design, places[0]) if places else None
        return value if isinstance(value, int | float | str) else ", ".join(map(str, value or ()))

    columns: tuple[Column, ...] = (Column("Pointer into the design", of=lambda pointer: pointer),)
    if design is not None:
        columns = (
            Column("Assumed value", of=lambda pointer: name_of(design, pointer)),
            Column("As assumed", of=as_assumed),
            replace(columns[0], on=On.SHEET),
        )
    note = (
        "Nobody stated these values of the design: they are a start, and the verdict holds as far as they do. Who "
        "knows a value takes its pointer off the design's list `assumed`."
    )
    return tabulate("Assumed", assumed_sentence(assumed), columns, assumed, note)


def verdict_blocks(verdict: Verdict) -> tuple[Block, ...]:
    """Every requirement at every target, and remarks."""
    return (
        *((checks_table(verdict),) if verdict.checks else ()),
        *((findings_table(verdict.findings),) if verdict.findings else ()),
    )

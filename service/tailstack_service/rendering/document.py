"""A document: what a report is made of, without saying how it looks, what all share, and how a terminal shows it.

HTML, PDF and spreadsheet have their own writers (``report``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

from tailstack.results import Finding, Provenance, Verdict
from tailstack.results.tables import EVERYWHERE, IN_DETAIL, PAPER, TERMINAL, Cell, Column, On, Table, tabulate
from tailstack.results.verdicts import STATED, assumed_sentence, checks_table, findings_table, rest_of

from .text import columns, current, fold, group_findings, paint, prose_width, wrap, write_table

Tone = Literal["pass", "fail", "inconclusive", "neutral"]


class ChangeableNumber(float):
    """A number that whoever opens a spreadsheet may change there."""


class Formula(float):
    """A number that a spreadsheet computes, and what it comes to; ``{row}`` in its text is that of its cell."""

    text: str

    def __new__(cls, value: float, text: str) -> Formula:
        made = super().__new__(cls, value)
        made.text = text
        return made


@dataclass(frozen=True)
class Figure:
    """A picture, SVG with its own title and description; it may be drawn when it is first looked at."""

    name: str  # kebab-case, unique in the report
    drawn: str | Callable[[], str]
    caption: str  # stands above; what it is of comes before its first colon
    drawn_narrow: str | Callable[[], str] = ""  # for a narrow screen; empty: there the picture is moved sideways
    scene: str = ""  # JSON: on a screen the picture is replaced by a viewer of the same scene, which can be turned

    @cached_property
    def svg(self) -> str:
        return self.drawn if isinstance(self.drawn, str) else self.drawn()

    @cached_property
    def narrow(self) -> str:
        """The picture of a narrow screen, if it has one."""
        return self.drawn_narrow if isinstance(self.drawn_narrow, str) else self.drawn_narrow()


@dataclass(frozen=True, slots=True)
class Paragraph:
    text: str
    strong: str = ""  # words that it begins with, before the text


@dataclass(frozen=True, slots=True)
class Bullets:
    items: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Facts:
    """Pairs of a word and what it is."""

    name: str
    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Listing:
    """Text that is kept as it stands: commands, a design document."""

    text: str
    caption: str = ""


@dataclass(frozen=True, slots=True)
class BlockGroup:
    """Blocks that belong together: shown at some places only, and in a terminal without blank lines between them."""

    made: tuple[Block, ...] | Callable[[], tuple[Block, ...]]  # a function is called where they are shown
    on: On

    @property
    def blocks(self) -> tuple[Block, ...]:
        return self.made() if callable(self.made) else self.made


Block = Table | Figure | Paragraph | Bullets | Facts | Listing | BlockGroup


def group(*blocks: Block, on: On = EVERYWHERE) -> BlockGroup:
    return BlockGroup(blocks, on)


def say(word: str, *sentences: str, on: On = TERMINAL) -> BlockGroup:
    """Sentences that each begin with what they are about; an empty one is none."""
    return BlockGroup((Facts(word, tuple((word, sentence) for sentence in sentences if sentence)),), on)


@dataclass(frozen=True, slots=True)
class Section:
    """A chapter.  On paper it begins where the one before it ends."""

    title: str
    blocks: tuple[Block, ...]
    on: On = EVERYWHERE
    reader: Literal["designer", "auditor"] = "designer"  # whom it is for: the contents say so


@dataclass(frozen=True, slots=True)
class KeyNumber:
    """One of the large numbers of the first page."""

    label: str
    value: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Document:
    """A whole report."""

    kind: str  # "Tolerance-budget report", "Gate", ...
    title: str
    tone: Tone
    status: str  # one or two words for the badge
    sentence: str
    numbers: tuple[KeyNumber, ...]
    sections: tuple[Section, ...]
    provenance: Facts
    matters: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()  # on the first page
    requirements: Table | None = None  # on the first page, too: each with its value, limit, margin and status
    # What a terminal has beside the sections: the question below the design's name, by which method, what decides,
    # findings, and a last line, its verdict in the colour of the tone
    made: Provenance | None = None
    question: str = ""
    method: str = ""
    opening: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    ending: str = ""
    captions: bool = False  # whether a terminal has those of the tables, and their notes

    @property
    def rests(self) -> str:
        """On how many assumed values the verdict rests, beside it."""
        return "" if self.made is None else rest_of(self.made.assumed)

    @property
    def title_block(self) -> tuple[tuple[str, str], ...]:
        """Under which number the design is kept, and who answers for it; what it does not say is empty."""
        if self.made is None:
            return ()
        return tuple(
            (word, getattr(self.made.document, name, None) or "")  # of no title block at all, nothing
            for name, word in (
                ("number", "Document"), ("revision", "Revision"), ("date", "Date"), ("author", "Author"),
                ("checker", "Checked"), ("approver", "Approved"),
            )
        )  # fmt: skip

    @property
    def approvals(self) -> tuple[tuple[str, str], ...]:
        """Who signs, and as what; the name is empty where the design does not say it."""
        named = dict(self.title_block)
        return tuple((word, named[word]) for word in ("Author", "Checked", "Approved") if word in named)

    def summaries(self) -> Iterator[Document]:
        """Its first page by itself, each time with less on it: pictures, then what matters, then rows go."""
        made = replace(self.provenance, pairs=self.provenance.pairs[:8])  # which design, record and version
        page = replace(self, sections=(), kind=f"{self.kind}, summary", provenance=made)
        yield page
        yield replace(page, figures=())
        for most in (60, 40, 25, 15, 8, 4, 1):
            rows = None if self.requirements is None else replace(self.requirements, most=most)
            yield replace(page, figures=(), matters=(), requirements=rows)

    def of(self, place: On) -> Document:
        """What of it is shown at a place: no table without rows, and groups in a terminal only."""
        here = [section for section in self.sections if section.on & place]
        shown = [replace(section, blocks=tuple(list_shown(section.blocks, place))) for section in here]
        return replace(self, sections=tuple(section for section in shown if section.blocks))


def list_shown(blocks: tuple[Block, ...], place: On) -> Iterator[Block]:
    """Those of blocks that are shown at a place."""
    for block in blocks:
        if isinstance(block, BlockGroup):
            shown = tuple(list_shown(block.blocks, place)) if block.on & place else ()
            yield from (replace(block, made=shown),) if place & TERMINAL else shown
        elif not isinstance(block, Table) or block.on(place).rows:
            yield block


def tone_of(status: str) -> Tone:
    if status == "pass" or status == "verified":
        return "pass"
    if status in ("fail", "not evaluated"):
        return "fail"
    return "inconclusive" if status == "inconclusive" else "neutral"


# --- what the documents of all results share: how they are composed, and what they end with ------------


def compose_document(
    record: Any, sha256: str, sections: Sequence[Section], command: str = "", words: str = "", **own: Any
) -> Document:
    """The document of a record of one design: its sections, and what every report ends with.

    sha256: of the record.  command: gives it again; words: about that.  own: further fields, before what the record
    gives.
    """
    made: Provenance = record.provenance
    facts = provenance_facts(made, sha256, record.schema)
    known: dict[str, Any] = {"title": made.design_name, "tone": "neutral", "provenance": facts, "made": made}
    again: list[Block] = [Listing(command)] if command else []
    again += [Paragraph(words)] if words else []
    return Document(sections=(*sections, *closing_sections(made, *again)), **(known | own))


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
        command,
        REPRODUCTION,
        kind=f"Study: {kind}",
        sentence=sentences[0],
        matters=tuple(sentences[1:4]),
        figures=() if figure is None else (Figure(*figure),),
        captions=True,
        **({"status": "study"} | own),
    )


def provenance_facts(made: Provenance, sha256: str, schema: str, which: str = "design") -> Facts:
    """What the numbers come from; ``which`` design they are of."""
    pairs = (
        ("Design", made.design_name),
        (f"SHA-256 of the {which}", made.design_sha256 or "not known"),
        ("SHA-256 of this record", sha256),
        ("Record", schema),
        ("Computed by", f"tailstack {made.tailstack_version}"),
        ("Installation error", f"{made.reading} reading, {made.rotation_form.replace('_', ' ')} rotation"),
        ("Estimator of a view", made.estimator.replace("_", " ")),
        ("Triangulation", made.triangulation),
    )
    return Facts("Provenance", pairs)


def closing_sections(
    provenance: Any, *reproduction: Block, design: dict[str, Any] | None = None
) -> tuple[Section, ...]:
    """What a report ends with: what nobody stated, errors that no number in it includes, and how to have it again.

    provenance: of the record, or what a gate has in its place.  design: its document, where the record holds it.
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


def verdict_blocks(verdict: Verdict, *others: Verdict) -> tuple[Block, ...]:
    """Every requirement at every target, by each verdict, and remarks of the first."""
    return checks_table(verdict, *others), findings_table(verdict.findings)


# --- in a terminal: what was asked, what decides, the sections in their order, the verdict --------------

MORE = "--details adds the method and every figure; `tailstack words` explains P95, TCP, connector and the like."


def document_text(document: Document) -> str:
    """Its text on the page that is being written."""
    details, made = current().details, document.made
    shown = document.of(On.DETAIL if details else On.PLAIN)
    named = "\n".join([*fold(document.title, prose_width()), wrap(document.question)])
    verdict, mark, basis = document.ending.partition(" (")  # in its colour, and what it rests on
    parts = (
        named if made is None else _write_heading(made, document.question, document.method),
        "\n".join(map(wrap, document.opening)),
        "" if document.requirements is None else _write_rows(document.requirements),
        *(_write_block(block, document.captions) for section in shown.sections for block in section.blocks),
        "" if made is None else _write_said(_list_said(made)),
        findings_text([finding for finding in document.findings if details or finding.rule not in STATED]),
        "" if details else wrap(MORE, first="more: ", indent="  "),
        paint(verdict, document.tone) + mark + basis if verdict else "",
    )
    return "\n\n".join(part for part in parts if part) + "\n"


def blocks_text(blocks: tuple[Block, ...]) -> str:
    """Blocks by themselves, with captions and notes of tables."""
    shown = list_shown(blocks, On.DETAIL if current().details else On.PLAIN)
    return "\n\n".join(text for block in shown if (text := _write_block(block, True))) + "\n"


def _write_heading(made: Provenance, question: str, method: str) -> str:
    """Name of the design and what was done; with details its hash, by which method and under which model."""
    width = prose_width()
    name = "\n".join(fold(made.design_name, width))
    if not current().details:
        return f"{name}\n{wrap(question)}"
    from tailstack.system import DEFAULT_ESTIMATOR  # late: it brings numpy, which `--help` does without

    usual = made.estimator == DEFAULT_ESTIMATOR
    estimator = "" if usual else f"{made.estimator.replace('_', ' ')} estimator · "
    if made.design_sha256 is not None:
        digest = f"(sha256 {made.design_sha256[:12]})"
        name += ("  " if columns(name) + 2 + columns(digest) <= width else "\n") + digest
    how = (
        f"{question} · {method} · {made.reading} reading · {made.rotation_form.replace('_', ' ')} rotation · "
        f"{estimator}{made.triangulation} triangulation · tailstack {made.tailstack_version}"
    )
    return f"{name}\n{wrap(how)}"


def findings_text(findings: Sequence[Finding]) -> str:
    """A sentence each; findings that are alike are one."""
    lines = []
    for finding, sentence in group_findings(findings):
        mark = paint(finding.severity, "fail" if finding.severity == "error" else "warning")
        lines.append(wrap(f"[{finding.rule}] {sentence}", first=f"{mark}: ", indent="  "))
    return "\n".join(lines)


def _list_said(made: Provenance) -> list[tuple[str, str]]:
    """Assumptions made on the way, and what no number here includes."""
    said = (("assumed", assumed_sentence(made.assumed)), ("not included", "; ".join(made.not_included)))
    return [*(("note", note) for note in made.notes), *said]


def _write_said(pairs: Sequence[tuple[str, str]]) -> str:
    return "\n".join(wrap(meaning, first=f"{word}: ", indent="  ") for word, meaning in pairs if meaning)


def _write_block(block: Block, captions: bool) -> str:
    if isinstance(block, Table):
        above, below = (block.caption, block.note) if captions else ("", "")
        return "\n".join(part for part in (wrap(above), _write_rows(block), wrap(below)) if part)
    if isinstance(block, BlockGroup):
        return "\n".join(text for inner in block.blocks if (text := _write_block(inner, captions)))
    write: Callable[..., str] | None = _WRITERS.get(type(block))
    return "" if write is None else write(block)


def _write_rows(table: Table) -> str:
    """The table, its failures in their colour."""
    lines = write_table(table).split("\n")
    return "\n".join(paint(line, "fail") if line.endswith("  fail") else line for line in lines)


def _write_paragraph(block: Paragraph) -> str:
    """The text, bold where it begins."""
    text = wrap(f"{block.strong}{block.text}")
    return text.replace(block.strong, paint(block.strong, "bold")) if block.strong else text


_WRITERS: dict[type, Callable[..., str]] = {
    Paragraph: _write_paragraph,
    Bullets: lambda block: "\n".join(wrap(item, first="* ", indent="  ") for item in block.items),
    Facts: lambda block: _write_said(block.pairs),
    Listing: lambda block: block.text,
}

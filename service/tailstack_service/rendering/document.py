"""A document as a terminal shows it: what was asked, what decides, the sections in their order, the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tailstack.results import Finding, Provenance
from tailstack.results.tables import On, Table
from tailstack.results.verdicts import STATED, assumed_sentence

from .blocks import Block, BlockGroup, Bullets, Document, Facts, Listing, Paragraph, list_shown
from .text import columns, current, fold, group_findings, paint, prose_width, wrap, write_table

TONE = {"neutral": "no requirement"}  # the role of its colour, where it is called otherwise
MORE = "--details adds the method and every figure; `tailstack words` explains P95, TCP, connector and the like."


def document_text(document: Document) -> str:
    """Its text on the page that is being written."""
    details, made = current().details, document.made
    shown = document.of(On.DETAIL if details else On.PLAIN)
    named = "\n".join([*fold(document.title, prose_width()), wrap(document.question)])
    parts = (
        named if made is None else _write_heading(made, document.question, document.method),
        "\n".join(map(wrap, document.opening)),
        "" if document.requirements is None else _write_rows(document.requirements),
        *(_write_block(block, document.captions) for section in shown.sections for block in section.blocks),
        "" if made is None else _write_provenance(made),
        findings_text([finding for finding in document.findings if details or finding.rule not in STATED]),
        "" if details else wrap(MORE, first="more: ", indent="  "),
        write_ending(document.ending, TONE.get(document.tone, document.tone)),
    )
    return "\n\n".join(part for part in parts if part) + "\n"


def blocks_text(blocks: tuple[Block, ...]) -> str:
    """Blocks by themselves, with captions and notes of tables."""
    shown = list_shown(blocks, On.DETAIL if current().details else On.PLAIN)
    return "\n\n".join(text for block in shown if (text := _write_block(block, True))) + "\n"


def write_ending(ending: str, role: str) -> str:
    """The last line: the verdict in the colour of its role, and what it rests on."""
    verdict, mark, basis = ending.partition(" (")
    return paint(verdict, role) + mark + basis if verdict else ""


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


def _write_provenance(made: Provenance) -> str:
    """Assumptions made on the way, and what no number here includes."""
    notes = [("note", note) for note in made.notes]
    return _write_said(
        [*notes, ("assumed", assumed_sentence(made.assumed)), ("not included", "; ".join(made.not_included))]
    )


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


def _write_bullets(block: Bullets) -> str:
    marks = [f"{k}. " if block.numbered else "* " for k in range(1, len(block.items) + 1)]
    return "\n".join(
        wrap(item, first=mark, indent=" " * len(mark)) for mark, item in zip(marks, block.items, strict=True)
    )


_WRITERS: dict[type, Callable[..., str]] = {
    Paragraph: _write_paragraph,
    Bullets: _write_bullets,
    Facts: lambda block: _write_said(block.pairs),
    Listing: lambda block: block.text,
}

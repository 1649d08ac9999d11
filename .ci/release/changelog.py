"""The changelog, as a release needs it: which version comes next, its section, and what a tag says of it."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass

HEADING = re.compile(r"^## (\d+\.\d+\.\d+) \(([^)]+)\)$", re.MULTILINE)
MUST, NEW = "What you must do", "What is new"
PAGE_LINES = 60  # a printed page: what somebody must do may not be longer


@dataclass(frozen=True)
class Section:
    """What the changelog says of one version."""

    version: str
    when: str  # a date, or "unreleased"
    text: str

    def part(self, title: str) -> str:
        """The text below a heading of the third level.  Raises LookupError."""
        found = re.search(rf"^### {re.escape(title)}\n+(.*?)(?=^### |\Z)", self.text, re.MULTILINE | re.DOTALL)
        if found is None:
            raise LookupError(f"CHANGELOG.md: the section of {self.version} has no part {title!r}")
        return found[1].strip()


def sections(text: str) -> list[Section]:
    """Every version's section, newest first."""
    _, *pieces = HEADING.split(text)
    return [Section(*(piece.strip() for piece in pieces[k : k + 3])) for k in range(0, len(pieces), 3)]


def next_section(text: str) -> Section:
    """The section of the version that is released next.  Raises LookupError where it cannot be."""
    first = re.search(r"^## .*$", text, re.MULTILINE)
    if first is None or HEADING.fullmatch(first[0]) is None:
        raise LookupError(f"CHANGELOG.md: the first section is {first[0] if first else 'missing'!r}, not a version's")
    section = sections(text)[0]
    if section.when != "unreleased":
        raise LookupError(f"CHANGELOG.md: {section.version} was released on {section.when}; begin the next section")
    if len(section.part(MUST).splitlines()) > PAGE_LINES:
        raise LookupError(f"CHANGELOG.md: {MUST!r} is longer than a page of {PAGE_LINES} lines")
    section.part(NEW)
    return section


def cut(text: str, day: str) -> str:
    """The changelog in which the next version was released on that day (``YYYY-MM-DD``)."""
    section = next_section(text)
    return text.replace(f"## {section.version} (unreleased)", f"## {section.version} ({day})", 1)


def tag_text(section: Section) -> str:
    """What an annotated tag of the version says, at most 72 characters wide: links by their words, no headings."""
    lines = [f"tailstack {section.version}", ""]
    for title in (MUST, NEW):
        lines += [title, ""]
        for item in re.split(r"\n(?=- )", section.part(title)):
            plain = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", item).replace("**", "").replace("`", "")
            words, bullet = " ".join(plain.split()), item.startswith("- ")
            lines += textwrap.wrap(words, 72, subsequent_indent="  " if bullet else "", break_on_hyphens=False)
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"

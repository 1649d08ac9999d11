"""What a report is made of, without saying how it looks: terminal, HTML, PDF and spreadsheet are its writers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from tailstack.results import Finding, Provenance
from tailstack.results.tables import EVERYWHERE, On, Table

Tone = Literal["pass", "fail", "inconclusive", "neutral"]


@dataclass(frozen=True)
class Figure:
    """A picture, SVG with its own title and description; it may be drawn when it is first looked at."""

    name: str  # kebab-case, unique in the report
    drawn: str | Callable[[], str]
    caption: str  # stands above; what it is of comes before its first colon
    narrow: str = ""  # the same for a narrow screen, SVG; empty: there the picture is moved sideways
    scene: str = ""  # JSON: on a screen the picture is replaced by a viewer of the same scene, which can be turned

    @cached_property
    def svg(self) -> str:
        """The picture."""
        return self.drawn if isinstance(self.drawn, str) else self.drawn()


@dataclass(frozen=True, slots=True)
class Paragraph:
    text: str


@dataclass(frozen=True, slots=True)
class Bullets:
    items: tuple[str, ...]
    numbered: bool = False


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


Block = Table | Figure | Paragraph | Bullets | Facts | Listing


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
    matters: tuple[str, ...]
    sections: tuple[Section, ...]
    provenance: Facts
    figures: tuple[Figure, ...] = field(default=())  # on the first page
    requirements: Table | None = None  # on the first page, too: each with its value, limit, margin and status
    # What a terminal has beside the sections: the question below the design's name, by which method, findings, and a
    # last line, in the colour of the tone
    made: Provenance | None = None
    question: str = ""
    method: str = ""
    findings: tuple[Finding, ...] = ()
    ending: str = ""

    def of(self, place: On) -> Document:
        """What of it is shown at a place."""
        shown = tuple(section for section in self.sections if section.on & place and section.blocks)
        return replace(self, sections=shown)


def tone_of(status: str) -> Tone:
    """The tone of a verdict."""
    if status == "pass" or status == "verified":
        return "pass"
    if status in ("fail", "not evaluated"):
        return "fail"
    return "inconclusive" if status == "inconclusive" else "neutral"

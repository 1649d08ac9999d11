"""Text for people: the page it is laid out on, wrapped words, aligned tables, colour, alike things as one, CSV.

A command chooses its page once, before its verb runs; whatever writes for people asks ``current()``.  Without a choice
the page is ``Page()``, so that a text is the same bytes in a pipe, a file, a test and an answer over HTTP.
"""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, TypeVar

from tailstack.results.tables import Column, On, Table, write_cell

if TYPE_CHECKING:
    from tailstack.results import Finding

T = TypeVar("T")
WIDTH = 80  # columns, where nobody says another number
NARROWEST = 40  # a page of fewer columns is written as one of so many
WIDEST_PROSE = 100  # columns of a paragraph: longer lines are hard to read


@dataclass(frozen=True, slots=True)
class Page:
    """What a text is written for."""

    width: int = WIDTH  # columns
    colour: bool = False
    details: bool = False  # with the method's own words and figures


_page: ContextVar[Page] = ContextVar("page", default=Page())  # noqa: B039 (a frozen record)


def current() -> Page:
    """The page that is being written on."""
    return _page.get()


@contextmanager
def write_on(page: Page) -> Iterator[None]:
    """Lay out every text of the block on a page."""
    token = _page.set(page)
    try:
        yield
    finally:
        _page.reset(token)


# --- words -----------------------------------------------------------------------------------------


def spell_count(count: int, what: str) -> str:
    """A number of things: 1 design, 2 designs."""
    return f"{count:,} {what}" + ("" if count == 1 else "s")


def visible(text: str) -> str:
    """Text with its control characters replaced: they could repaint a terminal."""
    return "".join("?" if unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp") else c for c in text)


def shorten(text: str, width: int) -> str:
    """Text cut to a width, for labels in pictures."""
    clean = visible(text)
    if columns(clean) <= width:
        return clean
    end = _cut(clean[::-1], (width - 1) // 3)[::-1]  # names often differ at their end: region[0], region[1]
    return _cut(clean, width - 1 - columns(end)) + "…" + end


def columns(text: str) -> int:
    """Terminal columns of a text: wide characters take two, combining ones none."""
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def fold(text: str, width: int, hanging: int = 0) -> list[str]:
    """Lines of at most ``width`` columns that hold the whole text, control characters replaced.

    Broken at spaces; a word that is longer than a line goes on in the next.  What is indented stays so, all lines but
    the first by ``hanging`` more.
    """
    clean = visible(text)
    if columns(clean) <= width:
        return [clean]
    indent = " " * min(len(clean) - len(clean.lstrip(" ")), (width - 1) // 2)
    deeper = " " * min(len(indent) + hanging, (width - 1) // 2)
    return wrap(clean, first=indent, indent=deeper, width=width).split("\n")


def _cut(word: str, width: int) -> str:
    """What of a word fits into ``width`` columns, one character at least."""
    end = 1
    while end < len(word) and columns(word[: end + 1]) <= width:
        end += 1
    return word[:end]


def _pieces(word: str, width: int) -> list[str]:
    """A word in parts of at most ``width`` columns, broken behind a hyphen, stroke or underscore where there is one."""
    parts = []
    while columns(word) > width:
        part = _cut(word, width)
        if len(part) == len(word):
            break
        joint = max(part.rfind(mark) for mark in "-_/") + 1
        part = part[:joint] if 3 * joint >= len(part) else part
        parts.append(part)
        word = word[len(part) :]
    return [*parts, word]


def _pad(text: str, width: int, left: bool) -> str:
    space = " " * max(0, width - columns(text))
    return text + space if left else space + text


LEAST_WIDTH = 8  # columns of a text
HANGING = 4  # columns by which the second line of a text stands further right than its first, where there is room
LONGEST_WORDS = (24, 12, 8)  # columns; longer words may be broken where the table is wider than the page


def draw_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1, names: Sequence[int] = (),
    whole: Sequence[int] = (),
) -> str:  # fmt: skip
    """A table that fits the page; the first ``left`` columns are texts, the others numbers.

    names: further columns of texts, among the numbers.  whole: columns of texts that are not folded, such as ids that
    are there to be copied.  A header may hold one line break: its second line is the unit.

    Where it is wider than the page its texts are folded, nothing is cut; where that is not enough its columns are
    shared out over several tables below one another, each with the first ``left`` columns.
    """
    words = [*range(left), *names]
    folded = [k for k in words if k not in whole]
    widths = _fit(header, rows, folded)
    lengths = [widths[k] for k in range(left, len(header))]
    if sum(widths) + 2 * (len(widths) - 1) <= _page_width() or len(lengths) < 2:
        return _draw(header, rows, widths, words, folded)
    room = _page_width() - sum(widths[:left]) - 2 * (left - 1)
    count = 1  # of the columns beside the first ones that go into this table
    while sum(lengths[: count + 1]) + 2 * (count + 1) <= room:
        count += 1
    parts = (list(range(left, left + count)), list(range(left + count, len(header))))
    return "\n\n".join(
        draw_table(
            [header[k] for k in (*range(left), *part)],
            [[row[k] for k in (*range(left), *part)] for row in rows],
            left=left,
            names=[left + place for place, k in enumerate(part) if k in names],
            whole=[*(k for k in whole if k < left), *(left + place for place, k in enumerate(part) if k in whole)],
        )
        for part in parts
    )


def write_table(table: Table) -> str:
    """What a terminal shows of a table: its columns for this page, those of texts before the first number as names."""
    here = table.on(On.DETAIL if current().details else On.PLAIN)
    texts = [k for k, column in enumerate(here.columns) if column.kind == "text"]
    left = next((k for k in range(len(here.columns)) if k not in texts), len(here.columns))
    rows = []
    for row in here.rows:
        name, *cells = map(write_cell, row.cells, here.columns)
        rows.append(["  " * row.depth + name, *cells])
    header = [column.brief or _head_of(column) for column in here.columns]
    return draw_table(header, rows, left=left, names=[k for k in texts if k >= left])


def _head_of(column: Column) -> str:
    """Its name, and below that its unit; a word begins small, as the texts around it do."""
    title = column.title
    name = title[:1].lower() + title[1:] if title[1:2].islower() else title
    return f"{name}\n{column.unit}".rstrip("\n")


def _page_width() -> int:
    return max(current().width, NARROWEST)


def _fit(header: Sequence[str], rows: Sequence[Sequence[str]], texts: Sequence[int]) -> list[int]:
    """Widths of the columns; those of ``texts`` give way where the page is too narrow, the widest first.

    Short words are broken only where the texts with a single column beside them are still too wide.
    """
    needed = [max(columns(line) for line in head.split("\n")) for head in header]
    widths = [max([needed[k], *(columns(visible(row[k])) for row in rows)]) for k in range(len(header))]
    words = {k: max((columns(word) for row in rows for word in visible(row[k]).split()), default=0) for k in texts}
    others = [width for k, width in enumerate(widths) if k not in texts]
    for longest in LONGEST_WORDS:
        beside = others if longest > LONGEST_WORDS[-1] else sorted(others)[-1:]
        fixed = sum(beside) + 2 * (len(texts) + len(beside) - 1)
        least = {k: max(needed[k], min(words[k], longest), LEAST_WIDTH) for k in texts}
        while fixed + sum(widths[k] for k in texts) > _page_width() and any(widths[k] > least[k] for k in texts):
            widths[max(texts, key=lambda k: widths[k] - least[k])] -= 1
    return widths


def _draw(
    header: Sequence[str], rows: Sequence[Sequence[str]], widths: list[int], words: list[int], folded: list[int]
) -> str:
    lines: list[Sequence[str]] = [*zip_longest(*(head.split("\n") for head in header), fillvalue="")]
    lines.append(["─" * width for width in widths])
    for row in rows:
        cells = [
            fold(cell, widths[k], HANGING if widths[k] > 5 * HANGING else 0) if k in folded else [visible(cell)]
            for k, cell in enumerate(row)
        ]
        lines += zip_longest(*cells, fillvalue="")
    return "\n".join(
        "  ".join(_pad(cell, widths[k], k in words) for k, cell in enumerate(row)).rstrip() for row in lines
    )


def wrap(text: str, *, indent: str = "", first: str | None = None, width: int | None = None) -> str:
    """Words wrapped at the width, by default the page's, control characters replaced.

    first: opens the first line, as it stands; indent: opens the others.
    """
    width = prose_width() if width is None else width
    lines, line = [], indent if first is None else first
    empty = True
    for word in _keep_units([*map(visible, text.split())], width - columns(indent)):
        here = columns(line) + (0 if empty else 1)
        fits = here + columns(word) <= width
        for part, piece in enumerate([word] if fits else _pieces(word, max(width - columns(indent), 1))):
            if not empty and (part > 0 or columns(line) + 1 + columns(piece) > width):
                lines.append(line)
                line, empty = indent, True
            line += piece if empty else " " + piece
            empty = False
    return "\n".join([*lines, line])


UNITS = frozenset(("%", "mm", "px", "deg", "°", "K", "N", "s"))


def _keep_units(words: Sequence[str], width: int) -> list[str]:
    """Words of which a number and its unit are one, where both fit on a line."""
    joined: list[str] = []
    for word in words:
        before = joined[-1] if joined else ""
        if before[-1:].isdigit() and word.rstrip(".,;:)") in UNITS and len(before) + len(word) < width:
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return joined


def prose_width() -> int:
    return min(_page_width(), WIDEST_PROSE)


# --- colour ---------------------------------------------------------------------------------------

_COLOURS = {"pass": "32", "fail": "31", "inconclusive": "33", "neutral": "2", "bold": "1", "warning": "33"}


def paint(text: str, role: str) -> str:
    """Text in the colour of its role on a page that has colours, otherwise as it stands."""
    return f"\x1b[{_COLOURS[role]}m{text}\x1b[0m" if current().colour and role in _COLOURS else text


# --- alike things as one ------------------------------------------------------------------------------------

FEWEST = 3  # two are still read one by one
MOST_PLACES = 8


def group_alike(items: Sequence[T], key: Callable[[T], Hashable | None]) -> list[list[T]]:
    """Items of one key together, where the first of them stands; those with the key None, and pairs, by themselves."""
    keys = [key(item) for item in items]
    count = Counter(keys)
    groups: dict[Hashable, list[T]] = {}
    for number, (item, own) in enumerate(zip(items, keys, strict=True)):
        alone = own is None or count[own] < FEWEST
        groups.setdefault(("alone", number) if alone else ("alike", own), []).append(item)
    return list(groups.values())


def name_field(pointer: str) -> str:
    """The last field of a pointer, whatever entry of a list it leads to: what alike findings share."""
    return next((step for step in reversed(pointer.split("/")) if step and not step.isdecimal()), "")


def name_rule(sentence: str) -> str:
    """What a sentence says before what arrived, whatever its numbers are."""
    return re.sub(r"-?\d+(\.\d+)?", "#", sentence.partition("; got ")[0])


def list_others(lines: Sequence[int | None], pointers: Sequence[str]) -> str:
    """``and 9 more like it: lines 12, 13, ...``, by pointers where there are no lines."""
    if None in lines:
        places, word = list(dict.fromkeys(pointers)), "at"
    else:
        places = [str(line) for line in dict.fromkeys(lines)]
        word = "lines" if len(places) > 1 else "line"
    more = ", ..." if len(places) > MOST_PLACES else ""
    return f"and {len(lines)} more like it: {word} {', '.join(places[:MOST_PLACES])}{more}"


def group_findings(findings: Sequence[Finding]) -> Iterator[tuple[Finding, str]]:
    """Findings with their sentences; three and more of the same words, each about another thing, are one."""
    for first, *others in group_alike(findings, _name_remark):
        fields = [name_field(item.pointer) for item in (first, *others)]
        # what a remark is about stands before its colon; its value does not count
        names = ", ".join(
            other.message.partition(": ")[0].partition(" is ")[0] + (f" ({field})" if len(set(fields)) > 1 else "")
            for other, field in zip(others, fields[1:], strict=True)
        )
        yield (first, first.message + (f" The same holds for {names}." if names else ""))


def _name_remark(finding: Finding) -> Hashable | None:
    """What it says, whatever it says it of: two fields of one view are alike."""
    remark = finding.message.partition(": ")[2].replace(name_field(finding.pointer) or ":", "#")
    return (finding.rule, finding.severity, remark) if remark else None


# --- rows of a grid: as CSV for spreadsheets, and why some of them have no numbers --------------------------

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """One line for each row; None is left empty, truths are ``true`` and ``false``."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(header)
    lines.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else value


def plain_text(text: str) -> str:
    """A text of the user's that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(FORMULA_STARTS) else text


def list_reasons(reasons: Sequence[str | None], most: int, *, numbered: bool = False) -> list[str]:
    """Each reason once, with the rows it holds for (``numbered``, from one) or how many they are; None is no reason."""
    places: dict[str, list[int]] = {}
    for place, reason in enumerate(reasons):
        if reason is not None:
            places.setdefault(reason, []).append(place + 1)
    listed = []
    for reason, held in list(places.items())[:most]:
        which = f"{len(held)} point{'s' if len(held) > 1 else ''}"
        if numbered:
            which = f"point{'s' if len(held) > 1 else ''} {', '.join(map(str, held[:8]))}"
            which += ", ..." if len(held) > 8 else ""
        listed.append(f"{which}: {reason}")
    if len(places) > most:
        listed.append(f"{len(places) - most} more reasons (--json and --csv list them all)")
    return listed

"""Tables as people have them: text with cells between commas, semicolons or tabs, read in one way wherever one arrives.

A spreadsheet of another country, a program's export and ``numpy.savetxt`` write the same numbers in many ways.  What
can be meant in one way only is read; everything else is refused with its line and what to do.  No row vanishes: each is
read, or left out and counted (:class:`Rows`), or the table is refused.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from math import isfinite
from typing import IO

from .cures import cure_text
from .errors import Problem, TailstackError
from .tables import read_table
from .units import LENGTHS_MM

DELIMITERS = "\t;,"
NAMED_LINES = 5  # of each kind of row that was left out
NUMBERINGS = ("no", "no.", "nr", "nr.", "#", "index", "idx", "row", "lfd. nr.", "pos.")  # columns that count rows
PREVIEW = 12  # rows that are looked at for the delimiter and the header
MOST_REMARKS = 200  # lines above the header
CHUNK = 1 << 20
SUMMARIES = read_table("words")["summaries"]  # what the first cell of a row says that sums up those above it
_OTHER_ENDS: dict[str, str] = read_table("words")["line ends"]  # which nothing here takes for one

_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_COMMA_NUMBER = re.compile(r"[-+]?[0-9]+,[0-9]+([eE][-+]?[0-9]+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")  # one comma that may be either
UNITS = frozenset((*LENGTHS_MM, "deg", "rad", "mrad", "px"))  # that a column may state
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # before UTF-16 LE, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_UNDEFINED = re.compile(rb"[\x81\x8d\x8f\x90\x9d]")  # bytes that Windows-1252 has no character for
_KINDS = {  # of rows that are left out
    "remark": "begin with # and are remarks",
    "title": "stand above the header and are titles",
    "empty": "hold nothing",
    "missing": "hold -3.697314e28, by which NDI says that nothing was seen",
}
_HEADING = re.compile(
    r"(.+?)(?:\s*[_/]\s*(U)|\s*\[\s*(U)\s*\]|\s*\(\s*(U)\s*\)|\s+(U))".replace("U", r"[^\s_/\[\]()]+")
)
KEPT_ENDS = "curl -d @FILE drops line ends, --data-binary @FILE keeps them"
_LINE_BREAK = "a cell goes on over several lines"


def read_plain_number(text: str) -> float | None:
    """A finite number with a decimal point, as a text; None of anything else.  The minus of typesetting is one."""
    text = text.strip().replace("\N{MINUS SIGN}", "-")
    value = float(text) if _NUMBER.fullmatch(text) else None
    return value if value is not None and isfinite(value) else None


def is_missing(value: float) -> bool:
    """Whether a number is what NDI's trackers write for a marker that was not seen, -3.697314e28."""
    return abs(value + 3.697314e28) < 1e25


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a number in some country's way of writing, or the place of one."""
    text = cell.strip().replace("\N{MINUS SIGN}", "-")
    return bool(re.fullmatch(r"[-+±]?[0-9][0-9.,'\u2019\u00a0\u202f ]*([eE][-+]?[0-9]+)?%?|[-+]?\.[0-9]+", text))


def split_heading(cell: str) -> tuple[str, str]:
    """Name and unit of a column, in small letters: ``x_mm``, ``x [mm]``, ``x (mm)``, ``x/mm`` and ``x mm`` alike.

    The unit is empty where the column states none that is known here.
    """
    cell = cell.strip().lower()
    match = _HEADING.fullmatch(cell)
    unit = clean_unit(next((group for group in match.groups()[1:] if group), "")) if match else ""
    return (match[1].strip(), unit) if match and unit in UNITS else (cell, "")


def clean_unit(cell: str) -> str:
    """A unit by itself, as it is or in brackets; the Greek mu is a micro sign, and - and 1 are no unit."""
    unit = cell.strip(" []()").lower().replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")
    return {"°": "deg", "-": "", "1": ""}.get(unit, unit)


@dataclass(slots=True)
class Rows:
    """How many rows of a table were read, and how many of each kind were left out, the first by their lines."""

    read: int = 0
    left_out: dict[str, int] = field(default_factory=dict)
    lines: dict[str, list[int]] = field(default_factory=dict)

    def leave_out(self, kind: str, line: int) -> None:
        """Count a row that is no data."""
        self.left_out[kind] = self.left_out.get(kind, 0) + 1
        known = self.lines.setdefault(kind, [])
        if len(known) < NAMED_LINES:
            known.append(line)

    def describe(self) -> Iterator[str]:
        """What was left out, in words: how many rows, in which lines, and why."""
        for kind, count in self.left_out.items():
            known = self.lines[kind]
            listed = ", ".join(map(str, known)) + (", ..." if count > len(known) else "")
            sentence = f"{count} rows were left out, as they {_KINDS[kind]}: lines {listed}"
            if count == 1:
                words = re.sub(r"\b(begin|stand|hold)\b", r"\1s", _KINDS[kind]).replace("are remarks", "is a remark")
                sentence = f"1 row was left out, as it {words.replace('are titles', 'is a title')}: line {listed}"
            yield sentence


@dataclass(slots=True)
class PeopleTable:
    """A table that is being read.  Its ``rows`` are iterated once; what was left out is known after that."""

    name: str | None  # of the file, for refusals
    error: type[TailstackError]  # what is raised
    header: tuple[str, ...]  # as it is written, without the spaces around
    header_line: int
    delimiter: str
    rows: Iterator[tuple[int, list[str]]]  # line, and as many cells as the header has, as they are written
    counts: Rows
    units: tuple[str, ...] | None = None  # of a row of its own below the header
    units_line: int = 0
    remarks: list[tuple[int, str]] = field(default_factory=list)  # line and text of what begins with #, the first ones
    encoding: str = ""  # that had to be guessed
    comma: tuple[int, str] | None = None  # the first number with a decimal comma: line and cell
    point: tuple[int, str] | None = None

    def refuse(
        self, code: str, detail: str, hint: str = "", line: int | None = None, column: int | None = None
    ) -> TailstackError:
        """What is wrong in a line, to be raised."""
        return self.error(Problem("", code, detail, hint, self.name, line, column))

    def read_number(self, cell: str, line: int, column: int, what: str | None = None) -> float:
        """The number in a cell of a column (counted from 0), finite.

        A comma is decimal where semicolons or tabs are between the cells; a table has one decimal mark.  Raises
        ``error`` with line and column.
        """
        value = self.find_number(cell, line, column)
        if value is None:
            what = what or self.header[column]
            detail = f"{what} is a number; got {quote(cell)}" if cell.strip() else f"{what} is empty"
            raise self.refuse("wrong-type", detail, self.cure(cell, what), line, column + 1)
        return value

    def find_number(self, cell: str, line: int, column: int) -> float | None:
        """As ``read_number``; None of what is no number.  Raises ``error`` for two decimal marks in one table."""
        text = cell.strip().replace("\N{MINUS SIGN}", "-")
        if _NUMBER.fullmatch(text):
            if "." in text and self.delimiter != ",":
                self.point = self.point or (line, cell.strip())
                self._refuse_two_marks(line, column)
            value = float(text)
            if not isfinite(value):
                detail, cure = f"{self.header[column]} is too large: {quote(cell)}", "leave out what was not measured"
                raise self.refuse("out-of-range", detail, cure, line, column + 1)
        elif self.delimiter != "," and _COMMA_NUMBER.fullmatch(text):
            if self.delimiter != ";" and _THOUSANDS.fullmatch(text):
                return None  # between tabs a comma may separate thousands, too
            self.comma = self.comma or (line, cell.strip())
            self._refuse_two_marks(line, column)
            value = float(text.replace(",", "."))
        else:
            return None
        return value

    def refuse_summary(self, label: str, line: int, what: str) -> None:
        """Raises ``error`` for a row whose label says that it sums up the others."""
        if re.sub(r"[\s_:-]", "", label).lower().rstrip(".") in SUMMARIES:
            detail = f"{quote(label)} says that this row sums up others, and it would count as {what}"
            raise self.refuse("summary-row", detail, "delete the row, or call it otherwise", line, 1)

    def cure(self, cell: str, what: str) -> str:
        """What to write instead of a cell that is no number."""
        if not cell.strip():
            return "every row has a number here; leave out what was not measured"
        return cure_text(cell.strip().replace("\N{MINUS SIGN}", "-"), what) or "every row has a number here"

    def _refuse_two_marks(self, line: int, column: int) -> None:
        if self.comma and self.point:
            detail = (
                f"the table has decimal commas ({self.comma[1]} in line {self.comma[0]}) and points "
                f"({self.point[1]} in line {self.point[0]})"
            )
            hint = "write all decimals alike, and no separators of thousands"
            raise self.refuse("mixed-decimals", detail, hint, line, column + 1)

    def describe(self) -> tuple[str, ...]:
        """What was left out and what was read in another way than it is written, once the rows were read."""
        sentences = list(self.counts.describe())
        if self.encoding:
            sentences.append(f"it is no UTF-8 and was read as {self.encoding}: look at its names")
        if self.comma:
            sentences.append("decimal commas were read as such")
        return tuple(sentences)


def quote(cell: str, length: int = 60) -> str:
    """A cell as it arrived, short and printable."""
    clean = "".join(each if each.isprintable() else "?" for each in cell)
    return repr(clean if len(clean) <= length else clean[: length - 3] + "...")


def describe_marked_row(text: str) -> tuple[str, str]:
    """What is wrong with a row of cells behind a #, which may be a remark or one that somebody took out; its cure."""
    detail = f"this begins with # and has the cells of a row: {quote(text)}"
    return detail, "delete the line if it is a remark, the # if it is none"


# --- bytes to lines ---------------------------------------------------------------------------------------


def encoding_of(content: bytes) -> str:
    """By its mark UTF-8, UTF-16 or UTF-32; UTF-8 without one."""
    return next((codec for mark, codec in _MARKS if content.startswith(mark)), "utf-8")


def find_encoding(stream: IO[bytes], name: str | None, error: type[TailstackError]) -> tuple[str, str]:
    """The encoding of a text, and what to call it if it had to be guessed.

    By its mark UTF-8, UTF-16 or UTF-32; without one strictly UTF-8, and what is not Windows-1252, which spreadsheets
    call ANSI.  A stream that cannot be read twice is taken for UTF-8.  Raises ``error`` for what is no text.
    """
    if not stream.seekable():
        return "utf-8-sig", ""
    begin = stream.tell()
    first = stream.read(4)
    encoding = encoding_of(first)
    if first.startswith(b"PK\x03\x04"):
        hint = "save the sheet with the table as CSV UTF-8"
        raise error(Problem("", "not-text", "this is a workbook or another archive, not a text", hint, name))
    decoder = codecs.getincrementaldecoder(encoding)()
    guessed, marked = "", encoding != "utf-8"
    for lines, part in chain(_list_parts(stream, begin), [(0, b"")]):
        if not marked and (at := part.find(b"\0")) >= 0:
            line = lines + part.count(b"\n", 0, at) + 1
            detail = "the text holds NUL characters: a binary file, or UTF-16 without a mark"
            raise error(Problem("", "not-text", detail, "save it as CSV UTF-8", name, line))
        if not guessed:
            try:
                decoder.decode(part, not part)
            except UnicodeDecodeError as failure:
                if marked:
                    promised = failure.encoding.upper()
                    detail = f"byte {failure.start + 1} is not valid {promised}, which its mark promises"
                    raise error(Problem("", "not-text", detail, "save it as CSV UTF-8", name)) from None
                encoding, guessed = "cp1252", "Windows-1252 (ANSI)"
    for lines, part in _list_parts(stream, begin) if guessed else ():
        if match := _UNDEFINED.search(part):
            line = lines + part.count(b"\n", 0, match.start()) + 1
            detail = f"byte 0x{match[0].hex()} is neither UTF-8 nor Windows-1252 (ANSI)"
            raise error(Problem("", "not-text", detail, "save it as CSV UTF-8", name, line))
    stream.seek(begin)
    return encoding, guessed


def _list_parts(stream: IO[bytes], begin: int) -> Iterator[tuple[int, bytes]]:
    """Parts of what a stream holds from there on, each with how many lines end before it."""
    stream.seek(begin)
    lines = 0
    for part in iter(partial(stream.read, CHUNK), b""):
        yield lines, part
        lines += part.count(b"\n")


def decode_people_text(content: bytes, name: str | None, error: type[TailstackError]) -> tuple[str, str]:
    """The text of a whole file, and the name of its encoding if that had to be guessed.  Raises ``error``."""
    encoding, guessed = find_encoding(io.BytesIO(content), name, error)
    return content.decode(encoding), guessed


def list_lines(stream: IO[bytes], encoding: str) -> Iterator[str]:
    """Lines of a text without their ends, whichever these are.  The stream stays open."""
    text = io.TextIOWrapper(stream, encoding, newline=None)
    try:
        yield from text
    finally:
        with suppress(ValueError):
            text.detach()


# --- lines to a table -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TextLine:
    """A row by its line, before it is known what it is."""

    number: int
    text: str
    cells: list[str]

    @property
    def filled_cells(self) -> int:
        return sum(1 for cell in self.cells if cell)


def read_people_table(
    source: IO[bytes] | bytes,
    name: str | None,
    error: type[TailstackError],
    knows_header: Callable[[Sequence[str]], bool] | None = None,
) -> PeopleTable:
    """The header of a table now, its rows as they are asked for.

    ``knows_header``: whether cells are a header of the kind that is wanted, which finds it below titles; without it
    the first row that is no title is the header.  Raises ``error`` with the line, now and then.
    """
    stream = io.BytesIO(source) if isinstance(source, bytes) else source
    encoding, guessed = find_encoding(stream, name, error)
    lines = list_lines(stream, encoding)
    try:
        return _open_table(lines, name, error, knows_header, guessed)
    except UnicodeDecodeError as failure:
        raise error(_not_decoded(failure, name, 1)) from None


def _not_decoded(failure: UnicodeDecodeError, name: str | None, line: int) -> Problem:
    detail = f"this is not {failure.encoding.upper()} from about line {line} on"
    return Problem("", "not-text", detail, "save it as CSV UTF-8", name, line)


def _open_table(
    lines: Iterator[str],
    name: str | None,
    error: type[TailstackError],
    knows_header: Callable[[Sequence[str]], bool] | None,
    guessed: str,
) -> PeopleTable:
    def refuse(code: str, detail: str, hint: str = "", line: int | None = None) -> TailstackError:
        return error(Problem("", code, detail, hint, name, line))

    held: list[str] = []
    contents = 0
    for text in lines:
        held.append(text)
        contents += bool(text.strip()) and not text.lstrip("\ufeff \t").startswith("#")
        if contents >= PREVIEW or len(held) - contents > MOST_REMARKS:
            break
    told = next((k for k, text in enumerate(held) if text.strip()), None)
    match = re.fullmatch(r'\ufeff?"?sep=(.)"?\s*', held[told], re.IGNORECASE) if told is not None else None
    start = 0 if match is None or told is None else told + 1
    texts = [(k + 1, text.rstrip("\r\n")) for k, text in enumerate(held) if k >= start and text.strip()]
    data = [(number, text) for number, text in texts if not text.lstrip().startswith("#")]
    if len(texts) == 1 and (lost_ends := _find_lost_ends(texts[0][1])):
        raise refuse("line-ends", *lost_ends, texts[0][0])
    if not data:
        raise refuse("empty-document", "the file holds no line of a table")
    if match is not None and match[1] not in (*DELIMITERS, "|"):
        raise refuse("csv-header", f"cells are separated by {match[1]!r}", "separate them by commas or semicolons", 1)
    delimiter = match[1] if match else _find_delimiter([text for _, text in data])

    def split(number: int, text: str) -> TextLine:
        try:
            cells = next(csv.reader([text], delimiter=delimiter, strict=True), [])
        except csv.Error as failure:
            detail = _LINE_BREAK if "unexpected end" in str(failure) else str(failure)
            hint = "take line breaks out of cells; a quote inside a quoted cell is doubled"
            raise refuse("csv-syntax", f"this line is not CSV: {detail}", hint, number) from None
        return TextLine(number, text, [cell.strip() for cell in cells])

    # the header, and nothing above it that could be a row; rows below are split only as far as they are needed
    contents_of = [split(*each) for each in data[:PREVIEW] if not _goes_on(each[1])] or [split(*data[0])]
    above = [(number, text) for number, text in texts if text.lstrip().startswith("#")]
    counts = Rows()
    marked = [each for each in above if each[0] < contents_of[0].number]
    known = knows_header is not None and any(knows_header(line.cells) for line in contents_of)
    if not known and marked and (header := _read_marked(split, *marked[-1], contents_of[0])):
        titles: list[TextLine] = []
    else:
        header, titles = find_header(contents_of, knows_header)
    for number, text in data:
        if number < header.number and _goes_on(text):
            split(number, text)  # which refuses it
    if knows_header is None and not header.text.lstrip().startswith("#"):
        numbers = [cell for cell in header.cells if looks_like_number(cell)]
        if any(not cell.isdecimal() for cell in numbers) or len(numbers) == len(header.cells):
            detail = f"the first row names the columns; here it holds {quote(numbers[0])}"
            raise refuse("csv-header", detail, "put a row with the names of the columns above it", header.number)
    for number, text in above:  # one with the cells of a row may be one that somebody took out
        if number < header.number and text.count(delimiter) == header.text.count(delimiter) > 0:
            titles.append(split(number, text))
    for title in titles:
        if title.filled_cells >= max(2, sum(map(bool, header.cells))) and any(map(looks_like_number, title.cells)):
            detail = f"a row stands above the header (line {header.number}): {quote(title.text)}"
            raise refuse("csv-header", detail, "put it below, or delete it", title.number)
        counts.leave_out("remark" if title.text.lstrip().startswith("#") else "title", title.number)
    if len(header.cells) == 1 and delimiter not in header.text:
        _refuse_spaces(contents_of, header, refuse)
    begins = header.number
    cells = header.cells
    while len(cells) > 1 and not cells[-1]:
        cells = cells[:-1]
    trailing = len(header.cells) - len(cells)
    following = next((line for line in contents_of if line.number > begins), None)
    stated = [] if following is None else [clean_unit(cell) for cell in following.cells]
    units = None
    if following and len(stated) == len(header.cells) and any(stated) and UNITS.issuperset(filter(None, stated)):
        units, begins = tuple(stated[: len(cells)]), following.number
    units_line = begins if units else 0
    remarks = [each for each in above if each[0] <= begins and each[0] != header.number]
    table = PeopleTable(
        name, error, tuple(cells), header.number, delimiter, iter(()), counts, units, units_line, remarks, guessed
    )
    table.rows = _list_rows(table, chain(held[begins:], lines), begins, trailing)
    return table


def _find_lost_ends(text: str) -> tuple[str, str] | None:
    """What is wrong with the only line of a text, and its cure, if it holds more than names of columns."""
    for mark, name in _OTHER_ENDS.items():
        if mark in text.strip():
            return f"the table is one line, with {name} where lines end", "end lines with LF, or CR LF"
    cells = [cell.strip() for cell in re.split(f"[{DELIMITERS}]", text)]
    numbers = [looks_like_number(cell) for cell in cells]
    if all(numbers) or not (any(numbers) or any(re.search(r"[0-9]\.[0-9]", cell) for cell in cells)):
        return None
    detail = "the table is one line, with numbers in it: it has no header, or its line ends are lost"
    return detail, f"put the names of the columns into a line above the rows; {KEPT_ENDS}"


def _goes_on(text: str) -> bool:
    """Whether a line ends inside of quotes; the row it begins is refused when it is reached."""
    return text.count('"') % 2 == 1


def _find_delimiter(texts: Sequence[str]) -> str:
    """The first of tab, semicolon and comma that stands outside of quotes in two lines, or in the only one.

    Not where another splits twice as many numbers off: it is one of what labels hold then.
    """
    bare = [re.sub(r'"[^"]*"', "", text) for text in texts]
    marks = [mark for mark in DELIMITERS if sum(mark in text for text in bare) >= min(2, len(bare))]
    numbers = {mark: sum(looks_like_number(cell) for text in bare for cell in text.split(mark)) for mark in marks}
    for mark in marks:
        if 2 * numbers[mark] >= max(numbers.values()):
            return mark
    return next((mark for mark in DELIMITERS if mark in bare[0]), ",")


def _read_marked(split: Callable[[int, str], TextLine], number: int, text: str, first: TextLine) -> TextLine | None:
    """The header in a remark above the first row, where numpy.savetxt puts it."""
    if not any(map(looks_like_number, first.cells)):
        return None
    cells = text.lstrip()
    line = split(number, cells if re.match(r"#\s*[\t;,]", cells) else cells.lstrip("#").lstrip())
    named = len(line.cells) == len(first.cells) and not any(map(looks_like_number, line.cells)) and all(line.cells)
    return TextLine(number, text, line.cells) if named else None


def find_header(
    contents: list[TextLine], knows_header: Callable[[Sequence[str]], bool] | None
) -> tuple[TextLine, list[TextLine]]:
    """The header, and the titles above it."""
    if knows_header is not None:
        at = next((k for k, line in enumerate(contents) if knows_header(line.cells)), None)
        if at is not None:
            return contents[at], contents[:at]
    at = 0
    while (
        at + 1 < len(contents)
        and contents[at].filled_cells == 1
        and contents[at + 1].filled_cells >= 1
        and not any(map(looks_like_number, contents[at + 1].cells))
        and max(line.filled_cells for line in contents[at + 1 :]) > 1
    ):
        at += 1
    return contents[at], contents[:at]


def _refuse_spaces(contents: list[TextLine], header: TextLine, refuse: Callable[..., TailstackError]) -> None:
    """Cells that only spaces separate: a name may hold a space, so nothing is guessed."""
    for line in contents[:2]:
        words = line.text.split()
        if len(words) > 1 and len(line.cells) == 1 and all(map(looks_like_number, words)):
            hint = "separate them by commas: numpy.savetxt(file, table, delimiter=',', header='x_mm,y_mm,z_mm')"
            raise refuse("csv-header", f"cells are separated by spaces: {quote(line.text)}", hint, header.number)


def _list_rows(table: PeopleTable, lines: Iterable[str], begins: int, trailing: int) -> Iterator[tuple[int, list[str]]]:
    """Rows of as many cells as the header has; everything else is counted, or refused."""
    width, counts, line = len(table.header), table.counts, begins
    reader = csv.reader(lines, delimiter=table.delimiter, strict=True)
    while True:
        try:
            row = next(reader, None)
        except UnicodeDecodeError as failure:
            raise table.error(_not_decoded(failure, table.name, line + 1)) from None
        except csv.Error as failure:
            goes_on = "unexpected end" in str(failure) or reader.line_num > line - begins + 1
            reason = _LINE_BREAK if goes_on else str(failure)
            hint = "take line breaks out of cells; a quote inside a quoted cell is doubled"
            raise table.refuse("csv-syntax", f"this line is not CSV: {reason}", hint, line + 1) from None
        if row is None:
            return
        line += 1
        if begins + reader.line_num != line:
            hint = "take the line break out of the cell, or close its quote"
            raise table.refuse("csv-syntax", f"this line is not CSV: {_LINE_BREAK}", hint, line)
        if not row:
            continue
        if row[0][:1] == "#" or row[0].lstrip()[:1] == "#":
            if width not in (len(row), len("\n".join(map(str.strip, row)).rstrip().split("\n"))):
                counts.leave_out("remark", line)
                if len(table.remarks) < MOST_REMARKS:
                    table.remarks.append((line, table.delimiter.join(row)))
                continue
            if width == 1 or not re.match(r"\s*#\S", row[0]):
                raise table.refuse("csv-row", *describe_marked_row(table.delimiter.join(row)), line, 1)
        if len(row) != width:
            if width < len(row) <= width + trailing and not any(map(str.strip, row[width:])):
                row = row[:width]
            elif not any(map(str.strip, row)):
                if len(row) > 1:
                    counts.leave_out("empty", line)
                continue
            else:
                raise _refuse_width(table, row, line)
        if not row[0] and not any(map(str.strip, row)):
            counts.leave_out("empty", line)
            continue
        counts.read += 1
        yield line, row


def _refuse_width(table: PeopleTable, row: list[str], line: int) -> TailstackError:
    width = len(table.header)
    detail = f"{len(row)} cells in a table of {width} columns"
    hint = f"cells are separated by {table.delimiter!r}; fill in what is missing, or delete the row"
    if len(row) > width:
        hint = "the line ends with a delimiter: leave it out"
        if any(map(str.strip, row[width:])):
            hint = "leave out what no column is there for"
            if table.delimiter == ",":
                hint = "write decimals with a point; a label that holds a comma stands in double quotes"
                hint = (cure_text(",".join(row), table.header[0]) if width == 1 else "") or hint
    return table.refuse("csv-row", detail, hint, line, 1)

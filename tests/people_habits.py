"""How people write a table of four columns, each habit for each reader, and what becomes of it.

``python tests/people_habits.py`` prints the table of docs/integrations/tables.md.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pyarrow
from pyarrow import parquet

from tailstack.design.fiducial_files import read_fiducials
from tailstack.design.reading import DEFAULT_LIMITS
from tailstack.errors import LimitError, TailstackError
from tailstack.integrations.step import read_step
from tailstack.studies.bench.file import read_measurements
from tailstack_service.integrations.conversion import BALL
from tailstack_service.tables import Format, read_table

Cells = Sequence[Sequence[str]]
Found = tuple[list[str], list[list[float]], tuple[str, ...]]  # labels, numbers, what is said

NUMBERS = [[-24.5, -27.75, 0.25], [28.5, 21.75, 0.5], [-21.5, 30.25, 0.125]]
LABELS = ["A1", "A2", "A3"]
HEADERS = {
    "fiducials": ["label", "x_mm", "y_mm", "z_mm"],
    "measurements": ["trial", "x_mm", "y_mm", "z_mm"],
    "table of designs": [
        "variant", "targets.tip.position_mm.0", "targets.tip.position_mm.1", "targets.tip.position_mm.2"
    ],
}  # fmt: skip
STEP = "STEP"
BEAD = (10.0, 20.0, 30.0)


def read_as(reader: str, content: bytes, form: Format = "csv") -> Found:
    """Labels, numbers and remarks, by one of the readers."""
    if reader == "fiducials":
        found = read_fiducials(content, "beads.csv", DEFAULT_LIMITS)
        return list(found.labels), [list(each) for each in found.positions_mm], found.notes
    if reader == "measurements":
        measured = read_measurements(content, ("tip",), "bench.csv")
        (group,) = measured.groups
        return [], [[float(value) for value in row] for row in group.values_mm], measured.notes
    if reader == STEP:
        reading = read_step(content, "bead.step")
        return list(reading.fiducials.labels), [list(each) for each in reading.fiducials.positions_mm], reading.notes
    table = read_table(io.BytesIO(content), form, "designs.csv")
    labels: list[str] = []
    numbers: list[list[float]] = []
    for block in table.blocks:
        whole, columns = table.with_numbers(block, [len(table.header) - 3 + k for k in range(3)])
        labels += [str(cell) for cell in whole.columns[len(table.header) - 4]]
        numbers += [list(row) for row in zip(*columns, strict=True)]
    return labels, numbers, table.describe()


def rows_of(reader: str, write: Callable[[float], str] = repr) -> Cells:
    return [HEADERS[reader], *([label, *map(write, row)] for label, row in zip(LABELS, NUMBERS, strict=True))]


def join(cells: Cells, delimiter: str = ",") -> str:
    return "".join(delimiter.join(row) + "\n" for row in cells)


def comma(value: float) -> str:
    return repr(value).replace(".", ",")


def spoil(reader: str, old: str, new: str, delimiter: str = ",") -> bytes:
    text = join(rows_of(reader), delimiter)
    assert old in text
    return text.replace(old, new, 1).encode()


def insert(reader: str, row: str) -> bytes:
    """The table with this row below its first one."""
    lines = join(rows_of(reader)).splitlines(keepends=True)
    return "".join([*lines[:2], row + "\n", *lines[2:]]).encode()


def numbered(reader: str) -> bytes:
    return join([[cell, *row] for cell, row in zip(["No.", *"123"], rows_of(reader), strict=True)]).encode()


def units_below(reader: str) -> bytes:
    header, *rows = rows_of(reader)
    bare = [re.sub(r"_mm$", "", cell) for cell in header]
    return join([bare, ["", "mm", "mm", "mm"], *rows], ";").encode()


def bracketed(reader: str) -> bytes:
    header, *rows = rows_of(reader)
    return join([[re.sub(r"_mm$", " [mm]", cell) for cell in header], *rows]).encode()


def step(change: Callable[[str], str] = str, codec: str = "utf-8") -> bytes:
    return change(BALL.text).encode(codec)


HABITS: dict[str, tuple[Callable[[str], bytes], bytes | None]] = {  # of a table; of a STEP file, where it has it
    "commas, decimal points": (lambda r: join(rows_of(r)).encode(), step()),
    "semicolons, decimal points": (lambda r: join(rows_of(r), ";").encode(), None),
    "tabs, decimal points": (lambda r: join(rows_of(r), "\t").encode(), None),
    "a line `sep=;`": (lambda r: b"sep=;\n" + join(rows_of(r), ";").encode(), None),
    "semicolons, decimal commas": (lambda r: join(rows_of(r, comma), ";").encode(), None),
    "tabs, decimal commas": (
        lambda r: join(rows_of(r, lambda value: comma(value).replace(",125", ",1250")), "\t").encode(), None,
    ),
    "commas, decimal commas": (
        lambda r: join(rows_of(r, comma)).encode(), step(lambda text: text.replace("10.,20.,30.", "10,5,20,5,30,5"))
    ),
    "decimal commas and points": (lambda r: spoil(r, "-24.5", "-24,5", ";"), None),
    "a byte order mark": (lambda r: join(rows_of(r)).encode("utf-8-sig"), step(codec="utf-8-sig")),
    "UTF-16": (lambda r: join(rows_of(r), "\t").encode("utf-16"), step(codec="utf-16")),
    "UTF-16 without a mark": (lambda r: join(rows_of(r), "\t").encode("utf-16-le"), step(codec="utf-16-le")),
    "ANSI (Windows-1252)": (
        lambda r: join(rows_of(r)).replace("A1", "A\N{LATIN CAPITAL LETTER O WITH DIAERESIS}").encode("cp1252"),
        step(lambda text: text.replace("BEAD1", "KÖRPER"), "cp1252"),
    ),
    "Shift-JIS": (lambda r: spoil(r, "A1", "\u7403").decode().encode("shift-jis"),
                  step(lambda text: text.replace("BEAD1", "\u7403"), "shift-jis")),
    "line ends of Windows": (lambda r: join(rows_of(r)).replace("\n", "\r\n").encode(),
                             step(lambda text: text.replace("\n", "\r\n"))),
    "line ends of old Macs": (lambda r: join(rows_of(r)).replace("\n", "\r").encode(),
                              step(lambda text: text.replace("\n", "\r"))),
    "no line ends (`curl -d @FILE`)": (lambda r: join(rows_of(r)).replace("\n", "").encode(),
                                      step(lambda text: text.replace("\n", ""))),
    "line ends written out, as `\\n`": (lambda r: join(rows_of(r)).replace("\n", "\\n").encode(), None),
    "line ends of Unicode, U+2028": (lambda r: join(rows_of(r)).replace("\n", "\u2028").encode(),
                                    step(lambda text: text.replace("\n", "\u2028"))),
    "a delimiter at the end of every row": (lambda r: join(rows_of(r)).replace("\n", ",\n").encode(), None),
    "a delimiter at the end of one row": (lambda r: spoil(r, "0.25\n", "0.25,\n"), None),
    "an empty row": (lambda r: insert(r, ",,,"), None),
    "an empty line": (lambda r: insert(r, ""), step(lambda text: text.replace("#5=", "\n\n#5="))),
    "a title above the header": (lambda r: b"Cage of May\n" + join(rows_of(r)).encode(), None),
    "units in a row of their own": (units_below, None),
    "units in brackets": (bracketed, None),
    "a column No.": (numbered, None),
    "a remark (#) between the rows": (lambda r: insert(r, "# measured twice"), step(
        lambda text: text.replace("#5=", "/* measured twice */ #5="))),
    "a row behind `# `": (lambda r: spoil(r, "A2,", "# A2,"), None),
    "a name that begins with #": (lambda r: spoil(r, "A2,", "#9,"), None),
    "numpy.savetxt's header": (lambda r: b"# " + join(rows_of(r)).encode(), None),
    "the minus U+2212": (lambda r: join(rows_of(r)).replace("-", "\N{MINUS SIGN}").encode(),
                         step(lambda text: text.replace("10.,20.,30.", "\N{MINUS SIGN}10.,20.,30."))),
    "thousands: 1,234.5": (lambda r: spoil(r, "28.5", '"1,234.5"'), None),
    "thousands: 1.234,5": (lambda r: spoil(r, "28.5", "1.234,5", ";"), None),
    "thousands: 1 234.5": (lambda r: spoil(r, "28.5", "1 234.5"), None),
    "a zone: +0.1/-0": (lambda r: spoil(r, "28.5", "+0.1/-0"), None),
    "a zone: ±0.05": (lambda r: spoil(r, "28.5", "±0.05"), None),
    "a value and its zone: 28.5 ± 0.05": (lambda r: spoil(r, "28.5", "28.5 ± 0.05"), None),
    "NDI's −3.697314e28": (lambda r: insert(r, "A9," + ",".join(["-3.697314E+028"] * 3)), None),
    "a cell too many": (lambda r: spoil(r, "28.5", "28.5,1"), None),
    "a cell too few": (lambda r: spoil(r, "28.5,", ""), None),
    "an empty cell": (lambda r: spoil(r, "28.5", ""), None),
    "#REF!, #N/A, NaN": (lambda r: spoil(r, "28.5", "#REF!"), None),
    "the header twice": (lambda r: insert(r, ",".join(HEADERS[r])), None),
    "cells separated by spaces": (lambda r: join(rows_of(r)[1:], " ").replace("A", "").encode(), None),
    "a line break inside of quotes": (lambda r: spoil(r, "A2", '"A\n2"'), None),
}  # fmt: skip


def decimals() -> bytes:
    columns: dict[str, Any] = {HEADERS["table of designs"][0]: LABELS}
    for k, name in enumerate(HEADERS["table of designs"][1:]):
        columns[name] = pyarrow.array([Decimal(repr(row[k])) for row in NUMBERS], pyarrow.decimal128(12, 6))
    stream = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), stream)
    return stream.getvalue()


BINARY: dict[str, tuple[Callable[[], bytes], Format]] = {  # of tables of designs alone
    "Parquet: DECIMAL": (decimals, "parquet"),
}  # fmt: skip


def outcome(reader: str, content: bytes, form: Format = "csv") -> str:
    """``read``, ``read, said``, or what is refused with its cure; raises AssertionError for a silent change."""
    expected = ([*LABELS], NUMBERS) if reader != STEP else (["BEAD1"], [[*BEAD]])
    try:
        labels, numbers, said = read_as(reader, content, form)
    except (TailstackError, LimitError) as error:
        problem = error.problems[0]
        assert problem.hint, problem
        assert problem.file is None or problem.line is not None or not content or reader == STEP, problem
        return f"refused: {problem.hint}"
    assert numbers == expected[1], f"{reader}: {numbers}"
    assert len(labels) in (0, len(numbers))
    return "read, and said" if said else "read"


def make_table() -> str:
    """Habits by reader, in Markdown; those of which the same comes share a row. A refusal says its cure itself."""
    rows: dict[tuple[str, ...], list[str]] = {}
    for habit, (write, of_step) in HABITS.items():
        cells: list[str] = [outcome(reader, write(reader)) for reader in HEADERS]
        cells.append("" if of_step is None else outcome(STEP, of_step))
        rows.setdefault(tuple(cell.partition(":")[0] for cell in cells), []).append(habit)
    for habit, (content, form) in BINARY.items():
        cell = outcome("table of designs", content(), form).partition(":")[0]
        rows.setdefault(("", "", cell, ""), []).append(habit)
    lines = ["| habit | fiducials | measurements | table of designs | STEP |", "|---|---|---|---|---|"]
    for row, habits in rows.items():
        lines.append("| " + " | ".join(["; ".join(habits).replace("|", "\\|"), *row]) + " |")
    return "\n".join(lines) + "\n"


PAGE = Path(__file__).parents[1] / "docs" / "integrations" / "tables.md"

if __name__ == "__main__":
    sys.stdout.write(make_table())

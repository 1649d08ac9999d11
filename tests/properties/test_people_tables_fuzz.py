"""Rows inserted, doubled, cut, commented and re-encoded: read and named are all there are, and no number changes."""

from __future__ import annotations

import io
import random
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tailstack.design.fiducial_files import read_fiducials
from tailstack.design.reading import DEFAULT_LIMITS
from tailstack.errors import DesignError, LimitError, TailstackError
from tailstack.people_tables import read_people_table
from tailstack.studies.bench.file import read_measurements
from tailstack_service.tables import read_table

cell = st.sampled_from(["1", "-2.5", "A1", "#9", "0,5", "", " ", "x", "#", "# a", "1e3", '"q"'])
row = st.lists(cell, min_size=1, max_size=5).map(",".join)
remark = st.sampled_from(["# a remark", "#", "# a,b", ""])


@given(st.lists(row | remark | st.just("A1,1,2,3"), max_size=12), st.sampled_from(["", "sep=,\n", "A title\n"]))
def test_rows_read_and_rows_named_are_all_there_are(rows: list[str], above: str) -> None:
    """independent: lines that hold anything are counted as text."""
    text = above + "label,x_mm,y_mm,z_mm\n" + "".join(each + "\n" for each in rows)
    try:
        table = read_people_table(text.encode(), "b.csv", DesignError, lambda cells: "x_mm" in cells)
        read = list(table.rows)
    except TailstackError:
        return
    there = sum(1 for each in rows if each.strip()) + (above == "A title\n")
    assert table.counts.read == len(read)
    assert len(read) + sum(table.counts.left_out.values()) == there
    assert bool(table.describe()) == (len(read) != there)


READERS = {
    "fiducials": ("label,x_mm,y_mm,z_mm", 8),
    "measurements": ("trial,x_mm,y_mm,z_mm", 8),
    "designs": ("variant,views.AP.fiducial_noise_px,views.LAT.fiducial_noise_px,targets.tip.position_mm.2", 8),
}


def make(reader: str, rng: random.Random, delimiter: str) -> list[str]:
    header, count = READERS[reader]
    rows = [[f"A{k}", *(f"{rng.uniform(-50, 50):.{rng.randrange(1, 5)}f}" for _ in range(3))] for k in range(count)]
    return [delimiter.join(cells) for cells in [header.split(","), *rows]]


def mutate(lines: list[str], rng: random.Random, delimiter: str) -> list[str]:
    """One row inserted, doubled, cut, commented, or changed in its form."""
    lines, at, kind = [*lines], rng.randrange(len(lines)), rng.randrange(12)
    if kind == 0:
        some = ["# a remark", "", delimiter * 3, "a title", "#9", "Z,1,2,3".replace(",", delimiter), "mm", "#REF!"]
        lines.insert(at, rng.choice(some))
    elif kind == 1:
        lines.insert(rng.randrange(len(lines) + 1), lines[at])
    elif kind == 2:
        lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
    elif kind == 3:
        lines[at] = rng.choice(["#", "# ", "## "]) + lines[at]
    elif kind == 4:
        del lines[at]
    elif kind == 5:
        cells = lines[at].split(delimiter)
        some = ["", "1,5", "1.5", "\u22125", "1 000", "NaN", "x", '"', "-3.697314E+28"]
        cells[rng.randrange(len(cells))] = rng.choice(some)
        lines[at] = delimiter.join(cells)
    elif kind == 6:
        lines[at] += rng.choice([delimiter, delimiter * 2, delimiter + "5", " "])
    elif kind == 7:
        lines[at], other = lines[rng.randrange(len(lines))], lines[at]
        lines.append(other)
    elif kind == 8:
        lines[at] = delimiter + lines[at]
    elif kind == 9:
        lines[at] = lines[at].replace(".", ",", rng.randrange(4))
    elif kind == 10:
        lines[at] = lines[at].replace("A", rng.choice(["Ö", "\u7403", "#", '"', "A\t"]), 1)
    else:
        lines = [*lines[:at], *lines[at + 1 :], lines[at]]
    return lines


def encode(lines: list[str], rng: random.Random) -> bytes:
    text = rng.choice(["\n", "\r\n", "\r"]).join(lines) + rng.choice(["", "\n"])
    if rng.random() < 0.3:  # one row as another program writes it
        at = rng.randrange(len(lines))
        pieces = [line.encode("cp1252" if k == at else "utf-8", "replace") for k, line in enumerate(lines)]
        return b"\n".join(pieces)
    return text.encode(rng.choice(["utf-8", "utf-8-sig", "utf-16", "cp1252"]), "replace")


def read_numbers(reader: str, content: bytes) -> tuple[list[list[float]], str]:
    """Numbers of every row, and what is said beside them."""
    if reader == "fiducials":
        beads = read_fiducials(content, "b.csv", DEFAULT_LIMITS)
        return [list(position) for position in beads.positions_mm], " ".join(beads.notes)
    if reader == "measurements":
        measured = read_measurements(content, ("tip",), "b.csv")
        rows = [[float(each) for each in values] for group in measured.groups for values in group.values_mm]
        return rows, " ".join(measured.notes)
    table = read_table(io.BytesIO(content), "csv", "b.csv")
    if not any("." in name for name in table.header):  # as of a table that begins with Z;1;2;3: the score refuses it
        raise table.refuse("wrong-header", "no column is called like a number of the design", "name the columns", 1)
    found: list[list[float]] = []
    for block in table.blocks:
        found += [list(each) for each in zip(*table.with_numbers(block, range(1, 4))[1], strict=True)]
    return found, " ".join(table.describe())


def numbers_in(line: str, delimiter: str) -> list[float] | None:
    """Three numbers behind a name, in a row of four cells: how a person reads it."""
    cells = [each.strip().strip('"').replace("\u2212", "-") for each in line.split(delimiter)]
    while len(cells) > 4 and not cells[-1]:
        cells.pop()
    plain = [each.replace(",", ".") if delimiter == ";" else each for each in cells[1:]]
    if len(cells) == 4 and all(re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", each) for each in plain):
        return [float(each) for each in plain]
    return None


def check(reader: str, lines: list[str], delimiter: str, content: bytes) -> bool:
    """Whether it is read, and then rightly: every line with numbers is there, in its order, or named."""
    try:
        found, said = read_numbers(reader, content)
    except (TailstackError, LimitError):
        return False
    filled = [line for line in lines if line.strip()]
    rows = [numbers for line in filled if (numbers := numbers_in(line, delimiter)) is not None]
    missing = [row for row in rows if any(number < -3.6e28 for number in row)]
    assert found == [row for row in rows if row not in missing], (lines, content)
    header = next((k for k, line in enumerate(filled) if "_mm" in line or "_px" in line), 0)
    remarks = sum(1 for line in filled[:header] if line.startswith("#") and line.count(delimiter) != 3)
    others = len(filled) - len(found) - 1 - remarks  # remarks above the header are where they belong
    assert not others or "left out" in said, (lines, said)
    return True


@pytest.mark.parametrize("reader", READERS)
def test_no_mutation_changes_a_number_in_silence(reader: str, run_seed: int) -> None:
    fuzz(reader, run_seed, 60)


@pytest.mark.long
@pytest.mark.hostile
@pytest.mark.parametrize("reader", READERS)
def test_none_of_ten_thousand_mutations_changes_a_number_in_silence(reader: str, run_seed: int) -> None:
    assert 0.1 < fuzz(reader, run_seed + 1, 3_400) < 0.9


def fuzz(reader: str, seed: int, count: int) -> float:
    """The share of mutations that are read."""
    rng, read = random.Random(f"{reader} {seed}"), 0
    for _ in range(count):
        delimiter = rng.choice(",;")
        lines = make(reader, rng, delimiter)
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            lines = mutate(lines, rng, delimiter)
        content = encode(lines, rng)
        read += check(reader, lines, delimiter, content)
    return read / count

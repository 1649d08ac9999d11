"""A result as a notebook shows it: HTML that a page of any colour can hold.

Everything is in the attributes of the elements, because viewers of notebooks drop style sheets, and nothing is said by
colour alone.  Text takes the colour of the page, lines are half transparent; a verdict has a ground and a letter of its
own, which can be read on both a light and a dark page.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from .look import BAR
from .outline import Outline
from .tables import Column, On, Row, Table, write_cell
from .verdicts import STATED

MOST_ROWS = 12
LINE = "rgba(128,128,128,.4)"
TONES = {  # ground and letters
    "pass": ("#e4f1e8", "#176332"),
    "fail": ("#f9e4e2", "#9a1c16"),
    "inconclusive": ("#fdf0cf", "#7a5300"),
    "error": ("#f9e4e2", "#9a1c16"),
    "warning": ("#fdf0cf", "#7a5300"),
}
PLAIN = ("#e9edf0", "#424b54")
CELL = f"padding:3px 8px;border-bottom:1px solid {LINE};vertical-align:top;"


def html_of(outline: Outline) -> str:
    """The result as a fragment of HTML."""
    parts = [
        f'<div style="font-size:13px;line-height:1.45;max-width:72em">'
        f'<div style="opacity:.75">{escape(outline.kind)}</div>'
        f'<div style="font-size:15px;font-weight:600;margin:2px 0 6px">{escape(outline.title)}</div>'
        f"<div>{_badge(outline.status)} {escape(outline.sentence)}</div>"
    ]
    for frame in outline.frames:
        if frame.shown is not None and frame.shown.rows:
            parts.append(_table(frame.shown.on(On.NOTEBOOK), frame.name))
    remarks = [remark for remark in outline.remarks if remark.rule not in STATED]
    if remarks:
        items = "".join(
            f'<li style="margin:2px 0">{_badge(remark.severity)} {escape(remark.message)}</li>'
            for remark in remarks[:MOST_ROWS]
        )
        more = _more(len(remarks), "remarks")
        parts.append(f'{_title("Remarks")}<ul style="margin:0;padding-left:18px">{items}</ul>{more}')
    return "".join(parts) + "</div>"


def _badge(status: str) -> str:
    if not status:
        return ""
    ground, letters = TONES.get(status, PLAIN)
    look = f"background:{ground};color:{letters};border-radius:4px;padding:1px 8px;font-weight:600"
    return f'<span style="{look}">{escape(status)}</span>'


def _title(words: str) -> str:
    return f'<div style="font-weight:600;margin:10px 0 3px">{escape(words)}</div>'


def _table(table: Table, name: str) -> str:
    heads = "".join(
        f'<th scope="col" style="{CELL}text-align:{_side(column)};font-weight:600">{escape(_heading(column))}</th>'
        for column in table.columns
    )
    body = "".join(f"<tr>{''.join(_cells(table, row))}</tr>" for row in table.rows[:MOST_ROWS])
    return (
        f'{_title(table.caption)}<table style="border-collapse:collapse;font-size:13px;margin:0">'
        f"<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>{_more(len(table.rows), name)}"
    )


def _heading(column: Column) -> str:
    """Its name and unit on one line."""
    return f"{column.title}, {column.unit}" if column.unit else column.title


def _more(count: int, name: str) -> str:
    """What of a table is not shown, and how to have it."""
    if count <= MOST_ROWS:
        return ""
    words = f"{count - MOST_ROWS} more" + ("" if name == "remarks" else f': .to_frame("{name}") has all')
    return f'<div style="opacity:.75;margin-top:3px">{escape(words)}</div>'


def _cells(table: Table, row: Row) -> Iterator[str]:
    for k, (cell, column) in enumerate(zip(row.cells, table.columns, strict=True)):
        words = "–" if cell is None else escape(write_cell(cell, column))
        if column.kind == "status":
            words = _badge("" if cell is None else str(cell))
        if column.bar and not isinstance(cell, str):
            share = min(max(100 * float(cell or 0.0), 0.0), 100.0)
            look = f"height:3px;width:{share:.1f}%;background:{BAR};margin:2px 0 0 auto"
            words += f'<div aria-hidden="true" style="{look}"></div>'
        indent = "padding-left:20px;" if k == 0 and row.depth else ""
        yield f'<td style="{CELL}{indent}text-align:{_side(column)}">{words}</td>'


def _side(column: Column) -> str:
    """Numbers stand right, texts left."""
    return "right" if column.numeric else "left"

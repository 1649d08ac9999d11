"""Aligned tables and numbers for people."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from math import isfinite

WIDTH = 100


def number(value: float | None, digits: int = 4) -> str:
    """A number with ``digits`` significant digits and no exponent where a person would write none."""
    if value is None:
        return "-"
    if value == 0:
        return "0"
    if not isfinite(value):
        return str(value)
    text = f"{value:#.{digits}g}" if 1e-3 <= abs(value) < 10**digits else f"{value:.{digits}g}"
    return text.rstrip(".")


def fixed(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def signed(value: float | None, decimals: int = 3) -> str:
    """A number with its sign; one that is not zero never looks like zero, for its sign is what is asked for."""
    if value is None:
        return "-"
    plain = f"{value:+.{decimals}f}"
    return f"{value:+.1g}" if value and not float(plain) else plain


def percent(fraction: float | None, decimals: int = 1) -> str:
    """A fraction as percent, ``<0.1`` for what would print as nothing."""
    if fraction is None:
        return "-"
    smallest = 10.0**-decimals
    if 0 < 100 * fraction < smallest / 2:
        return f"<{smallest:g}"
    return f"{100 * fraction:.{decimals}f}"


def shortened(text: str, width: int) -> str:
    """Text cut to a width, control characters replaced (they could repaint a terminal)."""
    clean = "".join("?" if unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp") else c for c in text)
    if columns(clean) <= width:
        return clean
    end = _cut(clean[::-1], (width - 1) // 3)[::-1]  # names often differ at their end: region[0], region[1]
    return _cut(clean, width - 1 - columns(end)) + "…" + end


def columns(text: str) -> int:
    """Terminal columns of a text: wide characters take two, combining ones none."""
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def _cut(text: str, width: int) -> str:
    kept, used = "", 0
    for character in text:
        used += columns(character)
        if used > width:
            break
        kept += character
    return kept


def _padded(text: str, width: int, left: bool) -> str:
    space = " " * max(0, width - columns(text))
    return text + space if left else space + text


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1, widest: int = 34, whole: int | None = None
) -> str:
    """A table; the first ``left`` columns are texts (cut at ``widest``, or to fit the page), the others numbers.

    whole: a column of texts that is not cut.
    A header may hold one line break: its second line is the unit.
    """
    heads = [head.split("\n") for head in header]
    depth = max(len(head) for head in heads)
    top = [[head[line] if line < len(head) else "" for head in heads] for line in range(depth)]
    needed = [max(columns(row[k]) for row in top) for k in range(len(header))]
    widths = [max(needed[k], *(columns(row[k]) for row in rows)) if rows else needed[k] for k in range(len(header))]
    if whole is not None:
        needed[whole] = widths[whole]
    widths[:left] = [max(needed[k], min(widths[k], widest)) for k in range(left)]
    while sum(widths) + 2 * (len(widths) - 1) > WIDTH:
        slack = [widths[k] - max(needed[k], 8) for k in range(left)]
        if max(slack) <= 0:
            break
        widths[slack.index(max(slack))] -= 1
    body = [[shortened(cell, widths[k]) if k < left else cell for k, cell in enumerate(row)] for row in rows]
    lines = [*top, ["─" * width for width in widths], *body]
    return "\n".join(
        "  ".join(_padded(cell, widths[k], k < left) for k, cell in enumerate(row)).rstrip() for row in lines
    )


def wrapped(text: str, *, indent: str = "", first: str | None = None, width: int = WIDTH) -> str:
    """Words wrapped at the width; ``first`` opens the first line, ``indent`` the others."""
    lines, line = [], indent if first is None else first
    empty = True
    for word in text.split():
        if not empty and columns(line) + 1 + columns(word) > width:
            lines.append(line)
            line, empty = indent, True
        line += word if empty else " " + word
        empty = False
    return "\n".join([*lines, line])


# --- colour ---------------------------------------------------------------------------------------

_COLOURS = {"pass": "32", "fail": "31", "inconclusive": "33", "no requirement": "2", "bold": "1", "warning": "33"}


def coloured(text: str, role: str, colour: bool) -> str:
    """Text in the colour of its role, or as it stands."""
    return f"\x1b[{_COLOURS[role]}m{text}\x1b[0m" if colour and role in _COLOURS else text

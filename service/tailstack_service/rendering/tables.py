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


def decimal(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def signed_decimal(value: float | None, decimals: int = 3) -> str:
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


def visible(text: str) -> str:
    """Text with its control characters replaced: they could repaint a terminal."""
    return "".join("?" if unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp") else c for c in text)


def shorten(text: str, width: int) -> str:
    """Text cut to a width, for labels in pictures."""
    clean = visible(text)
    if columns(clean) <= width:
        return clean
    end = _pieces(clean[::-1], (width - 1) // 3)[0][::-1]  # names often differ at their end: region[0], region[1]
    return _pieces(clean, width - 1 - columns(end))[0] + "…" + end


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


def _pieces(word: str, width: int) -> list[str]:
    """A word in parts of at most ``width`` columns."""
    if columns(word) <= width:
        return [word]
    parts = [""]
    for character in word:
        if parts[-1] and columns(parts[-1]) + columns(character) > width:
            parts.append("")
        parts[-1] += character
    return parts


def _pad(text: str, width: int, left: bool) -> str:
    space = " " * max(0, width - columns(text))
    return text + space if left else space + text


LEAST_WIDTH = 8  # columns of a text
HANGING = 4  # columns by which the second line of a text stands further right than its first
LONGEST_WORD = 24  # columns; a longer one may be broken where the table would be wider than the page


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    left: int = 1,
    names: Sequence[int] = (),
    whole: Sequence[int] = (),
    widest: int = 34,
) -> str:
    """A table; the first ``left`` columns are texts (folded at ``widest``, or to fit the page), the others numbers.

    names: further columns of texts, among the numbers.  whole: columns of texts that are not folded, such as ids that
    are there to be copied.  A header may hold one line break: its second line is the unit.
    """
    heads = [head.split("\n") for head in header]
    depth = max(len(head) for head in heads)
    top = [[head[line] if line < len(head) else "" for head in heads] for line in range(depth)]
    texts = [k for k in (*range(left), *names) if k not in whole]
    needed = [max(columns(row[k]) for row in top) for k in range(len(header))]
    widths = [max([needed[k], *(columns(visible(row[k])) for row in rows)]) for k in range(len(header))]
    for k in texts:
        widths[k] = max(needed[k], min(widths[k], widest))
    words = [[columns(word) for row in rows for word in visible(row[k]).split()] for k in texts]
    unbroken = {k: min(max(lengths, default=0), LONGEST_WORD) for k, lengths in zip(texts, words, strict=True)}
    for shortest in (unbroken, {}):  # words give way last
        least = {k: max(needed[k], shortest.get(k, 0), LEAST_WIDTH) for k in texts}
        while sum(widths) + 2 * (len(widths) - 1) > WIDTH and any(widths[k] > least[k] for k in texts):
            widths[max(texts, key=lambda k: widths[k] - least[k])] -= 1
    lines = [*top, ["─" * width for width in widths]]
    for row in rows:
        cells = [fold(cell, widths[k], HANGING) if k in texts else [visible(cell)] for k, cell in enumerate(row)]
        height = max(map(len, cells))
        lines += [[cell[line] if line < len(cell) else "" for cell in cells] for line in range(height)]
    return "\n".join(
        "  ".join(_pad(cell, widths[k], k < left or k in names) for k, cell in enumerate(row)).rstrip() for row in lines
    )


def wrap(text: str, *, indent: str = "", first: str | None = None, width: int = WIDTH) -> str:
    """Words wrapped at the width; ``first`` opens the first line, ``indent`` the others."""
    lines, line = [], indent if first is None else first
    empty = True
    for word in text.split():
        for part, piece in enumerate(_pieces(word, max(width - columns(indent), 1))):
            if not empty and (part > 0 or columns(line) + 1 + columns(piece) > width):
                lines.append(line)
                line, empty = indent, True
            line += piece if empty else " " + piece
            empty = False
    return "\n".join([*lines, line])


# --- colour ---------------------------------------------------------------------------------------

_COLOURS = {"pass": "32", "fail": "31", "inconclusive": "33", "no requirement": "2", "bold": "1", "warning": "33"}


def paint(text: str, role: str, colour: bool) -> str:
    """Text in the colour of its role, or as it stands."""
    return f"\x1b[{_COLOURS[role]}m{text}\x1b[0m" if colour and role in _COLOURS else text

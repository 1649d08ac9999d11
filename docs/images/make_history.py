"""Draw docs/images/bench_history.svg, what ``./run bench --save`` found of each release: no arguments, or ``--check``.

A row is a target that must be met; a mark is a release, placed at how many times the must it does, so that the right of
1 is good whichever way the target goes.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from math import inf, log10
from pathlib import Path
from typing import Any

from line_charts import WIDTH, Shape, begin, mark
from pictures import write_picture

from tailstack.results.look import BLUE, FAINT, INK, MUTED, VERMILION
from tailstack_service.report.svg import line, text

HISTORY = Path(__file__).resolve().parents[2] / "benchmarks" / "history"
LEFT, RIGHT, TOP, STEP = 540, WIDTH - 40, 84, 21
TICKS = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
SHAPES: tuple[Shape, ...] = ("circle", "square", "triangle", "diamond")


def read_history(folder: Path = HISTORY) -> list[dict[str, Any]]:
    """The releases, oldest first."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")]
    return sorted(found, key=lambda release: [int(part) for part in release["version"].split(".")])


def place(factor: float) -> float:
    """Across, by how many times the must; what lies off the axis stands at its end."""
    low, high = TICKS[0], TICKS[-1]
    return LEFT + (RIGHT - LEFT) * log10(min(high, max(low, factor)) / low) / log10(high / low)


def draw(releases: Sequence[dict[str, Any]]) -> str:
    """The whole picture."""
    targets: dict[tuple[str, str], None] = {}
    for release in reversed(releases):
        targets |= dict.fromkeys((row["name"], row["what"]) for row in release["rows"] if row["must"])
    height = TOP + STEP * len(targets) + 20
    versions = ", ".join(release["version"] for release in releases)
    parts = begin("What tailstack costs, by release", f"Times the must of each row of ./run bench: {versions}.", height)
    for number, release in enumerate(releases):
        parts.append(mark(SHAPES[number % len(SHAPES)], 24 + 90 * number, 46, BLUE))
        parts.append(text(34 + 90 * number, 51, release["version"], size=13))
    parts.append(text(LEFT, TOP - 30, "times what must be (right of 1: met)", size=12, colour=MUTED))
    for tick in TICKS:
        parts.append(line(place(tick), TOP - 10, place(tick), height - 16, INK if tick == 1 else FAINT))
        parts.append(text(place(tick), TOP - 14, f"{tick:g}", anchor="middle", size=12))
    for index, target in enumerate(targets):
        y = TOP + STEP * index + 8
        unclear = sum(what == target[1] for _, what in targets) > 1 or target[1].startswith("the same")
        parts.append(text(LEFT - 12, y + 4, ": ".join(target) if unclear else target[1], anchor="end", size=11))
        for number, release in enumerate(releases):
            for row in release["rows"]:
                if (row["name"], row["what"]) != target or row["value"] is None or not row["must"]:
                    continue
                value, must = row["value"], row["must"]
                factor = value / must if row["better"] == ">" else inf if value <= 0 else must / value
                colour = VERMILION if factor < 1 else BLUE
                parts.append(mark(SHAPES[number % len(SHAPES)], place(factor), y, colour, hollow=row["loaded"]))
    return "\n".join((*parts, "</svg>")) + "\n"


if __name__ == "__main__":
    sys.exit(write_picture(Path(__file__).with_name("bench_history.svg"), draw(read_history())))

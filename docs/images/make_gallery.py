"""Draw the pictures of docs/gallery.md, and write the result of each design into it: no arguments.

A design is examples/gallery/NAME.yaml or one of ``BESIDE``, its picture images/gallery/NAME.svg; the paragraph of the
page that begins with ``P95`` below the link to the design is its result.  ``--check`` writes nothing and fails on a
difference.
"""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

from pictures import write_picture

from tailstack import Design, load_design, score
from tailstack.results import Check, Score
from tailstack_service.report.scene import scene_of
from tailstack_service.report.scene_picture import draw_scene

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("clip_on", "pedicle_screw", "radiostereometry", "forearm_shell", "half_shell")
BESIDE = [ROOT / "examples" / f"{name}.yaml" for name in NAMES]
DESIGNS = [*sorted((ROOT / "examples" / "gallery").glob("*.yaml")), *BESIDE]
PAGE = ROOT / "docs" / "gallery.md"
PICTURES = ROOT / "docs" / "images" / "gallery"
BACKGROUND = '<rect width="100%" height="100%" fill="#ffffff"/>'  # for pages that are dark


def draw(design: Design, result: Score, name: str) -> str:
    """The scene of a report, on white."""
    svg = draw_scene(scene_of(design, result, design.name, None, ""), name)
    return svg.replace("</desc>\n", f"</desc>\n{BACKGROUND}\n", 1) + "\n"


def name_other(check: Check) -> str:
    """What is limited, where it is not P95 of the error at the tool."""
    plain = check.error == "tcp" and check.statistic == "quantile" and check.risk != "per_mounting"
    return "" if plain else f"{check.name_value(check.words).removeprefix('P95 ')} "


def unit_of(check: Check) -> str:
    return "" if check.statistic == "probability" else f" {check.unit}"


def state(result: Score) -> str:
    """A design's result in one line: the value, limit and status of each requirement, and who is to blame most."""
    checks = ", ".join(
        f"{name_other(check)}{check.value:.3f}{unit_of(check)} of {check.limit:g}{unit_of(check)}"
        f"{' per unit' if check.risk == 'per_unit' else ''}: **{check.status}**"
        for check in result.verdict.checks
    )
    groups = (entry for entry in result.targets[0].contributors if entry.component == "all")
    most = max(groups, key=lambda entry: entry.variance_share)
    whole = f"P95 {checks}. Largest share: {100 * most.variance_share:.0f} %, {most.label}."
    return textwrap.fill(whole, 120, break_long_words=False, break_on_hyphens=False)


def main() -> int:
    page, codes = PAGE.read_text(encoding="utf-8"), []
    for file in DESIGNS:
        design = load_design(file)
        result = score(design)
        codes.append(write_picture(PICTURES / f"{file.stem}.svg", draw(design, result, file.stem)))
        below = re.compile(rf"({file.stem}\.yaml\)\n\n)P95.*(?:\n.+)*")
        page = below.sub(rf"\g<1>{state(result)}", page, count=1)
    return max(*codes, write_picture(PAGE, page))


if __name__ == "__main__":
    sys.exit(main())

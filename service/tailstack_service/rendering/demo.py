"""The demo's own texts: chapter headings, and the table of before and after."""

from __future__ import annotations

from itertools import groupby
from math import dist
from typing import TYPE_CHECKING

from tailstack.results.digits import decimal, decimals_of, number

from .tables import paint, prose_width, visible, wrap

if TYPE_CHECKING:
    from tailstack.results import Optimisation, Verification


def chapter(title: str) -> str:
    """A heading across the page."""
    return "\n" + paint(f"━━ {title} ".ljust(prose_width(), "━"), "bold") + "\n\n"


def summary_text(before: Verification, after: Verification, result: Optimisation) -> str:
    """The lines that matter: the verdict before and after, what was changed, what that costs."""
    lines = [visible(before.provenance.design_name)]
    for words, side in (("before:", before), ("after:", after)):
        for check in side.verdict.checks:
            decimals = decimals_of((check,))
            low, high = (decimal(end, decimals) for end in check.interval_mm)
            value = decimal(check.value_mm, decimals)
            lines.append(
                f"{words:<8}{side.verdict.status}: {check.headline} at {visible(check.target)} {value} mm "
                f"({low} to {high}), limit {check.limit_mm:g} mm"
            )
    return "\n".join([*lines, *_change_lines(result)]) + "\n"


def _change_lines(result: Optimisation) -> list[str]:
    """What the optimiser changed: how many fiducials and how far, each interface's half-widths, the cost."""
    pairs = [(e.before_mm, e.after_mm) for e in result.moved if e.before_mm and e.after_mm]
    distances = [distance for distance in (dist(*pair) for pair in pairs) if distance]
    lines = []
    if distances:
        lines.append(f"changed: {len(distances)} fiducials moved, by {min(distances):.0f} to {max(distances):.0f} mm")
    for _, group in groupby(result.tolerances, lambda tolerance: tolerance.contributor):
        tolerances = tuple(group)
        name = tolerances[0].label.removesuffix(f" {tolerances[0].component}")
        lines.append(wrap(f"half-widths of {visible(name)}:", first="  ", indent="    "))
        changes: dict[str, list[str]] = {}
        for tolerance in tolerances:
            unit = "°" if tolerance.unit == "deg" else f" {tolerance.unit}"
            change = f"±{tolerance.before_half_width:.2g} -> ±{tolerance.after_half_width:.2g}{unit}"
            changes.setdefault(change, []).append(tolerance.component)
        words = ", ".join(f"{' '.join(components)} {change}" for change, components in changes.items())
        lines.append(wrap(words, first="    ", indent="    "))
    if result.cost_before and result.cost_after is not None:
        costs = f"{number(result.cost_before)} -> {number(result.cost_after)}"
        lines.append(
            f"  cost of these tolerances: {costs} ({100 * (result.cost_after / result.cost_before - 1):+.0f} %)"
        )
    return lines

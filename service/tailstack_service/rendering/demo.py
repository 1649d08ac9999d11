"""The demo's own texts: chapter headings, and the table of before and after."""

from __future__ import annotations

from tailstack.results import Optimisation, Score, Verification

from .tables import WIDTH, decimal, number, paint, percent, table
from .verdict import verdict_line


def chapter(title: str, colour: bool) -> str:
    """A heading across the page."""
    return "\n" + paint(f"━━ {title} ".ljust(WIDTH, "━"), "bold", colour) + "\n\n"


def before_after_text(
    score_before: Score, before: Verification, score_after: Score, after: Verification, result: Optimisation
) -> str:
    """What the optimiser changed, each side with its own Monte Carlo check."""
    rows = []
    for old, new, first_old, first_new in zip(
        before.targets, after.targets, score_before.targets, score_after.targets, strict=True
    ):
        beyond = [percent(side.exceedance.probability if side.exceedance else None, 2) for side in (old, new)]
        rows += [
            (f"{old.name}: P95, first order", "mm", decimal(first_old.p95_mm, 4), decimal(first_new.p95_mm, 4)),
            (f"{old.name}: P95, Monte Carlo", "mm", decimal(old.p95_mm, 4), decimal(new.p95_mm, 4)),
            (f"{old.name}: its interval", "mm", *(f"{low:.3f} .. {high:.3f}" for low, high in
                                                  (old.p95_interval_mm, new.p95_interval_mm))),
            (f"{old.name}: mean error, Monte Carlo", "mm", decimal(old.mean_norm_mm, 4), decimal(new.mean_norm_mm, 4)),
            (f"{old.name}: shots beyond the limit", "%", *beyond),
        ]  # fmt: skip
    rows.append(("cost of what was free", "", number(result.cost_before), number(result.cost_after)))
    rows += [
        (f"{t.label}, half-width", t.unit, number(t.before_half_width, 3), number(t.after_half_width, 3))
        for t in result.tolerances
    ]
    rows.append(("verdict, Monte Carlo", "", before.verdict.status, after.verdict.status))
    return (
        table(("", "unit", "before", "after"), rows, left=2, widest=60)
        + "\n\n"
        + verdict_line(after.verdict, False)
        + "\n"
    )

"""A sweep as a table for people and as CSV for spreadsheets."""

from __future__ import annotations

from tailstack.results.sweep import Sweep, SweepAxis

from .page import current
from .rows import csv_text, plain_text, reasons_text
from .tables import decimal, paint, table, wrap
from .verdict import heading, join_blocks, more_text, provenance_text

MOST_REASONS = 12


def sweep_text(sweep: Sweep) -> str:
    """Axes, one row for every point at its worst target, and why points were refused."""
    count = f"{len(sweep.points):,} point{'s' if len(sweep.points) > 1 else ''}"
    how = "estimated" if sweep.check == "score" else f"simulated with seed {sweep.seed}"
    method = "first order" if sweep.check == "score" else "Monte Carlo"
    return join_blocks(
        heading(sweep.provenance, f"Sweep of {count}, each {how}.", method),
        _axes_text(sweep.axes),
        _range_text(sweep),
        _points_table(sweep),
        reasons_text([point.reason for point in sweep.points], MOST_REASONS, numbered=True),
        provenance_text(sweep.provenance),
        more_text(),
    )


def _range_text(sweep: Sweep) -> str:
    """Where the error is least and largest, and how many points pass."""
    sizes = [(max(target.p95_mm for target in point.targets), point) for point in sweep.points if point.targets]
    if len(sizes) < 2:
        return ""
    ends = (min(sizes, key=lambda entry: entry[0]), max(sizes, key=lambda entry: entry[0]))
    if f"{ends[0][0]:.4f}" == f"{ends[1][0]:.4f}":
        said = f"P95 is {ends[0][0]:.4f} mm at every point: what is varied here does not matter"
    else:
        named = [
            f"{p95:.4f} mm at "
            + ", ".join(
                f"{letter} = {value:g}" for letter, value in zip(_letters(sweep.axes), point.values, strict=True)
            )
            for p95, point in ends
        ]
        said = f"P95 is between {named[0]} and {named[1]}"
    verdicts = [point.verdict for _, point in sizes if point.verdict not in (None, "no requirement")]
    passed = f"; {verdicts.count('pass')} of {len(verdicts)} points pass" if verdicts else ""
    return wrap(f"{said}{passed}.", first="found: ", indent="  ")


def _axes_text(axes: tuple[SweepAxis, ...]) -> str:
    lines = []
    for letter, axis in zip(_letters(axes), axes, strict=True):
        unit = f" {axis.unit}" if axis.unit else ""
        now = "varies" if axis.base is None else f"{axis.base:g}{unit}"
        count = f"{len(axis.values)} value{'s' if len(axis.values) > 1 else ''}"
        lines.append(wrap(f"{axis.pointer}: {count}; now {now}", first=f"{letter}: ", indent="   "))
    return "\n".join(lines)


def _letters(axes: tuple[SweepAxis, ...]) -> tuple[str, ...]:
    return tuple("ABCDEF"[: len(axes)])


def _points_table(sweep: Sweep) -> str:
    checked, details = sweep.check == "verification", current().details
    several = any(len(point.targets) > 1 for point in sweep.points)
    rows = []
    for place, point in enumerate(sweep.points):
        verdict = point.verdict or "refused"
        row = [str(place + 1), *(f"{value:g}" for value in point.values)]
        if point.targets:
            worst = max(point.targets, key=lambda target: target.p95_mm)
            row.append(decimal(worst.p95_mm, 4))
            if checked:
                low, high = worst.p95_interval_mm or (worst.p95_mm, worst.p95_mm)
                row.append(f"{low:.3f} .. {high:.3f}")
            row.append(decimal(worst.mean_norm_mm, 4))
            row += [decimal(worst.bias_norm_mm, 4)] if details else []
            row.append(decimal(worst.localisation_p95_mm, 4))
            row += [worst.name] if several else []
        else:
            row += ["-"] * (3 + details + checked + several)
        rows.append((*row, verdict))
    units = [f"{letter}\n{axis.unit}" for letter, axis in zip(_letters(sweep.axes), sweep.axes, strict=True)]
    header = ["point", *units, "P95\nmm", *(["between\nmm"] if checked else []), "mean\nmm"]
    header += ["|bias|\nmm"] if details else []
    header += ["P95 as\nlocated, mm", *(["worst target"] if several else []), "verdict"]
    lines = table(header, rows, names=(len(header) - 2,) if several else ()).split("\n")
    return "\n".join(paint(line, "fail") if line.endswith("  fail") else line for line in lines)


def sweep_csv(sweep: Sweep) -> str:
    """One line for each point and target; a refused point has one line without numbers."""
    rows: list[list[object]] = []
    for place, point in enumerate(sweep.points):
        head = [place + 1, *point.values, point.status, point.verdict]
        if not point.targets:
            rows.append([*head, *[None] * 7, point.reason])
        for target in point.targets:
            interval = target.p95_interval_mm or (None, None)
            rows.append([
                *head, plain_text(target.name), target.p95_mm, *interval, target.mean_norm_mm, target.bias_norm_mm,
                target.localisation_p95_mm, None,
            ])  # fmt: skip
    header = (
        "point", *(axis.pointer for axis in sweep.axes), "status", "verdict", "target", "p95_mm", "p95_low_mm",
        "p95_high_mm", "mean_norm_mm", "bias_norm_mm", "localisation_p95_mm", "reason",
    )  # fmt: skip
    return csv_text(header, rows)

"""A sweep as a table for people and as CSV for spreadsheets."""

from __future__ import annotations

from tailstack.results.sweep import Sweep, points_table

from .rows import csv_text, list_reasons, plain_text
from .tables import paint, wrap, write_table
from .verdict import heading, join_blocks, more_text, provenance_text

MOST_REASONS = 12


def sweep_text(sweep: Sweep) -> str:
    """Axes, one row for every point at its worst target, and why points were refused."""
    count = f"{len(sweep.points):,} point{'s' if len(sweep.points) > 1 else ''}"
    how = "estimated" if sweep.check == "score" else f"simulated with seed {sweep.seed}"
    refused = list_reasons([point.reason for point in sweep.points], MOST_REASONS, numbered=True)
    method = "first order" if sweep.check == "score" else "Monte Carlo"
    return join_blocks(
        heading(sweep.provenance, f"Sweep of {count}, each {how}.", method),
        _axes_text(sweep),
        _range_text(sweep),
        _points_table(sweep),
        "\n".join(wrap(said, first="refused: ", indent="  ") for said in refused),
        provenance_text(sweep.provenance),
        more_text(),
    )


def _range_text(sweep: Sweep) -> str:
    """Where the error is least and largest, and how many points pass."""
    sizes = [(max(target.p95_mm for target in point.targets), point) for point in sweep.points if point.targets]
    if len(sizes) < 2:
        return ""
    ends = (min(sizes, key=lambda entry: entry[0]), max(sizes, key=lambda entry: entry[0]))
    decimals = sweep.decimals
    if f"{ends[0][0]:.4f}" == f"{ends[1][0]:.4f}":
        said = f"P95 is {ends[0][0]:.{decimals}f} mm at every point: what is varied here does not matter"
    else:
        named = [
            f"{p95:.{decimals}f} mm at "
            + ", ".join(f"{letter} = {value:g}" for letter, value in zip(sweep.letters, point.values, strict=True))
            for p95, point in ends
        ]
        said = f"P95 is between {named[0]} and {named[1]}"
    verdicts = [point.verdict for _, point in sizes if point.verdict not in (None, "no requirement")]
    passed = f"; {verdicts.count('pass')} of {len(verdicts)} points pass" if verdicts else ""
    return wrap(f"{said}{passed}.", first="found: ", indent="  ")


def _axes_text(sweep: Sweep) -> str:
    lines = []
    for letter, axis in zip(sweep.letters, sweep.axes, strict=True):
        unit = f" {axis.unit}" if axis.unit else ""
        now = "varies" if axis.base is None else f"{axis.base:g}{unit}"
        count = f"{len(axis.values)} value{'s' if len(axis.values) > 1 else ''}"
        lines.append(wrap(f"{axis.called}: {count}; now {now}", first=f"{letter}: ", indent="   "))
    return "\n".join(lines)


def _points_table(sweep: Sweep) -> str:
    lines = write_table(points_table(sweep)).split("\n")
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

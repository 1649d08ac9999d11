"""The reach of first order as text and as CSV."""

from __future__ import annotations

from tailstack.results import ERRORS
from tailstack.studies.linearity import LinearityPoint, StudyLinearity, Within

from ..page import current
from ..rows import csv_text, reasons_text
from ..tables import number, percent, table, visible, wrap
from ..verdict import heading, join_blocks, more_text, provenance_text

MARK: dict[Within, str] = {"1 %": " ", "5 %": "~", "20 %": "+", "beyond": "#"}
MOST_REASONS = 8


def linearity_text(study: StudyLinearity) -> str:
    """The map as a table for each count of fiducials, what it says, and how the validity statement did."""
    details = current().details
    what = (
        f"How far the estimate of `tailstack score` can be trusted: P95 of {ERRORS[study.error]} at "
        f"{visible(study.target)}, estimated and simulated."
    )
    method = f"first order against Monte Carlo, up to {study.trials:,} trials a point, seed {study.seed}"
    return join_blocks(
        heading(study.provenance, what, method),
        "\n".join(wrap(said, first="* ", indent="  ") for said in study.sentences),
        wrap(study.varied),
        wrap(
            "by how many % the estimate is off: no mark within 1 %, ~ within 5 %, + within 20 %, # beyond; ? open, as "
            f"the {percent(study.confidence, 0)} % interval reaches across; - refused"
        ),
        *(_count_table(study, count) for count in study.counts),
        *((_calibration_table(study), wrap(f"intervals: {study.interval_method}.")) if details else ()),
        reasons_text([point.reason for point in study.points], MOST_REASONS, numbered=False),
        provenance_text(study.provenance),
        more_text(),
    )


def points_by_place(study: StudyLinearity) -> dict[tuple[float, float, float, int], LinearityPoint]:
    """By noise, rotation, spread and count."""
    return {(point.noise_px, point.rotation_deg, point.spread, point.fiducials): point for point in study.points}


def deviation(point: LinearityPoint) -> str:
    """The deviation in per cent, as many decimals as its interval allows."""
    if point.ratio is None or point.ratio_interval is None:
        return "-"
    half = 50 * (point.ratio_interval[1] - point.ratio_interval[0])
    text = f"{100 * (point.ratio - 1):+.{2 if half < 0.05 else 1 if half < 2 else 0}f}"
    return text if float(text) else text[1:]


def _count_table(study: StudyLinearity, count: int) -> str:
    points, details, rotations = points_by_place(study), current().details, study.rotations_deg
    rows = []
    for spread in study.spreads:
        for noise in study.noises_px:
            here = [points[noise, rotation, spread, count] for rotation in rotations]
            nu = next((point.nu for point in here if point.nu is not None), None)
            row = [f"{spread:g}", f"{noise:g}", *([number(nu, 2)] if details else [])]
            for point in here:
                mark = " " if point.within is None else MARK[point.within]
                row.append(f"{deviation(point)} {mark}{' ' if point.sure or point.within is None else '?'}")
            rows.append(row)
    header = [
        f"{count} fiducials,\nspread",
        "noise\npx",
        *(["nu\n"] if details else []),
        *(f"{r:g} deg\n%  " for r in rotations),
    ]
    return table(header, rows, left=2)


def _calibration_table(study: StudyLinearity) -> str:
    rows = [
        [
            line.promise, str(line.points), str(line.kept), str(line.broken) if line.promise != "not valid" else "-",
            str(line.open), f"{line.lowest_ratio:.3f} .. {line.highest_ratio:.3f}",
        ]
        for line in study.calibration
    ]  # fmt: skip
    header = (
        "validity statement\n(counts: by the whole interval)", "points\n", "came\ntrue", "broken\n", "left\nopen",
        "ratio FO / MC\n",
    )  # fmt: skip
    return table(header, rows)


def linearity_csv(study: StudyLinearity) -> str:
    """One line for each point."""
    names = [name for name in LinearityPoint.__dataclass_fields__ if name != "ratio_interval"]
    rows = (
        [*(getattr(point, name) for name in names), *(point.ratio_interval or (None, None))] for point in study.points
    )
    return csv_text([*names, "ratio_low", "ratio_high"], rows)

"""The reach of first order as text, as CSV and as a map."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.studies.linearity import LinearityPoint, StudyLinearity, Within

from ...report.svg import FAINT, INK, MUTED, box, printable, text
from ..rows import csv_text, reasons_text
from ..tables import number, percent, table, visible, wrapped
from ..verdict import design_line, joined, provenance_text
from .page import page

MARK: dict[Within, str] = {"1 %": " ", "5 %": "~", "20 %": "+", "beyond": "#"}
MOST_REASONS = 8
MOST_COLUMNS = 6  # rotations in a table
# From pale to dark, so that a print in grey keeps the order; text on it stays readable.
FILL: dict[Within, tuple[str, str]] = {
    "1 %": ("#e4f1e8", INK), "5 %": ("#efcf6d", INK), "20 %": ("#e08f4c", INK), "beyond": ("#a5301f", "#ffffff"),
}  # fmt: skip
CELL_WIDTH, CELL_HEIGHT, LEFT, TOP = 62, 26, 118, 78
LEAST_WIDTH = 800  # of the key


def linearity_text(study: StudyLinearity) -> str:
    """The map as a table for each count of fiducials, what it says, and how the validity statement did."""
    made = study.provenance
    how = (
        f"first order against Monte Carlo · P95 of the {study.error} error at {visible(study.target)} · up to "
        f"{study.trials:,} trials a point, seed {study.seed} · {made.reading} reading · tailstack "
        f"{made.tailstack_version}"
    )
    return joined(
        design_line(made) + "\n" + wrapped(how),
        wrapped(study.varied),
        "first order over Monte Carlo, less one, in %:   within 1 %   ~ within 5 %   + within 20 %   # beyond\n"
        f"? the {percent(study.confidence, 0)} % interval leaves the class open   - refused",
        *(_count_tables(study, count) for count in study.counts),
        "\n".join(wrapped(said, first="* ", indent="  ") for said in study.sentences),
        _calibration_table(study),
        wrapped(f"intervals: {study.interval_method}."),
        reasons_text([point.reason for point in study.points], MOST_REASONS, numbered=False),
        provenance_text(made),
    )


def _at(study: StudyLinearity) -> dict[tuple[float, float, float, int], LinearityPoint]:
    return {(point.noise_px, point.rotation_deg, point.spread, point.fiducials): point for point in study.points}


def _signed(point: LinearityPoint) -> str:
    """The deviation in per cent, as many decimals as its interval allows."""
    if point.ratio is None or point.ratio_interval is None:
        return "-"
    half = 50 * (point.ratio_interval[1] - point.ratio_interval[0])
    text = f"{100 * (point.ratio - 1):+.{2 if half < 0.05 else 1 if half < 2 else 0}f}"
    return text if float(text) else text[1:]


def _count_tables(study: StudyLinearity, count: int) -> str:
    """As many tables below one another as the page's width takes."""
    chunks = [study.rotations_deg[k : k + MOST_COLUMNS] for k in range(0, len(study.rotations_deg), MOST_COLUMNS)]
    return "\n\n".join(_count_table(study, count, rotations) for rotations in chunks)


def _count_table(study: StudyLinearity, count: int, rotations: Sequence[float]) -> str:
    points = _at(study)
    rows = []
    for spread in study.spreads:
        for noise in study.noises_px:
            here = [points[noise, rotation, spread, count] for rotation in rotations]
            nu = next((point.nu for point in here if point.nu is not None), None)
            row = [f"{spread:g}", f"{noise:g}", number(nu, 2)]
            for point in here:
                mark = " " if point.within is None else MARK[point.within]
                row.append(f"{_signed(point)} {mark}{' ' if point.sure or point.within is None else '?'}")
            rows.append(row)
    header = [f"{count} fiducials,\nspread", "noise\npx", "nu\n", *(f"{r:g} deg\n%  " for r in rotations)]
    return table(header, rows)


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


# --- the map --------------------------------------------------------------------------------------


def linearity_svg(study: StudyLinearity) -> str:
    """Panels: spread from left to right, count from top to bottom; in each, noise upwards and rotation to the right."""
    across = CELL_WIDTH * len(study.rotations_deg) + 22
    down = CELL_HEIGHT * len(study.noises_px) + 44
    width = max(LEFT + across * len(study.spreads) + 12, LEAST_WIDTH)
    height = TOP + down * len(study.counts) + 62
    points = _at(study)
    parts = _key(TOP - 30)
    for row, count in enumerate(study.counts):
        top = TOP + 24 + row * down
        parts.append(text(16, top - 8, f"{count} fiducials", weight="bold"))
        for column, spread in enumerate(study.spreads):
            left = LEFT + column * across
            middle = left + CELL_WIDTH * len(study.rotations_deg) / 2
            parts.append(text(middle, top - 8, f"spread {spread:g}", anchor="middle", colour=MUTED))
            for k, noise in enumerate(reversed(study.noises_px)):
                y = top + k * CELL_HEIGHT
                if column == 0:
                    parts.append(text(left - 8, y + 17, f"{noise:g} px", anchor="end", colour=MUTED))
                for j, rotation in enumerate(study.rotations_deg):
                    parts += _cell(points[noise, rotation, spread, count], left + j * CELL_WIDTH, y)
            if row == len(study.counts) - 1:
                bottom = top + CELL_HEIGHT * len(study.noises_px) + 15
                for j, rotation in enumerate(study.rotations_deg):
                    x = left + (j + 0.5) * CELL_WIDTH
                    parts.append(text(x, bottom, f"{rotation:g} deg", anchor="middle", colour=MUTED))
    words = "standard deviation of the rotations of the structure; up the page: noise of each image coordinate"
    parts.append(text(LEFT, height - 14, f"to the right: {words}", colour=MUTED))
    said = " ".join(study.sentences)
    title = f"First order over Monte Carlo: {printable(study.provenance.design_name, 60)}"
    return page(title, f"P95 at target {study.target}, deviation in per cent. {said}", width, height, parts)


def _cell(point: LinearityPoint, x: float, y: float) -> list[str]:
    x1, y1 = x + CELL_WIDTH - 2, y + CELL_HEIGHT - 2
    middle = (x + x1) / 2
    if point.within is None:
        return [box(x, y, x1, y1, f'fill="#ffffff" stroke="{FAINT}"'), text(middle, y + 16, "refused", anchor="middle",
                                                                            colour=MUTED)]  # fmt: skip
    fill, ink = FILL[point.within]
    words = f"{_signed(point).replace('-', '−')} %{'' if point.sure else ' ?'}"
    return [box(x, y, x1, y1, f'fill="{fill}"'), text(middle, y + 16, words, anchor="middle", colour=ink)]


def _key(y: float) -> list[str]:
    parts, x = [], 16.0
    for within, (fill, _) in FILL.items():
        parts.append(box(x, y - 11, x + 16, y + 3, f'fill="{fill}" stroke="{FAINT}" stroke-width="0.5"'))
        words = "further off" if within == "beyond" else f"within {within}"
        parts.append(text(x + 22, y, words, colour=MUTED))
        x += 104
    words = "− optimistic, + pessimistic; ?: the interval leaves it open"
    parts.append(text(x, y, words, colour=MUTED))
    return parts

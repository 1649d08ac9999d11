"""The paper's figures from the tool: sweeps, levels and noise, and S3's columns; printed values as squares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tailstack.studies.paper.reproduce import Geometry, PaperCell, StudyPaper

from ...report.svg import FAINT, INK, MUTED, box, line, printable, text
from .chart import COLOURS, Curve, Mark, drawn, fitted, mark
from .page import around, left_axis, page

WIDTH, TOP, BOTTOM, HEIGHT = 900.0, 114.0, 340.0, 390.0
SHIFT = 0.1  # px, of one level against the next: their marks would lie on one another
DASHES = ("", "7 3", "2 3")
NOT_DRAWN = ("without view", "matrices alone")
Points = list[tuple[float, float]]


def paper_figures(study: StudyPaper) -> dict[str, str]:
    """File name and SVG of every figure: three for each geometry."""
    found = {}
    for letter, geometry in zip("abcdefgh", study.geometries, strict=False):
        found[f"{letter}_sweeps.svg"] = sweeps_svg(geometry, study)
        found[f"{letter}_levels.svg"] = levels_svg(geometry, study)
        found[f"{letter}_factor.svg"] = factor_svg(geometry)
    return found


def _series(
    cells: Sequence[PaperCell], along: str, name: str, colour: str, shift: float = 0.0, dashes: str = ""
) -> Iterator[Curve]:
    """Ours as a line, printed values as frames with the half-width of their bands; all moved aside by ``shift``."""
    at = [(float(getattr(cell, along)) + shift, cell) for cell in cells]
    yield Curve(name, [(x, cell.value_mm) for x, cell in at], colour, dashes=dashes)
    printed = [(x, cell) for x, cell in at if cell.printed_mm is not None]
    if printed:
        points: Points = [(x, cell.printed_mm or 0.0) for x, cell in printed]
        errors = [(cell.band_mm[1] - cell.band_mm[0]) / 2 for _, cell in printed]
        yield Curve("", points, colour, joined=False, mark="frame", errors=errors)


def _words(geometry: Geometry) -> str:
    return "fitted to the printed tables" if geometry.compared else "not compared with the printed tables"


def _legend(geometry: Geometry, study: StudyPaper) -> list[str]:
    parts = [mark("disc", 62, 46, INK), text(72, 50, f"tailstack, Monte Carlo, {study.trials:,} trials", colour=MUTED)]
    if geometry.compared:
        parts.append(mark("frame", 322, 46, INK))
        band = f"{100 * study.band:g} % band of {study.published_trials:,} trials and rounding"
        parts.append(text(332, 50, f"printed, read as metres; bars: {band}", colour=MUTED))
    return parts


def sweeps_svg(geometry: Geometry, study: StudyPaper) -> str:
    """S1: mean and P95 over rotation and over translation."""
    cells = [cell for cell in geometry.cells if cell.table == "S1"]
    parts = _legend(geometry, study)
    for place, (along, title) in enumerate(
        (("rotation_deg", "rotation about each axis, deg"), ("translation_mm", "translation, mm"))
    ):
        start = "rotation" if along == "rotation_deg" else "translation"
        chosen = [cell for cell in cells if cell.row.startswith(start)]
        curves: list[Curve] = []
        for k, (quantity, name) in enumerate((("mean", "mean"), ("p95", "P95"))):
            curves += _series([cell for cell in chosen if cell.quantity == quantity], along, name, COLOURS[k])
        axes = fitted(curves, 62 + 445 * place, 400 + 445 * place, TOP, BOTTOM)
        parts += drawn(axes, curves, f"{start}, 1 px of noise", title, "3-D error, mm")
    words = "; ".join(f"{cell.row}, {cell.quantity}: {cell.value_mm:.4g} mm" for cell in cells)
    return page(f"S1: {printable(geometry.name, 60)}", f"{_words(geometry)}. {words}.", WIDTH, HEIGHT, parts)


def levels_svg(geometry: Geometry, study: StudyPaper) -> str:
    """S2: P95 over noise, a line for each level."""
    cells = [cell for cell in geometry.cells if cell.table == "S2"]
    levels = list(dict.fromkeys(cell.row.partition(",")[0] for cell in cells))
    curves: list[Curve] = []
    for k, level in enumerate(levels):
        chosen = [cell for cell in cells if cell.row.startswith(level)]
        name = f"{level}: {chosen[0].rotation_deg:g} deg, {chosen[0].translation_mm:g} mm"
        curves += _series(chosen, "noise_px", name, COLOURS[k], SHIFT * (k - (len(levels) - 1) / 2), DASHES[k % 3])
    axes = fitted(curves, 62, 680, TOP, BOTTOM)
    title = "noise of each image coordinate, px"
    parts = [*_legend(geometry, study), *drawn(axes, curves, "levels, moved aside a little", title, "P95, mm")]
    words = "; ".join(f"{cell.row}: {cell.value_mm:.4g} mm" for cell in cells)
    return page(f"S2: {printable(geometry.name, 60)}", f"{_words(geometry)}. {words}.", WIDTH, HEIGHT, parts)


def factor_svg(geometry: Geometry) -> str:
    """S3: standard deviations per axis, every way of propagating beside Monte Carlo and the printed columns."""
    found = geometry.factor
    bars = [("Monte Carlo", found.monte_carlo_mm, COLOURS[0])]
    drawn_ways = [one for one in found.propagations if not one.name.startswith(NOT_DRAWN)]
    bars += [(one.name, one.std_mm, COLOURS[1 + k % 5]) for k, one in enumerate(drawn_ways)]
    marks: list[tuple[str, Mark, tuple[float, ...], str]] = []
    if found.printed_monte_carlo_mm is not None and found.printed_analytic_mm is not None:
        marks = [("printed, Monte Carlo", "square", found.printed_monte_carlo_mm, "Monte Carlo")]
        same = [one.name for one in found.propagations if one.reproduces_printed]
        marks += [("printed, analytic", "ring", found.printed_analytic_mm, same[0] if same else "full")]
    highest = [value for values in [*(bar[1] for bar in bars), *(one[2] for one in marks)] for value in values]
    up = around([0.0, *highest], BOTTOM, TOP - 40, zero=True)
    left, right = 62.0, 690.0
    parts = left_axis(up, left, right, "standard deviation, mm")
    each, wide = (right - left) / 3, (right - left) / 3 / (len(bars) + 1.6)
    for axis, label in enumerate("xyz"):
        begin = left + axis * each + 0.8 * wide
        for k, (name, values, colour) in enumerate(bars):
            x0 = begin + k * wide
            parts.append(box(x0 + 1, up.at(values[axis]), x0 + wide - 1, BOTTOM, f'fill="{colour}" fill-opacity="0.8"'))
            for _, shape, printed, belongs in marks:
                if belongs == name:
                    parts.append(mark(shape, x0 + wide / 2, up.at(printed[axis]), INK))
        parts.append(text(begin + len(bars) * wide / 2, BOTTOM + 17, label, anchor="middle", colour=MUTED))
    parts.append(line(left, BOTTOM, right, BOTTOM, FAINT))
    parts.append(text((left + right) / 2, BOTTOM + 34, "axis of the connector frame", anchor="middle", colour=MUTED))
    parts += _key(
        [(name, colour) for name, _, colour in bars], [(name, shape) for name, shape, _, _ in marks], right + 22
    )
    words = "; ".join(f"{name}: {' / '.join(f'{v:.3g}' for v in values)} mm" for name, values, _ in bars)
    title = f"S3 at {found.noise_px:g} px: {printable(geometry.name, 56)}"
    return page(title, f"{words}. {found.sentence}", WIDTH, HEIGHT, parts)


def _key(bars: Sequence[tuple[str, str]], marks: Sequence[tuple[str, Mark]], x: float) -> list[str]:
    parts = []
    for k, (name, colour) in enumerate(bars):
        y = TOP - 30 + 20 * k
        parts += [box(x, y - 9, x + 14, y + 2, f'fill="{colour}" fill-opacity="0.8"'), text(x + 21, y, name)]
    for k, (name, shape) in enumerate(marks):
        y = TOP - 30 + 20 * (len(bars) + k)
        parts += [mark(shape, x + 7, y - 4, INK), text(x + 21, y, name)]
    return parts

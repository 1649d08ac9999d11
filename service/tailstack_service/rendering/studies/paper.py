"""The paper's tables, printed and reproduced, as text and as CSV."""

from __future__ import annotations

from tailstack.studies.paper.reproduce import Geometry, PaperCell, StudyPaper

from ..page import current
from ..rows import csv_text, plain_text
from ..tables import number, table, visible, wrap
from ..verdict import join_blocks, more_text

TABLES = (
    ("S1", "S1: installation error at 1 px"),
    ("S2", "S2: installation level and pixel noise"),
    ("S3", "S3: standard deviations at 2 px, simulated"),
)
LETTERS = "ABCDEFGH"
QUANTITY = {"mean": "mean", "p95": "P95", "std_x": "std x", "std_y": "std y", "std_z": "std z"}
EXACT = 1e-9


def paper_text(study: StudyPaper) -> str:
    """Every table, printed cells beside ours, what is outside and why."""
    if not current().details:
        return _short_text(study)
    return join_blocks(
        _heading(study),
        *(_table_text(study, name, words) for name, words in TABLES),
        _tool_text(study),
        _means_text(study),
        _bench_text(study),
        *(_geometry_text(letter, geometry) for letter, geometry in zip(LETTERS, study.geometries, strict=False)),
        *(wrap(f"{one.about}: {one.sentence}", indent="  ") for one in study.statements),
    )  # fmt: skip


def _short_text(study: StudyPaper) -> str:
    """The printed tables beside ours, and which cells no such geometry gives."""
    named = [
        wrap(
            f"{visible(geometry.name)}"
            + (", a geometry fitted to these tables, as the paper prints none" if geometry.compared else "")
            + f"; pivot to target {geometry.lever_mm:.0f} mm",
            first=f"{letter}: ",
            indent="   ",
        )
        for letter, geometry in zip(LETTERS, study.geometries, strict=False)
    ]
    intro = (
        f"The paper's tables as printed and as simulated with {study.trials:,} shots a value, in mm. * marks what is "
        f"further off than chance explains ({study.band:.0%} of experiments of {study.published_trials:,} shots stay "
        "within); - was not printed."
    )
    return join_blocks(
        wrap(study.source),
        "\n".join([wrap(intro), *named]),
        *(_table_text(study, name, words) for name, words in TABLES),
        *(_outside_text(letter, one) for letter, one in zip(LETTERS, study.geometries, strict=False)),
        more_text(),
    )


def _outside_text(letter: str, geometry: Geometry) -> str:
    if not geometry.compared:
        return ""
    outside = [f"{cell.table} {cell.row}, {QUANTITY[cell.quantity]}" for cell in geometry.cells if cell.outside]
    listed = f": {'; '.join(outside)}" if outside else ""
    said = f"{geometry.compared_cells} values compared, {len(outside)} further off than chance explains{listed}."
    return wrap(said, first=f"{letter}: ", indent="   ")


def _heading(study: StudyPaper) -> str:
    lines = [
        wrap(study.source),
        wrap(
            f"ours: Monte Carlo on the full chain, {study.trials:,} trials a cell, seed {study.seed}; all numbers in "
            f"mm. z: printed less ours, over the standard deviation that the cell has in experiments of "
            f"{study.published_trials:,} trials, with the rounding of what is printed and our own error. * beyond the "
            f"{study.band:.0%} band. - not printed. tailstack {study.tailstack_version}"
        ),
    ]
    for letter, geometry in zip(LETTERS, study.geometries, strict=False):
        origin = "fitted to these tables, which print none" if geometry.compared else "not compared"
        lines.append(
            wrap(
                f"{visible(geometry.name)}; {origin}; {geometry.reading} reading, pivot to target "
                f"{geometry.lever_mm:.0f} mm, nu = {geometry.nu:.2g} at 5 px",
                first=f"{letter}: ", indent="   ",
            )
        )  # fmt: skip
    return "\n".join(lines)


def _value(cell: PaperCell) -> str:
    return "0" if cell.value_mm < EXACT else number(cell.value_mm)


def _table_text(study: StudyPaper, name: str, words: str) -> str:
    details = current().details
    chosen = [[cell for cell in geometry.cells if cell.table == name] for geometry in study.geometries]
    printed = {(one.row, one.column): f"{one.value:g}" for one in study.printed if one.table == name}
    columns = [_columns(cell) for cell in chosen[0]]
    kinds = [k for k in (0, 1) if any(entry[k] for entry in columns)]  # the 3-D error, the error at the tool
    rows = []
    for place, cell in enumerate(chosen[0]):
        row = [f"{cell.row}, {QUANTITY[cell.quantity]}" if name != "S3" else QUANTITY[cell.quantity]]
        row += [printed.get(column, "-") if (column := columns[place][k]) else "-" for k in kinds]
        for geometry, cells in zip(study.geometries, chosen, strict=True):
            outside = "*" if cells[place].outside else " "
            row.append(_value(cells[place]) + ("" if details or not geometry.compared else outside))
            if geometry.compared and details:
                z = cells[place].z
                row.append("-" if z is None else f"{z:+.2f}{'*' if cells[place].outside else ' '}")
        rows.append(row)
    header = [words, *(("printed,\n3-D, mm", "printed,\ntool, mm")[k] for k in kinds)]
    for letter, geometry in zip(LETTERS, study.geometries, strict=False):
        header += [f"{letter}\nmm", "\nz"] if geometry.compared and details else [f"{letter}\nmm"]
    return table(header, rows)


def _columns(cell: PaperCell) -> tuple[tuple[str, str] | None, tuple[str, str] | None]:
    """Row and column of the printed table with this statistic, of the 3-D error and of the error at the tool."""
    if cell.table == "S1":
        return ((cell.row, "e_3d_mean"), (cell.row, "e_tcp_mean")) if cell.quantity == "mean" else (
            None, (cell.row, "e_tcp_p95"),
        )  # fmt: skip
    if cell.table == "S2":
        level, _, noise = cell.row.partition(", ")
        return None, (level, noise)
    return (cell.quantity[-1], "mc_std"), None


def _means_text(study: StudyPaper) -> str:
    """S3's means, and by how much ours differ from that of first order."""
    printed = {(one.row, one.column): one.printed for one in study.printed}
    compared = next((geometry.factor for geometry in study.geometries if geometry.compared), None)
    rows = []
    for place, axis in enumerate("xyz"):
        row = [axis, printed[axis, "mc_mean"], printed[axis, "analytic_mean"]]
        difference = None if compared is None else compared.printed_mean_difference_mm
        row.append("-" if difference is None else f"{difference[place]:g}")
        for geometry in study.geometries:
            found = geometry.factor
            row.append(f"{found.mean_error_mm[place]:+.2f} ± {found.mean_standard_error_mm[place]:.2f}")
        rows.append(row)
    letters = [f"{letter}\nmm" for letter, _ in zip(LETTERS, study.geometries, strict=False)]
    header = [
        "S3: means, as printed", "Monte\nCarlo", "analytic\n", "Monte Carlo\nless analytic, mm", *letters,
    ]  # fmt: skip
    remark = next(one.remark for one in study.printed if (one.table, one.column) == ("S3", "mc_mean"))
    return table(header, rows) + "\n" + wrap(f"Means: {remark}. Ours: mean of Monte Carlo less that of first order.")


def _bench_text(study: StudyPaper) -> str:
    """S4 as printed, what its figures say, and why ours are not compared."""
    cells = [one for one in study.printed if one.table == "S4"]
    printed = {(one.row, one.column): one for one in cells}
    rows = []
    for level in dict.fromkeys(one.row for one in cells):
        mean, std, p95, pixels = (printed[level, column] for column in dict.fromkeys(one.column for one in cells))
        row = [level, mean.printed, std.printed, p95.printed, pixels.printed]
        if std.value > 0:
            row += [f"{mean.value / pixels.value:.4f}", f"{(p95.value - mean.value) / std.value:.2f}"]
            row.append(f"{p95.value / mean.value:.4f}")
        else:
            row += ["-", "-", "-"]
        shapes = [next(one for one in geometry.shapes if one.level == level) for geometry in study.geometries]
        rows.append(row + [f"{one.standard_deviations:.2f}" for one in shapes])
    letters = [f"ours,\n{letter}" for letter, _ in zip(LETTERS, study.geometries, strict=False)]
    header = [
        "S4, as\nprinted", "mean\n", "std\n", "P95\n", "reprojection\npx", "mean\nper px",
        "(P95 - mean)\n/ std", "P95\n/ mean", *letters,
    ]  # fmt: skip
    remarks = dict.fromkeys(one.remark for one in cells)
    words = f"{'; '.join(remarks)}. Ours at these levels without noise stand below; (P95 - mean) / std is at 2 px."
    return table(header, rows) + "\n" + wrap(words[0].upper() + words[1:])


def _tool_text(study: StudyPaper) -> str:
    """The error at the tool beside the 3-D error, for the norms of S1 and S2."""
    cells = [cell for geometry in study.geometries for cell in geometry.cells if cell.table != "S3"]
    apart = max(abs(cell.tcp_mm - cell.value_mm) / max(cell.value_mm, 1.0) for cell in cells)
    if apart > EXACT:
        return wrap("Error at the tool: --json and --csv have it for every cell (tcp_mm).")
    return wrap(
        "Error at the tool: sampled in the same trials, mean and P95 of S1 and S2 are the same numbers in either "
        "reading, to rounding, as S1 prints them; S1's P95 and S2 are printed of the tool alone. P95 over translation "
        "is not printed. At 2 px, L0 and L2, z is of the text's 90.39 and 108.56 mm. What maps the point to the "
        "tool is a rigid transform, and the tables have no error after it. A second interface with tolerances, "
        "hand-eye error or repeatability would set the two apart; these tables leave them out, those of your own "
        "design too, and `tailstack score` has both errors with them."
    )


def _geometry_text(letter: str, geometry: Geometry) -> str:
    return join_blocks(
        _verdict(letter, geometry), _additivity_text(letter, geometry), _factor_text(letter, geometry),
        _levels_text(letter, geometry),
    ).rstrip("\n")  # fmt: skip


def _verdict(letter: str, geometry: Geometry) -> str:
    if not geometry.compared:
        return ""
    outside = [cell for cell in geometry.cells if cell.outside]
    listed = "; ".join(f"{cell.table} {cell.row}, {QUANTITY[cell.quantity]} (z = {cell.z:+.1f})" for cell in outside)
    return wrap(
        f"{geometry.compared_cells} cells compared, {geometry.outside_cells} outside the 99 % band"
        + (f": {listed}. " if listed else ". ")
        + f"Sum of z squared {geometry.chi_square or 0.0:.1f}; the geometry was chosen for these cells, so a small sum "
        "proves nothing, and a large z is a cell that this model does not give.",
        first=f"{letter}: ", indent="   ",
    )  # fmt: skip


def _additivity_text(letter: str, geometry: Geometry) -> str:
    rows = []
    for one in geometry.additivity:
        row = [one.row, number(one.joint_mm), number(one.first_order_mm), number(one.bias_mm), number(one.noise_mm)]
        row += [number(one.quadrature_mm), number(one.sum_mm)]
        if geometry.compared:
            row += [number(one.printed_joint_mm), number(one.printed_quadrature_mm)]
        rows.append(row)
    header = [
        f"{letter}: S2 and its parts\nmm", "P95\n", "first\norder", "|bias|\n", "noise\nP95", "quad-\nrature", "sum\n",
    ]  # fmt: skip
    return table(header + (["printed\n", "quadrature of\nprinted parts"] if geometry.compared else []), rows)


def _factor_text(letter: str, geometry: Geometry) -> str:
    found = geometry.factor
    rows = [["Monte Carlo", *map(number, found.monte_carlo_mm), "", "", "", ""]]
    if found.printed_monte_carlo_mm is not None and found.printed_analytic_mm is not None:
        rows.append(["printed, Monte Carlo", *(f"{v:g}" for v in found.printed_monte_carlo_mm), "", "", "", ""])
        rows.append(["printed, analytic", *(f"{v:g}" for v in found.printed_analytic_mm), "", "", "", ""])
    for one in found.propagations:
        ratios = [f"{ratio:.3f}" for ratio in one.over_monte_carlo]
        same = {True: "yes", False: "no", None: ""}[one.reproduces_printed]
        rows.append([one.name, *map(number, one.std_mm), *ratios, same])
    header = [
        f"{letter}: S3, propagated", "std x\nmm", "std y\nmm", "std z\nmm", "over MC\nx", "over MC\ny", "over MC\nz",
        "gives the printed\nanalytic column" if geometry.compared else "",
    ]  # fmt: skip
    if not geometry.compared:
        header, rows = header[:-1], [row[:-1] for row in rows]
    return table(header, rows) + "\n" + wrap(found.sentence)


def _levels_text(letter: str, geometry: Geometry) -> str:
    rows = [
        [
            f"{one.level}: {one.rotation_deg:g} deg, {one.translation_mm:g} mm", _small(one.error_mm),
            _small(one.reprojection_estimated_px), f"{one.reprojection_noisy_px:.4f}", _small(one.reprojection_kept_px),
            number(one.mm_per_px, 3),
        ]
        for one in geometry.levels
    ]  # fmt: skip
    header = [
        f"{letter}: S4, without noise", "error\nmm", "reprojection,\npx", "with 2 px of\nnoise, px",
        "with L0's\nmatrices, px", "error over it\nmm/px",
    ]  # fmt: skip
    return table(header, rows)


def _small(value: float) -> str:
    return "0" if abs(value) < EXACT else number(value)


def paper_csv(study: StudyPaper) -> str:
    """One line for each cell of each geometry."""
    header = (
        "geometry", "reading", "table", "row", "quantity", "rotation_deg", "translation_mm", "noise_px", "printed_mm",
        "rounding_mm", "value_mm", "standard_error_mm", "tcp_mm", "first_order_mm", "other_reading_mm",
        "published_error_mm", "band_low_mm", "band_high_mm", "z", "outside",
    )  # fmt: skip
    rows = [
        [
            plain_text(geometry.name), geometry.reading, cell.table, cell.row, cell.quantity, cell.rotation_deg,
            cell.translation_mm, cell.noise_px, cell.printed_mm, cell.rounding_mm, cell.value_mm,
            cell.standard_error_mm, cell.tcp_mm, cell.first_order_mm, cell.other_reading_mm, cell.published_error_mm,
            *cell.band_mm, cell.z, cell.outside,
        ]
        for geometry in study.geometries
        for cell in geometry.cells
    ]  # fmt: skip
    return csv_text(header, rows)

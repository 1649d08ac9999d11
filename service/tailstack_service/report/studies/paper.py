"""The paper's tables, printed and reproduced."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from tailstack.results.digits import number
from tailstack.results.look import COLOURS, INK
from tailstack.results.tables import IN_DETAIL, LONG_TABLE, PAPER, TERMINAL, Cell, Column, On, Row, Table, tabulate

from ...rendering.rows import csv_text, plain_text
from ...rendering.tables import visible
from ..blocks import Document, Facts, Figure, KeyNumber, Listing, Paragraph, Section
from ..charts import RING
from ..page import DASHED, DOTTED, name_at_right, titled_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tailstack.studies.paper.reproduce import Geometry, PaperCell, StudyPaper

    from ..matplotlib_svg import Chart

TABLES = (
    ("S1", "S1: installation error at 1 px"),
    ("S2", "S2: installation level and pixel noise"),
    ("S3", "S3: standard deviations at 2 px, simulated"),
)
LETTERS = "ABCDEFGH"
QUANTITY = {"mean": "mean", "p95": "P95", "std_x": "std x", "std_y": "std y", "std_z": "std z"}
EXACT = 1e-9
OWN = TERMINAL | On.PAGE  # the tables as the paper has them; a spreadsheet has every cell as a row


def paper_document(study: StudyPaper, sha256: str) -> Document:
    """Every table, printed cells beside ours, what is outside and why."""
    lettered = tuple(zip(LETTERS, study.geometries, strict=False))
    compared = [geometry for geometry in study.geometries if geometry.compared]
    cells, outside = (
        sum(getattr(geometry, name) for geometry in compared) for name in ("compared_cells", "outside_cells")
    )
    pictures = tuple(Figure(name.replace("_", "-"), draw, "") for name, draw in _list_charts(study).items())
    statements = Facts("Statements", tuple((statement.about, statement.sentence) for statement in study.statements))
    own = [geometry.design_sha256 or "not known" for geometry in study.geometries]
    how = (
        f"Ours: Monte Carlo on the full chain, {study.trials:,} shots a value, seed {study.seed}; all numbers in mm. * "
        f"marks what is further off than chance explains ({100 * study.band:g} % of experiments of "
        f"{study.published_trials:,} shots stay within); - was not printed."
    )
    z = (
        "z: printed less ours, over the standard deviation that the cell has in experiments of "
        f"{study.published_trials:,} trials, with the rounding of what is printed and our own error."
    )
    return Document(
        kind="Study: the published tables",
        title=study.source,
        tone="neutral",
        status="study",
        sentence=study.statements[0].sentence if study.statements else "No table was compared.",
        numbers=(
            KeyNumber("Cells compared", f"{cells:,}", f"in {len(compared)} geometries that were fitted"),
            KeyNumber("Outside", f"{outside:,}", f"the {100 * study.band:g} % band"),
            KeyNumber("Trials a cell", f"{study.trials:,}", f"{study.published_trials:,} as published"),
        ),
        matters=tuple(statement.sentence for statement in study.statements[1:4]),
        figures=pictures[:1],
        sections=(
            Section(
                "Printed beside ours",
                (
                    Paragraph(how),
                    Facts("Geometries", tuple((letter, _describe(geometry)) for letter, geometry in lettered)),
                    *(printed_table(study, name, words) for name, words in TABLES),
                    means_table(study),
                    bench_table(study),
                    Facts(
                        "Outside",
                        tuple((letter, _count(study, geometry)) for letter, geometry in lettered if geometry.compared),
                    ),
                ),
                on=OWN,
            ),
            Section("How cells are compared", (Paragraph(z), Paragraph(_tell_tool(study))), on=On.DETAIL | On.PAGE),
            *(
                Section(
                    f"Geometry {letter}",
                    (
                        Paragraph(f"{letter}: {geometry.reading} reading, nu = {geometry.nu:.2g} at 5 px."),
                        *_squares(geometry),
                        parts_table(letter, geometry),
                        propagations_table(letter, geometry),
                        Paragraph(geometry.factor.sentence),
                        levels_table(letter, geometry),
                    ),
                    on=On.DETAIL | On.PAGE,
                )
                for letter, geometry in lettered
            ),
            *(
                Section(f"Cells of geometry {letter}", (cells_table(geometry, k),), on=PAPER)
                for k, (letter, geometry) in enumerate(lettered, 1)
            ),
            Section("Printed cells", (every_printed_table(study),), on=PAPER),
            Section("Pictures", pictures[1:], on=On.PAGE),
            Section("What the printed figures say", (statements,), on=IN_DETAIL),
            Section(
                "Reproduction",
                (Listing(f"tailstack study paper --trials {study.trials} --seed {study.seed} --json"),),
                on=PAPER,
                reader="auditor",
            ),
        ),
        provenance=Facts(
            "Provenance",
            (
                ("Source", study.source),
                *((f"SHA-256 of design {k}", digest) for k, digest in enumerate(own, 1)),
                ("SHA-256 of this record", sha256),
                ("Record", study.schema),
                ("Computed by", f"tailstack {study.tailstack_version}"),
            ),
        ),
        question="The paper's tables as printed and as simulated.",
        captions=True,
    )


def _describe(geometry: Geometry) -> str:
    fitted = ", a geometry fitted to these tables, as the paper prints none" if geometry.compared else ", not compared"
    return f"{visible(geometry.name)}{fitted}; pivot to target {geometry.lever_mm:.0f} mm"


def _count(study: StudyPaper, geometry: Geometry) -> str:
    outside = [cell for cell in geometry.cells if cell.outside]
    listed = "; ".join(
        f"{cell.table} {cell.row}, {QUANTITY[cell.quantity]} ({abs(cell.z or 0.0):.1f} standard deviations "
        f"{'above' if (cell.z or 0.0) > 0 else 'below'} ours)"
        for cell in outside
    )
    return (
        f"{geometry.compared_cells} values compared, {len(outside)} outside the {100 * study.band:g} % band"
        + (f": {listed}" if listed else "")
        + "."
    )


def _squares(geometry: Geometry) -> tuple[Paragraph, ...]:
    if not geometry.compared:
        return ()
    return (
        Paragraph(
            f"Sum of z squared {geometry.chi_square or 0.0:.1f}; the geometry was chosen for these cells, so a small "
            "sum proves nothing, and a large z is a cell that this model does not give."
        ),
    )


def _tell_tool(study: StudyPaper) -> str:
    """The error at the tool beside the 3-D error, for the norms of S1 and S2."""
    cells = [cell for geometry in study.geometries for cell in geometry.cells if cell.table != "S3"]
    apart = max(abs(cell.tcp_mm - cell.value_mm) / max(cell.value_mm, 1.0) for cell in cells)
    if apart > EXACT:
        return "Error at the tool: --json and --csv have it for every cell (tcp_mm)."
    return (
        "Error at the tool: sampled in the same trials, mean and P95 of S1 and S2 are the same numbers in either "
        "reading, to rounding, as S1 prints them; S1's P95 and S2 are printed of the tool alone. P95 over translation "
        "is not printed. At 2 px, L0 and L2, z is of the text's 90.39 and 108.56 mm. What maps the point to the "
        "tool is a rigid transform, and the tables have no error after it. A second interface with tolerances, "
        "hand-eye error or repeatability would set the two apart; these tables leave them out, those of your own "
        "design too, and `tailstack score` has both errors with them."
    )


def printed_table(study: StudyPaper, name: str, words: str) -> Table:
    """One of the paper's tables, ours beside the printed cells, a column for each geometry."""
    chosen = [[cell for cell in geometry.cells if cell.table == name] for geometry in study.geometries]
    printed = {
        (printed_cell.row, printed_cell.column): f"{printed_cell.value:g}"
        for printed_cell in study.printed
        if printed_cell.table == name
    }
    places = [_place_in_print(cell) for cell in chosen[0]]
    kinds = [k for k in (0, 1) if any(entry[k] for entry in places)]  # the 3-D error, the error at the tool
    columns = [
        Column("Row"),
        *(Column(f"Printed, {what}", "mm", "fixed", brief=f"printed,\n{what}, mm")
          for what in (("3-D", "tool")[k] for k in kinds)),
    ]  # fmt: skip
    for letter, geometry in zip(LETTERS, study.geometries, strict=False):
        columns.append(Column(letter, "mm", "fixed", brief=f"{letter}\nmm"))
        if geometry.compared:
            columns.append(Column(f"z of {letter}", kind="signed", digits=2, brief="\nz", on=IN_DETAIL))
    rows = []
    for place, cell in enumerate(chosen[0]):
        cells: list[Cell] = [f"{cell.row}, {QUANTITY[cell.quantity]}" if name != "S3" else QUANTITY[cell.quantity]]
        cells += [printed.get(column, "-") if (column := places[place][k]) else "-" for k in kinds]
        for geometry, own in zip(study.geometries, chosen, strict=True):
            mark = "" if not geometry.compared else "*" if own[place].outside else " "
            cells.append(_write_value(own[place].value_mm) + mark)
            if geometry.compared:
                cells.append(own[place].z)
        rows.append(Row(tuple(cells)))
    return Table(name, words, tuple(columns), tuple(rows))


def _place_in_print(cell: PaperCell) -> tuple[tuple[str, str] | None, tuple[str, str] | None]:
    """Row and column of the printed table with this statistic, of the 3-D error and of the error at the tool."""
    if cell.table == "S1":
        return ((cell.row, "e_3d_mean"), (cell.row, "e_tcp_mean")) if cell.quantity == "mean" else (
            None, (cell.row, "e_tcp_p95"),
        )  # fmt: skip
    if cell.table == "S2":
        level, _, noise = cell.row.partition(", ")
        return None, (level, noise)
    return (cell.quantity[-1], "mc_std"), None


def _write_value(value: float) -> str:
    return "0" if abs(value) < EXACT else number(value)


def means_table(study: StudyPaper) -> Table:
    """S3's means, and by how much ours differ from that of first order."""
    printed = {(cell.row, cell.column): cell.printed for cell in study.printed}
    compared = next((geometry.factor for geometry in study.geometries if geometry.compared), None)
    difference = None if compared is None else compared.printed_mean_difference_mm
    rows = []
    for place, axis in enumerate("xyz"):
        apart = None if difference is None else f"{difference[place]:g}"
        ours = [
            f"{factor.mean_error_mm[place]:+.2f} ± {factor.mean_standard_error_mm[place]:.2f}"
            for factor in (geometry.factor for geometry in study.geometries)
        ]
        rows.append(Row((axis, printed[axis, "mc_mean"], printed[axis, "analytic_mean"], apart, *ours)))
    columns = (
        Column("Axis"),
        Column("Monte Carlo", kind="fixed", brief="Monte\nCarlo"),
        Column("Analytic", kind="fixed", brief="analytic\n"),
        Column("Monte Carlo less analytic", "mm", "fixed", brief="Monte Carlo\nless analytic, mm"),
        *(
            Column(letter, "mm", "fixed", brief=f"{letter}\nmm")
            for letter, _ in zip(LETTERS, study.geometries, strict=False)
        ),
    )
    remark = next(cell.remark for cell in study.printed if (cell.table, cell.column) == ("S3", "mc_mean"))
    note = f"Means: {remark}. Ours: mean simulated less estimated."
    return Table("S3 means", "S3: means, as printed", columns, tuple(rows), note)


def bench_table(study: StudyPaper) -> Table:
    """S4 as printed, what its figures say, and why ours are not compared."""
    cells = [cell for cell in study.printed if cell.table == "S4"]
    printed = {(cell.row, cell.column): cell for cell in cells}
    rows = []
    for level in dict.fromkeys(cell.row for cell in cells):
        mean, std, p95, pixels = (printed[level, column] for column in dict.fromkeys(cell.column for cell in cells))
        ratios: list[Cell] = [None, None, None]
        if std.value > 0:
            ratios = [mean.value / pixels.value, f"{(p95.value - mean.value) / std.value:.2f}", p95.value / mean.value]
        shapes = [next(shape for shape in geometry.shapes if shape.level == level) for geometry in study.geometries]
        rows.append(Row((level, mean.printed, std.printed, p95.printed, pixels.printed, *ratios,
                         *(shape.standard_deviations for shape in shapes))))  # fmt: skip
    columns = (
        Column("Level"),
        Column("Mean", kind="fixed", brief="mean\n"),
        Column("Std", kind="fixed", brief="std\n"),
        Column("P95", kind="fixed", brief="P95\n"),
        Column("Reprojection", "px", "fixed", brief="reprojection\npx"),
        Column("Mean per px", kind="fixed", digits=4, brief="mean\nper px"),
        Column("(P95 - mean) / std", kind="fixed", brief="(P95 - mean)\n/ std"),
        Column("P95 / mean", kind="fixed", digits=4, brief="P95\n/ mean"),
        *(Column(f"Ours, {letter}", kind="fixed", digits=2, brief=f"ours,\n{letter}")
          for letter, _ in zip(LETTERS, study.geometries, strict=False)),
    )  # fmt: skip
    words = f"{'; '.join(dict.fromkeys(cell.remark for cell in cells))}. Ours: (P95 - mean) / std is at 2 px."
    return Table("S4", "S4, as printed", columns, tuple(rows), words[0].upper() + words[1:])


def _millimetres(title: str, brief: str, of: Callable[[Any], Cell]) -> Column:
    return Column(title, "mm", "significant", 4, brief=brief, of=of)


def parts_table(letter: str, geometry: Geometry) -> Table:
    """S2 and its parts."""
    columns = [
        Column("Row", of=lambda part: part.row),
        _millimetres("P95", "P95\n", lambda part: part.joint_mm),
        _millimetres("First order", "first\norder", lambda part: part.first_order_mm),
        _millimetres("|bias|", "|bias|\n", lambda part: part.bias_mm),
        _millimetres("Noise P95", "noise\nP95", lambda part: part.noise_mm),
        _millimetres("Quadrature", "quad-\nrature", lambda part: part.quadrature_mm),
        _millimetres("Sum", "sum\n", lambda part: part.sum_mm),
    ]
    if geometry.compared:
        columns += [
            _millimetres("Printed", "printed\n", lambda part: part.printed_joint_mm),
            _millimetres("Quadrature of printed parts", "quadrature of\nprinted parts",
                         lambda part: part.printed_quadrature_mm),
        ]  # fmt: skip
    return tabulate(f"Parts {letter}", f"{letter}: S2 and its parts, mm", columns, geometry.additivity)


def propagations_table(letter: str, geometry: Geometry) -> Table:
    """S3: one covariance propagated in several ways, beside Monte Carlo and the printed columns."""
    factor = geometry.factor
    empty = ("", "", "", "")
    rows = [Row(("Monte Carlo", *factor.monte_carlo_mm, *empty))]
    if factor.printed_monte_carlo_mm is not None and factor.printed_analytic_mm is not None:
        rows.append(Row(("printed, Monte Carlo", *(f"{v:g}" for v in factor.printed_monte_carlo_mm), *empty)))
        rows.append(Row(("printed, analytic", *(f"{v:g}" for v in factor.printed_analytic_mm), *empty)))
    for way in factor.propagations:
        same = {True: "yes", False: "no", None: ""}[way.reproduces_printed]
        rows.append(Row((way.name, *way.std_mm, *way.over_monte_carlo, same)))
    columns = [
        Column("Way"),
        *(Column(f"Std {axis}", "mm", "significant", 4, brief=f"std {axis}\nmm") for axis in "xyz"),
        *(Column(f"Over Monte Carlo, {axis}", kind="fixed", brief=f"over MC\n{axis}") for axis in "xyz"),
        Column("Gives the printed analytic column", kind="fixed", brief="gives the printed\nanalytic column"),
    ]
    if not geometry.compared:
        columns, rows = columns[:-1], [Row(row.cells[:-1]) for row in rows]
    return Table(f"Propagated {letter}", f"{letter}: S3, propagated", tuple(columns), tuple(rows))


def levels_table(letter: str, geometry: Geometry) -> Table:
    """S4 without noise."""
    columns = (
        Column("Level", of=lambda level: f"{level.level}: {level.rotation_deg:g} deg, {level.translation_mm:g} mm"),
        Column("Error", "mm", "fixed", brief="error\nmm", of=lambda level: _write_value(level.error_mm)),
        Column("Reprojection", "px", "fixed", brief="reprojection,\npx",
               of=lambda level: _write_value(level.reprojection_estimated_px)),
        Column("With 2 px of noise", "px", "fixed", 4, brief="with 2 px of\nnoise, px",
               of=lambda level: level.reprojection_noisy_px),
        Column("With L0's matrices", "px", "fixed", brief="with L0's\nmatrices, px",
               of=lambda level: _write_value(level.reprojection_kept_px)),
        Column("Error over it", "mm/px", "significant", brief="error over it\nmm/px", of=lambda level: level.mm_per_px),
    )  # fmt: skip
    return tabulate(f"Levels {letter}", f"{letter}: S4, without noise", columns, geometry.levels)


def cells_table(geometry: Geometry, place: int) -> Table:
    """Every cell of ours beside the printed one."""
    columns = (
        Column("Table", of=lambda cell: cell.table),
        Column("Row", of=lambda cell: cell.row),
        Column("Statistic", of=lambda cell: cell.quantity),
        _millimetres("Ours", "", lambda cell: cell.value_mm),
        Column("Standard error", "mm", "significant", 2, of=lambda cell: cell.standard_error_mm),
        _millimetres("Estimate", "", lambda cell: cell.first_order_mm),
        _millimetres("Other reading", "", lambda cell: cell.other_reading_mm),
        _millimetres("At the tool", "", lambda cell: cell.tcp_mm),
        _millimetres("Printed", "", lambda cell: cell.printed_mm),
        Column("z", kind="signed", digits=1, of=lambda cell: cell.z),
    )
    caption = f"Target {geometry.target}, {geometry.reading} reading: our cells beside the printed ones"
    return tabulate(f"Geometry {place}", caption, columns, geometry.cells, most=LONG_TABLE)


def every_printed_table(study: StudyPaper) -> Table:
    """Every printed cell, as it is printed, and why one is not predicted."""

    def ours(place: int) -> Callable[[Any], Cell]:
        return lambda cell: cell.ours[place]

    columns = (
        Column("Table", of=lambda cell: cell.table),
        Column("Row", of=lambda cell: cell.row),
        Column("Column", of=lambda cell: cell.column),
        Column("Printed", of=lambda cell: cell.printed),
        Column("Value", kind="significant", digits=4, of=lambda cell: cell.value),
        Column("Unit", of=lambda cell: cell.unit),
        *(
            Column(f"Ours, geometry {k + 1}", kind="significant", digits=4, of=ours(k))
            for k in range(len(study.geometries))
        ),
        Column("Remark", of=lambda cell: cell.remark),
    )
    caption = "Every printed cell, as it is printed, and why one is not predicted"
    return tabulate("Printed", caption, columns, study.printed, most=LONG_TABLE)


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


# --- its charts ---------------------------------------------------------------------------------------------

SHIFT = 0.1  # px, of one level against the next: their marks would lie on one another
DASHES = ("-", DASHED, DOTTED)
NOT_DRAWN = ("without view", "matrices alone")
FRAME: dict[str, Any] = {
    "marker": "s",
    "linestyle": "",
    "markerfacecolor": "none",
    "markersize": 7.6,
}  # what lies below can be seen


def draw_paper(study: StudyPaper) -> dict[str, str]:
    """File name and SVG of every figure: three for each geometry."""
    return {f"{name}.svg": draw() for name, draw in _list_charts(study).items()}


def _list_charts(study: StudyPaper) -> dict[str, Callable[[], str]]:
    charts: dict[str, Callable[[], str]] = {}
    for letter, geometry in zip(LETTERS.lower(), study.geometries, strict=False):
        charts[f"{letter}_sweeps"] = partial(draw_paper_sweeps, geometry, study)
        charts[f"{letter}_levels"] = partial(draw_paper_levels, geometry, study)
        charts[f"{letter}_factor"] = partial(draw_paper_factor, geometry)
    return charts


def draw_paper_sweeps(geometry: Geometry, study: StudyPaper) -> str:
    """S1: mean and P95 over rotation and over translation."""
    cells = [cell for cell in geometry.cells if cell.table == "S1"]
    title = f"S1: {geometry.name}"
    with titled_page("study", title, "", 364) as (page, top):
        _explain_paper(page, geometry, study, top)
        for place, (along, x) in enumerate(
            (("rotation_deg", "rotation about each axis, deg"), ("translation_mm", "translation, mm"))
        ):
            start = "rotation" if along == "rotation_deg" else "translation"
            left = 62 + 445 * place
            page.say(left - 6, top + 60, f"{start}, 1 px of noise", weight="bold")
            axes = page.axes(left, top + 86, left + 338, top + 312, x, "3-D error, mm")
            ends = []
            for colour, (quantity, name) in zip(COLOURS, (("mean", "mean"), ("p95", "P95")), strict=False):
                these = [cell for cell in cells if cell.row.startswith(start) and cell.quantity == quantity]
                ends.append((name, _draw_series(axes, these, along, name, colour), colour))
            _fit(axes)
            name_at_right(axes, ends, 12)
        words = "; ".join(f"{cell.row}, {cell.quantity}: {cell.value_mm:.4g} mm" for cell in cells)
        return page.svg(title, f"{_words(geometry)}. {words}.")


def draw_paper_levels(geometry: Geometry, study: StudyPaper) -> str:
    """S2: P95 over noise, a line for each level."""
    cells = [cell for cell in geometry.cells if cell.table == "S2"]
    levels = list(dict.fromkeys(cell.row.partition(",")[0] for cell in cells))
    title = f"S2: {geometry.name}"
    with titled_page("study", title, "", 364) as (page, top):
        _explain_paper(page, geometry, study, top)
        page.say(56, top + 60, "levels, moved aside a little", weight="bold")
        axes = page.axes(62, top + 86, 680, top + 312, "noise of each image coordinate, px", "P95, mm")
        for k, level in enumerate(levels):
            these = [cell for cell in cells if cell.row.startswith(level)]
            shift, dashes = SHIFT * (k - (len(levels) - 1) / 2), DASHES[k % len(DASHES)]
            name = f"{level}: {these[0].rotation_deg:g} deg, {these[0].translation_mm:g} mm"
            _draw_series(axes, these, "noise_px", name, COLOURS[k], shift, dashes)
        _fit(axes)
        page.explain(694, top + 100, list(zip(*axes.get_legend_handles_labels(), strict=True)), ncols=1)
        words = "; ".join(f"{cell.row}: {cell.value_mm:.4g} mm" for cell in cells)
        return page.svg(title, f"{_words(geometry)}. {words}.")


def draw_paper_factor(geometry: Geometry) -> str:
    """S3: standard deviations per axis, every way of propagating beside Monte Carlo and the printed columns."""
    factor = geometry.factor
    ways = [way for way in factor.propagations if not way.name.startswith(NOT_DRAWN)]
    bars = [("Monte Carlo", factor.monte_carlo_mm), *((way.name, way.std_mm) for way in ways)]
    printed = []
    if factor.printed_monte_carlo_mm is not None and factor.printed_analytic_mm is not None:
        same = next((way.name for way in factor.propagations if way.reproduces_printed), "full")
        printed = [("printed, Monte Carlo", "s", factor.printed_monte_carlo_mm, "Monte Carlo"),
                   ("printed, analytic", "o", factor.printed_analytic_mm, same)]  # fmt: skip
    title = f"S3 at {factor.noise_px:g} px: {geometry.name}"
    with titled_page("study", title, "", 362) as (page, top):
        axes = page.axes(
            62, top + 44, 690, top + 310, "axis of the connector frame", "standard deviation, mm", grid="y"
        )
        wide = 1 / (len(bars) + 1.6)
        marks: list[tuple[Any, str]] = []
        for k, (name, values) in enumerate(bars):
            places = [axis + (0.8 + k + 0.5) * wide for axis in range(3)]
            colour = COLOURS[0] if k == 0 else COLOURS[1 + (k - 1) % 5]
            axes.bar(places, values, 0.94 * wide, color=colour, alpha=0.8)
            marks.append((page.patch(color=colour, alpha=0.8), name))
            for _, shape, theirs, belongs in printed:
                if belongs == name:
                    axes.plot(places, theirs, shape, color=INK, clip_on=False, **RING)
        marks += [(page.sample(marker=shape, linestyle="", color=INK, **RING), name) for name, shape, *_ in printed]
        axes.set(xlim=(0, 3), ylim=(0, 1.06 * axes.dataLim.y1))
        axes.set_xticks([axis + (0.8 + len(bars) / 2) * wide for axis in range(3)], ["x", "y", "z"])
        axes.tick_params(length=0)
        page.explain(712, top + 44, marks, ncols=1, labelspacing=0.7)
        words = "; ".join(f"{name}: {' / '.join(f'{v:.3g}' for v in values)} mm" for name, values in bars)
        return page.svg(title, f"{words}. {factor.sentence}")


def _draw_series(
    axes: Axes, cells: Sequence[PaperCell], along: str, name: str, colour: str, shift: float = 0.0, dashes: Any = "-"
) -> float:
    """Ours as a line, printed values as frames with the half-width of their bands, moved aside; returns the last."""
    places = [float(getattr(cell, along)) + shift for cell in cells]
    axes.plot(
        places,
        [cell.value_mm for cell in cells],
        marker="o",
        markeredgewidth=0,
        linestyle=dashes,
        color=colour,
        label=name,
    )
    printed = [(x, cell) for x, cell in zip(places, cells, strict=True) if cell.printed_mm is not None]
    if printed:
        x, values = [x for x, _ in printed], [cell.printed_mm or 0.0 for _, cell in printed]
        bands = [abs(cell.band_mm[1] - cell.band_mm[0]) / 2 for _, cell in printed]
        axes.errorbar(x, values, bands, fmt="none", ecolor=colour, elinewidth=1.2, capsize=3, capthick=1.2)
        axes.plot(x, values, color=colour, **FRAME)
    return cells[-1].value_mm


def _fit(axes: Axes) -> None:
    """Some room to the sides; y begins at zero."""
    low, high = axes.dataLim.intervalx
    axes.set(xlim=(low - 0.06 * (high - low), high + 0.06 * (high - low)), ylim=(0, 1.06 * axes.dataLim.y1))
    axes.spines["left"].set_visible(True)


def _words(geometry: Geometry) -> str:
    return "fitted to the printed tables" if geometry.compared else "not compared with the printed tables"


def _explain_paper(page: Chart, geometry: Geometry, study: StudyPaper, top: float) -> None:
    ours = page.sample(marker="o", linestyle="", color=INK)
    marks = [(ours, f"tailstack, Monte Carlo, {study.trials:,} trials")]
    if geometry.compared:
        band = f"{100 * study.band:g} % band of {study.published_trials:,} trials and rounding"
        marks.append((page.sample(color=INK, **FRAME), f"printed, read as metres; bars: {band}"))
    page.explain(52, top + 10, marks)

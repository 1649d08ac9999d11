"""Every printed cell of S1-S4 beside ours, or the reason why nothing can stand beside it."""

from __future__ import annotations

from collections.abc import Sequence

from .paper_records import Geometry, PrintedCell
from .published import AXES, MM_PER_PRINTED_UNIT, TABLES

MEANS = (
    "where the point lies in the authors' frame, which is not printed; what can be predicted is by how much the two "
    "means differ"
)
ANALYTIC = "ours is first order in full; the printed column leaves a covariance out"
AT_REST = "zero in any geometry: shown, not counted"
BENCH = "a bench whose geometry, pivot, axes and trials are not stated, counted from L0: shown, not compared"
SPREAD = "the bench's noise, instrument and number of trials are not stated: no geometry gives it"


def printed_cells(geometries: Sequence[Geometry]) -> tuple[PrintedCell, ...]:
    """In the order of the tables, row by row."""
    found = []
    for table in ("S1", "S2", "S3", "S4"):
        for row, *texts in TABLES[table]["rows"]:
            for column, text in zip(TABLES[table]["columns"], texts, strict=True):
                if text is not None:
                    found.append(_cell(table, row, column, text, geometries))
    return tuple(found)


def _cell(table: str, row: str, column: str, text: str, geometries: Sequence[Geometry]) -> PrintedCell:
    lengths = table != "S4"
    return PrintedCell(
        table=table,  # type: ignore[arg-type]
        row=row,
        column=column,
        printed=text,
        value=round(float(text) * MM_PER_PRINTED_UNIT, 6) if lengths else float(text),
        unit="px" if column.endswith("_px") else "mm",
        ours=tuple(_OURS[table](geometry, row, column) for geometry in geometries),
        remark=_remark(table, row, column),
    )


def _remark(table: str, row: str, column: str) -> str:
    if table == "S2":
        return AT_REST if (row, column) == ("L0", "0 px") else ""
    if table == "S3":
        return MEANS if column.endswith("mean") else ANALYTIC if column == "analytic_std" else ""
    if table == "S4":
        return SPREAD if column in ("e_3d_std", "e_3d_p95") else BENCH
    return ""


def _of_s1(geometry: Geometry, row: str, column: str) -> float:
    quantity = "p95" if column.endswith("p95") else "mean"
    cell = next(cell for cell in geometry.cells if (cell.table, cell.row, cell.quantity) == ("S1", row, quantity))
    return cell.value_mm if column == "e_3d_mean" else cell.tcp_mm


def _of_s2(geometry: Geometry, row: str, column: str) -> float:
    return next(cell.tcp_mm for cell in geometry.cells if (cell.table, cell.row) == ("S2", f"{row}, {column}"))


def _of_s3(geometry: Geometry, row: str, column: str) -> float | None:
    axis = AXES.index(row)
    if column == "mc_std":
        return geometry.factor.monte_carlo_mm[axis]
    full = next(one for one in geometry.factor.propagations if one.name == "full")
    return full.std_mm[axis] if column == "analytic_std" else None


def _of_s4(geometry: Geometry, row: str, column: str) -> float | None:
    level = next(level for level in geometry.levels if level.level == row)
    return {"e_3d_mean": level.error_mm, "e_reprojection_mean_px": level.reprojection_kept_px}.get(column)


_OURS = {"S1": _of_s1, "S2": _of_s2, "S3": _of_s3, "S4": _of_s4}

"""What is handed to a supplier: beads and seats of a design as drawn, dimensioned, and nothing that was computed."""

from __future__ import annotations

from .operation import Csv, LateImport, Operation, Options, run_function

OPERATION = Operation(
    name="sheet",
    verb="report",
    path="/v1/sheets",
    summary="Sheet for the supplier: beads, seats, tolerances as drawn",
    description="Beads and seats of one design with their tolerances as drawn, the datum, and a dimensioned view where "
    "a report is asked for; text/csv is a file of fiducials. It holds no requirement, price or target.",
    title="sheet for the supplier: beads and seats with their tolerances as drawn",
    options=Options,
    record=LateImport("..report.chapters.supplier", "Sheet").load,
    run=run_function(LateImport("..report.chapters.supplier", "draw_up_sheet")),
    immediate=True,
    document=LateImport("..report.chapters.supplier", "sheet_document"),
    csv=Csv("bead", LateImport("..report.chapters.supplier", "sheet_csv")),
)

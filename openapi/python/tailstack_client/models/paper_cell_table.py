from typing import Literal

PaperCellTable = Literal["S1", "S2", "S3"]

PAPER_CELL_TABLE_VALUES: set[PaperCellTable] = {
    "S1",
    "S2",
    "S3",
}


def check_paper_cell_table(value: str) -> PaperCellTable:
    if value in PAPER_CELL_TABLE_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {PAPER_CELL_TABLE_VALUES!r}")

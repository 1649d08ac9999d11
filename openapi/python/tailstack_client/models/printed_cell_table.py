from typing import Literal

PrintedCellTable = Literal["S1", "S2", "S3", "S4"]

PRINTED_CELL_TABLE_VALUES: set[PrintedCellTable] = {
    "S1",
    "S2",
    "S3",
    "S4",
}


def check_printed_cell_table(value: str) -> PrintedCellTable:
    if value in PRINTED_CELL_TABLE_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {PRINTED_CELL_TABLE_VALUES!r}")

from typing import Literal

PrintedCellUnit = Literal["mm", "px"]

PRINTED_CELL_UNIT_VALUES: set[PrintedCellUnit] = {
    "mm",
    "px",
}


def check_printed_cell_unit(value: str) -> PrintedCellUnit:
    if value in PRINTED_CELL_UNIT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {PRINTED_CELL_UNIT_VALUES!r}")

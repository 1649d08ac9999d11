from typing import Literal

PaperCellQuantity = Literal["mean", "p95", "std_x", "std_y", "std_z"]

PAPER_CELL_QUANTITY_VALUES: set[PaperCellQuantity] = {
    "mean",
    "p95",
    "std_x",
    "std_y",
    "std_z",
}


def check_paper_cell_quantity(value: str) -> PaperCellQuantity:
    if value in PAPER_CELL_QUANTITY_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {PAPER_CELL_QUANTITY_VALUES!r}")

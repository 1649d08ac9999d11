from typing import Literal

StatementAbout = Literal["falling", "lever", "means", "repeat", "S4", "tail", "units", "zero"]

STATEMENT_ABOUT_VALUES: set[StatementAbout] = {
    "falling",
    "lever",
    "means",
    "repeat",
    "S4",
    "tail",
    "units",
    "zero",
}


def check_statement_about(value: str) -> StatementAbout:
    if value in STATEMENT_ABOUT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STATEMENT_ABOUT_VALUES!r}")

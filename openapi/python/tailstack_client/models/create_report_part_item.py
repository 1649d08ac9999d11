from typing import Literal

CreateReportPartItem = Literal["optimisation", "score", "verification"]

CREATE_REPORT_PART_ITEM_VALUES: set[CreateReportPartItem] = {
    "optimisation",
    "score",
    "verification",
}


def check_create_report_part_item(value: str) -> CreateReportPartItem:
    if value in CREATE_REPORT_PART_ITEM_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_REPORT_PART_ITEM_VALUES!r}")

from typing import Literal

ReportRequestPartsItem = Literal["optimisation", "score", "verification"]

REPORT_REQUEST_PARTS_ITEM_VALUES: set[ReportRequestPartsItem] = {
    "optimisation",
    "score",
    "verification",
}


def check_report_request_parts_item(value: str) -> ReportRequestPartsItem:
    if value in REPORT_REQUEST_PARTS_ITEM_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {REPORT_REQUEST_PARTS_ITEM_VALUES!r}")

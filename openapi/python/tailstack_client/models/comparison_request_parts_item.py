from typing import Literal

ComparisonRequestPartsItem = Literal["score", "verification"]

COMPARISON_REQUEST_PARTS_ITEM_VALUES: set[ComparisonRequestPartsItem] = {
    "score",
    "verification",
}


def check_comparison_request_parts_item(value: str) -> ComparisonRequestPartsItem:
    if value in COMPARISON_REQUEST_PARTS_ITEM_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {COMPARISON_REQUEST_PARTS_ITEM_VALUES!r}")

from typing import Literal

BatchRequestColumnsItem = Literal[
    "bias_norm_mm", "localisation_p95_mm", "mean_norm_mm", "p95_mm", "value_mm", "verdict", "within_limits"
]

BATCH_REQUEST_COLUMNS_ITEM_VALUES: set[BatchRequestColumnsItem] = {
    "bias_norm_mm",
    "localisation_p95_mm",
    "mean_norm_mm",
    "p95_mm",
    "value_mm",
    "verdict",
    "within_limits",
}


def check_batch_request_columns_item(value: str) -> BatchRequestColumnsItem:
    if value in BATCH_REQUEST_COLUMNS_ITEM_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {BATCH_REQUEST_COLUMNS_ITEM_VALUES!r}")

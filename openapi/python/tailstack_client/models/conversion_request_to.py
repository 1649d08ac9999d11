from typing import Literal

ConversionRequestTo = Literal["csv", "fcsv", "json", "mrk.json", "yaml"]

CONVERSION_REQUEST_TO_VALUES: set[ConversionRequestTo] = {
    "csv",
    "fcsv",
    "json",
    "mrk.json",
    "yaml",
}


def check_conversion_request_to(value: str) -> ConversionRequestTo:
    if value in CONVERSION_REQUEST_TO_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CONVERSION_REQUEST_TO_VALUES!r}")

from typing import Literal

ConversionRequestFormat = Literal["csv", "fcsv", "json", "mrk.json", "step", "yaml"]

CONVERSION_REQUEST_FORMAT_VALUES: set[ConversionRequestFormat] = {
    "csv",
    "fcsv",
    "json",
    "mrk.json",
    "step",
    "yaml",
}


def check_conversion_request_format(value: str) -> ConversionRequestFormat:
    if value in CONVERSION_REQUEST_FORMAT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CONVERSION_REQUEST_FORMAT_VALUES!r}")

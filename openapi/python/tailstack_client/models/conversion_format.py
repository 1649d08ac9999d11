from typing import Literal

ConversionFormat = Literal["csv", "fcsv", "json", "mrk.json", "yaml"]

CONVERSION_FORMAT_VALUES: set[ConversionFormat] = {
    "csv",
    "fcsv",
    "json",
    "mrk.json",
    "yaml",
}


def check_conversion_format(value: str) -> ConversionFormat:
    if value in CONVERSION_FORMAT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CONVERSION_FORMAT_VALUES!r}")

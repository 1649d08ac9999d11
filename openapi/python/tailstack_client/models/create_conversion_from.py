from typing import Literal

CreateConversionFrom = Literal["csv", "fcsv", "json", "mrk.json", "yaml"]

CREATE_CONVERSION_FROM_VALUES: set[CreateConversionFrom] = {
    "csv",
    "fcsv",
    "json",
    "mrk.json",
    "yaml",
}


def check_create_conversion_from(value: str) -> CreateConversionFrom:
    if value in CREATE_CONVERSION_FROM_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_CONVERSION_FROM_VALUES!r}")

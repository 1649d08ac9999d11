from typing import Literal

CreateConversionTo = Literal["csv", "fcsv", "json", "mrk.json", "yaml"]

CREATE_CONVERSION_TO_VALUES: set[CreateConversionTo] = {
    "csv",
    "fcsv",
    "json",
    "mrk.json",
    "yaml",
}


def check_create_conversion_to(value: str) -> CreateConversionTo:
    if value in CREATE_CONVERSION_TO_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_CONVERSION_TO_VALUES!r}")

from typing import Literal

MeasuredFileForm = Literal["norms", "points", "summary", "vectors"]

MEASURED_FILE_FORM_VALUES: set[MeasuredFileForm] = {
    "norms",
    "points",
    "summary",
    "vectors",
}


def check_measured_file_form(value: str) -> MeasuredFileForm:
    if value in MEASURED_FILE_FORM_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {MEASURED_FILE_FORM_VALUES!r}")

from typing import Literal

GetReportFormat = Literal["html", "json", "pdf", "xlsx"]

GET_REPORT_FORMAT_VALUES: set[GetReportFormat] = {
    "html",
    "json",
    "pdf",
    "xlsx",
}


def check_get_report_format(value: str) -> GetReportFormat:
    if value in GET_REPORT_FORMAT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GET_REPORT_FORMAT_VALUES!r}")

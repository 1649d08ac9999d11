from typing import Literal

GetSchemaDraft = Literal["2020-12", "7"]

GET_SCHEMA_DRAFT_VALUES: set[GetSchemaDraft] = {
    "2020-12",
    "7",
}


def check_get_schema_draft(value: str) -> GetSchemaDraft:
    if value in GET_SCHEMA_DRAFT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GET_SCHEMA_DRAFT_VALUES!r}")

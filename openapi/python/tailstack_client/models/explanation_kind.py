from typing import Literal

ExplanationKind = Literal["factor", "value"]

EXPLANATION_KIND_VALUES: set[ExplanationKind] = {
    "factor",
    "value",
}


def check_explanation_kind(value: str) -> ExplanationKind:
    if value in EXPLANATION_KIND_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {EXPLANATION_KIND_VALUES!r}")

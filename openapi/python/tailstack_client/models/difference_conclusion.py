from typing import Literal

DifferenceConclusion = Literal["computed", "larger", "not decided", "smaller"]

DIFFERENCE_CONCLUSION_VALUES: set[DifferenceConclusion] = {
    "computed",
    "larger",
    "not decided",
    "smaller",
}


def check_difference_conclusion(value: str) -> DifferenceConclusion:
    if value in DIFFERENCE_CONCLUSION_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {DIFFERENCE_CONCLUSION_VALUES!r}")

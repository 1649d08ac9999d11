from typing import Literal

ComparisonTestSides = Literal["both", "upper"]

COMPARISON_TEST_SIDES_VALUES: set[ComparisonTestSides] = {
    "both",
    "upper",
}


def check_comparison_test_sides(value: str) -> ComparisonTestSides:
    if value in COMPARISON_TEST_SIDES_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {COMPARISON_TEST_SIDES_VALUES!r}")

from typing import Literal

ComparisonTestTest = Literal["between installations", "mean", "spread", "tail"]

COMPARISON_TEST_TEST_VALUES: set[ComparisonTestTest] = {
    "between installations",
    "mean",
    "spread",
    "tail",
}


def check_comparison_test_test(value: str) -> ComparisonTestTest:
    if value in COMPARISON_TEST_TEST_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {COMPARISON_TEST_TEST_VALUES!r}")

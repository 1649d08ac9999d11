from typing import Literal

StudyComparisonVerdict = Literal["agrees", "differs", "not testable"]

STUDY_COMPARISON_VERDICT_VALUES: set[StudyComparisonVerdict] = {
    "agrees",
    "differs",
    "not testable",
}


def check_study_comparison_verdict(value: str) -> StudyComparisonVerdict:
    if value in STUDY_COMPARISON_VERDICT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_COMPARISON_VERDICT_VALUES!r}")

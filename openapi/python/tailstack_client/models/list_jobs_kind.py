from typing import Literal

ListJobsKind = Literal[
    "batch",
    "comparison",
    "gate",
    "optimisation",
    "report",
    "study-comparison",
    "study-coupling",
    "study-estimators",
    "study-linearity",
    "study-paper",
    "study-views",
    "sweep",
    "verification",
]

LIST_JOBS_KIND_VALUES: set[ListJobsKind] = {
    "batch",
    "comparison",
    "gate",
    "optimisation",
    "report",
    "study-comparison",
    "study-coupling",
    "study-estimators",
    "study-linearity",
    "study-paper",
    "study-views",
    "sweep",
    "verification",
}


def check_list_jobs_kind(value: str) -> ListJobsKind:
    if value in LIST_JOBS_KIND_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {LIST_JOBS_KIND_VALUES!r}")

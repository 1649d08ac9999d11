from typing import Literal

JobKind = Literal[
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

JOB_KIND_VALUES: set[JobKind] = {
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


def check_job_kind(value: str) -> JobKind:
    if value in JOB_KIND_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {JOB_KIND_VALUES!r}")

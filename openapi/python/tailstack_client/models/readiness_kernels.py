from typing import Literal

ReadinessKernels = Literal["failed", "ready", "warming up"]

READINESS_KERNELS_VALUES: set[ReadinessKernels] = {
    "failed",
    "ready",
    "warming up",
}


def check_readiness_kernels(value: str) -> ReadinessKernels:
    if value in READINESS_KERNELS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {READINESS_KERNELS_VALUES!r}")

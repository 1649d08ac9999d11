from typing import Literal

BiasComparedIntervalOf = Literal["installations of this kind", "this installation"]

BIAS_COMPARED_INTERVAL_OF_VALUES: set[BiasComparedIntervalOf] = {
    "installations of this kind",
    "this installation",
}


def check_bias_compared_interval_of(value: str) -> BiasComparedIntervalOf:
    if value in BIAS_COMPARED_INTERVAL_OF_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {BIAS_COMPARED_INTERVAL_OF_VALUES!r}")

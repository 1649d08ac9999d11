from typing import Literal

CreateGateOnInconclusive = Literal["fail", "warn"]

CREATE_GATE_ON_INCONCLUSIVE_VALUES: set[CreateGateOnInconclusive] = {
    "fail",
    "warn",
}


def check_create_gate_on_inconclusive(value: str) -> CreateGateOnInconclusive:
    if value in CREATE_GATE_ON_INCONCLUSIVE_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_GATE_ON_INCONCLUSIVE_VALUES!r}")

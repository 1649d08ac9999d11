from typing import Literal

GateRequestOnInconclusiveType0 = Literal["fail", "warn"]

GATE_REQUEST_ON_INCONCLUSIVE_TYPE_0_VALUES: set[GateRequestOnInconclusiveType0] = {
    "fail",
    "warn",
}


def check_gate_request_on_inconclusive_type_0(value: str) -> GateRequestOnInconclusiveType0:
    if value in GATE_REQUEST_ON_INCONCLUSIVE_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_REQUEST_ON_INCONCLUSIVE_TYPE_0_VALUES!r}")

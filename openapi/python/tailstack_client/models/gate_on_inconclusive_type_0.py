from typing import Literal

GateOnInconclusiveType0 = Literal["fail", "warn"]

GATE_ON_INCONCLUSIVE_TYPE_0_VALUES: set[GateOnInconclusiveType0] = {
    "fail",
    "warn",
}


def check_gate_on_inconclusive_type_0(value: str) -> GateOnInconclusiveType0:
    if value in GATE_ON_INCONCLUSIVE_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_ON_INCONCLUSIVE_TYPE_0_VALUES!r}")

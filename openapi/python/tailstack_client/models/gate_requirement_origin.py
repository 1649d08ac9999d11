from typing import Literal

GateRequirementOrigin = Literal["design", "policy"]

GATE_REQUIREMENT_ORIGIN_VALUES: set[GateRequirementOrigin] = {
    "design",
    "policy",
}


def check_gate_requirement_origin(value: str) -> GateRequirementOrigin:
    if value in GATE_REQUIREMENT_ORIGIN_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_REQUIREMENT_ORIGIN_VALUES!r}")

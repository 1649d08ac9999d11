from typing import Literal

GateFindingSeverity = Literal["error", "note", "warning"]

GATE_FINDING_SEVERITY_VALUES: set[GateFindingSeverity] = {
    "error",
    "note",
    "warning",
}


def check_gate_finding_severity(value: str) -> GateFindingSeverity:
    if value in GATE_FINDING_SEVERITY_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_FINDING_SEVERITY_VALUES!r}")

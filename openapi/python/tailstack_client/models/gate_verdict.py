from typing import Literal

GateVerdict = Literal["fail", "inconclusive", "not evaluated", "pass"]

GATE_VERDICT_VALUES: set[GateVerdict] = {
    "fail",
    "inconclusive",
    "not evaluated",
    "pass",
}


def check_gate_verdict(value: str) -> GateVerdict:
    if value in GATE_VERDICT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_VERDICT_VALUES!r}")

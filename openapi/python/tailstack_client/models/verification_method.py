from typing import Literal

VerificationMethod = Literal["plain", "radial"]

VERIFICATION_METHOD_VALUES: set[VerificationMethod] = {
    "plain",
    "radial",
}


def check_verification_method(value: str) -> VerificationMethod:
    if value in VERIFICATION_METHOD_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {VERIFICATION_METHOD_VALUES!r}")

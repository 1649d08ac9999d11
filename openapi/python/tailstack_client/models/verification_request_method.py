from typing import Literal

VerificationRequestMethod = Literal["plain", "radial"]

VERIFICATION_REQUEST_METHOD_VALUES: set[VerificationRequestMethod] = {
    "plain",
    "radial",
}


def check_verification_request_method(value: str) -> VerificationRequestMethod:
    if value in VERIFICATION_REQUEST_METHOD_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {VERIFICATION_REQUEST_METHOD_VALUES!r}")

from typing import Literal

CreateVerificationMethod = Literal["plain", "radial"]

CREATE_VERIFICATION_METHOD_VALUES: set[CreateVerificationMethod] = {
    "plain",
    "radial",
}


def check_create_verification_method(value: str) -> CreateVerificationMethod:
    if value in CREATE_VERIFICATION_METHOD_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_VERIFICATION_METHOD_VALUES!r}")

from typing import Literal

ConversionRequestXmalabType0 = Literal["cm", "mm"]

CONVERSION_REQUEST_XMALAB_TYPE_0_VALUES: set[ConversionRequestXmalabType0] = {
    "cm",
    "mm",
}


def check_conversion_request_xmalab_type_0(value: str) -> ConversionRequestXmalabType0:
    if value in CONVERSION_REQUEST_XMALAB_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CONVERSION_REQUEST_XMALAB_TYPE_0_VALUES!r}")

from typing import Literal

SecondOrderStatus = Literal["applied", "not requested", "refused"]

SECOND_ORDER_STATUS_VALUES: set[SecondOrderStatus] = {
    "applied",
    "not requested",
    "refused",
}


def check_second_order_status(value: str) -> SecondOrderStatus:
    if value in SECOND_ORDER_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {SECOND_ORDER_STATUS_VALUES!r}")

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.linearity_point_errs_type_0 import check_linearity_point_errs_type_0
from ..models.linearity_point_errs_type_0 import LinearityPointErrsType0
from ..models.linearity_point_status import check_linearity_point_status
from ..models.linearity_point_status import LinearityPointStatus
from ..models.linearity_point_within_type_0 import check_linearity_point_within_type_0
from ..models.linearity_point_within_type_0 import LinearityPointWithinType0
from typing import cast


T = TypeVar("T", bound="LinearityPoint")


@_attrs_define
class LinearityPoint:
    """One point of the grid.

    Attributes:
        noise_px (float): Noise of every image coordinate, fiducials and targets, px.
        rotation_deg (float): Standard deviation of each random rotation of the structure's mount, deg.
        spread (float): Factor on the layout about its centroid.
        fiducials (int): Number of fiducials.
        status (LinearityPointStatus): refused: this point could not be computed.
        reason (None | str): Why it was refused; otherwise null.
        nu (float | None): Validity number; null where it was refused.
        promise (None | str): What the validity statement says: good to 1 % ...; null where it was refused.
        promised_percent (float | None): Relative error of P95 that it promises, %; null where it says that first order
            is not valid.
        first_order_p95_mm (float | None): First-order P95, mm; null where it was refused.
        second_order_p95_mm (float | None): Second-order P95, mm; null where there is none.
        second_order_reason (None | str): Why there is none; otherwise null.
        monte_carlo_p95_mm (float | None): Sampled P95, mm; null where it was refused.
        ratio (float | None): First order over Monte Carlo; null where it was refused.
        ratio_interval (list[float] | None): Confidence interval of that ratio; null where it was refused.
        second_order_ratio (float | None): Second order over Monte Carlo; null where there is none.
        within (LinearityPointWithinType0 | None): How far first order is from Monte Carlo, by the ratio; null where it
            was refused.
        sure (bool | None): Whether the whole interval says the same; null where it was refused.
        trials (int | None): Trials drawn: an eighth of them where first order is plainly beyond all levels; null where
            it was refused.
        errs (LinearityPointErrsType0 | None): On which side first order errs, by the whole interval; null where it was
            refused.
    """

    noise_px: float
    rotation_deg: float
    spread: float
    fiducials: int
    status: LinearityPointStatus
    reason: None | str
    nu: float | None
    promise: None | str
    promised_percent: float | None
    first_order_p95_mm: float | None
    second_order_p95_mm: float | None
    second_order_reason: None | str
    monte_carlo_p95_mm: float | None
    ratio: float | None
    ratio_interval: list[float] | None
    second_order_ratio: float | None
    within: LinearityPointWithinType0 | None
    sure: bool | None
    trials: int | None
    errs: LinearityPointErrsType0 | None

    def to_dict(self) -> dict[str, Any]:
        noise_px = self.noise_px

        rotation_deg = self.rotation_deg

        spread = self.spread

        fiducials = self.fiducials

        status: str = self.status

        reason: None | str
        reason = self.reason

        nu: float | None
        nu = self.nu

        promise: None | str
        promise = self.promise

        promised_percent: float | None
        promised_percent = self.promised_percent

        first_order_p95_mm: float | None
        first_order_p95_mm = self.first_order_p95_mm

        second_order_p95_mm: float | None
        second_order_p95_mm = self.second_order_p95_mm

        second_order_reason: None | str
        second_order_reason = self.second_order_reason

        monte_carlo_p95_mm: float | None
        monte_carlo_p95_mm = self.monte_carlo_p95_mm

        ratio: float | None
        ratio = self.ratio

        ratio_interval: list[float] | None
        if isinstance(self.ratio_interval, list):
            ratio_interval = []
            for ratio_interval_type_0_item_data in self.ratio_interval:
                ratio_interval_type_0_item: float
                ratio_interval_type_0_item = ratio_interval_type_0_item_data
                ratio_interval.append(ratio_interval_type_0_item)

        else:
            ratio_interval = self.ratio_interval

        second_order_ratio: float | None
        second_order_ratio = self.second_order_ratio

        within: None | str
        if isinstance(self.within, str):
            within = self.within
        else:
            within = self.within

        sure: bool | None
        sure = self.sure

        trials: int | None
        trials = self.trials

        errs: None | str
        if isinstance(self.errs, str):
            errs = self.errs
        else:
            errs = self.errs

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "noise_px": noise_px,
                "rotation_deg": rotation_deg,
                "spread": spread,
                "fiducials": fiducials,
                "status": status,
                "reason": reason,
                "nu": nu,
                "promise": promise,
                "promised_percent": promised_percent,
                "first_order_p95_mm": first_order_p95_mm,
                "second_order_p95_mm": second_order_p95_mm,
                "second_order_reason": second_order_reason,
                "monte_carlo_p95_mm": monte_carlo_p95_mm,
                "ratio": ratio,
                "ratio_interval": ratio_interval,
                "second_order_ratio": second_order_ratio,
                "within": within,
                "sure": sure,
                "trials": trials,
                "errs": errs,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        noise_px = d.pop("noise_px")

        rotation_deg = d.pop("rotation_deg")

        spread = d.pop("spread")

        fiducials = d.pop("fiducials")

        status = check_linearity_point_status(d.pop("status"))

        def _parse_reason(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        reason = _parse_reason(d.pop("reason"))

        def _parse_nu(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        nu = _parse_nu(d.pop("nu"))

        def _parse_promise(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        promise = _parse_promise(d.pop("promise"))

        def _parse_promised_percent(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        promised_percent = _parse_promised_percent(d.pop("promised_percent"))

        def _parse_first_order_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        first_order_p95_mm = _parse_first_order_p95_mm(d.pop("first_order_p95_mm"))

        def _parse_second_order_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        second_order_p95_mm = _parse_second_order_p95_mm(d.pop("second_order_p95_mm"))

        def _parse_second_order_reason(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        second_order_reason = _parse_second_order_reason(d.pop("second_order_reason"))

        def _parse_monte_carlo_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        monte_carlo_p95_mm = _parse_monte_carlo_p95_mm(d.pop("monte_carlo_p95_mm"))

        def _parse_ratio(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        ratio = _parse_ratio(d.pop("ratio"))

        def _parse_ratio_interval(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                ratio_interval_type_0 = []
                _ratio_interval_type_0 = data
                for ratio_interval_type_0_item_data in _ratio_interval_type_0:

                    def _parse_ratio_interval_type_0_item(data: object) -> float:
                        return cast(float, data)

                    ratio_interval_type_0_item = _parse_ratio_interval_type_0_item(ratio_interval_type_0_item_data)

                    ratio_interval_type_0.append(ratio_interval_type_0_item)

                return ratio_interval_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        ratio_interval = _parse_ratio_interval(d.pop("ratio_interval"))

        def _parse_second_order_ratio(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        second_order_ratio = _parse_second_order_ratio(d.pop("second_order_ratio"))

        def _parse_within(data: object) -> LinearityPointWithinType0 | None:
            if data is None:
                return data
            try:
                if not isinstance(data, str):
                    raise TypeError()
                within_type_0 = check_linearity_point_within_type_0(data)

                return within_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(LinearityPointWithinType0 | None, data)

        within = _parse_within(d.pop("within"))

        def _parse_sure(data: object) -> bool | None:
            if data is None:
                return data
            return cast(bool | None, data)

        sure = _parse_sure(d.pop("sure"))

        def _parse_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        trials = _parse_trials(d.pop("trials"))

        def _parse_errs(data: object) -> LinearityPointErrsType0 | None:
            if data is None:
                return data
            try:
                if not isinstance(data, str):
                    raise TypeError()
                errs_type_0 = check_linearity_point_errs_type_0(data)

                return errs_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(LinearityPointErrsType0 | None, data)

        errs = _parse_errs(d.pop("errs"))

        linearity_point = cls(
            noise_px=noise_px,
            rotation_deg=rotation_deg,
            spread=spread,
            fiducials=fiducials,
            status=status,
            reason=reason,
            nu=nu,
            promise=promise,
            promised_percent=promised_percent,
            first_order_p95_mm=first_order_p95_mm,
            second_order_p95_mm=second_order_p95_mm,
            second_order_reason=second_order_reason,
            monte_carlo_p95_mm=monte_carlo_p95_mm,
            ratio=ratio,
            ratio_interval=ratio_interval,
            second_order_ratio=second_order_ratio,
            within=within,
            sure=sure,
            trials=trials,
            errs=errs,
        )

        return linearity_point

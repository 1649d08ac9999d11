from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.verification_request_method import check_verification_request_method
from ..models.verification_request_method import VerificationRequestMethod
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design


T = TypeVar("T", bound="VerificationRequest")


@_attrs_define
class VerificationRequest:
    """
    Attributes:
        design (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        trials (int | None | Unset): Number of trials. Either this or precision; neither: the solver's own precision.
        precision (float | None | Unset): Half-width of the confidence interval of P95, relative, at which sampling
            stops.
        seed (int | Unset): Seed; one seed is one answer, whatever workers and threads. Default: 0.
        method (VerificationRequestMethod | Unset): plain: order statistics of the trials. radial: conditional on the
            direction. Default: 'plain'.
    """

    design: Design
    trials: int | None | Unset = UNSET
    precision: float | None | Unset = UNSET
    seed: int | Unset = 0
    method: VerificationRequestMethod | Unset = "plain"

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415

        design = self.design.to_dict()

        trials: int | None | Unset
        if isinstance(self.trials, Unset):
            trials = UNSET
        else:
            trials = self.trials

        precision: float | None | Unset
        if isinstance(self.precision, Unset):
            precision = UNSET
        else:
            precision = self.precision

        seed = self.seed

        method: str | Unset = UNSET
        if not isinstance(self.method, Unset):
            method = self.method

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "design": design,
            }
        )
        if trials is not UNSET:
            field_dict["trials"] = trials
        if precision is not UNSET:
            field_dict["precision"] = precision
        if seed is not UNSET:
            field_dict["seed"] = seed
        if method is not UNSET:
            field_dict["method"] = method

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.design import Design  # noqa: PLC0415

        d = dict(src_dict)
        design = Design.from_dict(d.pop("design"))

        def _parse_trials(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        trials = _parse_trials(d.pop("trials", UNSET))

        def _parse_precision(data: object) -> float | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(float | None | Unset, data)

        precision = _parse_precision(d.pop("precision", UNSET))

        seed = d.pop("seed", UNSET)

        _method = d.pop("method", UNSET)
        method: VerificationRequestMethod | Unset
        if isinstance(_method, Unset):
            method = UNSET
        else:
            method = check_verification_request_method(_method)

        verification_request = cls(
            design=design,
            trials=trials,
            precision=precision,
            seed=seed,
            method=method,
        )

        return verification_request

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.loss import Loss
    from ..models.mixture import Mixture


T = TypeVar("T", bound="Losses")


@_attrs_define
class Losses:
    """What the loss of fiducials in all views does to one requirement, or to P95 where the design has none.

    Attributes:
        requirement (str): Name of the requirement; empty where the design has none and P95 of the error at the tool is
            meant.
        limit_mm (float | None): Its limit, mm; null where the design has none.
        value_mm (float): What it limits, with all fiducials and at the worst of its targets, mm.
        single (Loss): The worst of all ways to lose some fiducials.
        double (Loss | None): The worst loss of two; null where there are too many fiducials to try every pair.
        mixture (Mixture | None): What it comes to over shots with and without losses; null where the design states no
            probability of a loss.
    """

    requirement: str
    limit_mm: float | None
    value_mm: float
    single: Loss
    double: Loss | None
    mixture: Mixture | None

    def to_dict(self) -> dict[str, Any]:
        from ..models.loss import Loss  # noqa: PLC0415
        from ..models.mixture import Mixture  # noqa: PLC0415

        requirement = self.requirement

        limit_mm: float | None
        limit_mm = self.limit_mm

        value_mm = self.value_mm

        single = self.single.to_dict()

        double: dict[str, Any] | None
        if isinstance(self.double, Loss):
            double = self.double.to_dict()
        else:
            double = self.double

        mixture: dict[str, Any] | None
        if isinstance(self.mixture, Mixture):
            mixture = self.mixture.to_dict()
        else:
            mixture = self.mixture

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "requirement": requirement,
                "limit_mm": limit_mm,
                "value_mm": value_mm,
                "single": single,
                "double": double,
                "mixture": mixture,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.loss import Loss  # noqa: PLC0415
        from ..models.mixture import Mixture  # noqa: PLC0415

        d = dict(src_dict)
        requirement = d.pop("requirement")

        def _parse_limit_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        limit_mm = _parse_limit_mm(d.pop("limit_mm"))

        value_mm = d.pop("value_mm")

        single = Loss.from_dict(d.pop("single"))

        def _parse_double(data: object) -> Loss | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                double_type_0 = Loss.from_dict(data)

                return double_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(Loss | None, data)

        double = _parse_double(d.pop("double"))

        def _parse_mixture(data: object) -> Mixture | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                mixture_type_0 = Mixture.from_dict(data)

                return mixture_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(Mixture | None, data)

        mixture = _parse_mixture(d.pop("mixture"))

        losses = cls(
            requirement=requirement,
            limit_mm=limit_mm,
            value_mm=value_mm,
            single=single,
            double=double,
            mixture=mixture,
        )

        return losses

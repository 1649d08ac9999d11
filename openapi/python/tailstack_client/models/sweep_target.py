from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="SweepTarget")


@_attrs_define
class SweepTarget:
    """What was found at one target of one point: the TCP error.

    Attributes:
        name (str): Name of the target, or of one sample of a region (zone[3]).
        p95_mm (float): 95 % quantile of the TCP error's norm, mm.
        p95_interval_mm (list[float] | None): Confidence interval of it by Monte Carlo, mm; null for scores.
        mean_norm_mm (float): Mean of the TCP error's norm, mm.
        bias_norm_mm (float): Norm of the mean TCP error, mm.
        localisation_p95_mm (float): 95 % quantile of the localisation error's norm, mm.
    """

    name: str
    p95_mm: float
    p95_interval_mm: list[float] | None
    mean_norm_mm: float
    bias_norm_mm: float
    localisation_p95_mm: float

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        p95_mm = self.p95_mm

        p95_interval_mm: list[float] | None
        if isinstance(self.p95_interval_mm, list):
            p95_interval_mm = []
            for p95_interval_mm_type_0_item_data in self.p95_interval_mm:
                p95_interval_mm_type_0_item: float
                p95_interval_mm_type_0_item = p95_interval_mm_type_0_item_data
                p95_interval_mm.append(p95_interval_mm_type_0_item)

        else:
            p95_interval_mm = self.p95_interval_mm

        mean_norm_mm = self.mean_norm_mm

        bias_norm_mm = self.bias_norm_mm

        localisation_p95_mm = self.localisation_p95_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "p95_mm": p95_mm,
                "p95_interval_mm": p95_interval_mm,
                "mean_norm_mm": mean_norm_mm,
                "bias_norm_mm": bias_norm_mm,
                "localisation_p95_mm": localisation_p95_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        p95_mm = d.pop("p95_mm")

        def _parse_p95_interval_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                p95_interval_mm_type_0 = []
                _p95_interval_mm_type_0 = data
                for p95_interval_mm_type_0_item_data in _p95_interval_mm_type_0:

                    def _parse_p95_interval_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    p95_interval_mm_type_0_item = _parse_p95_interval_mm_type_0_item(p95_interval_mm_type_0_item_data)

                    p95_interval_mm_type_0.append(p95_interval_mm_type_0_item)

                return p95_interval_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        p95_interval_mm = _parse_p95_interval_mm(d.pop("p95_interval_mm"))

        mean_norm_mm = d.pop("mean_norm_mm")

        bias_norm_mm = d.pop("bias_norm_mm")

        localisation_p95_mm = d.pop("localisation_p95_mm")

        sweep_target = cls(
            name=name,
            p95_mm=p95_mm,
            p95_interval_mm=p95_interval_mm,
            mean_norm_mm=mean_norm_mm,
            bias_norm_mm=bias_norm_mm,
            localisation_p95_mm=localisation_p95_mm,
        )

        return sweep_target

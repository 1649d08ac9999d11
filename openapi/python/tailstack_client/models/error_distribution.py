from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ErrorDistribution")


@_attrs_define
class ErrorDistribution:
    """TCP error at one target: shares of shots by bins of the error's norm, sampled and by the first-order law.

    Attributes:
        target (str): Name of the target.
        edges_mm (list[float]): Edges of n bins of the error's norm, n + 1 numbers, mm.
        sampled (list[float] | None): Share of sampled shots in each bin; what is beyond the last edge is in none. Null:
            nothing was drawn.
        first_order (list[float]): Share of shots in each bin by the first-order law.
        trials (int | None): Sampled shots; null: nothing was drawn.
    """

    target: str
    edges_mm: list[float]
    sampled: list[float] | None
    first_order: list[float]
    trials: int | None

    def to_dict(self) -> dict[str, Any]:
        target = self.target

        edges_mm = self.edges_mm

        sampled: list[float] | None
        if isinstance(self.sampled, list):
            sampled = self.sampled

        else:
            sampled = self.sampled

        first_order = self.first_order

        trials: int | None
        trials = self.trials

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "target": target,
                "edges_mm": edges_mm,
                "sampled": sampled,
                "first_order": first_order,
                "trials": trials,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        target = d.pop("target")

        edges_mm = cast(list[float], d.pop("edges_mm"))

        def _parse_sampled(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                sampled_type_0 = cast(list[float], data)

                return sampled_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        sampled = _parse_sampled(d.pop("sampled"))

        first_order = cast(list[float], d.pop("first_order"))

        def _parse_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        trials = _parse_trials(d.pop("trials"))

        error_distribution = cls(
            target=target,
            edges_mm=edges_mm,
            sampled=sampled,
            first_order=first_order,
            trials=trials,
        )

        return error_distribution

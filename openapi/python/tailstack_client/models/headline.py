from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.headline_status import check_headline_status
from ..models.headline_status import HeadlineStatus
from typing import cast


T = TypeVar("T", bound="Headline")


@_attrs_define
class Headline:
    """The first page: what a project lead needs to know.

    Attributes:
        status (HeadlineStatus): The verdict.
        basis (str): What it rests on: first order or Monte Carlo.
        sentence (str): The verdict with its numbers, in a sentence.
        requirement (None | str): Requirement of the check that decides; null without requirement.
        target (str): Target of the check that decides.
        quantile (float): Quantile of the error's norm, 0.95 for P95.
        value_mm (float): The value that decides, mm.
        interval_mm (list[float | None]): Its lower and upper end, mm; a null upper end is not known.
        limit_mm (float | None): The limit, mm; null without requirement.
        matters (list[str]): What matters most, at most three sentences.
        error (str): Error that decides: tcp (at the tool) or localisation (of the target). Default: 'tcp'.
        min_yield (float | None): Fraction of units that must keep the limit; null: the risk is pooled.
        headline (str): What the value is, in words: "P95 that 90 % of units keep". Default: ''.
        margin_mm (float | None): Limit less the upper end of the interval, mm; null where one of them is not known.
    """

    status: HeadlineStatus
    basis: str
    sentence: str
    requirement: None | str
    target: str
    quantile: float
    value_mm: float
    interval_mm: list[float | None]
    limit_mm: float | None
    matters: list[str]
    min_yield: float | None
    margin_mm: float | None
    error: str = "tcp"
    headline: str = ""

    def to_dict(self) -> dict[str, Any]:
        status: str = self.status

        basis = self.basis

        sentence = self.sentence

        requirement: None | str
        requirement = self.requirement

        target = self.target

        quantile = self.quantile

        value_mm = self.value_mm

        interval_mm = []
        for interval_mm_item_data in self.interval_mm:
            interval_mm_item: float | None
            interval_mm_item = interval_mm_item_data
            interval_mm.append(interval_mm_item)

        limit_mm: float | None
        limit_mm = self.limit_mm

        matters = self.matters

        error = self.error

        min_yield: float | None
        min_yield = self.min_yield

        headline = self.headline

        margin_mm: float | None
        margin_mm = self.margin_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "status": status,
                "basis": basis,
                "sentence": sentence,
                "requirement": requirement,
                "target": target,
                "quantile": quantile,
                "value_mm": value_mm,
                "interval_mm": interval_mm,
                "limit_mm": limit_mm,
                "matters": matters,
                "error": error,
                "min_yield": min_yield,
                "headline": headline,
                "margin_mm": margin_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        status = check_headline_status(d.pop("status"))

        basis = d.pop("basis")

        sentence = d.pop("sentence")

        def _parse_requirement(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        requirement = _parse_requirement(d.pop("requirement"))

        target = d.pop("target")

        quantile = d.pop("quantile")

        value_mm = d.pop("value_mm")

        interval_mm = []
        _interval_mm = d.pop("interval_mm")
        for interval_mm_item_data in _interval_mm:

            def _parse_interval_mm_item(data: object) -> float | None:
                if data is None:
                    return data
                return cast(float | None, data)

            interval_mm_item = _parse_interval_mm_item(interval_mm_item_data)

            interval_mm.append(interval_mm_item)

        def _parse_limit_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        limit_mm = _parse_limit_mm(d.pop("limit_mm"))

        matters = cast(list[str], d.pop("matters"))

        error = d.pop("error")

        def _parse_min_yield(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        min_yield = _parse_min_yield(d.pop("min_yield"))

        headline = d.pop("headline")

        def _parse_margin_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        margin_mm = _parse_margin_mm(d.pop("margin_mm"))

        headline = cls(
            status=status,
            basis=basis,
            sentence=sentence,
            requirement=requirement,
            target=target,
            quantile=quantile,
            value_mm=value_mm,
            interval_mm=interval_mm,
            limit_mm=limit_mm,
            matters=matters,
            error=error,
            min_yield=min_yield,
            headline=headline,
            margin_mm=margin_mm,
        )

        return headline

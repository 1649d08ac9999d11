from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Propagation")


@_attrs_define
class Propagation:
    """Standard deviations at S3's noise, propagated one way.

    Attributes:
        name (str): Name of this way of propagating.
        sentence (str): What it leaves out, in a sentence.
        std_mm (list[float]): Standard deviations along x, y, z of con, mm.
        over_monte_carlo (list[float]): Their ratio to Monte Carlo's, along x, y, z.
        printed_difference_mm (list[float] | None): Their difference from the printed analytic column, mm; null where
            nothing is printed.
        reproduces_printed (bool | None): Whether that is within the rounding on all three axes; null where nothing is
            printed.
    """

    name: str
    sentence: str
    std_mm: list[float]
    over_monte_carlo: list[float]
    printed_difference_mm: list[float] | None
    reproduces_printed: bool | None

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        sentence = self.sentence

        std_mm = []
        for std_mm_item_data in self.std_mm:
            std_mm_item: float
            std_mm_item = std_mm_item_data
            std_mm.append(std_mm_item)

        over_monte_carlo = []
        for over_monte_carlo_item_data in self.over_monte_carlo:
            over_monte_carlo_item: float
            over_monte_carlo_item = over_monte_carlo_item_data
            over_monte_carlo.append(over_monte_carlo_item)

        printed_difference_mm: list[float] | None
        if isinstance(self.printed_difference_mm, list):
            printed_difference_mm = []
            for printed_difference_mm_type_0_item_data in self.printed_difference_mm:
                printed_difference_mm_type_0_item: float
                printed_difference_mm_type_0_item = printed_difference_mm_type_0_item_data
                printed_difference_mm.append(printed_difference_mm_type_0_item)

        else:
            printed_difference_mm = self.printed_difference_mm

        reproduces_printed: bool | None
        reproduces_printed = self.reproduces_printed

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "sentence": sentence,
                "std_mm": std_mm,
                "over_monte_carlo": over_monte_carlo,
                "printed_difference_mm": printed_difference_mm,
                "reproduces_printed": reproduces_printed,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        sentence = d.pop("sentence")

        std_mm = []
        _std_mm = d.pop("std_mm")
        for std_mm_item_data in _std_mm:

            def _parse_std_mm_item(data: object) -> float:
                return cast(float, data)

            std_mm_item = _parse_std_mm_item(std_mm_item_data)

            std_mm.append(std_mm_item)

        over_monte_carlo = []
        _over_monte_carlo = d.pop("over_monte_carlo")
        for over_monte_carlo_item_data in _over_monte_carlo:

            def _parse_over_monte_carlo_item(data: object) -> float:
                return cast(float, data)

            over_monte_carlo_item = _parse_over_monte_carlo_item(over_monte_carlo_item_data)

            over_monte_carlo.append(over_monte_carlo_item)

        def _parse_printed_difference_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                printed_difference_mm_type_0 = []
                _printed_difference_mm_type_0 = data
                for printed_difference_mm_type_0_item_data in _printed_difference_mm_type_0:

                    def _parse_printed_difference_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    printed_difference_mm_type_0_item = _parse_printed_difference_mm_type_0_item(
                        printed_difference_mm_type_0_item_data
                    )

                    printed_difference_mm_type_0.append(printed_difference_mm_type_0_item)

                return printed_difference_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        printed_difference_mm = _parse_printed_difference_mm(d.pop("printed_difference_mm"))

        def _parse_reproduces_printed(data: object) -> bool | None:
            if data is None:
                return data
            return cast(bool | None, data)

        reproduces_printed = _parse_reproduces_printed(d.pop("reproduces_printed"))

        propagation = cls(
            name=name,
            sentence=sentence,
            std_mm=std_mm,
            over_monte_carlo=over_monte_carlo,
            printed_difference_mm=printed_difference_mm,
            reproduces_printed=reproduces_printed,
        )

        return propagation

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.propagation import Propagation


T = TypeVar("T", bound="Factor")


@_attrs_define
class Factor:
    """S3: the analytic column against Monte Carlo, and which simplification makes it.

    Attributes:
        noise_px (float): Standard deviation of each image coordinate, px.
        monte_carlo_mm (list[float]): Standard deviations by Monte Carlo along x, y, z of con, mm.
        standard_error_mm (list[float]): Standard errors of them, mm.
        printed_monte_carlo_mm (list[float] | None): The printed Monte Carlo column, mm; null where it is not compared.
        printed_analytic_mm (list[float] | None): The printed analytic column, mm; null where it is not compared.
        mean_error_mm (list[float]): Mean of Monte Carlo less the point that first order has for it, along x, y, z of
            con, mm.
        mean_standard_error_mm (list[float]): Standard errors of it, mm.
        printed_mean_difference_mm (list[float] | None): Printed mean by Monte Carlo less the analytic one, mm; null
            where it is not compared.
        propagations (list[Propagation]): The simplifications that were tried.
        sentence (str): Which of them makes the printed column, in a sentence.
    """

    noise_px: float
    monte_carlo_mm: list[float]
    standard_error_mm: list[float]
    printed_monte_carlo_mm: list[float] | None
    printed_analytic_mm: list[float] | None
    mean_error_mm: list[float]
    mean_standard_error_mm: list[float]
    printed_mean_difference_mm: list[float] | None
    propagations: list[Propagation]
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        from ..models.propagation import Propagation  # noqa: PLC0415

        noise_px = self.noise_px

        monte_carlo_mm = []
        for monte_carlo_mm_item_data in self.monte_carlo_mm:
            monte_carlo_mm_item: float
            monte_carlo_mm_item = monte_carlo_mm_item_data
            monte_carlo_mm.append(monte_carlo_mm_item)

        standard_error_mm = []
        for standard_error_mm_item_data in self.standard_error_mm:
            standard_error_mm_item: float
            standard_error_mm_item = standard_error_mm_item_data
            standard_error_mm.append(standard_error_mm_item)

        printed_monte_carlo_mm: list[float] | None
        if isinstance(self.printed_monte_carlo_mm, list):
            printed_monte_carlo_mm = []
            for printed_monte_carlo_mm_type_0_item_data in self.printed_monte_carlo_mm:
                printed_monte_carlo_mm_type_0_item: float
                printed_monte_carlo_mm_type_0_item = printed_monte_carlo_mm_type_0_item_data
                printed_monte_carlo_mm.append(printed_monte_carlo_mm_type_0_item)

        else:
            printed_monte_carlo_mm = self.printed_monte_carlo_mm

        printed_analytic_mm: list[float] | None
        if isinstance(self.printed_analytic_mm, list):
            printed_analytic_mm = []
            for printed_analytic_mm_type_0_item_data in self.printed_analytic_mm:
                printed_analytic_mm_type_0_item: float
                printed_analytic_mm_type_0_item = printed_analytic_mm_type_0_item_data
                printed_analytic_mm.append(printed_analytic_mm_type_0_item)

        else:
            printed_analytic_mm = self.printed_analytic_mm

        mean_error_mm = []
        for mean_error_mm_item_data in self.mean_error_mm:
            mean_error_mm_item: float
            mean_error_mm_item = mean_error_mm_item_data
            mean_error_mm.append(mean_error_mm_item)

        mean_standard_error_mm = []
        for mean_standard_error_mm_item_data in self.mean_standard_error_mm:
            mean_standard_error_mm_item: float
            mean_standard_error_mm_item = mean_standard_error_mm_item_data
            mean_standard_error_mm.append(mean_standard_error_mm_item)

        printed_mean_difference_mm: list[float] | None
        if isinstance(self.printed_mean_difference_mm, list):
            printed_mean_difference_mm = []
            for printed_mean_difference_mm_type_0_item_data in self.printed_mean_difference_mm:
                printed_mean_difference_mm_type_0_item: float
                printed_mean_difference_mm_type_0_item = printed_mean_difference_mm_type_0_item_data
                printed_mean_difference_mm.append(printed_mean_difference_mm_type_0_item)

        else:
            printed_mean_difference_mm = self.printed_mean_difference_mm

        propagations = []
        for propagations_item_data in self.propagations:
            propagations_item = propagations_item_data.to_dict()
            propagations.append(propagations_item)

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "noise_px": noise_px,
                "monte_carlo_mm": monte_carlo_mm,
                "standard_error_mm": standard_error_mm,
                "printed_monte_carlo_mm": printed_monte_carlo_mm,
                "printed_analytic_mm": printed_analytic_mm,
                "mean_error_mm": mean_error_mm,
                "mean_standard_error_mm": mean_standard_error_mm,
                "printed_mean_difference_mm": printed_mean_difference_mm,
                "propagations": propagations,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.propagation import Propagation  # noqa: PLC0415

        d = dict(src_dict)
        noise_px = d.pop("noise_px")

        monte_carlo_mm = []
        _monte_carlo_mm = d.pop("monte_carlo_mm")
        for monte_carlo_mm_item_data in _monte_carlo_mm:

            def _parse_monte_carlo_mm_item(data: object) -> float:
                return cast(float, data)

            monte_carlo_mm_item = _parse_monte_carlo_mm_item(monte_carlo_mm_item_data)

            monte_carlo_mm.append(monte_carlo_mm_item)

        standard_error_mm = []
        _standard_error_mm = d.pop("standard_error_mm")
        for standard_error_mm_item_data in _standard_error_mm:

            def _parse_standard_error_mm_item(data: object) -> float:
                return cast(float, data)

            standard_error_mm_item = _parse_standard_error_mm_item(standard_error_mm_item_data)

            standard_error_mm.append(standard_error_mm_item)

        def _parse_printed_monte_carlo_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                printed_monte_carlo_mm_type_0 = []
                _printed_monte_carlo_mm_type_0 = data
                for printed_monte_carlo_mm_type_0_item_data in _printed_monte_carlo_mm_type_0:

                    def _parse_printed_monte_carlo_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    printed_monte_carlo_mm_type_0_item = _parse_printed_monte_carlo_mm_type_0_item(
                        printed_monte_carlo_mm_type_0_item_data
                    )

                    printed_monte_carlo_mm_type_0.append(printed_monte_carlo_mm_type_0_item)

                return printed_monte_carlo_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        printed_monte_carlo_mm = _parse_printed_monte_carlo_mm(d.pop("printed_monte_carlo_mm"))

        def _parse_printed_analytic_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                printed_analytic_mm_type_0 = []
                _printed_analytic_mm_type_0 = data
                for printed_analytic_mm_type_0_item_data in _printed_analytic_mm_type_0:

                    def _parse_printed_analytic_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    printed_analytic_mm_type_0_item = _parse_printed_analytic_mm_type_0_item(
                        printed_analytic_mm_type_0_item_data
                    )

                    printed_analytic_mm_type_0.append(printed_analytic_mm_type_0_item)

                return printed_analytic_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        printed_analytic_mm = _parse_printed_analytic_mm(d.pop("printed_analytic_mm"))

        mean_error_mm = []
        _mean_error_mm = d.pop("mean_error_mm")
        for mean_error_mm_item_data in _mean_error_mm:

            def _parse_mean_error_mm_item(data: object) -> float:
                return cast(float, data)

            mean_error_mm_item = _parse_mean_error_mm_item(mean_error_mm_item_data)

            mean_error_mm.append(mean_error_mm_item)

        mean_standard_error_mm = []
        _mean_standard_error_mm = d.pop("mean_standard_error_mm")
        for mean_standard_error_mm_item_data in _mean_standard_error_mm:

            def _parse_mean_standard_error_mm_item(data: object) -> float:
                return cast(float, data)

            mean_standard_error_mm_item = _parse_mean_standard_error_mm_item(mean_standard_error_mm_item_data)

            mean_standard_error_mm.append(mean_standard_error_mm_item)

        def _parse_printed_mean_difference_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                printed_mean_difference_mm_type_0 = []
                _printed_mean_difference_mm_type_0 = data
                for printed_mean_difference_mm_type_0_item_data in _printed_mean_difference_mm_type_0:

                    def _parse_printed_mean_difference_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    printed_mean_difference_mm_type_0_item = _parse_printed_mean_difference_mm_type_0_item(
                        printed_mean_difference_mm_type_0_item_data
                    )

                    printed_mean_difference_mm_type_0.append(printed_mean_difference_mm_type_0_item)

                return printed_mean_difference_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        printed_mean_difference_mm = _parse_printed_mean_difference_mm(d.pop("printed_mean_difference_mm"))

        propagations = []
        _propagations = d.pop("propagations")
        for propagations_item_data in _propagations:
            propagations_item = Propagation.from_dict(propagations_item_data)

            propagations.append(propagations_item)

        sentence = d.pop("sentence")

        factor = cls(
            noise_px=noise_px,
            monte_carlo_mm=monte_carlo_mm,
            standard_error_mm=standard_error_mm,
            printed_monte_carlo_mm=printed_monte_carlo_mm,
            printed_analytic_mm=printed_analytic_mm,
            mean_error_mm=mean_error_mm,
            mean_standard_error_mm=mean_standard_error_mm,
            printed_mean_difference_mm=printed_mean_difference_mm,
            propagations=propagations,
            sentence=sentence,
        )

        return factor

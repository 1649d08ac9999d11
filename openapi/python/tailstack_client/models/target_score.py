from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.bounds import Bounds
    from ..models.contributor import Contributor
    from ..models.metric_score import MetricScore
    from ..models.per_unit import PerUnit
    from ..models.second_order import SecondOrder


T = TypeVar("T", bound="TargetScore")


@_attrs_define
class TargetScore:
    """``bias_mm`` ... ``bounds_mm`` are the TCP error; ``localisation`` is the same before connector_flange.

    Attributes:
        name (str): Name of the target, or of one sample of a region (zone[3]).
        frame (str): Frame of the TCP error: tcp.
        bias_mm (list[float]): Mean error vector x, y, z in `frame`, mm.
        covariance_mm2 (list[list[float]]): Covariance of the error, rows and columns x, y, z in `frame`, mm².
        std_mm (list[float]): Standard deviations of the error along x, y, z in `frame`, mm.
        mean_norm_mm (float): Mean of the error's norm, mm.
        p95_mm (float): 95 % quantile of the error's norm under the declared laws, pooled over installations and shots,
            mm.
        law (str): The law that the quantile was computed with, in words.
        law_error_mm (float): Numerical error of the quantile itself, mm; it says nothing of the linearisation.
        bounds_mm (Bounds): Upper bounds of the quantile under ever weaker assumptions on the law of the error.
        cvar95_mm (float): Mean of the worst 5 % of the error's norm, mm.
        limit_mm (float | None): Tightest limit that the design sets for this error here, mm; null without one.
        exceedance_probability (float | None): Probability that the error's norm is beyond `limit_mm`; null without a
            limit.
        localisation (MetricScore): First-order result for one error metric at one target.
        block_diagonal_p95_mm (float): Gaussian P95 with the covariance between views dropped (Eq 16 of the paper), mm:
            compare bounds_mm.gaussian.
        contributors (list[Contributor]): The budget: what each source of error contributes.
        worst_vertex (list[str]): Bounded components at those ends of their ranges that are worst together:
            structure_connector.rz=+0.10 deg.
        per_unit (PerUnit): The second reading of risk: the installation is drawn once per unit and stays.
        second_order (SecondOrder): Correction of the TCP error by the Hessian of the chain; see its own range of
            validity.
        extrapolation (float): Distance of the target from the fiducials' centroid over their RMS radius.
    """

    name: str
    frame: str
    bias_mm: list[float]
    covariance_mm2: list[list[float]]
    std_mm: list[float]
    mean_norm_mm: float
    p95_mm: float
    law: str
    law_error_mm: float
    bounds_mm: Bounds
    cvar95_mm: float
    limit_mm: float | None
    exceedance_probability: float | None
    localisation: MetricScore
    block_diagonal_p95_mm: float
    contributors: list[Contributor]
    worst_vertex: list[str]
    per_unit: PerUnit
    second_order: SecondOrder
    extrapolation: float

    def to_dict(self) -> dict[str, Any]:
        from ..models.bounds import Bounds  # noqa: PLC0415
        from ..models.contributor import Contributor  # noqa: PLC0415
        from ..models.metric_score import MetricScore  # noqa: PLC0415
        from ..models.per_unit import PerUnit  # noqa: PLC0415
        from ..models.second_order import SecondOrder  # noqa: PLC0415

        name = self.name

        frame = self.frame

        bias_mm = []
        for bias_mm_item_data in self.bias_mm:
            bias_mm_item: float
            bias_mm_item = bias_mm_item_data
            bias_mm.append(bias_mm_item)

        covariance_mm2 = []
        for covariance_mm2_item_data in self.covariance_mm2:
            covariance_mm2_item: list[float]
            if isinstance(covariance_mm2_item_data, list):
                covariance_mm2_item = []
                for covariance_mm2_item_type_0_item_data in covariance_mm2_item_data:
                    covariance_mm2_item_type_0_item: float
                    covariance_mm2_item_type_0_item = covariance_mm2_item_type_0_item_data
                    covariance_mm2_item.append(covariance_mm2_item_type_0_item)

            covariance_mm2.append(covariance_mm2_item)

        std_mm = []
        for std_mm_item_data in self.std_mm:
            std_mm_item: float
            std_mm_item = std_mm_item_data
            std_mm.append(std_mm_item)

        mean_norm_mm = self.mean_norm_mm

        p95_mm = self.p95_mm

        law = self.law

        law_error_mm = self.law_error_mm

        bounds_mm = self.bounds_mm.to_dict()

        cvar95_mm = self.cvar95_mm

        limit_mm: float | None
        limit_mm = self.limit_mm

        exceedance_probability: float | None
        exceedance_probability = self.exceedance_probability

        localisation = self.localisation.to_dict()

        block_diagonal_p95_mm = self.block_diagonal_p95_mm

        contributors = []
        for contributors_item_data in self.contributors:
            contributors_item = contributors_item_data.to_dict()
            contributors.append(contributors_item)

        worst_vertex = self.worst_vertex

        per_unit = self.per_unit.to_dict()

        second_order = self.second_order.to_dict()

        extrapolation = self.extrapolation

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "frame": frame,
                "bias_mm": bias_mm,
                "covariance_mm2": covariance_mm2,
                "std_mm": std_mm,
                "mean_norm_mm": mean_norm_mm,
                "p95_mm": p95_mm,
                "law": law,
                "law_error_mm": law_error_mm,
                "bounds_mm": bounds_mm,
                "cvar95_mm": cvar95_mm,
                "limit_mm": limit_mm,
                "exceedance_probability": exceedance_probability,
                "localisation": localisation,
                "block_diagonal_p95_mm": block_diagonal_p95_mm,
                "contributors": contributors,
                "worst_vertex": worst_vertex,
                "per_unit": per_unit,
                "second_order": second_order,
                "extrapolation": extrapolation,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.bounds import Bounds  # noqa: PLC0415
        from ..models.contributor import Contributor  # noqa: PLC0415
        from ..models.metric_score import MetricScore  # noqa: PLC0415
        from ..models.per_unit import PerUnit  # noqa: PLC0415
        from ..models.second_order import SecondOrder  # noqa: PLC0415

        d = dict(src_dict)
        name = d.pop("name")

        frame = d.pop("frame")

        bias_mm = []
        _bias_mm = d.pop("bias_mm")
        for bias_mm_item_data in _bias_mm:

            def _parse_bias_mm_item(data: object) -> float:
                return cast(float, data)

            bias_mm_item = _parse_bias_mm_item(bias_mm_item_data)

            bias_mm.append(bias_mm_item)

        covariance_mm2 = []
        _covariance_mm2 = d.pop("covariance_mm2")
        for covariance_mm2_item_data in _covariance_mm2:

            def _parse_covariance_mm2_item(data: object) -> list[float]:
                if not isinstance(data, list):
                    raise TypeError()
                covariance_mm2_item_type_0 = []
                _covariance_mm2_item_type_0 = data
                for covariance_mm2_item_type_0_item_data in _covariance_mm2_item_type_0:

                    def _parse_covariance_mm2_item_type_0_item(data: object) -> float:
                        return cast(float, data)

                    covariance_mm2_item_type_0_item = _parse_covariance_mm2_item_type_0_item(
                        covariance_mm2_item_type_0_item_data
                    )

                    covariance_mm2_item_type_0.append(covariance_mm2_item_type_0_item)

                return covariance_mm2_item_type_0

            covariance_mm2_item = _parse_covariance_mm2_item(covariance_mm2_item_data)

            covariance_mm2.append(covariance_mm2_item)

        std_mm = []
        _std_mm = d.pop("std_mm")
        for std_mm_item_data in _std_mm:

            def _parse_std_mm_item(data: object) -> float:
                return cast(float, data)

            std_mm_item = _parse_std_mm_item(std_mm_item_data)

            std_mm.append(std_mm_item)

        mean_norm_mm = d.pop("mean_norm_mm")

        p95_mm = d.pop("p95_mm")

        law = d.pop("law")

        law_error_mm = d.pop("law_error_mm")

        bounds_mm = Bounds.from_dict(d.pop("bounds_mm"))

        cvar95_mm = d.pop("cvar95_mm")

        def _parse_limit_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        limit_mm = _parse_limit_mm(d.pop("limit_mm"))

        def _parse_exceedance_probability(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        exceedance_probability = _parse_exceedance_probability(d.pop("exceedance_probability"))

        localisation = MetricScore.from_dict(d.pop("localisation"))

        block_diagonal_p95_mm = d.pop("block_diagonal_p95_mm")

        contributors = []
        _contributors = d.pop("contributors")
        for contributors_item_data in _contributors:
            contributors_item = Contributor.from_dict(contributors_item_data)

            contributors.append(contributors_item)

        worst_vertex = cast(list[str], d.pop("worst_vertex"))

        per_unit = PerUnit.from_dict(d.pop("per_unit"))

        second_order = SecondOrder.from_dict(d.pop("second_order"))

        extrapolation = d.pop("extrapolation")

        target_score = cls(
            name=name,
            frame=frame,
            bias_mm=bias_mm,
            covariance_mm2=covariance_mm2,
            std_mm=std_mm,
            mean_norm_mm=mean_norm_mm,
            p95_mm=p95_mm,
            law=law,
            law_error_mm=law_error_mm,
            bounds_mm=bounds_mm,
            cvar95_mm=cvar95_mm,
            limit_mm=limit_mm,
            exceedance_probability=exceedance_probability,
            localisation=localisation,
            block_diagonal_p95_mm=block_diagonal_p95_mm,
            contributors=contributors,
            worst_vertex=worst_vertex,
            per_unit=per_unit,
            second_order=second_order,
            extrapolation=extrapolation,
        )

        return target_score

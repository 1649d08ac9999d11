from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.exceedance import Exceedance
    from ..models.metric_estimate import MetricEstimate


T = TypeVar("T", bound="TargetEstimate")


@_attrs_define
class TargetEstimate:
    """``bias_mm`` ... ``exceedance`` are the TCP error; ``localisation`` is the same before connector_flange.

    Attributes:
        name (str): Name of the target, or of one sample of a region (zone[3]).
        frame (str): Frame of the TCP error: tcp.
        bias_mm (list[float]): Mean TCP error x, y, z in `frame`, mm.
        std_mm (list[float]): Standard deviations of the TCP error along x, y, z in `frame`, mm.
        mean_norm_mm (float): Mean of the TCP error's norm, mm.
        p95_mm (float): Sampled 95 % quantile of the TCP error's norm, pooled over installations and shots, mm.
        p95_interval_mm (list[float]): Confidence interval of `p95_mm`, by order statistics, mm.
        confidence (float): Confidence of each interval by itself, 0 to 1.
        cvar95_mm (float): Mean of the worst 5 % of the error's norm, mm.
        worst_mm (float): Largest error's norm among the trials, mm: it grows with their number.
        exceedance (Exceedance | None): How often the error is beyond the tightest limit here; null without a limit.
        flagged_trials (int): Trials that the fast chain could not prove solved and that were computed again by singular
            value decomposition.
        first_order_p95_mm (float): P95 to first order, mm: that of the score; where the design says how often fiducials
            are missed, over shots with up to two of them missed.
        first_order_ratio (float): First-order P95 over the sampled one: below 1, first order is optimistic.
        localisation (MetricEstimate): Sampled result for one error metric at one target.
    """

    name: str
    frame: str
    bias_mm: list[float]
    std_mm: list[float]
    mean_norm_mm: float
    p95_mm: float
    p95_interval_mm: list[float]
    confidence: float
    cvar95_mm: float
    worst_mm: float
    exceedance: Exceedance | None
    flagged_trials: int
    first_order_p95_mm: float
    first_order_ratio: float
    localisation: MetricEstimate

    def to_dict(self) -> dict[str, Any]:
        from ..models.exceedance import Exceedance  # noqa: PLC0415
        from ..models.metric_estimate import MetricEstimate  # noqa: PLC0415

        name = self.name

        frame = self.frame

        bias_mm = []
        for bias_mm_item_data in self.bias_mm:
            bias_mm_item: float
            bias_mm_item = bias_mm_item_data
            bias_mm.append(bias_mm_item)

        std_mm = []
        for std_mm_item_data in self.std_mm:
            std_mm_item: float
            std_mm_item = std_mm_item_data
            std_mm.append(std_mm_item)

        mean_norm_mm = self.mean_norm_mm

        p95_mm = self.p95_mm

        p95_interval_mm = []
        for p95_interval_mm_item_data in self.p95_interval_mm:
            p95_interval_mm_item: float
            p95_interval_mm_item = p95_interval_mm_item_data
            p95_interval_mm.append(p95_interval_mm_item)

        confidence = self.confidence

        cvar95_mm = self.cvar95_mm

        worst_mm = self.worst_mm

        exceedance: dict[str, Any] | None
        if isinstance(self.exceedance, Exceedance):
            exceedance = self.exceedance.to_dict()
        else:
            exceedance = self.exceedance

        flagged_trials = self.flagged_trials

        first_order_p95_mm = self.first_order_p95_mm

        first_order_ratio = self.first_order_ratio

        localisation = self.localisation.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "frame": frame,
                "bias_mm": bias_mm,
                "std_mm": std_mm,
                "mean_norm_mm": mean_norm_mm,
                "p95_mm": p95_mm,
                "p95_interval_mm": p95_interval_mm,
                "confidence": confidence,
                "cvar95_mm": cvar95_mm,
                "worst_mm": worst_mm,
                "exceedance": exceedance,
                "flagged_trials": flagged_trials,
                "first_order_p95_mm": first_order_p95_mm,
                "first_order_ratio": first_order_ratio,
                "localisation": localisation,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.exceedance import Exceedance  # noqa: PLC0415
        from ..models.metric_estimate import MetricEstimate  # noqa: PLC0415

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

        std_mm = []
        _std_mm = d.pop("std_mm")
        for std_mm_item_data in _std_mm:

            def _parse_std_mm_item(data: object) -> float:
                return cast(float, data)

            std_mm_item = _parse_std_mm_item(std_mm_item_data)

            std_mm.append(std_mm_item)

        mean_norm_mm = d.pop("mean_norm_mm")

        p95_mm = d.pop("p95_mm")

        p95_interval_mm = []
        _p95_interval_mm = d.pop("p95_interval_mm")
        for p95_interval_mm_item_data in _p95_interval_mm:

            def _parse_p95_interval_mm_item(data: object) -> float:
                return cast(float, data)

            p95_interval_mm_item = _parse_p95_interval_mm_item(p95_interval_mm_item_data)

            p95_interval_mm.append(p95_interval_mm_item)

        confidence = d.pop("confidence")

        cvar95_mm = d.pop("cvar95_mm")

        worst_mm = d.pop("worst_mm")

        def _parse_exceedance(data: object) -> Exceedance | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                exceedance_type_0 = Exceedance.from_dict(data)

                return exceedance_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(Exceedance | None, data)

        exceedance = _parse_exceedance(d.pop("exceedance"))

        flagged_trials = d.pop("flagged_trials")

        first_order_p95_mm = d.pop("first_order_p95_mm")

        first_order_ratio = d.pop("first_order_ratio")

        localisation = MetricEstimate.from_dict(d.pop("localisation"))

        target_estimate = cls(
            name=name,
            frame=frame,
            bias_mm=bias_mm,
            std_mm=std_mm,
            mean_norm_mm=mean_norm_mm,
            p95_mm=p95_mm,
            p95_interval_mm=p95_interval_mm,
            confidence=confidence,
            cvar95_mm=cvar95_mm,
            worst_mm=worst_mm,
            exceedance=exceedance,
            flagged_trials=flagged_trials,
            first_order_p95_mm=first_order_p95_mm,
            first_order_ratio=first_order_ratio,
            localisation=localisation,
        )

        return target_estimate

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.bias_compared import BiasCompared
    from ..models.comparison_test import ComparisonTest
    from ..models.norm_compared import NormCompared
    from ..models.quantile_point import QuantilePoint
    from ..models.spread_compared import SpreadCompared
    from ..models.tail_shape import TailShape


T = TypeVar("T", bound="LevelCompared")


@_attrs_define
class LevelCompared:
    """One level at one target.

    Attributes:
        level (str): Name of the level in the file.
        target (str): Name of the target.
        trials (int | None): Trials; null for summary statistics without n.
        installations (int): Installations that the trials belong to.
        deliberate_deg_mm (list[float] | None): Installation error that was set on purpose: rx, ry, rz in deg and tx,
            ty, tz in mm; null where none was stated.
        benches (int): Simulated benches; 0 when nothing could be tested.
        bias (BiasCompared | None): Mean error vectors; null for norms and summaries.
        norm (NormCompared): Mean error norm of all trials, mm.
        spread (None | SpreadCompared): Spread from trial to trial within installations; null where nothing can be said
            of it.
        spread_between (None | SpreadCompared): Spread of the means of two or more installations; null for one.
        tests (list[ComparisonTest]): The tests.
        quantiles (list[QuantilePoint]): Ordered norms against simulated benches.
        ratio_to_reprojection_mm_per_px (float | None): Mean norm over the reprojection error that the file states, mm
            per px; null where it states none.
        not_tested (str): Why nothing was tested; empty where it was.
        tail_shape (None | TailShape): How far P95 stands above the mean, of summary statistics that state a P95;
            otherwise null.
    """

    level: str
    target: str
    trials: int | None
    installations: int
    deliberate_deg_mm: list[float] | None
    benches: int
    bias: BiasCompared | None
    norm: NormCompared
    spread: None | SpreadCompared
    spread_between: None | SpreadCompared
    tests: list[ComparisonTest]
    quantiles: list[QuantilePoint]
    ratio_to_reprojection_mm_per_px: float | None
    not_tested: str
    tail_shape: None | TailShape

    def to_dict(self) -> dict[str, Any]:
        from ..models.bias_compared import BiasCompared  # noqa: PLC0415
        from ..models.comparison_test import ComparisonTest  # noqa: PLC0415
        from ..models.norm_compared import NormCompared  # noqa: PLC0415
        from ..models.quantile_point import QuantilePoint  # noqa: PLC0415
        from ..models.spread_compared import SpreadCompared  # noqa: PLC0415
        from ..models.tail_shape import TailShape  # noqa: PLC0415

        level = self.level

        target = self.target

        trials: int | None
        trials = self.trials

        installations = self.installations

        deliberate_deg_mm: list[float] | None
        if isinstance(self.deliberate_deg_mm, list):
            deliberate_deg_mm = []
            for deliberate_deg_mm_type_0_item_data in self.deliberate_deg_mm:
                deliberate_deg_mm_type_0_item: float
                deliberate_deg_mm_type_0_item = deliberate_deg_mm_type_0_item_data
                deliberate_deg_mm.append(deliberate_deg_mm_type_0_item)

        else:
            deliberate_deg_mm = self.deliberate_deg_mm

        benches = self.benches

        bias: dict[str, Any] | None
        if isinstance(self.bias, BiasCompared):
            bias = self.bias.to_dict()
        else:
            bias = self.bias

        norm = self.norm.to_dict()

        spread: dict[str, Any] | None
        if isinstance(self.spread, SpreadCompared):
            spread = self.spread.to_dict()
        else:
            spread = self.spread

        spread_between: dict[str, Any] | None
        if isinstance(self.spread_between, SpreadCompared):
            spread_between = self.spread_between.to_dict()
        else:
            spread_between = self.spread_between

        tests = []
        for tests_item_data in self.tests:
            tests_item = tests_item_data.to_dict()
            tests.append(tests_item)

        quantiles = []
        for quantiles_item_data in self.quantiles:
            quantiles_item = quantiles_item_data.to_dict()
            quantiles.append(quantiles_item)

        ratio_to_reprojection_mm_per_px: float | None
        ratio_to_reprojection_mm_per_px = self.ratio_to_reprojection_mm_per_px

        not_tested = self.not_tested

        tail_shape: dict[str, Any] | None
        if isinstance(self.tail_shape, TailShape):
            tail_shape = self.tail_shape.to_dict()
        else:
            tail_shape = self.tail_shape

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "level": level,
                "target": target,
                "trials": trials,
                "installations": installations,
                "deliberate_deg_mm": deliberate_deg_mm,
                "benches": benches,
                "bias": bias,
                "norm": norm,
                "spread": spread,
                "spread_between": spread_between,
                "tests": tests,
                "quantiles": quantiles,
                "ratio_to_reprojection_mm_per_px": ratio_to_reprojection_mm_per_px,
                "not_tested": not_tested,
                "tail_shape": tail_shape,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.bias_compared import BiasCompared  # noqa: PLC0415
        from ..models.comparison_test import ComparisonTest  # noqa: PLC0415
        from ..models.norm_compared import NormCompared  # noqa: PLC0415
        from ..models.quantile_point import QuantilePoint  # noqa: PLC0415
        from ..models.spread_compared import SpreadCompared  # noqa: PLC0415
        from ..models.tail_shape import TailShape  # noqa: PLC0415

        d = dict(src_dict)
        level = d.pop("level")

        target = d.pop("target")

        def _parse_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        trials = _parse_trials(d.pop("trials"))

        installations = d.pop("installations")

        def _parse_deliberate_deg_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                deliberate_deg_mm_type_0 = []
                _deliberate_deg_mm_type_0 = data
                for deliberate_deg_mm_type_0_item_data in _deliberate_deg_mm_type_0:

                    def _parse_deliberate_deg_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    deliberate_deg_mm_type_0_item = _parse_deliberate_deg_mm_type_0_item(
                        deliberate_deg_mm_type_0_item_data
                    )

                    deliberate_deg_mm_type_0.append(deliberate_deg_mm_type_0_item)

                return deliberate_deg_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        deliberate_deg_mm = _parse_deliberate_deg_mm(d.pop("deliberate_deg_mm"))

        benches = d.pop("benches")

        def _parse_bias(data: object) -> BiasCompared | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                bias_type_0 = BiasCompared.from_dict(data)

                return bias_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(BiasCompared | None, data)

        bias = _parse_bias(d.pop("bias"))

        norm = NormCompared.from_dict(d.pop("norm"))

        def _parse_spread(data: object) -> None | SpreadCompared:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                spread_type_0 = SpreadCompared.from_dict(data)

                return spread_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | SpreadCompared, data)

        spread = _parse_spread(d.pop("spread"))

        def _parse_spread_between(data: object) -> None | SpreadCompared:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                spread_between_type_0 = SpreadCompared.from_dict(data)

                return spread_between_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | SpreadCompared, data)

        spread_between = _parse_spread_between(d.pop("spread_between"))

        tests = []
        _tests = d.pop("tests")
        for tests_item_data in _tests:
            tests_item = ComparisonTest.from_dict(tests_item_data)

            tests.append(tests_item)

        quantiles = []
        _quantiles = d.pop("quantiles")
        for quantiles_item_data in _quantiles:
            quantiles_item = QuantilePoint.from_dict(quantiles_item_data)

            quantiles.append(quantiles_item)

        def _parse_ratio_to_reprojection_mm_per_px(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        ratio_to_reprojection_mm_per_px = _parse_ratio_to_reprojection_mm_per_px(
            d.pop("ratio_to_reprojection_mm_per_px")
        )

        not_tested = d.pop("not_tested")

        def _parse_tail_shape(data: object) -> None | TailShape:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                tail_shape_type_0 = TailShape.from_dict(data)

                return tail_shape_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | TailShape, data)

        tail_shape = _parse_tail_shape(d.pop("tail_shape"))

        level_compared = cls(
            level=level,
            target=target,
            trials=trials,
            installations=installations,
            deliberate_deg_mm=deliberate_deg_mm,
            benches=benches,
            bias=bias,
            norm=norm,
            spread=spread,
            spread_between=spread_between,
            tests=tests,
            quantiles=quantiles,
            ratio_to_reprojection_mm_per_px=ratio_to_reprojection_mm_per_px,
            not_tested=not_tested,
            tail_shape=tail_shape,
        )

        return level_compared

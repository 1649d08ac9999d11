from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.sweep_check import check_sweep_check
from ..models.sweep_check import SweepCheck
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.provenance import Provenance
    from ..models.sweep_axis import SweepAxis
    from ..models.sweep_point import SweepPoint


T = TypeVar("T", bound="Sweep")


@_attrs_define
class Sweep:
    """A grid of designs: every combination of the axes' values, the last axis running fastest.

    Attributes:
        schema (Literal['tailstack/sweep/1']): Name and version of this record's schema.
        axes (list[SweepAxis]): The numbers of the design that were varied.
        check (SweepCheck): What was computed at each point: score (first order) or verification (Monte Carlo).
        seed (int | None): Seed of every point's check, so that points differ by their designs alone; null for scores.
        trials (int | None): Trials asked for at every point; null: a score, or as many as the precision takes.
        max_trials (int | None): At most so many at every point; null: a score, or trials were asked for.
        points (list[SweepPoint]): Every combination of the axes' values, the last axis running fastest.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/sweep/1"]
    axes: list[SweepAxis]
    check: SweepCheck
    seed: int | None
    trials: int | None
    max_trials: int | None
    points: list[SweepPoint]
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.sweep_axis import SweepAxis  # noqa: PLC0415
        from ..models.sweep_point import SweepPoint  # noqa: PLC0415

        schema = self.schema

        axes = []
        for axes_item_data in self.axes:
            axes_item = axes_item_data.to_dict()
            axes.append(axes_item)

        check: str = self.check

        seed: int | None
        seed = self.seed

        trials: int | None
        trials = self.trials

        max_trials: int | None
        max_trials = self.max_trials

        points = []
        for points_item_data in self.points:
            points_item = points_item_data.to_dict()
            points.append(points_item)

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "axes": axes,
                "check": check,
                "seed": seed,
                "trials": trials,
                "max_trials": max_trials,
                "points": points,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.sweep_axis import SweepAxis  # noqa: PLC0415
        from ..models.sweep_point import SweepPoint  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/sweep/1"], d.pop("schema"))
        if schema != "tailstack/sweep/1":
            raise ValueError(f"schema must match const 'tailstack/sweep/1', got '{schema}'")

        axes = []
        _axes = d.pop("axes")
        for axes_item_data in _axes:
            axes_item = SweepAxis.from_dict(axes_item_data)

            axes.append(axes_item)

        check = check_sweep_check(d.pop("check"))

        def _parse_seed(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        seed = _parse_seed(d.pop("seed"))

        def _parse_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        trials = _parse_trials(d.pop("trials"))

        def _parse_max_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        max_trials = _parse_max_trials(d.pop("max_trials"))

        points = []
        _points = d.pop("points")
        for points_item_data in _points:
            points_item = SweepPoint.from_dict(points_item_data)

            points.append(points_item)

        provenance = Provenance.from_dict(d.pop("provenance"))

        sweep = cls(
            schema=schema,
            axes=axes,
            check=check,
            seed=seed,
            trials=trials,
            max_trials=max_trials,
            points=points,
            provenance=provenance,
        )

        return sweep

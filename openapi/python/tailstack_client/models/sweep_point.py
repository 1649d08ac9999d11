from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.sweep_point_status import check_sweep_point_status
from ..models.sweep_point_status import SweepPointStatus
from ..models.sweep_point_verdict_type_0 import check_sweep_point_verdict_type_0
from ..models.sweep_point_verdict_type_0 import SweepPointVerdictType0
from typing import cast

if TYPE_CHECKING:
    from ..models.sweep_target import SweepTarget


T = TypeVar("T", bound="SweepPoint")


@_attrs_define
class SweepPoint:
    """One point of the grid.

    Attributes:
        values (list[float]): Values at this point, in the order and units of the axes.
        status (SweepPointStatus): refused: the design could not be computed with these values.
        reason (None | str): Why it was refused; otherwise null.
        targets (list[SweepTarget]): What was found at each target; empty where it was refused.
        verdict (None | SweepPointVerdictType0): Verdict on the design with these values; null where it was refused.
    """

    values: list[float]
    status: SweepPointStatus
    reason: None | str
    targets: list[SweepTarget]
    verdict: None | SweepPointVerdictType0

    def to_dict(self) -> dict[str, Any]:
        from ..models.sweep_target import SweepTarget  # noqa: PLC0415

        values = self.values

        status: str = self.status

        reason: None | str
        reason = self.reason

        targets = []
        for targets_item_data in self.targets:
            targets_item = targets_item_data.to_dict()
            targets.append(targets_item)

        verdict: None | str
        if isinstance(self.verdict, str):
            verdict = self.verdict
        else:
            verdict = self.verdict

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "values": values,
                "status": status,
                "reason": reason,
                "targets": targets,
                "verdict": verdict,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.sweep_target import SweepTarget  # noqa: PLC0415

        d = dict(src_dict)
        values = cast(list[float], d.pop("values"))

        status = check_sweep_point_status(d.pop("status"))

        def _parse_reason(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        reason = _parse_reason(d.pop("reason"))

        targets = []
        _targets = d.pop("targets")
        for targets_item_data in _targets:
            targets_item = SweepTarget.from_dict(targets_item_data)

            targets.append(targets_item)

        def _parse_verdict(data: object) -> None | SweepPointVerdictType0:
            if data is None:
                return data
            try:
                if not isinstance(data, str):
                    raise TypeError()
                verdict_type_0 = check_sweep_point_verdict_type_0(data)

                return verdict_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | SweepPointVerdictType0, data)

        verdict = _parse_verdict(d.pop("verdict"))

        sweep_point = cls(
            values=values,
            status=status,
            reason=reason,
            targets=targets,
            verdict=verdict,
        )

        return sweep_point

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.losses import Losses
    from ..models.provenance import Provenance
    from ..models.slip_reliability import SlipReliability
    from ..models.target_score import TargetScore
    from ..models.validity import Validity
    from ..models.verdict import Verdict
    from ..models.view_check import ViewCheck


T = TypeVar("T", bound="Score")


@_attrs_define
class Score:
    """First order: bias, covariance, tail and budget at every target.

    Attributes:
        schema (Literal['tailstack/score/1']): Name and version of this record's schema.
        targets (list[TargetScore]): One entry for each target and each sample of a region.
        validity (Validity): How far to trust the linearisation: nu and what it was calibrated to mean.
        views (list[ViewCheck]): Visibility of the fiducials in each view.
        verdict (Verdict): ``pass`` only when the upper end of every check's interval is within its limit.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
        losses (list[Losses]): What becomes of each requirement when one or two fiducials are lost; empty where that was
            not asked for.
        reliability (list[SlipReliability]): For each view and fiducial the smallest slip of its image that its
            residuals give away, the largest effect first; empty where that was not asked for.
    """

    schema: Literal["tailstack/score/1"]
    targets: list[TargetScore]
    validity: Validity
    views: list[ViewCheck]
    verdict: Verdict
    provenance: Provenance
    losses: list[Losses]
    reliability: list[SlipReliability]

    def to_dict(self) -> dict[str, Any]:
        from ..models.losses import Losses  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.slip_reliability import SlipReliability  # noqa: PLC0415
        from ..models.target_score import TargetScore  # noqa: PLC0415
        from ..models.validity import Validity  # noqa: PLC0415
        from ..models.verdict import Verdict  # noqa: PLC0415
        from ..models.view_check import ViewCheck  # noqa: PLC0415

        schema = self.schema

        targets = []
        for targets_item_data in self.targets:
            targets_item = targets_item_data.to_dict()
            targets.append(targets_item)

        validity = self.validity.to_dict()

        views = []
        for views_item_data in self.views:
            views_item = views_item_data.to_dict()
            views.append(views_item)

        verdict = self.verdict.to_dict()

        provenance = self.provenance.to_dict()

        losses = []
        for losses_item_data in self.losses:
            losses_item = losses_item_data.to_dict()
            losses.append(losses_item)

        reliability = []
        for reliability_item_data in self.reliability:
            reliability_item = reliability_item_data.to_dict()
            reliability.append(reliability_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "targets": targets,
                "validity": validity,
                "views": views,
                "verdict": verdict,
                "provenance": provenance,
                "losses": losses,
                "reliability": reliability,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.losses import Losses  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.slip_reliability import SlipReliability  # noqa: PLC0415
        from ..models.target_score import TargetScore  # noqa: PLC0415
        from ..models.validity import Validity  # noqa: PLC0415
        from ..models.verdict import Verdict  # noqa: PLC0415
        from ..models.view_check import ViewCheck  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/score/1"], d.pop("schema"))
        if schema != "tailstack/score/1":
            raise ValueError(f"schema must match const 'tailstack/score/1', got '{schema}'")

        targets = []
        _targets = d.pop("targets")
        for targets_item_data in _targets:
            targets_item = TargetScore.from_dict(targets_item_data)

            targets.append(targets_item)

        validity = Validity.from_dict(d.pop("validity"))

        views = []
        _views = d.pop("views")
        for views_item_data in _views:
            views_item = ViewCheck.from_dict(views_item_data)

            views.append(views_item)

        verdict = Verdict.from_dict(d.pop("verdict"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        losses = []
        _losses = d.pop("losses")
        for losses_item_data in _losses:
            losses_item = Losses.from_dict(losses_item_data)

            losses.append(losses_item)

        reliability = []
        _reliability = d.pop("reliability")
        for reliability_item_data in _reliability:
            reliability_item = SlipReliability.from_dict(reliability_item_data)

            reliability.append(reliability_item)

        score = cls(
            schema=schema,
            targets=targets,
            validity=validity,
            views=views,
            verdict=verdict,
            provenance=provenance,
            losses=losses,
            reliability=reliability,
        )

        return score

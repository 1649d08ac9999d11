from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.verification_method import check_verification_method
from ..models.verification_method import VerificationMethod
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.drawn_losses import DrawnLosses
    from ..models.provenance import Provenance
    from ..models.reprojection import Reprojection
    from ..models.target_estimate import TargetEstimate
    from ..models.verdict import Verdict


T = TypeVar("T", bound="Verification")


@_attrs_define
class Verification:
    """Monte Carlo on the full nonlinear chain.

    Attributes:
        schema (Literal['tailstack/verification/1']): Name and version of this record's schema.
        seed (int): Seed of the trials: the same seed gives the same digits.
        trials (int): Trials that were drawn.
        method (VerificationMethod): plain: every trial by itself; radial: directions, with the quantile found along
            each.
        engine (str): The chain that computed the trials, in words.
        precision_requested (float | None): Relative half-width of P95's interval that was asked for; null where a
            number of trials was.
        max_trials (int | None): At most so many; null where their number was asked for. It sets when the precision is
            looked at, so the intervals.
        precision_reached (float): Largest relative half-width of P95's interval over the targets.
        stopping (str): Why it stopped, in a sentence.
        targets (list[TargetEstimate]): One entry for each target and each sample of a region.
        reprojection (Reprojection): RMS over fiducials and views of the distance between measured and reprojected
            images.
        first_order_ratio (float): First-order P95 over the sampled one at the worst target.
        verdict (Verdict): ``pass`` only when the upper end of every check's interval is within its limit.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
        losses (DrawnLosses | None): Shots with fiducials missed; null where the design does not say how often they are.
    """

    schema: Literal["tailstack/verification/1"]
    seed: int
    trials: int
    method: VerificationMethod
    engine: str
    precision_requested: float | None
    max_trials: int | None
    precision_reached: float
    stopping: str
    targets: list[TargetEstimate]
    reprojection: Reprojection
    first_order_ratio: float
    verdict: Verdict
    provenance: Provenance
    losses: DrawnLosses | None

    def to_dict(self) -> dict[str, Any]:
        from ..models.drawn_losses import DrawnLosses  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.reprojection import Reprojection  # noqa: PLC0415
        from ..models.target_estimate import TargetEstimate  # noqa: PLC0415
        from ..models.verdict import Verdict  # noqa: PLC0415

        schema = self.schema

        seed = self.seed

        trials = self.trials

        method: str = self.method

        engine = self.engine

        precision_requested: float | None
        precision_requested = self.precision_requested

        max_trials: int | None
        max_trials = self.max_trials

        precision_reached = self.precision_reached

        stopping = self.stopping

        targets = []
        for targets_item_data in self.targets:
            targets_item = targets_item_data.to_dict()
            targets.append(targets_item)

        reprojection = self.reprojection.to_dict()

        first_order_ratio = self.first_order_ratio

        verdict = self.verdict.to_dict()

        provenance = self.provenance.to_dict()

        losses: dict[str, Any] | None
        if isinstance(self.losses, DrawnLosses):
            losses = self.losses.to_dict()
        else:
            losses = self.losses

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "seed": seed,
                "trials": trials,
                "method": method,
                "engine": engine,
                "precision_requested": precision_requested,
                "max_trials": max_trials,
                "precision_reached": precision_reached,
                "stopping": stopping,
                "targets": targets,
                "reprojection": reprojection,
                "first_order_ratio": first_order_ratio,
                "verdict": verdict,
                "provenance": provenance,
                "losses": losses,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.drawn_losses import DrawnLosses  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.reprojection import Reprojection  # noqa: PLC0415
        from ..models.target_estimate import TargetEstimate  # noqa: PLC0415
        from ..models.verdict import Verdict  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/verification/1"], d.pop("schema"))
        if schema != "tailstack/verification/1":
            raise ValueError(f"schema must match const 'tailstack/verification/1', got '{schema}'")

        seed = d.pop("seed")

        trials = d.pop("trials")

        method = check_verification_method(d.pop("method"))

        engine = d.pop("engine")

        def _parse_precision_requested(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        precision_requested = _parse_precision_requested(d.pop("precision_requested"))

        def _parse_max_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        max_trials = _parse_max_trials(d.pop("max_trials"))

        precision_reached = d.pop("precision_reached")

        stopping = d.pop("stopping")

        targets = []
        _targets = d.pop("targets")
        for targets_item_data in _targets:
            targets_item = TargetEstimate.from_dict(targets_item_data)

            targets.append(targets_item)

        reprojection = Reprojection.from_dict(d.pop("reprojection"))

        first_order_ratio = d.pop("first_order_ratio")

        verdict = Verdict.from_dict(d.pop("verdict"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        def _parse_losses(data: object) -> DrawnLosses | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                losses_type_0 = DrawnLosses.from_dict(data)

                return losses_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(DrawnLosses | None, data)

        losses = _parse_losses(d.pop("losses"))

        verification = cls(
            schema=schema,
            seed=seed,
            trials=trials,
            method=method,
            engine=engine,
            precision_requested=precision_requested,
            max_trials=max_trials,
            precision_reached=precision_reached,
            stopping=stopping,
            targets=targets,
            reprojection=reprojection,
            first_order_ratio=first_order_ratio,
            verdict=verdict,
            provenance=provenance,
            losses=losses,
        )

        return verification

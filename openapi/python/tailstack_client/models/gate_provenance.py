from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="GateProvenance")


@_attrs_define
class GateProvenance:
    """What decided, besides the designs.

    Attributes:
        tailstack_version (str): Version of the solver.
        policy_name (str): Name of the policy.
        policy_sha256 (None | str): SHA-256 of the policy's canonical content, defaults filled in; null: it could not be
            read.
        waivers_sha256 (None | str): SHA-256 of the waivers' canonical content; null without waivers.
        baseline_sha256 (None | str): SHA-256 of the baseline; null without one.
        today (str): Date by which waivers were judged, ISO 8601.
        not_included (list[str]): Errors that no number here includes.
    """

    tailstack_version: str
    policy_name: str
    policy_sha256: None | str
    waivers_sha256: None | str
    baseline_sha256: None | str
    today: str
    not_included: list[str]

    def to_dict(self) -> dict[str, Any]:
        tailstack_version = self.tailstack_version

        policy_name = self.policy_name

        policy_sha256: None | str
        policy_sha256 = self.policy_sha256

        waivers_sha256: None | str
        waivers_sha256 = self.waivers_sha256

        baseline_sha256: None | str
        baseline_sha256 = self.baseline_sha256

        today = self.today

        not_included = self.not_included

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "tailstack_version": tailstack_version,
                "policy_name": policy_name,
                "policy_sha256": policy_sha256,
                "waivers_sha256": waivers_sha256,
                "baseline_sha256": baseline_sha256,
                "today": today,
                "not_included": not_included,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        tailstack_version = d.pop("tailstack_version")

        policy_name = d.pop("policy_name")

        def _parse_policy_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        policy_sha256 = _parse_policy_sha256(d.pop("policy_sha256"))

        def _parse_waivers_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        waivers_sha256 = _parse_waivers_sha256(d.pop("waivers_sha256"))

        def _parse_baseline_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        baseline_sha256 = _parse_baseline_sha256(d.pop("baseline_sha256"))

        today = d.pop("today")

        not_included = cast(list[str], d.pop("not_included"))

        gate_provenance = cls(
            tailstack_version=tailstack_version,
            policy_name=policy_name,
            policy_sha256=policy_sha256,
            waivers_sha256=waivers_sha256,
            baseline_sha256=baseline_sha256,
            today=today,
            not_included=not_included,
        )

        return gate_provenance

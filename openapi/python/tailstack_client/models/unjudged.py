from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Unjudged")


@_attrs_define
class Unjudged:
    """Something that was asked for, or a target, that nothing was held against.

    Attributes:
        requirement (None | str): Name of the requirement; null: no requirement and no limit of the policy is about the
            target.
        target (str): Name of the target.
        rule (None | str): Rule that would have judged it; null without requirement.
        reason (str): Why nothing was held against it.
    """

    requirement: None | str
    target: str
    rule: None | str
    reason: str

    def to_dict(self) -> dict[str, Any]:
        requirement: None | str
        requirement = self.requirement

        target = self.target

        rule: None | str
        rule = self.rule

        reason = self.reason

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "requirement": requirement,
                "target": target,
                "rule": rule,
                "reason": reason,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)

        def _parse_requirement(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        requirement = _parse_requirement(d.pop("requirement"))

        target = d.pop("target")

        def _parse_rule(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        rule = _parse_rule(d.pop("rule"))

        reason = d.pop("reason")

        unjudged = cls(
            requirement=requirement,
            target=target,
            rule=rule,
            reason=reason,
        )

        return unjudged

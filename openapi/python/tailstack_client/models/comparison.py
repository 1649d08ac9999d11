from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.change import Change
    from ..models.comparison_headline import ComparisonHeadline
    from ..models.difference import Difference
    from ..models.report import Report


T = TypeVar("T", bound="Comparison")


@_attrs_define
class Comparison:
    """Two designs computed alike, with the same seed, and what sets them apart.

    Attributes:
        schema (Literal['tailstack/comparison/1']): Name and version of this record's schema.
        title (str): Title of the comparison: the names of both designs.
        headline (ComparisonHeadline): The first page of a comparison.
        differences (list[Difference]): P95 at every target that both designs have, largest of the second first.
        compared_trials (int | None): Trials of each design, with the same random numbers, that the intervals come from;
            null: first order.
        sections (int | None): Sections that those trials are cut into; null: first order.
        only_first (list[str]): Targets that only the first design has.
        only_second (list[str]): Targets that only the second design has.
        changes (list[Change]): Fields of the design document that differ.
        changes_left_out (int): Further differing fields that are not listed.
        first (Report): A design, what was found about it, and how to find it again.
        second (Report): A design, what was found about it, and how to find it again.
    """

    schema: Literal["tailstack/comparison/1"]
    title: str
    headline: ComparisonHeadline
    differences: list[Difference]
    compared_trials: int | None
    sections: int | None
    only_first: list[str]
    only_second: list[str]
    changes: list[Change]
    changes_left_out: int
    first: Report
    second: Report

    def to_dict(self) -> dict[str, Any]:
        from ..models.change import Change  # noqa: PLC0415
        from ..models.comparison_headline import ComparisonHeadline  # noqa: PLC0415
        from ..models.difference import Difference  # noqa: PLC0415
        from ..models.report import Report  # noqa: PLC0415

        schema = self.schema

        title = self.title

        headline = self.headline.to_dict()

        differences = []
        for differences_item_data in self.differences:
            differences_item = differences_item_data.to_dict()
            differences.append(differences_item)

        compared_trials: int | None
        compared_trials = self.compared_trials

        sections: int | None
        sections = self.sections

        only_first = self.only_first

        only_second = self.only_second

        changes = []
        for changes_item_data in self.changes:
            changes_item = changes_item_data.to_dict()
            changes.append(changes_item)

        changes_left_out = self.changes_left_out

        first = self.first.to_dict()

        second = self.second.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "title": title,
                "headline": headline,
                "differences": differences,
                "compared_trials": compared_trials,
                "sections": sections,
                "only_first": only_first,
                "only_second": only_second,
                "changes": changes,
                "changes_left_out": changes_left_out,
                "first": first,
                "second": second,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.change import Change  # noqa: PLC0415
        from ..models.comparison_headline import ComparisonHeadline  # noqa: PLC0415
        from ..models.difference import Difference  # noqa: PLC0415
        from ..models.report import Report  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/comparison/1"], d.pop("schema"))
        if schema != "tailstack/comparison/1":
            raise ValueError(f"schema must match const 'tailstack/comparison/1', got '{schema}'")

        title = d.pop("title")

        headline = ComparisonHeadline.from_dict(d.pop("headline"))

        differences = []
        _differences = d.pop("differences")
        for differences_item_data in _differences:
            differences_item = Difference.from_dict(differences_item_data)

            differences.append(differences_item)

        def _parse_compared_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        compared_trials = _parse_compared_trials(d.pop("compared_trials"))

        def _parse_sections(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        sections = _parse_sections(d.pop("sections"))

        only_first = cast(list[str], d.pop("only_first"))

        only_second = cast(list[str], d.pop("only_second"))

        changes = []
        _changes = d.pop("changes")
        for changes_item_data in _changes:
            changes_item = Change.from_dict(changes_item_data)

            changes.append(changes_item)

        changes_left_out = d.pop("changes_left_out")

        first = Report.from_dict(d.pop("first"))

        second = Report.from_dict(d.pop("second"))

        comparison = cls(
            schema=schema,
            title=title,
            headline=headline,
            differences=differences,
            compared_trials=compared_trials,
            sections=sections,
            only_first=only_first,
            only_second=only_second,
            changes=changes,
            changes_left_out=changes_left_out,
            first=first,
            second=second,
        )

        return comparison

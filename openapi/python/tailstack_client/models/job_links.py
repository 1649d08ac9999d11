from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="JobLinks")


@_attrs_define
class JobLinks:
    """Paths of what belongs to a job.  ``result`` and ``report`` are null until it has succeeded.

    Attributes:
        self_ (str): Path of this record.
        events (str): Path of the stream of events.
        cancel (str): Path to post to in order to cancel.
        result (None | str): Path of the result; null until it is there.
        report (None | str): Path of the result as a report; null until it is there.
    """

    self_: str
    events: str
    cancel: str
    result: None | str
    report: None | str

    def to_dict(self) -> dict[str, Any]:
        self_ = self.self_

        events = self.events

        cancel = self.cancel

        result: None | str
        result = self.result

        report: None | str
        report = self.report

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "self": self_,
                "events": events,
                "cancel": cancel,
                "result": result,
                "report": report,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        self_ = d.pop("self")

        events = d.pop("events")

        cancel = d.pop("cancel")

        def _parse_result(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        result = _parse_result(d.pop("result"))

        def _parse_report(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        report = _parse_report(d.pop("report"))

        job_links = cls(
            self_=self_,
            events=events,
            cancel=cancel,
            result=result,
            report=report,
        )

        return job_links

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.job import Job


T = TypeVar("T", bound="JobPage")


@_attrs_define
class JobPage:
    """Jobs, newest first, and the path of the page after this one.

    Attributes:
        schema (Literal['tailstack/jobs/1']): Name and version of this record's schema.
        jobs (list[Job]): Jobs, newest first.
        next_ (None | str): Path of the page after this one; null on the last.
    """

    schema: Literal["tailstack/jobs/1"]
    jobs: list[Job]
    next_: None | str

    def to_dict(self) -> dict[str, Any]:
        from ..models.job import Job  # noqa: PLC0415

        schema = self.schema

        jobs = []
        for jobs_item_data in self.jobs:
            jobs_item = jobs_item_data.to_dict()
            jobs.append(jobs_item)

        next_: None | str
        next_ = self.next_

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "jobs": jobs,
                "next": next_,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.job import Job  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/jobs/1"], d.pop("schema"))
        if schema != "tailstack/jobs/1":
            raise ValueError(f"schema must match const 'tailstack/jobs/1', got '{schema}'")

        jobs = []
        _jobs = d.pop("jobs")
        for jobs_item_data in _jobs:
            jobs_item = Job.from_dict(jobs_item_data)

            jobs.append(jobs_item)

        def _parse_next_(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        next_ = _parse_next_(d.pop("next"))

        job_page = cls(
            schema=schema,
            jobs=jobs,
            next_=next_,
        )

        return job_page

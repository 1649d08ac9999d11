from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="JobProgress")


@_attrs_define
class JobProgress:
    """How far a job was when something was last recorded.  ``fraction`` is between 0 and 1.

    Attributes:
        fraction (float): How much is done, 0 to 1.
        units_done (int): Units of work whose results are recorded.
        units_expected (int): Units of work in all; grows when the job turns out to be longer.
        note (str): What is being done, in words.
        eta_seconds (float | None): Seconds to the end, at the pace so far; null when nobody can know.
    """

    fraction: float
    units_done: int
    units_expected: int
    note: str
    eta_seconds: float | None

    def to_dict(self) -> dict[str, Any]:
        fraction = self.fraction

        units_done = self.units_done

        units_expected = self.units_expected

        note = self.note

        eta_seconds: float | None
        eta_seconds = self.eta_seconds

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "fraction": fraction,
                "units_done": units_done,
                "units_expected": units_expected,
                "note": note,
                "eta_seconds": eta_seconds,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        fraction = d.pop("fraction")

        units_done = d.pop("units_done")

        units_expected = d.pop("units_expected")

        note = d.pop("note")

        def _parse_eta_seconds(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        eta_seconds = _parse_eta_seconds(d.pop("eta_seconds"))

        job_progress = cls(
            fraction=fraction,
            units_done=units_done,
            units_expected=units_expected,
            note=note,
            eta_seconds=eta_seconds,
        )

        return job_progress

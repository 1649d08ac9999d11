from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.readiness_database import check_readiness_database
from ..models.readiness_database import ReadinessDatabase
from ..models.readiness_kernels import check_readiness_kernels
from ..models.readiness_kernels import ReadinessKernels
from ..models.readiness_status_type_0 import check_readiness_status_type_0
from ..models.readiness_status_type_0 import ReadinessStatusType0
from ..models.readiness_status_type_1 import check_readiness_status_type_1
from ..models.readiness_status_type_1 import ReadinessStatusType1
from typing import cast


T = TypeVar("T", bound="Readiness")


@_attrs_define
class Readiness:
    """Whether requests should be sent here, and why not.

    Attributes:
        status (ReadinessStatusType0 | ReadinessStatusType1): ready: send requests here; otherwise why not.
        kernels (ReadinessKernels): Whether the kernels are compiled.
        database (ReadinessDatabase): Whether jobs can be stored and read.
        workers (int): Workers that computed or looked for work lately, on any host; jobs wait while there is none.
    """

    status: ReadinessStatusType0 | ReadinessStatusType1
    kernels: ReadinessKernels
    database: ReadinessDatabase
    workers: int

    def to_dict(self) -> dict[str, Any]:
        status: str
        if isinstance(self.status, str):
            status = self.status
        else:
            status = self.status

        kernels: str = self.kernels

        database: str = self.database

        workers = self.workers

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "status": status,
                "kernels": kernels,
                "database": database,
                "workers": workers,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)

        def _parse_status(data: object) -> ReadinessStatusType0 | ReadinessStatusType1:
            try:
                if not isinstance(data, str):
                    raise TypeError()
                status_type_0 = check_readiness_status_type_0(data)

                return status_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            if not isinstance(data, str):
                raise TypeError()
            status_type_1 = check_readiness_status_type_1(data)

            return status_type_1

        status = _parse_status(d.pop("status"))

        kernels = check_readiness_kernels(d.pop("kernels"))

        database = check_readiness_database(d.pop("database"))

        workers = d.pop("workers")

        readiness = cls(
            status=status,
            kernels=kernels,
            database=database,
            workers=workers,
        )

        return readiness

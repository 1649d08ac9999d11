from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.batch_columns import BatchColumns
    from ..models.batch_pointers import BatchPointers
    from ..models.batch_ways import BatchWays
    from ..models.provenance import Provenance


T = TypeVar("T", bound="Batch")


@_attrs_define
class Batch:
    """A design scored for each row of a table: the table's own columns, and those of the answer.

    Attributes:
        schema (Literal['tailstack/batch/1']): Name and version of this record's schema.
        pointers (BatchPointers): JSON pointer of the number of the design that each of these columns gave.
        columns (BatchColumns): Cells by column, row by row: those of the table as they were sent; numbers of the answer
            (p95_mm:TARGET), null where a row could not be scored; texts of the answer, empty where it could not; and
            `reason`, why.
        rows (int): Number of rows.
        refused (int): Rows that could not be scored.
        ways (BatchWays): Rows that were computed compiled, linearised and in full.
        why (str): Why not all were computed by the fastest of these ways; empty: they were.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/batch/1"]
    pointers: BatchPointers
    columns: BatchColumns
    rows: int
    refused: int
    ways: BatchWays
    why: str
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.batch_columns import BatchColumns  # noqa: PLC0415
        from ..models.batch_pointers import BatchPointers  # noqa: PLC0415
        from ..models.batch_ways import BatchWays  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        schema = self.schema

        pointers = self.pointers.to_dict()

        columns = self.columns.to_dict()

        rows = self.rows

        refused = self.refused

        ways = self.ways.to_dict()

        why = self.why

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "pointers": pointers,
                "columns": columns,
                "rows": rows,
                "refused": refused,
                "ways": ways,
                "why": why,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.batch_columns import BatchColumns  # noqa: PLC0415
        from ..models.batch_pointers import BatchPointers  # noqa: PLC0415
        from ..models.batch_ways import BatchWays  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/batch/1"], d.pop("schema"))
        if schema != "tailstack/batch/1":
            raise ValueError(f"schema must match const 'tailstack/batch/1', got '{schema}'")

        pointers = BatchPointers.from_dict(d.pop("pointers"))

        columns = BatchColumns.from_dict(d.pop("columns"))

        rows = d.pop("rows")

        refused = d.pop("refused")

        ways = BatchWays.from_dict(d.pop("ways"))

        why = d.pop("why")

        provenance = Provenance.from_dict(d.pop("provenance"))

        batch = cls(
            schema=schema,
            pointers=pointers,
            columns=columns,
            rows=rows,
            refused=refused,
            ways=ways,
            why=why,
            provenance=provenance,
        )

        return batch

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.geometry import Geometry
    from ..models.printed_cell import PrintedCell
    from ..models.statement import Statement


T = TypeVar("T", bound="StudyPaper")


@_attrs_define
class StudyPaper:
    """Tables S1 to S4, printed and reproduced.

    Attributes:
        schema (Literal['tailstack/study-paper/1']): Name and version of this record's schema.
        source (str): The publication.
        seed (int): Seed of the trials.
        trials (int): Trials of each of our cells.
        published_trials (int): Trials of each published cell.
        band (float): Share of experiments of the paper's size that would print a cell within its band.
        geometries (list[Geometry]): The tables in each geometry.
        printed (list[PrintedCell]): Every cell of S1 to S4.
        statements (list[Statement]): What can be said of the tables.
        tailstack_version (str): Version of the solver.
    """

    schema: Literal["tailstack/study-paper/1"]
    source: str
    seed: int
    trials: int
    published_trials: int
    band: float
    geometries: list[Geometry]
    printed: list[PrintedCell]
    statements: list[Statement]
    tailstack_version: str

    def to_dict(self) -> dict[str, Any]:
        from ..models.geometry import Geometry  # noqa: PLC0415
        from ..models.printed_cell import PrintedCell  # noqa: PLC0415
        from ..models.statement import Statement  # noqa: PLC0415

        schema = self.schema

        source = self.source

        seed = self.seed

        trials = self.trials

        published_trials = self.published_trials

        band = self.band

        geometries = []
        for geometries_item_data in self.geometries:
            geometries_item = geometries_item_data.to_dict()
            geometries.append(geometries_item)

        printed = []
        for printed_item_data in self.printed:
            printed_item = printed_item_data.to_dict()
            printed.append(printed_item)

        statements = []
        for statements_item_data in self.statements:
            statements_item = statements_item_data.to_dict()
            statements.append(statements_item)

        tailstack_version = self.tailstack_version

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "source": source,
                "seed": seed,
                "trials": trials,
                "published_trials": published_trials,
                "band": band,
                "geometries": geometries,
                "printed": printed,
                "statements": statements,
                "tailstack_version": tailstack_version,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.geometry import Geometry  # noqa: PLC0415
        from ..models.printed_cell import PrintedCell  # noqa: PLC0415
        from ..models.statement import Statement  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/study-paper/1"], d.pop("schema"))
        if schema != "tailstack/study-paper/1":
            raise ValueError(f"schema must match const 'tailstack/study-paper/1', got '{schema}'")

        source = d.pop("source")

        seed = d.pop("seed")

        trials = d.pop("trials")

        published_trials = d.pop("published_trials")

        band = d.pop("band")

        geometries = []
        _geometries = d.pop("geometries")
        for geometries_item_data in _geometries:
            geometries_item = Geometry.from_dict(geometries_item_data)

            geometries.append(geometries_item)

        printed = []
        _printed = d.pop("printed")
        for printed_item_data in _printed:
            printed_item = PrintedCell.from_dict(printed_item_data)

            printed.append(printed_item)

        statements = []
        _statements = d.pop("statements")
        for statements_item_data in _statements:
            statements_item = Statement.from_dict(statements_item_data)

            statements.append(statements_item)

        tailstack_version = d.pop("tailstack_version")

        study_paper = cls(
            schema=schema,
            source=source,
            seed=seed,
            trials=trials,
            published_trials=published_trials,
            band=band,
            geometries=geometries,
            printed=printed,
            statements=statements,
            tailstack_version=tailstack_version,
        )

        return study_paper

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.additivity import Additivity
    from ..models.factor import Factor
    from ..models.level_ratio import LevelRatio
    from ..models.level_shape import LevelShape
    from ..models.paper_cell import PaperCell


T = TypeVar("T", bound="Geometry")


@_attrs_define
class Geometry:
    """The tables in one geometry.

    Attributes:
        name (str): Name of the geometry.
        design_sha256 (None | str): SHA-256 of its design's canonical content; null where there is no design.
        compared (bool): Whether it was fitted to the tables, and is set beside them.
        reading (str): Reading of the installation error: physical or eq18.
        target (str): Name of the target.
        lever_mm (float): Distance from the pivot to the target, mm.
        nu (float): Validity number at the largest noise of the tables.
        cells (list[PaperCell]): The cells of S1 to S3 in this geometry.
        compared_cells (int): How many of them stand beside a printed one.
        outside_cells (int): How many printed ones are outside their band.
        chi_square (float | None): Sum of the squares of their z; null where nothing is compared.
        additivity (list[Additivity]): S2 against its parts.
        factor (Factor): S3: the analytic column against Monte Carlo, and which simplification makes it.
        levels (list[LevelRatio]): S4's ratio of error to reprojection error.
        shapes (list[LevelShape]): S4's tail.
    """

    name: str
    design_sha256: None | str
    compared: bool
    reading: str
    target: str
    lever_mm: float
    nu: float
    cells: list[PaperCell]
    compared_cells: int
    outside_cells: int
    chi_square: float | None
    additivity: list[Additivity]
    factor: Factor
    levels: list[LevelRatio]
    shapes: list[LevelShape]

    def to_dict(self) -> dict[str, Any]:
        from ..models.additivity import Additivity  # noqa: PLC0415
        from ..models.factor import Factor  # noqa: PLC0415
        from ..models.level_ratio import LevelRatio  # noqa: PLC0415
        from ..models.level_shape import LevelShape  # noqa: PLC0415
        from ..models.paper_cell import PaperCell  # noqa: PLC0415

        name = self.name

        design_sha256: None | str
        design_sha256 = self.design_sha256

        compared = self.compared

        reading = self.reading

        target = self.target

        lever_mm = self.lever_mm

        nu = self.nu

        cells = []
        for cells_item_data in self.cells:
            cells_item = cells_item_data.to_dict()
            cells.append(cells_item)

        compared_cells = self.compared_cells

        outside_cells = self.outside_cells

        chi_square: float | None
        chi_square = self.chi_square

        additivity = []
        for additivity_item_data in self.additivity:
            additivity_item = additivity_item_data.to_dict()
            additivity.append(additivity_item)

        factor = self.factor.to_dict()

        levels = []
        for levels_item_data in self.levels:
            levels_item = levels_item_data.to_dict()
            levels.append(levels_item)

        shapes = []
        for shapes_item_data in self.shapes:
            shapes_item = shapes_item_data.to_dict()
            shapes.append(shapes_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "design_sha256": design_sha256,
                "compared": compared,
                "reading": reading,
                "target": target,
                "lever_mm": lever_mm,
                "nu": nu,
                "cells": cells,
                "compared_cells": compared_cells,
                "outside_cells": outside_cells,
                "chi_square": chi_square,
                "additivity": additivity,
                "factor": factor,
                "levels": levels,
                "shapes": shapes,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.additivity import Additivity  # noqa: PLC0415
        from ..models.factor import Factor  # noqa: PLC0415
        from ..models.level_ratio import LevelRatio  # noqa: PLC0415
        from ..models.level_shape import LevelShape  # noqa: PLC0415
        from ..models.paper_cell import PaperCell  # noqa: PLC0415

        d = dict(src_dict)
        name = d.pop("name")

        def _parse_design_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        design_sha256 = _parse_design_sha256(d.pop("design_sha256"))

        compared = d.pop("compared")

        reading = d.pop("reading")

        target = d.pop("target")

        lever_mm = d.pop("lever_mm")

        nu = d.pop("nu")

        cells = []
        _cells = d.pop("cells")
        for cells_item_data in _cells:
            cells_item = PaperCell.from_dict(cells_item_data)

            cells.append(cells_item)

        compared_cells = d.pop("compared_cells")

        outside_cells = d.pop("outside_cells")

        def _parse_chi_square(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        chi_square = _parse_chi_square(d.pop("chi_square"))

        additivity = []
        _additivity = d.pop("additivity")
        for additivity_item_data in _additivity:
            additivity_item = Additivity.from_dict(additivity_item_data)

            additivity.append(additivity_item)

        factor = Factor.from_dict(d.pop("factor"))

        levels = []
        _levels = d.pop("levels")
        for levels_item_data in _levels:
            levels_item = LevelRatio.from_dict(levels_item_data)

            levels.append(levels_item)

        shapes = []
        _shapes = d.pop("shapes")
        for shapes_item_data in _shapes:
            shapes_item = LevelShape.from_dict(shapes_item_data)

            shapes.append(shapes_item)

        geometry = cls(
            name=name,
            design_sha256=design_sha256,
            compared=compared,
            reading=reading,
            target=target,
            lever_mm=lever_mm,
            nu=nu,
            cells=cells,
            compared_cells=compared_cells,
            outside_cells=outside_cells,
            chi_square=chi_square,
            additivity=additivity,
            factor=factor,
            levels=levels,
            shapes=shapes,
        )

        return geometry

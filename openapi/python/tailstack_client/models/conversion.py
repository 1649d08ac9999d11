from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.conversion_format import check_conversion_format
from ..models.conversion_format import ConversionFormat
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.converted_body import ConvertedBody
    from ..models.converted_point import ConvertedPoint


T = TypeVar("T", bound="Conversion")


@_attrs_define
class Conversion:
    """A fiducial file or a design in another format, and the fiducials in it.

    Attributes:
        schema (Literal['tailstack/conversion/1']): Name and version of this record's schema.
        format_ (ConversionFormat): Format of `content`.
        content (str): The converted text.
        fiducials (list[ConvertedPoint]): The fiducials in it.
        notes (list[str]): What was done to the numbers on the way.
        bodies (list[ConvertedBody]): Of a STEP file: the balls that became fiducials, and whatever has a spherical face
            or a name as asked for.
    """

    schema: Literal["tailstack/conversion/1"]
    format_: ConversionFormat
    content: str
    fiducials: list[ConvertedPoint]
    notes: list[str]
    bodies: list[ConvertedBody]

    def to_dict(self) -> dict[str, Any]:
        from ..models.converted_body import ConvertedBody  # noqa: PLC0415
        from ..models.converted_point import ConvertedPoint  # noqa: PLC0415

        schema = self.schema

        format_: str = self.format_

        content = self.content

        fiducials = []
        for fiducials_item_data in self.fiducials:
            fiducials_item = fiducials_item_data.to_dict()
            fiducials.append(fiducials_item)

        notes = self.notes

        bodies = []
        for bodies_item_data in self.bodies:
            bodies_item = bodies_item_data.to_dict()
            bodies.append(bodies_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "format": format_,
                "content": content,
                "fiducials": fiducials,
                "notes": notes,
                "bodies": bodies,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.converted_body import ConvertedBody  # noqa: PLC0415
        from ..models.converted_point import ConvertedPoint  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/conversion/1"], d.pop("schema"))
        if schema != "tailstack/conversion/1":
            raise ValueError(f"schema must match const 'tailstack/conversion/1', got '{schema}'")

        format_ = check_conversion_format(d.pop("format"))

        content = d.pop("content")

        fiducials = []
        _fiducials = d.pop("fiducials")
        for fiducials_item_data in _fiducials:
            fiducials_item = ConvertedPoint.from_dict(fiducials_item_data)

            fiducials.append(fiducials_item)

        notes = cast(list[str], d.pop("notes"))

        bodies = []
        _bodies = d.pop("bodies")
        for bodies_item_data in _bodies:
            bodies_item = ConvertedBody.from_dict(bodies_item_data)

            bodies.append(bodies_item)

        conversion = cls(
            schema=schema,
            format_=format_,
            content=content,
            fiducials=fiducials,
            notes=notes,
            bodies=bodies,
        )

        return conversion

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.conversion_request_format import check_conversion_request_format
from ..models.conversion_request_format import ConversionRequestFormat
from ..models.conversion_request_to import check_conversion_request_to
from ..models.conversion_request_to import ConversionRequestTo
from ..models.conversion_request_xmalab_type_0 import check_conversion_request_xmalab_type_0
from ..models.conversion_request_xmalab_type_0 import ConversionRequestXmalabType0
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.conversion_request_base_type_0 import ConversionRequestBaseType0


T = TypeVar("T", bound="ConversionRequest")


@_attrs_define
class ConversionRequest:
    """
    Attributes:
        format_ (ConversionRequestFormat): What the content is; yaml and json are designs.
        content (str): The text of the file.
        sphere_diameter_mm (float | None | Unset): STEP only: diameter of the balls that are fiducials, mm. Absent: all,
            if they have one.
        sphere_tolerance_mm (float | Unset): STEP only: how far a diameter may be from sphere_diameter_mm, mm. Default:
            0.01.
        name (None | str | Unset): STEP only: pattern of the name of a ball: its own, or that of its part or instance.
        frame (None | str | Unset): STEP only: name of the coordinate system, part or instance whose frame becomes con.
        seats (None | str | Unset): STEP only: pattern of the names of cylinders and coordinate systems that hold the
            structure along their axis; with pins they become its six locators.
        pins (None | str | Unset): STEP only: pattern of the names of cylinders and coordinate systems that hold the
            structure across their axis: the first both ways, each other one across the line to it.
        xmalab (ConversionRequestXmalabType0 | None | Unset): CSV only: it is a frame specification of XMALab, with
            numbers in this unit: the content, or, if that is no CSV, what is made of it.
        to (ConversionRequestTo | Unset): What to make of it; a design becomes a design, or its fiducials. Default:
            'yaml'.
        base (ConversionRequestBaseType0 | None | Unset): A design whose fiducials are to be replaced by those of the
            content; the answer holds it.
    """

    format_: ConversionRequestFormat
    content: str
    sphere_diameter_mm: float | None | Unset = UNSET
    sphere_tolerance_mm: float | Unset = 0.01
    name: None | str | Unset = UNSET
    frame: None | str | Unset = UNSET
    seats: None | str | Unset = UNSET
    pins: None | str | Unset = UNSET
    xmalab: ConversionRequestXmalabType0 | None | Unset = UNSET
    to: ConversionRequestTo | Unset = "yaml"
    base: ConversionRequestBaseType0 | None | Unset = UNSET

    def to_dict(self) -> dict[str, Any]:
        from ..models.conversion_request_base_type_0 import ConversionRequestBaseType0  # noqa: PLC0415

        format_: str = self.format_

        content = self.content

        sphere_diameter_mm: float | None | Unset
        if isinstance(self.sphere_diameter_mm, Unset):
            sphere_diameter_mm = UNSET
        else:
            sphere_diameter_mm = self.sphere_diameter_mm

        sphere_tolerance_mm = self.sphere_tolerance_mm

        name: None | str | Unset
        if isinstance(self.name, Unset):
            name = UNSET
        else:
            name = self.name

        frame: None | str | Unset
        if isinstance(self.frame, Unset):
            frame = UNSET
        else:
            frame = self.frame

        seats: None | str | Unset
        if isinstance(self.seats, Unset):
            seats = UNSET
        else:
            seats = self.seats

        pins: None | str | Unset
        if isinstance(self.pins, Unset):
            pins = UNSET
        else:
            pins = self.pins

        xmalab: None | str | Unset
        if isinstance(self.xmalab, Unset):
            xmalab = UNSET
        elif isinstance(self.xmalab, str):
            xmalab = self.xmalab
        else:
            xmalab = self.xmalab

        to: str | Unset = UNSET
        if not isinstance(self.to, Unset):
            to = self.to

        base: dict[str, Any] | None | Unset
        if isinstance(self.base, Unset):
            base = UNSET
        elif isinstance(self.base, ConversionRequestBaseType0):
            base = self.base.to_dict()
        else:
            base = self.base

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "format": format_,
                "content": content,
            }
        )
        if sphere_diameter_mm is not UNSET:
            field_dict["sphere_diameter_mm"] = sphere_diameter_mm
        if sphere_tolerance_mm is not UNSET:
            field_dict["sphere_tolerance_mm"] = sphere_tolerance_mm
        if name is not UNSET:
            field_dict["name"] = name
        if frame is not UNSET:
            field_dict["frame"] = frame
        if seats is not UNSET:
            field_dict["seats"] = seats
        if pins is not UNSET:
            field_dict["pins"] = pins
        if xmalab is not UNSET:
            field_dict["xmalab"] = xmalab
        if to is not UNSET:
            field_dict["to"] = to
        if base is not UNSET:
            field_dict["base"] = base

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.conversion_request_base_type_0 import ConversionRequestBaseType0  # noqa: PLC0415

        d = dict(src_dict)
        format_ = check_conversion_request_format(d.pop("format"))

        content = d.pop("content")

        def _parse_sphere_diameter_mm(data: object) -> float | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(float | None | Unset, data)

        sphere_diameter_mm = _parse_sphere_diameter_mm(d.pop("sphere_diameter_mm", UNSET))

        sphere_tolerance_mm = d.pop("sphere_tolerance_mm", UNSET)

        def _parse_name(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        name = _parse_name(d.pop("name", UNSET))

        def _parse_frame(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        frame = _parse_frame(d.pop("frame", UNSET))

        def _parse_seats(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        seats = _parse_seats(d.pop("seats", UNSET))

        def _parse_pins(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        pins = _parse_pins(d.pop("pins", UNSET))

        def _parse_xmalab(data: object) -> ConversionRequestXmalabType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, str):
                    raise TypeError()
                xmalab_type_0 = check_conversion_request_xmalab_type_0(data)

                return xmalab_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(ConversionRequestXmalabType0 | None | Unset, data)

        xmalab = _parse_xmalab(d.pop("xmalab", UNSET))

        _to = d.pop("to", UNSET)
        to: ConversionRequestTo | Unset
        if isinstance(_to, Unset):
            to = UNSET
        else:
            to = check_conversion_request_to(_to)

        def _parse_base(data: object) -> ConversionRequestBaseType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                base_type_0 = ConversionRequestBaseType0.from_dict(data)

                return base_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(ConversionRequestBaseType0 | None | Unset, data)

        base = _parse_base(d.pop("base", UNSET))

        conversion_request = cls(
            format_=format_,
            content=content,
            sphere_diameter_mm=sphere_diameter_mm,
            sphere_tolerance_mm=sphere_tolerance_mm,
            name=name,
            frame=frame,
            seats=seats,
            pins=pins,
            xmalab=xmalab,
            to=to,
            base=base,
        )

        return conversion_request

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.gate_request_design_design_type_0 import GateRequestDesignDesignType0


T = TypeVar("T", bound="GateRequestDesign")


@_attrs_define
class GateRequestDesign:
    """One design of a gate.

    Attributes:
        file (str): What findings call it; the policy's patterns see this name.
        design (GateRequestDesignDesignType0 | None | Unset): The design document. Either this or text.
        text (None | str | Unset): The design document as YAML or JSON text: findings then have line and column.
        class_ (None | str | Unset): Class of the policy. Absent: the policy's patterns decide.
    """

    file: str
    design: GateRequestDesignDesignType0 | None | Unset = UNSET
    text: None | str | Unset = UNSET
    class_: None | str | Unset = UNSET

    def to_dict(self) -> dict[str, Any]:
        from ..models.gate_request_design_design_type_0 import GateRequestDesignDesignType0  # noqa: PLC0415

        file = self.file

        design: dict[str, Any] | None | Unset
        if isinstance(self.design, Unset):
            design = UNSET
        elif isinstance(self.design, GateRequestDesignDesignType0):
            design = self.design.to_dict()
        else:
            design = self.design

        text: None | str | Unset
        if isinstance(self.text, Unset):
            text = UNSET
        else:
            text = self.text

        class_: None | str | Unset
        if isinstance(self.class_, Unset):
            class_ = UNSET
        else:
            class_ = self.class_

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "file": file,
            }
        )
        if design is not UNSET:
            field_dict["design"] = design
        if text is not UNSET:
            field_dict["text"] = text
        if class_ is not UNSET:
            field_dict["class"] = class_

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.gate_request_design_design_type_0 import GateRequestDesignDesignType0  # noqa: PLC0415

        d = dict(src_dict)
        file = d.pop("file")

        def _parse_design(data: object) -> GateRequestDesignDesignType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                design_type_0 = GateRequestDesignDesignType0.from_dict(data)

                return design_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(GateRequestDesignDesignType0 | None | Unset, data)

        design = _parse_design(d.pop("design", UNSET))

        def _parse_text(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        text = _parse_text(d.pop("text", UNSET))

        def _parse_class_(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        class_ = _parse_class_(d.pop("class", UNSET))

        gate_request_design = cls(
            file=file,
            design=design,
            text=text,
            class_=class_,
        )

        return gate_request_design

"""The design document: reading, checking, compiling to a :class:`tailstack.system.System`, writing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..extras import load_on_first_use

if TYPE_CHECKING:
    from ..integrations.conversion import Conversion, convert, convert_file
    from ..integrations.step import StepBody, StepContact, StepReading, StepSelection, read_step
    from .compile import check_design, compile_design
    from .document import design_json_schema
    from .loading import Design, load_design
    from .presets import list_presets
    from .reading import DEFAULT_LIMITS, Limits
    from .write import (
        Revision,
        design_to_data,
        design_to_json,
        design_to_yaml,
        revise_design,
    )

# Loaded on first use: who only looks at a text, or asks for the schema, does not wait for the geometry.
_HOME = {
    "check_design": "compile",
    "compile_design": "compile",
    "design_json_schema": "document",
    "Design": "loading",
    "load_design": "loading",
    "list_presets": "presets",
    "DEFAULT_LIMITS": "reading",
    "Limits": "reading",
    "StepBody": ".integrations.step",
    "StepContact": ".integrations.step",
    "StepReading": ".integrations.step",
    "StepSelection": ".integrations.step",
    "read_step": ".integrations.step",
    "Conversion": ".integrations.conversion",
    "Revision": "write",
    "convert": ".integrations.conversion",
    "convert_file": ".integrations.conversion",
    "design_to_data": "write",
    "design_to_json": "write",
    "design_to_yaml": "write",
    "revise_design": "write",
}

__all__ = [
    "DEFAULT_LIMITS",
    "Conversion",
    "Design",
    "Limits",
    "Revision",
    "StepBody",
    "StepContact",
    "StepReading",
    "StepSelection",
    "check_design",
    "compile_design",
    "convert",
    "convert_file",
    "design_json_schema",
    "design_to_data",
    "design_to_json",
    "design_to_yaml",
    "list_presets",
    "load_design",
    "read_step",
    "revise_design",
]

__getattr__ = load_on_first_use(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__

"""The design document: reading, checking, compiling to a :class:`tailstack.system.System`, writing."""

from __future__ import annotations

from .compile import check_design, compile_design
from .conversion import Conversion, convert, convert_file
from .document import design_json_schema
from .loading import (
    CONTRIBUTOR,
    FIELD,
    Design,
    Revision,
    design_to_data,
    design_to_json,
    design_to_yaml,
    load_design,
    revise_design,
)
from .presets import list_presets
from .reading import DEFAULT_LIMITS, Limits

__all__ = [
    "CONTRIBUTOR",
    "DEFAULT_LIMITS",
    "FIELD",
    "Conversion",
    "Design",
    "Limits",
    "Revision",
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
    "revise_design",
]

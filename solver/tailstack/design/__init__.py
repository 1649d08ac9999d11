"""The design document: reading, checking, compiling to a :class:`tailstack.system.System`, writing."""

from __future__ import annotations

from .compile import check_design, compile_design
from .document import design_json_schema
from .loading import Design, load_design
from .presets import list_presets
from .reading import DEFAULT_LIMITS, Limits
from .write import (
    Conversion,
    Revision,
    convert,
    convert_file,
    design_to_data,
    design_to_json,
    design_to_yaml,
    revise_design,
)

__all__ = [
    "DEFAULT_LIMITS",
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

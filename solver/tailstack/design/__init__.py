"""The design document: reading, checking, compiling to a :class:`tailstack.system.System`, writing."""

from __future__ import annotations

from .checked import check_design
from .compile import compile_design
from .conversion import Conversion, convert, convert_file
from .loading import Design, design_to_data, design_to_json, design_to_yaml, load_design
from .presets import list_presets
from .reading import DEFAULT_LIMITS, Limits
from .revision import CONTRIBUTOR, FIELD, Revision, revise_design
from .schema import design_json_schema

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

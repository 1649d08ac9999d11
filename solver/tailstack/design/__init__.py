"""The design document: reading, checking, compiling to a :class:`tailstack.system.System`, writing."""

from __future__ import annotations

from .compile import compile_design
from .loading import Design, design_to_data, design_to_json, design_to_yaml, load_design

__all__ = ["Design", "compile_design", "design_to_data", "design_to_json", "design_to_yaml", "load_design"]

"""The published JSON Schemas of what a gate judges by."""

from __future__ import annotations

from typing import Any

from tailstack.design.document import without_null

from .policy_document import Policy
from .rules import RULES
from .waiver_document import LONGEST_DAYS, Waivers


def policy_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/policy/1``."""
    head = {
        "title": "tailstack policy, version 1",
        "description": "What a gate judges by: rules by id with their severity and limits, and classes of designs with "
        "rules of their own. Unknown fields, NaN and infinities are refused.",
    }
    schema = without_null(Policy.model_json_schema(by_alias=True))
    for name, entry in schema["$defs"]["Rules"]["properties"].items():
        entry["description"] = f"{RULES[name].title}."
    return {**schema, **head}


def waivers_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/waivers/1``."""
    head = {
        "title": "tailstack waivers, version 1",
        "description": f"Findings that a gate accepts for now, each by somebody, for a reason, up to a value and a day "
        f"at most {LONGEST_DAYS} days ahead.",
    }
    return {**without_null(Waivers.model_json_schema(by_alias=True)), **head}

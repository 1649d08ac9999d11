"""What schemathesis is told beyond the document, so that valid requests reach what lies behind the readers.

Most documents that fit the schema of a design describe no structure that could be built, so half of the valid
requests get the design of the examples (and a gate a policy), with the generated options beside it.  And OpenAPI
cannot say that options stand in the query with a YAML body only: valid requests in JSON leave them out.  Invalid
ones are sent as they are.
"""

from __future__ import annotations

import copy
import hashlib
import json
from typing import Any

import schemathesis
from schemathesis import GenerationMode

from tailstack_service.integrations.conversion import STEP_MEDIA
from tailstack_service.operations.example import EXAMPLE_DESIGN
from tailstack_service.tables import MEDIA_TYPES

# Documents that the schema of a request leaves open, and trials within the limit of the service that is asked.
POLICY = {"schema": "tailstack/policy/1", "verification": {"max_trials": 1000, "precision": 0.3}}
CHECKS = {"/v1/verifications", "/v1/comparisons", "/v1/reports"}  # they draw more than that unless told otherwise
FEW = {"trials": None, "max_trials": 1000}
# As many starts as the service that is asked allows; trials as in the example, for without them it takes two seconds
LITTLE = {"/v1/optimisations": {"starts": 1}, "/v1/studies/coupling": {"trials": 8192}}


@schemathesis.serializer(*STEP_MEDIA)
def serialize_step(context: Any, value: Any) -> bytes:
    """A STEP file is text, which schemathesis does not know."""
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogatepass")


@schemathesis.serializer(*(set(MEDIA_TYPES.values()) - {"text/csv"}))
def serialize_table(context: Any, value: Any) -> bytes:
    """So are lines of JSON; workbooks and Arrow are bytes."""
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogatepass")


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Change a valid request just before it is sent."""
    if case.meta is None or case.meta.generation.mode != GenerationMode.POSITIVE or case.body is None:
        return
    # Hangs on nothing but the body, so that a seed repeats
    draw = hashlib.sha256(json.dumps(case.body, sort_keys=True, default=str).encode()).digest()[0]
    if case.media_type == "application/json" and isinstance(case.body, dict):
        case.query = {}
        if case.operation.path in CHECKS and case.body.keys() & {"design", "first"}:
            case.body = {**case.body, **FEW}  # the examples ask for more, and not all seeds change one of them
        if case.operation.path == "/v1/reports" and draw % 2:  # few generated ones say a design
            design, parts = copy.deepcopy(EXAMPLE_DESIGN), ["score", "verification"]
            case.body = {"design": design, "parts": parts, "max_trials": 1000}
        elif "design" in case.body and draw % 2:
            case.body = {**case.body, "design": copy.deepcopy(EXAMPLE_DESIGN)}
            case.body |= LITTLE.get(case.operation.path, {})
        elif case.operation.path in CHECKS and draw % 2:
            sides = {side: copy.deepcopy(EXAMPLE_DESIGN) for side in ("first", "second")}
            case.body = {**case.body, **sides, **FEW}
        elif "designs" in case.body and draw % 2:
            named = [{"file": entry["file"], "design": copy.deepcopy(EXAMPLE_DESIGN)} for entry in case.body["designs"]]
            rest = {"policy": copy.deepcopy(POLICY), "waivers": None, "baseline": None}
            case.body = {**case.body, "designs": named, **rest}
    elif case.media_type == "application/yaml" and isinstance(case.body, dict) and draw % 2:
        case.body = copy.deepcopy(EXAMPLE_DESIGN)

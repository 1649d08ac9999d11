"""Rules of our own for the OpenAPI document; openapi/README.md gives the reason of each.

``python openapi/rules.py [DOCUMENT]`` prints one line per violation and leaves with 1 if there are any.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
METHODS = ("get", "put", "post", "delete", "options", "head", "patch", "trace")
PROBLEM = "application/problem+json"
SNAKE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*\Z")
UNIT = re.compile(r"_(mm2?|mm_per_n|kg|nm_per_rad|per_m|deg|px|n|k|um_per_m_k|s|seconds|percent|bytes|per_unit)\Z")

# What a status obliges to say in headers, whatever the operation.
HEADERS = {
    "202": ("Location", "Retry-After"),
    "303": ("Location",),
    "304": ("ETag",),
    "401": ("WWW-Authenticate",),
    "405": ("Allow",),
    "429": ("Retry-After",),
    "503": ("Retry-After",),
}
# Readiness tells its state in one form, ready or not.
OTHER_ERRORS = {("get_readiness", "503")}
DONE = {"cancel_job"}  # its 202 has nothing to come back for: the job is cancelled when it is answered
UNSAID = {"text/plain"}  # means nothing without the parameter that says what the text is
ITSELF = "get_openapi"  # answers with this very document, which is its own example

COUNTS = frozenset(
    {"benches", "broken", "changes_left_out", "column", "compared_cells", "compared_trials", "converged_starts",
     "count", "counts", "evaluations", "exit_code", "fiducials", "first_start", "flagged_trials",
     "installations", "kept", "line", "lost", "markers", "max", "max_trials", "min", "n", "open", "order",
     "outside_cells", "pairs", "points", "points_per_axis", "poses", "published_trials", "refused", "rows", "scored",
     "sections", "seed", "solved", "starts", "status", "tightening_rounds", "trials", "trials_with_losses",
     "trials_without_answer", "units_done", "units_expected", "within", "workers"}
)  # fmt: skip
RATIOS = frozenset(
    {"along", "axis", "band", "beam_direction", "beam_direction_before", "bias_rel", "chi_square", "coefficient",
     "confidence", "contrast", "corridor_major_direction", "coverage_factor", "direction",
     "error_rate", "exceedance_probability", "extrapolation",
     "factor", "fiducial_noise_shape", "first_order", "first_order_ratio", "focal_rel_sd", "fraction", "gap",
     "half_width_rel", "highest_ratio", "interval", "kept_fraction", "kkt_residual", "largest_loss_probability",
     "largest_share", "limit_probability", "loss_probability", "lowest_ratio", "max_scale", "min_scale",
     "min_yield", "normal", "nu", "nu_bias", "nu_crossing", "nu_depth", "nu_disagreement", "nu_gap", "nu_range",
     "nu_turns", "over_monte_carlo", "p_adjusted", "p_value", "precision", "precision_reached",
     "precision_requested", "probability", "probability_of_none", "probability_unaccounted",
     "probability_without_answer", "quantile", "quaternion_wxyz", "ratio", "ratio_interval", "rotation", "sampled",
     "scale", "share", "share_interval", "smallest_loss_probability", "snr", "spread", "spreads", "statistic",
     "target_noise_shape", "towards", "units_fraction", "up", "up_direction",
     "variance_share", "worst_ratio", "yield_fraction", "yield_standard_error", "z"}
)  # fmt: skip
PRICES = frozenset(  # in the unit in which the design states its own prices
    {"best_costs", "cost", "cost_after", "cost_before", "cost_closed_form", "cost_exact_law", "cost_limit",
     "cost_of_moves", "cost_per_fiducial", "cost_weight", "cost_with", "cost_without", "lower_bound", "price",
     "weight", "worth"}
)  # fmt: skip
SEVERAL = frozenset(  # mm, degrees, px, a price or a ratio: the record says which, in a field or in words
    {"half_widths", "limit", "objective", "objective_as_aimed",
     "objective_left", "objective_moved", "scaling", "slope", "start", "stop", "value", "value_without",
     "values"}
)  # fmt: skip
INSIDE = frozenset({"gaussian", "moments", "unimodal", "principal_point_px_sd"})  # whose record or name says it
MATRICES = frozenset(
    {"T_con_file", "T_flange_con", "T_tcp_flange", "pose", "projection", "target_projection"}
)  # mixed units, stated in words


def violations(document: Mapping[str, Any]) -> list[str]:
    """One sentence per broken rule."""
    found = [] if str(document.get("openapi", "")).startswith("3.1.") else ["openapi: the document is not OpenAPI 3.1"]
    found += [f"{place}: itemSchema is a keyword of OpenAPI 3.2" for place in _places(document, "itemSchema")]
    ids: dict[str, str] = {}
    tags = {tag["name"] for tag in document.get("tags", ()) if tag.get("description")}
    for path, item in document["paths"].items():
        for method in (m for m in METHODS if m in item):
            name, operation = f"{method.upper()} {path}", item[method]
            found += [f"{name}: {text}" for text in _operation(document, path, item, operation, tags)]
            identity = operation.get("operationId")
            if identity in ids:
                found.append(f"{name}: operationId {identity} is also that of {ids[identity]}")
            ids.setdefault(identity, name)
    for name, schema in document.get("components", {}).get("schemas", {}).items():
        found += [f"schema {name}: {text}" for text in (*_units(schema), *without_words(schema))]
    return found


def _operation(document: Mapping[str, Any], path: str, item: Any, operation: Any, tags: set[str]) -> Iterator[str]:
    identity = operation.get("operationId", "")
    if not SNAKE.match(identity):
        yield f"operationId {identity!r} is not snake_case"
    if not operation.get("summary"):
        yield "no summary"
    if not operation.get("description"):
        yield "no description"
    if len(operation.get("tags", ())) != 1 or not set(operation["tags"]) <= tags:
        yield "needs one tag, and the document describes it"
    parameters = [resolved(document, p) for p in (*item.get("parameters", ()), *operation.get("parameters", ()))]
    yield from _parameters(path, parameters)
    for media, content in resolved(document, operation.get("requestBody", {})).get("content", {}).items():
        if not _has_example(content) and media not in UNSAID and content["schema"].get("format") != "binary":
            yield f"request body {media}: no example"
    statuses = operation.get("responses", {})
    if not any(status[0] in "23" for status in statuses):
        yield "no response for success"
    for status, response in statuses.items():
        answer = resolved(document, response)
        yield from (f"response {status}: {text}" for text in _response(document, identity, status, answer))
        json_answer = answer.get("content", {}).get("application/json")
        if status == "200" and json_answer is not None and identity != ITSELF and not _has_example(json_answer):
            yield "response 200: no example (python openapi/answers.py URL writes it)"


def _parameters(path: str, parameters: list[Any]) -> Iterator[str]:
    inside = set(re.findall(r"{([^}]+)}", path))
    for parameter in parameters:
        name = f"{parameter['in']} parameter {parameter['name']}"
        if not parameter.get("description"):
            yield f"{name}: no description"
        if parameter["in"] == "path":
            inside.discard(parameter["name"])
            if not _has_example(parameter):
                yield f"{name}: no example"
    yield from (f"path parameter {name}: not described at all" for name in sorted(inside))


def _response(document: Mapping[str, Any], identity: str, status: str, response: Any) -> Iterator[str]:
    if not response.get("description"):
        yield "no description"
    if status[0] in "45" and (identity, status) not in OTHER_ERRORS:
        content = response.get("content", {})
        if list(content) != [PROBLEM]:
            yield f"an error is {PROBLEM} and nothing else"
        elif content[PROBLEM].get("schema") != {"$ref": "#/components/schemas/Problem"}:
            yield "an error refers to the schema Problem"
    headers = {name.lower(): resolved(document, header) for name, header in response.get("headers", {}).items()}
    expected = () if identity in DONE else HEADERS.get(status, ())
    for name in expected:
        if not headers.get(name.lower(), {}).get("schema") or not headers[name.lower()].get("description"):
            yield f"the header {name} is not documented"


def _has_example(content: Any) -> bool:
    return bool(content.get("examples")) or "example" in content or bool(content.get("schema", {}).get("examples"))


def _units(schema: Any) -> Iterator[str]:
    """Properties that hold numbers and do not say of what."""
    if isinstance(schema, list):
        for part in schema:
            yield from _units(part)
    if not isinstance(schema, dict):
        return
    properties = schema.get("properties", {})
    for name, kind in properties.items():
        known = name in COUNTS | RATIOS | PRICES | SEVERAL | INSIDE | MATRICES
        if _is_number(kind) and not (UNIT.search(name) or known or "unit" in properties):
            yield f"the number {name} has no unit in its name, no field `unit` beside it, and is not listed"
    for keyword, part in schema.items():
        for child in part.values() if keyword in ("properties", "$defs") else (part,):
            if keyword not in ("example", "examples", "default", "enum", "const"):
                yield from _units(child)


def without_words(schema: Any) -> Iterator[str]:
    """Properties that nothing is said of, wherever they are."""
    if isinstance(schema, list):
        for part in schema:
            yield from without_words(part)
    if not isinstance(schema, dict):
        return
    for name, part in schema.get("properties", {}).items():
        if not part.get("description"):
            yield f"the property {name} has no description"
    for keyword, part in schema.items():
        for child in part.values() if keyword in ("properties", "$defs") else (part,):
            if keyword not in ("example", "examples", "default", "enum", "const"):
                yield from without_words(child)


def _is_number(schema: Any) -> bool:
    """A number, or a list of them, or null instead."""
    if not isinstance(schema, dict):
        return False
    if {"number", "integer"} & set(kinds if isinstance(kinds := schema.get("type"), list) else [kinds]):
        return True
    parts = [*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("prefixItems", ()), schema.get("items")]
    return any(_is_number(part) for part in parts)


def resolved(document: Mapping[str, Any], node: Any) -> Any:
    """A node with its references into the document followed."""
    while "$ref" in node:
        place: Any = document
        for step in node["$ref"].removeprefix("#/").split("/"):
            place = place[step.replace("~1", "/").replace("~0", "~")]
        node = place
    return node


def _places(node: Any, keyword: str, at: str = "") -> Iterator[str]:
    if isinstance(node, dict):
        for key, child in node.items():
            if key == keyword:
                yield at or "the document"
            yield from _places(child, keyword, f"{at}/{key}")
    elif isinstance(node, list):
        for place, child in enumerate(node):
            yield from _places(child, keyword, f"{at}/{place}")


def main(arguments: list[str]) -> int:
    """Command line: the document, by default openapi.json beside this file."""
    path = Path(arguments[0]) if arguments else HERE / "openapi.json"
    found = violations(json.loads(path.read_text(encoding="utf-8")))
    print("\n".join(found) if found else "no rule is broken")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

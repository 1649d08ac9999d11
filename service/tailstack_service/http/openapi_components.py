"""Components of the OpenAPI document: schemas, parameters, headers, problem responses, examples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ..documents import json_schema, record_json_schema
from ..problems import CATALOGUE, ProblemType
from .example import EXAMPLE_DESIGN
from .information import Health, Readiness, SchemaList, Version
from .operations import JOB_OPERATIONS, OPERATIONS
from .options import ComparisonOptions, ConversionOptions
from .problems import PROBLEM

# Names in the document, and so of the classes of generated clients, by the name of the published schema
COMPONENT = {
    "design": "Design", "score": "Score", "verification": "Verification", "optimisation": "Optimisation",
    "sweep": "Sweep", "gate": "Gate", "report": "Report", "comparison": "Comparison",
    "validation": "Validation", "conversion": "Conversion",
    "job": "Job", "jobs": "JobPage", "problem": "Problem",
}  # fmt: skip
PUBLISHED = {"JobDocument": "Job", "ProblemDocument": "Problem"}  # records whose own names say it twice
ANSWERS = Path(__file__).with_name("example_answers")  # written by openapi/answers.py, of a running service
ANSWERED = frozenset(path.stem for path in ANSWERS.glob("*.json"))  # operations whose 200 is shown so
RETRIED = frozenset({409, 429, 503})
EXAMPLE_ID = "01k4z8t5r2w7x3y9v6n1m0q8pc"
EXAMPLE_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


def reference(kind: str, name: str) -> dict[str, str]:
    """A reference to a component."""
    return {"$ref": f"#/components/{kind}/{name}"}


# --- schemas ----------------------------------------------------------------------------------------


class _Schemas:
    """Schemas by component name.  Equal definitions are shared, different ones of one name are kept apart."""

    def __init__(self) -> None:
        self.found: dict[str, Any] = {}

    def add(self, name: str, schema: dict[str, Any]) -> None:
        definitions = schema.pop("$defs", {})
        body = {key: value for key, value in schema.items() if key not in ("$schema", "$id")}
        names = {
            key: key if key != name and self._free(key, definitions[key]) else f"{name}{key}" for key in definitions
        } | {key: PUBLISHED[key] for key in definitions if key in PUBLISHED}
        for key, definition in definitions.items():
            self.found[names[key]] = _renamed(definition, names)
        self.found[name] = _renamed(body, names)

    def _free(self, key: str, definition: Any) -> bool:
        return key not in self.found or self.found[key] == _renamed(definition, {})


def _renamed(node: Any, names: dict[str, str]) -> Any:
    """The same schema with its references led to the components."""
    if isinstance(node, list):
        return [_renamed(item, names) for item in node]
    if not isinstance(node, dict):
        return node
    return {
        key: "#/components/schemas/" + names.get(value[8:], value[8:])
        if key == "$ref" and isinstance(value, str) and value.startswith("#/$defs/")
        else _renamed(value, names)
        for key, value in node.items()
    }


def schemas() -> dict[str, Any]:
    """Every schema that an operation speaks of."""
    from ..gate.request import GateRequest

    made = _Schemas()
    for name, component in COMPONENT.items():
        made.add(component, json_schema(name))
    for path, options in {entry.path: entry.options for entry in (*OPERATIONS, *JOB_OPERATIONS)}.items():
        made.add(request_name(path), _with_design(options))
    made.add("ConversionRequest", ConversionOptions.model_json_schema())
    made.add("ComparisonRequest", _with_designs(ComparisonOptions, COMPARED))
    made.add("GateRequest", GateRequest.model_json_schema(by_alias=True))
    made.add("JobEvent", _job_event())
    for record in (ProblemType, SchemaList, Health, Readiness, Version):
        made.add(record.__name__, record_json_schema(record))
    return dict(sorted(made.found.items()))


def _job_event() -> dict[str, Any]:
    words = (
        "job (its id) and at (RFC 3339); with state: state, and result_sha256 or problem; with progress: units_done, "
    )
    words += "units_expected, note, eta_seconds; with recomputed, after an upgrade of the solver: from and to."
    data = {"type": "string", "contentMediaType": "application/json", "description": words}
    properties: dict[str, Any] = {
        "id": {"type": "string", "pattern": "^[0-9]+$", "description": "Counts the events of a job from 1."},
        "event": {
            "type": "string",
            "enum": ["state", "progress", "recomputed"],
            "description": "What `data` tells of.",
        },
        "data": data,
    }
    return {"type": "object", "additionalProperties": False, "required": list(properties), "properties": properties}


def request_name(path: str) -> str:
    """Component name of the request of a computation: /v1/scores is asked with a ScoreRequest."""
    word = path.rpartition("/")[2]
    return word.removesuffix("s").capitalize() + "Request"


def _with_design(options: type[BaseModel]) -> dict[str, Any]:
    return _with_designs(options, {"design": "The design document."})


def _with_designs(options: type[BaseModel], fields: dict[str, str]) -> dict[str, Any]:
    """The schema of a request: designs, each with what it is, beside the options."""
    schema = options.model_json_schema()
    return {
        "type": "object",
        "additionalProperties": False,
        "required": [*fields, *schema.get("required", ())],
        "properties": {
            **{field: {**reference("schemas", "Design"), "description": words} for field, words in fields.items()},
            **schema.get("properties", {}),
        },
        "$defs": schema.get("$defs", {}),
    }


# --- parameters and headers -------------------------------------------------------------------------

COMPARED = {"first": "The design that is compared with.", "second": "The design whose changes are looked at."}
WHOLE = {"type": "integer", "minimum": 0}

PARAMETERS: dict[str, Any] = {
    "Prefer": {
        "name": "Prefer", "in": "header", "required": False, "schema": {"type": "string"}, "example": "wait=10",
        "description": "RFC 7240. wait=N: answer 200 with the result if it is there within N seconds, otherwise 202. "
        "The service may wait for less (TAILSTACK_MAX_WAIT_SECONDS).",
    },
    "IdempotencyKey": {
        "name": "Idempotency-Key", "in": "header", "required": False,
        "schema": {"type": "string", "minLength": 1, "maxLength": 255, "pattern": "^[!-~]+$"},
        "description": "One key stands for one request: sent again with the same body it gives the same job.",
    },
    "IfNoneMatch": {
        "name": "If-None-Match", "in": "header", "required": False, "schema": {"type": "string"},
        "description": "The ETag of what the client has: 304 if it is still that.",
    },
    "LastEventID": {
        "name": "Last-Event-ID", "in": "header", "required": False,
        "schema": {"type": "string", "pattern": "^[0-9]{0,15}$"},
        "description": "Id of the last event that was read; the stream goes on after it. Empty: none was.",
    },
    "After": {
        "name": "after", "in": "query", "required": False,
        "schema": {"type": "integer", "minimum": 0, "maximum": 10**15 - 1},
        "description": "The same as Last-Event-ID, for clients that cannot set headers.",
    },
    "JobId": {
        "name": "id", "in": "path", "required": True, "schema": {"type": "string", "pattern": "^[0-9a-z]{26}$"},
        "description": "Id of a job.", "example": EXAMPLE_ID,
    },
    "Sha256": {
        "name": "sha256", "in": "path", "required": True, "schema": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "description": "SHA-256 of the result, hexadecimal.", "example": EXAMPLE_SHA256,
    },
}  # fmt: skip


def header(description: str, schema: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    return {"description": description, "schema": schema or {"type": "string"}, **more}


# ``required``: wherever it is documented it is sent
HEADERS: dict[str, Any] = {
    "RequestId": header("Id of the request, in the log too.", {"type": "string", "maxLength": 64}, required=True),
    "ETag": header("Strong validator of the body.", required=True),
    "CacheControl": header("How long the answer may be used without asking.", required=True),
    "Vary": header("A cache keeps answers to different credentials apart.", required=True),
    "Location": header("Path of the job.", {"type": "string", "format": "uri-reference"}, required=True),
    "ResultLocation": header("Path of the result.", {"type": "string", "format": "uri-reference"}, required=True),
    "RetryAfter": header("Seconds after which it is worth asking again; absent once it is not.", WHOLE),
    "ComeBack": header("Seconds after which it is worth asking again.", WHOLE, required=True),
    "PreferenceApplied": header("The wait that was granted; absent when none was asked for."),
    "IdempotencyReplayed": header(
        "true: the key had made this job before; otherwise absent.", {"type": "string", "const": "true"}
    ),
    "Link": header('The next page, as <path>; rel="next"; absent on the last.'),
    "Challenge": header("RFC 6750 challenge.", required=True),
    "WWWAuthenticate": header("RFC 6750 challenge; absent where there is no authentication."),
    "ContentDisposition": header("A file name for the report.", required=True),
    "ContentSecurityPolicy": header("What HTML may do in a browser: run what it came with. Only with html."),
    "ContentTypeOptions": header("nosniff.", {"type": "string", "const": "nosniff"}, required=True),
    "Unbuffered": header("no: proxies pass events on as they come.", {"type": "string", "const": "no"}, required=True),
}


# --- responses --------------------------------------------------------------------------------------


def problem_responses() -> dict[str, Any]:
    """One response per status, with the classes of problems that come with it."""
    slugs: dict[int, list[str]] = {413: ["limit-exceeded"]}
    for entry in CATALOGUE.values():
        slugs.setdefault(entry.status, []).append(entry.slug)
    made = {}
    for status in sorted(slugs.keys() - {405}):  # of a path, not of an operation: nothing could refer to it
        headers = {"X-Request-ID": reference("headers", "RequestId")}
        if status in RETRIED:
            headers["Retry-After"] = reference("headers", "RetryAfter" if status == 409 else "ComeBack")
        if status in (401, 403):
            headers["WWW-Authenticate"] = reference("headers", "Challenge" if status == 401 else "WWWAuthenticate")
        made[f"Problem{status}"] = {
            "description": "Problem: " + ", ".join(slugs[status]) + ".",
            "headers": headers,
            "content": {PROBLEM: {"schema": reference("schemas", "Problem")}},
        }
    return made


# --- examples ---------------------------------------------------------------------------------------

_OPTIONS: dict[str, dict[str, Any]] = {
    "/v1/scores": {"second_order": True},
    "/v1/validations": {},
    "/v1/verifications": {"precision": 0.01, "seed": 7, "method": "plain"},
    "/v1/optimisations": {"starts": 2, "seed": 1},
    "/v1/sweeps": {
        "axes": [{"pointer": "/views/0/fiducial_noise_px", "start": 0.1, "stop": 0.5, "count": 5}],
        "check": "score",
    },
    "/v1/reports": {"parts": ["score", "verification"], "precision": 0.01, "seed": 7},
}
_JOB: dict[str, Any] = {
    "schema": "tailstack/job/1",
    "id": EXAMPLE_ID,
    "kind": "verification",
    "state": "running",
    "design_name": "eight beads, two seats",
    "created_at": "2026-01-31T12:00:00.000Z",
    "started_at": "2026-01-31T12:00:00.120Z",
    "finished_at": None,
    "solver_version": "0.4.0",
    "recomputed": None,
    "cpu_seconds": 0.31,
    "progress": {
        "fraction": 0.4, "units_done": 4, "units_expected": 10, "note": "524288 trials", "eta_seconds": 1.5,
    },
    "problem": None,
    "result_sha256": None,
    "links": {
        "self": f"/v1/jobs/{EXAMPLE_ID}",
        "events": f"/v1/jobs/{EXAMPLE_ID}/events",
        "cancel": f"/v1/jobs/{EXAMPLE_ID}/cancel",
        "result": None,
        "report": None,
    },
}  # fmt: skip
_JOB_EVENT = {
    "id": "3",
    "event": "progress",
    "data": f'{{"job": "{EXAMPLE_ID}", "at": "2026-01-31T12:00:01.000Z", "units_done": 4, "units_expected": 10, '
    '"note": "524288 trials", "eta_seconds": 1.5}',
}
_BEADS = "label,x_mm,y_mm,z_mm\nF1,0,0,0\nF2,40,0,5\nF3,0,35,-10\n"


def examples() -> dict[str, Any]:
    """A request for every computation, and answers where they are small."""
    made: dict[str, Any] = {
        request_name(path): {
            "summary": "Eight beads, two seats",
            "value": {"design": EXAMPLE_DESIGN, **options},
        }
        for path, options in _OPTIONS.items()
    }
    made["GateRequest"] = {
        "summary": "One design under a policy, first order, with one finding accepted for now",
        "value": {
            "designs": [{"file": "designs/guide.yaml", "design": EXAMPLE_DESIGN}],
            "policy": {
                "schema": "tailstack/policy/1",
                "name": "drill guides",
                "rules": {"p95": {"limit_mm": 0.6}, "overlap": {"min_px": 5.0}},
            },
            "waivers": {
                "schema": "tailstack/waivers/1",
                "waivers": [
                    {
                        "rule": "p95",
                        "owner": "J. Doe, systems",
                        "reason": "first article only",
                        "max_value": 0.7,
                        "expires": "2027-01-31",
                    }
                ],
            },
            "today": "2026-11-21",
            "mode": "analytic",
        },
    }
    quieter = {**EXAMPLE_DESIGN, "name": "eight beads, quieter images"}
    quieter["views"] = [{**view, "fiducial_noise_px": 0.2} for view in EXAMPLE_DESIGN["views"]]
    made["ComparisonRequest"] = {
        "summary": "The same structure with quieter images",
        "value": {"first": EXAMPLE_DESIGN, "second": quieter, "precision": 0.01, "seed": 7},
    }
    made["ConversionRequest"] = {
        "summary": "A CSV file to the fiducials of a design",
        "value": {"format": "csv", "content": _BEADS, "to": "yaml"},
    }
    made["Csv"] = {"summary": "The file itself", "value": _BEADS}
    made["DesignAsYaml"] = {"summary": "The design itself", "value": EXAMPLE_DESIGN}
    made["Job"] = {"summary": "A job that runs", "value": _JOB}
    made["JobPage"] = {
        "summary": "A page of one",
        "value": {"schema": "tailstack/jobs/1", "jobs": [_JOB], "next": None},
    }
    made["JobEvent"] = {"summary": "A job gets on", "value": _JOB_EVENT}
    for operation_id in sorted(ANSWERED):
        value = json.loads((ANSWERS / f"{operation_id}.json").read_text(encoding="utf-8"))
        made[operation_id] = {"summary": "As a service answered the example of the request", "value": value}
    return made

"""What the OpenAPI document says of each computation: options, bodies, answers at once or by a job."""

from __future__ import annotations

from typing import Any

from .computations import CONVERSION_FORMATS, GATE_QUERY
from .openapi_components import COMPONENT, reference, request_name
from .openapi_objects import JSON, YAML, job_links, media_types, only_with, parameter, query_parameter, response_of
from .operations import JobOperation, Operation
from .options import Options
from .posting import RAW

BODY_PROBLEMS = (400, 408, 413, 415, 422, 503)


def _option_parameters(options: type[Options]) -> list[dict[str, Any]]:
    schema = options.model_json_schema().get("properties", {})
    renamed = {option: name for name, option in options.in_query().items()}
    made = []
    for option, described in schema.items():
        words = f"Only with a YAML body. {described.get('description', '')}".strip()
        if option in renamed:
            made.append(query_parameter(renamed[option], {"type": "array", "items": _ITEM[renamed[option]]}, words))
        else:
            kept = {key: value for key, value in described.items() if key not in ("title", "description")}
            made.append(query_parameter(option, _without_null(kept), words))
    return made


_ITEM: dict[str, dict[str, Any]] = {
    "set": {"type": "string", "pattern": "^[^=]+=.+$", "examples": ["views.AP.fiducial_noise_px=0.1:0.5:5"]},
    "part": {"type": "string", "enum": ["score", "verification", "optimisation"]},
}


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Absence is how a query says null."""
    if "anyOf" not in schema:
        return schema
    return next(entry for entry in schema["anyOf"] if entry.get("type") != "null")


def _request_body(name: str, **more: Any) -> dict[str, Any]:
    content = media_types(JSON, reference("schemas", name), name)
    content |= media_types(YAML, reference("schemas", "Design"), "DesignAsYaml")
    return {"required": True, "content": content | more}


AT_ONCE = {
    "score": "First order through every stage at the biased geometry: bias, covariance and quantiles of the error "
    "under the declared laws, their bounds, the budget of every tolerance, the validity of the linearisation, the "
    "verdict. Takes milliseconds; more with second_order.",
    "validation": "Reads the design, checks its geometry and says what it holds. No error is computed. A design that "
    "is not valid is answered with 422 and everything that is wrong with it.",
}
BECOMES_A_JOB = (
    " Becomes a job. With Prefer: wait=N the answer is the result itself (200), or the problem that it came to, if "
    "that is known within N seconds."
)
BY_A_JOB = {
    "verification": "Monte Carlo on the full nonlinear chain: quantiles with distribution-free intervals, exceedance, "
    "worst trial, the verdict. One seed, one answer.",
    "optimisation": "Places fiducials and sets tolerances as the design's section optimise asks, and answers with a "
    "new design that passed a Monte Carlo check.",
    "sweep": "Scores, or checks, the design at every point of a grid of some of its numbers.",
    "report": "Score, check and optimisation of one design in one record, of which /v1/results/{sha256}/report makes "
    "pages.",
}


def computation(operation: Operation) -> dict[str, Any]:
    """What is answered at once."""
    answer = media_types(JSON, reference("schemas", COMPONENT[operation.answer]))
    return {
        "summary": operation.summary,
        "description": AT_ONCE[operation.answer],
        "tags": ["computations"],
        "parameters": _option_parameters(operation.options),
        "requestBody": _request_body(request_name(operation.path)),
        "responses": {"200": response_of(f"{operation.summary}.", answer)},
        "problems": BODY_PROBLEMS,
    }


def _job_answers(summary: str, answer: str, at_once: str) -> dict[str, Any]:
    done = response_of(
        f"{summary}: {at_once}.", media_types(JSON, reference("schemas", answer)), ETag="ETag",
        Cache_Control="CacheControl", Vary="Vary", Location="Location", Content_Location="ResultLocation",
        Preference_Applied="PreferenceApplied", Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    accepted = response_of(
        "Accepted: the job.", media_types(JSON, reference("schemas", "Job"), "Job"), Location="Location",
        Retry_After="RetryAfter", Cache_Control="CacheControl", Preference_Applied="PreferenceApplied",
        Idempotency_Replayed="IdempotencyReplayed",
    )  # fmt: skip
    return {"200": done, "202": {**accepted, "links": job_links()}}


def job(operation: JobOperation) -> dict[str, Any]:
    """What becomes a job."""
    return {
        "summary": operation.summary,
        "description": BY_A_JOB[operation.kind] + BECOMES_A_JOB,
        "tags": ["computations"],
        "parameters": [
            parameter("Prefer"), parameter("IdempotencyKey"), *_option_parameters(operation.options),
        ],
        "requestBody": _request_body(request_name(operation.path)),
        "responses": _job_answers(operation.summary, COMPONENT[operation.kind], "with Prefer: wait, in time"),
        "problems": (*BODY_PROBLEMS, 429),
    }  # fmt: skip


def comparison() -> dict[str, Any]:
    """Two designs, which become a job."""
    summary = "Two designs side by side"
    return {
        "summary": summary,
        "description": "Both are checked alike with one seed; differences have an interval. Becomes a job.",
        "tags": ["computations"],
        "parameters": [parameter("Prefer"), parameter("IdempotencyKey")],
        "requestBody": {
            "required": True,
            "content": media_types(JSON, reference("schemas", "ComparisonRequest"), "ComparisonRequest"),
        },
        "responses": _job_answers(summary, COMPONENT["comparison"], "with Prefer: wait, in time"),
        "problems": (*BODY_PROBLEMS, 429),
    }


def gate() -> dict[str, Any]:
    """A gate: at once or as a job."""
    from ..gate.request import GateRequest

    properties = GateRequest.model_json_schema()["properties"]
    options = []
    for name in GATE_QUERY:
        kept = {key: value for key, value in properties[name].items() if key not in ("title", "description")}
        words = f"Only with a YAML body. {properties[name].get('description', '')}"
        options.append(query_parameter(name, _without_null(kept), words))
    answers = _job_answers("The verdict", COMPONENT["gate"], "mode analytic, or with Prefer: wait in time")
    answers["200"]["headers"] = only_with("when it was a job", answers["200"]["headers"])
    return {
        "summary": "Policy and designs to a verdict",
        "description": "Mode analytic is answered at once; verify and auto become a job.",
        "tags": ["computations"],
        "parameters": [parameter("Prefer"), parameter("IdempotencyKey"), *options],
        "requestBody": _request_body("GateRequest"),
        "responses": answers,
        "problems": (*BODY_PROBLEMS, 429),
    }


def conversion() -> dict[str, Any]:
    """Fiducial files and designs."""
    formats = {"type": "string", "enum": list(CONVERSION_FORMATS)}
    body = media_types(JSON, reference("schemas", "ConversionRequest"), "ConversionRequest")
    body |= media_types(YAML, reference("schemas", "Design"), "DesignAsYaml")
    for media in RAW:
        body |= media_types(media, {"type": "string"}, "Csv")
    return {
        "summary": "Fiducial files and designs into one another",
        "description": "In memory: no file is read, nothing is fetched. With text/plain, from says what the text is.",
        "tags": ["computations"],
        "parameters": [
            query_parameter(
                "from", formats, "Not with a JSON body. What the content is; text/csv and YAML say it themselves."
            ),
            query_parameter("to", {**formats, "default": "yaml"}, "Not with a JSON body. What to make of it."),
        ],
        "requestBody": {"required": True, "content": body},
        "responses": {"200": response_of("The converted text.", media_types(JSON, reference("schemas", "Conversion")))},
        "problems": BODY_PROBLEMS,
    }

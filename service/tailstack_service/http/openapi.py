"""The OpenAPI 3.1 document, written from the routes and the published schemas.

Bodies are read by our own strict reader and streams are plain, so nothing here is inferred by the framework.
"""

from __future__ import annotations

from typing import Any

from fastapi.routing import APIRoute

from tailstack import __version__
from tailstack.json_text import write_json

from . import openapi_components as components
from .app import ROUTERS
from .openapi_operations import operation_of

DESCRIPTION = (
    "Where does the tool end up, how bad is the worst 5 %, which tolerance is to blame, and what is the cheapest "
    "design that stays under the limit? Lengths in mm, angles in degrees, images in px; frames as in "
    "docs/conventions.md. Scores, validations and conversions are answered at once; what takes longer becomes a job "
    "that survives restarts. Every refusal is application/problem+json (RFC 9457) whose errors point into the document "
    "that was sent. A harmless X-Request-ID (letters, digits, . _ : -, at most 64) is echoed, otherwise one is made. "
    "Sizes are bounded; a refusal names the limit and the TAILSTACK_ variable that sets it. Unknown fields, NaN and "
    "infinities are refused. Without authentication the service answers on loopback only, and needs no credential."
)
TAGS = [
    {"name": "computations", "description": "Scores and the like at once; checks, optimisations and sweeps as jobs."},
    {"name": "jobs", "description": "What was accepted: state, progress, events, cancelling."},
    {"name": "results", "description": "Answers of jobs, named by their SHA-256."},
    {"name": "information", "description": "Health, version, metrics, schemas, classes of problems."},
]
BEARER = {
    "type": "http",
    "scheme": "bearer",
    "description": "An API key (tsk_...) or a JSON Web Token, where the service requires it. Scopes: compute, read, "
    "metrics.",
}


def document() -> dict[str, Any]:
    """The document as plain data."""
    paths: dict[str, dict[str, Any]] = {}
    for route in (route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)):
        for method in route.methods or ():
            paths.setdefault(route.path, {})[method.lower()] = operation_of(route)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "tailstack",
            "summary": "Tolerance stack-up of X-ray reference structures, judged by its tail.",
            "description": DESCRIPTION,
            "version": __version__,
            "license": {"name": "Apache-2.0", "identifier": "Apache-2.0"},
        },
        "servers": [{"url": "http://127.0.0.1:8321", "description": "tailstack serve"}],
        "tags": TAGS,
        "paths": paths,
        "components": {
            "schemas": components.schemas(),
            "parameters": components.PARAMETERS,
            "headers": components.HEADERS,
            "responses": components.problem_responses(),
            "examples": components.examples(),
            "securitySchemes": {"bearer": BEARER},
        },
    }


def openapi_json() -> bytes:
    """The document as it is committed."""
    return (write_json(document(), indent=1) + "\n").encode()

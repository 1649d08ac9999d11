"""What the service says about itself: health, version, schemas, classes of problems."""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass
from typing import Literal

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from tailstack import __version__
from tailstack.errors import Problem

from ..documents import json_schema, schema_names
from ..problems import CATALOGUE, ProblemType, TransportError


@dataclass(frozen=True, slots=True)
class SchemaEntry:
    name: str
    title: str
    url: str


@dataclass(frozen=True, slots=True)
class SchemaList:
    schemas: tuple[SchemaEntry, ...]


@dataclass(frozen=True, slots=True)
class Health:
    status: Literal["alive", "ready", "warming up", "stopping", "failed"]


@dataclass(frozen=True, slots=True)
class Version:
    tailstack: str
    python: str
    documents: tuple[str, ...]  # value of the field `schema` of each document this version reads and writes


async def live(request: Request) -> Response:
    return JSONResponse(asdict(Health("alive")))


async def ready(request: Request) -> Response:
    """200 once the kernels are compiled (or read from their cache), until the service is told to stop."""
    state = request.app.state
    status: str = "stopping" if state.stopping.is_set() else state.warmth
    headers = {} if status == "ready" else {"Retry-After": "2"}
    return JSONResponse({"status": status}, 200 if status == "ready" else 503, headers)


async def version(request: Request) -> Response:
    names = ("design", "score", "verification", "optimisation", "validation")
    return JSONResponse(
        asdict(Version(__version__, platform.python_version(), tuple(f"tailstack/{name}/1" for name in names)))
    )


async def schemas(request: Request) -> Response:
    entries = (SchemaEntry(name, title, f"/v1/schemas/{name}") for name, title in schema_names().items())
    return JSONResponse(asdict(SchemaList(tuple(entries))))


async def schema(request: Request) -> Response:
    name = request.path_params["name"]
    if name not in schema_names():
        raise _nothing(f"no schema is called {name[:60]!r}", f"one of {', '.join(schema_names())}")
    return JSONResponse(json_schema(name), media_type="application/schema+json")


async def problem_type(request: Request) -> Response:
    slug = request.path_params["slug"]
    if slug not in CATALOGUE:
        raise _nothing(f"no class of problems is called {slug[:60]!r}", f"one of {', '.join(CATALOGUE)}")
    entry: ProblemType = CATALOGUE[slug]
    return JSONResponse(asdict(entry))


def _nothing(detail: str, hint: str) -> TransportError:
    return TransportError("not-found", Problem("", "not-found", detail, hint))

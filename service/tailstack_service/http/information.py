"""What the service says about itself: health, version, schemas, classes of problems."""

from __future__ import annotations

import asyncio
import logging
import platform
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

from fastapi import APIRouter, Depends, Response

from tailstack import __version__
from tailstack.errors import Problem, TailstackError
from tailstack.json_text import write_json

from ..documents import RECORDS, json_schema, schema_names
from ..jobs.store.workers import check_readiness
from ..problems import CATALOGUE, ProblemType, TransportError
from .answers import JSON, record_response
from .dependencies import Needs, TheService
from .metrics import CONTENT_TYPE, FRESH_SECONDS
from .places import Warmth

log = logging.getLogger("tailstack.service")
router = APIRouter(tags=["information"])
DOCUMENTS = tuple(f"tailstack/{name}/1" for name in ("design", *RECORDS) if name != "problem")


@dataclass(frozen=True, slots=True)
class SchemaEntry:
    name: str
    """Name of the schema."""
    title: str
    """What it is the schema of."""
    url: str
    """Path where it is served."""


@dataclass(frozen=True, slots=True)
class SchemaList:
    schemas: tuple[SchemaEntry, ...]
    """Every published schema."""


@dataclass(frozen=True, slots=True)
class Health:
    status: Literal["alive"]
    """The process answers."""


@dataclass(frozen=True, slots=True)
class Readiness:
    """Whether requests should be sent here, and why not."""

    status: Warmth | Literal["stopping", "no database"]
    """ready: send requests here; otherwise why not."""
    kernels: Warmth
    """Whether the kernels are compiled."""
    database: Literal["ready", "not ready"]
    """Whether jobs can be stored and read."""
    workers: int
    """Workers that computed or looked for work lately, on any host; jobs wait while there is none."""


@dataclass(frozen=True, slots=True)
class Version:
    tailstack: str
    """Version of the service and its solver."""
    python: str
    """Version of Python that runs it."""
    documents: tuple[str, ...]
    """Value of the field `schema` of each document that this version reads and writes."""


@router.get("/health/live", operation_id="get_liveness")
async def liveness() -> Response:
    return record_response(Health("alive"))


@router.get("/health/ready", operation_id="get_readiness")
async def readiness(service: TheService) -> Response:
    """200 once the kernels are compiled and the database can be used, until the service is told to stop.

    A service without a worker is ready: it scores, and accepts jobs that run as soon as a worker comes.  The answer
    takes no longer than a look at the database may, whatever became of that.
    """
    try:
        workers: int | None = await service.storage.look(
            lambda database: check_readiness(database, fresh_seconds=FRESH_SECONDS)
        )
    except TailstackError as error:
        log.warning("not ready, for want of the database: %s", error, extra={"action": "database-not-ready"})
        workers = None
    document = Readiness(
        status="stopping" if service.stopping.is_set() else service.places.warmth,
        kernels=service.places.warmth,
        database="not ready" if workers is None else "ready",
        workers=workers or 0,
    )
    if document.status == "ready" and workers is None:
        document = replace(document, status="no database")
    ready = document.status == "ready"
    headers = {"Cache-Control": "no-store"} | ({} if ready else {"Retry-After": "2"})
    return record_response(document, 200 if ready else 503, headers)


@router.get("/metrics", operation_id="get_metrics", dependencies=[Depends(Needs("metrics"))])
async def metrics(service: TheService) -> Response:
    """Counters of the API; jobs and workers too while the database answers."""
    try:
        page = await service.storage.run(service.metrics.page)
    except TailstackError:
        page = service.metrics.page(None)
    return Response(page, media_type=CONTENT_TYPE)


@router.get("/version", operation_id="get_version")
async def version() -> Response:
    return record_response(Version(__version__, platform.python_version(), DOCUMENTS))


@router.get("/v1/schemas", operation_id="list_schemas")
async def schemas() -> Response:
    entries = (SchemaEntry(name, title, f"/v1/schemas/{name}") for name, title in schema_names().items())
    return record_response(SchemaList(tuple(entries)))


@router.get("/v1/schemas/{name}", operation_id="get_schema")
async def schema(name: str) -> Response:
    if name not in schema_names():
        raise _unknown_name_error(f"no schema is called {name[:60]!r}", f"one of {', '.join(schema_names())}")
    body = await asyncio.to_thread(lambda: write_json(json_schema(name)))
    return Response(body, media_type="application/schema+json")


@router.get("/v1/problems/{slug}", operation_id="get_problem_type")
async def problem_type(slug: str) -> Response:
    if slug not in CATALOGUE:
        raise _unknown_name_error(f"no class of problems is called {slug[:60]!r}", f"one of {', '.join(CATALOGUE)}")
    entry: ProblemType = CATALOGUE[slug]
    return record_response(entry)


@router.get("/openapi.json", operation_id="get_openapi")
async def openapi() -> Response:
    # putting it together takes seconds, which nobody else has to wait for
    return Response(await asyncio.to_thread(_document), media_type=JSON)


@cache
def _document() -> bytes:
    from .openapi import document

    return write_json(document()).encode()


def _unknown_name_error(detail: str, hint: str) -> TransportError:
    return TransportError("not-found", Problem("", "not-found", detail, hint))

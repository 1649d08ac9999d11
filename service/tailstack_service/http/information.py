"""What the service says about itself: health, version, schemas, classes of problems."""

from __future__ import annotations

import asyncio
import logging
import platform
from dataclasses import dataclass, replace
from typing import Literal

from starlette.requests import Request
from starlette.responses import Response

from tailstack import __version__
from tailstack.errors import Problem, TailstackError
from tailstack.json_text import write_json

from ..documents import RECORDS, json_schema, schema_names
from ..problems import CATALOGUE, ProblemType, TransportError
from ..store.readiness import look
from .answers import record_response
from .metrics import CONTENT_TYPE, FRESH_SECONDS
from .service import Warmth, service_of

log = logging.getLogger("tailstack.service")
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


async def liveness(request: Request) -> Response:
    return record_response(Health("alive"))


async def readiness(request: Request) -> Response:
    """200 once the kernels are compiled and the database can be used, until the service is told to stop.

    A service without a worker is ready: it scores, and accepts jobs that run as soon as a worker comes.  The answer
    takes no longer than a look at the database may, whatever became of that.
    """
    service = service_of(request)
    try:
        workers: int | None = await service.storage.look(lambda database: look(database, fresh_seconds=FRESH_SECONDS))
    except TailstackError as error:
        log.warning("%s", error, extra={"action": "database-not-ready"})
        workers = None
    document = Readiness(
        status="stopping" if service.stopping.is_set() else service.warmth,
        kernels=service.warmth,
        database="not ready" if workers is None else "ready",
        workers=workers or 0,
    )
    if document.status == "ready" and workers is None:
        document = replace(document, status="no database")
    ready = document.status == "ready"
    headers = {"Cache-Control": "no-store"} | ({} if ready else {"Retry-After": "2"})
    return record_response(document, 200 if ready else 503, headers)


async def metrics(request: Request) -> Response:
    """Counters of the API; jobs and workers too while the database answers."""
    service = service_of(request)
    try:
        page = await service.storage.run(service.metrics.page)
    except TailstackError:
        page = service.metrics.page(None)
    return Response(page, media_type=CONTENT_TYPE)


async def version(request: Request) -> Response:
    return record_response(Version(__version__, platform.python_version(), DOCUMENTS))


async def schemas(request: Request) -> Response:
    entries = (SchemaEntry(name, title, f"/v1/schemas/{name}") for name, title in schema_names().items())
    return record_response(SchemaList(tuple(entries)))


async def schema(request: Request) -> Response:
    name = request.path_params["name"]
    if name not in schema_names():
        raise _nothing(f"no schema is called {name[:60]!r}", f"one of {', '.join(schema_names())}")
    body = await asyncio.to_thread(lambda: write_json(json_schema(name)))
    return Response(body, media_type="application/schema+json")


async def problem_type(request: Request) -> Response:
    slug = request.path_params["slug"]
    if slug not in CATALOGUE:
        raise _nothing(f"no class of problems is called {slug[:60]!r}", f"one of {', '.join(CATALOGUE)}")
    entry: ProblemType = CATALOGUE[slug]
    return record_response(entry)


def _nothing(detail: str, hint: str) -> TransportError:
    return TransportError("not-found", Problem("", "not-found", detail, hint))

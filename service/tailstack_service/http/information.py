"""What the service says about itself: health, version, schemas, classes of problems."""

from __future__ import annotations

import asyncio
import logging
import platform
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import Any, Literal

from fastapi import APIRouter, Depends, FastAPI, Request, Response

from tailstack import __version__
from tailstack.cures import ask_label
from tailstack.design.presets import PRESETS, PresetEntry
from tailstack.errors import Problem, TailstackError
from tailstack.results.json_text import write_json

from ..documents import DRAFTS, to_json
from ..jobs.store.workers import check_readiness
from ..operations.request import single
from ..problems import CATALOGUE, ProblemType, RequestError, TransportError
from ..schemas import RECORDS, TITLES, json_schema
from ..shipped import list_example_designs, read_example, write_example
from .answers import JSON, place, record_response, takes
from .compute_pool import Warmth
from .metrics import CONTENT_TYPE, FRESH_SECONDS
from .openapi import YAML, extra, json_of, media_types, query_parameter, response_of
from .service import Needs, TheService

log = logging.getLogger("tailstack.service")
router = APIRouter(tags=["information"], default_response_class=Response)
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
    max_trials: int
    """Trials that one check may draw here; one that may draw more is refused (the operator's TAILSTACK_MAX_TRIALS)."""


@dataclass(frozen=True, slots=True)
class PresetList:
    presets: tuple[PresetEntry, ...]
    """Every preset."""


@dataclass(frozen=True, slots=True)
class ExampleEntry:
    name: str
    """Name of the example."""
    title: str
    """Name of its design."""
    description: str
    """What it shows; may be empty."""
    url: str
    """Path of the design."""


@dataclass(frozen=True, slots=True)
class ExampleList:
    examples: tuple[ExampleEntry, ...]
    """Every example that is one design."""


# What is answered beside published records
DESCRIBED = (Health, Readiness, SchemaList, Version, ProblemType, PresetList, ExampleList)
READINESS = json_of("Readiness")


def _path_parameter(name: str, words: str, example: str) -> dict[str, Any]:
    return {
        "name": name, "in": "path", "required": True, "description": words, "schema": {"type": "string"},
        "example": example,
    }  # fmt: skip


@router.get(
    "/health/live",
    operation_id="get_liveness",
    summary="The process answers",
    description="It looks at nothing else: /health/ready says whether requests should be sent here.",
    responses={200: response_of("The process answers.", json_of("Health"))},
)
async def liveness() -> Response:
    return record_response(Health("alive"))


@router.get(
    "/health/ready",
    operation_id="get_readiness",
    summary="Whether requests should be sent here",
    description="Kernels are compiled and the database can be used. Jobs wait while workers is 0.",
    responses={
        200: response_of("Ready.", READINESS, Cache_Control="CacheControl"),
        503: response_of(
            "Warming up, stopping, without its database, or broken; see status.",
            READINESS,
            Retry_After="ComeBack",
            Cache_Control="CacheControl",
        ),
    },
)
async def readiness(service: TheService) -> Response:
    """A service without a worker is ready: it scores, and accepts jobs that run as soon as a worker comes.

    The answer takes no longer than a look at the database may, whatever became of that.
    """
    try:
        workers: int | None = await service.storage.look(partial(check_readiness, fresh_seconds=FRESH_SECONDS))
    except TailstackError as error:
        log.warning("not ready, for want of the database: %s", error, extra={"action": "database-not-ready"})
        workers = None
    kernels = service.pool.warmth
    status: Warmth | Literal["stopping", "no database"] = "stopping" if service.stopping.is_set() else kernels
    if status == "ready" and workers is None:
        status = "no database"
    document = Readiness(status, kernels, "not ready" if workers is None else "ready", workers or 0)
    ready = status == "ready"
    headers = {"Cache-Control": "no-store"} | ({} if ready else {"Retry-After": "2"})
    return record_response(document, 200 if ready else 503, headers)


@router.get(
    "/metrics",
    operation_id="get_metrics",
    dependencies=[Depends(Needs("metrics"))],
    summary="Figures for Prometheus",
    description="Counters of this process; of jobs and workers too while the database answers.",
    responses={200: response_of("Figures for Prometheus.", media_types(CONTENT_TYPE, {"type": "string"}))},
)
async def metrics(service: TheService) -> Response:
    try:
        page = await service.storage.run(service.metrics.page)
    except TailstackError:
        page = service.metrics.page(None)
    return Response(page, media_type=CONTENT_TYPE)


@router.get(
    "/version",
    operation_id="get_version",
    summary="Version, documents and the limit of trials",
    description="Of the service, which documents it reads and writes, and how many trials a check may draw.",
    responses={200: response_of("Version and documents.", json_of("Version"))},
)
async def version(service: TheService) -> Response:
    most = service.settings.max_trials
    return record_response(Version(__version__, platform.python_version(), DOCUMENTS, most))


@router.get(
    "/v1/schemas",
    operation_id="list_schemas",
    summary="Published schemas",
    description="Every document that is sent or answered, with the path of its JSON Schema.",
    responses={200: response_of("Published schemas.", json_of("SchemaList"))},
)
async def schemas() -> Response:
    entries = (SchemaEntry(name, title, place(f"/v1/schemas/{name}")) for name, title in TITLES.items())
    return record_response(SchemaList(tuple(entries)))


@router.get(
    "/v1/schemas/{name}",
    operation_id="get_schema",
    summary="One JSON Schema",
    description="The same as tailstack schema NAME prints; with draft=7 as editors read it.",
    responses={200: response_of("One JSON Schema.", media_types("application/schema+json", {"type": "object"}))},
    openapi_extra=extra(
        _path_parameter("name", "Name of a published schema.", "design"),
        query_parameter(
            "draft", {"type": "string", "enum": list(DRAFTS), "default": DRAFTS[0]}, "Of JSON Schema: 7 for editors."
        ),
        problems=(404, 422),
    ),
)
async def schema(request: Request) -> Response:
    name = request.path_params["name"]
    if name not in TITLES:
        hint = ask_label(name, TITLES, f"one of {', '.join(TITLES)}")
        raise TransportError("not-found", f"no schema is called {name[:60]!r}", hint)
    asked = single(request.query_params.multi_items(), "draft")
    asked = DRAFTS[0] if asked is None else asked
    draft = next((known for known in DRAFTS if known == asked), None)
    if draft is None:
        detail = f"draft is one of {', '.join(DRAFTS)}; got {asked[:40]!r}"
        raise RequestError(Problem("/draft", "unknown-value", detail))
    body = await asyncio.to_thread(lambda: write_json(json_schema(name, draft)))
    return Response(body, media_type="application/schema+json")


@router.get(
    "/v1/presets",
    operation_id="list_presets",
    summary="Published C-arm geometries",
    description="What the field preset of a view takes, with its numbers and their source.",
    responses={200: response_of("Published C-arm geometries.", json_of("PresetList"))},
)
async def presets() -> Response:
    return Response(await asyncio.to_thread(_presets), media_type=JSON)


@cache
def _presets() -> bytes:
    return to_json(PresetList(tuple(PRESETS.values())))


@router.get(
    "/v1/examples",
    operation_id="list_examples",
    summary="Designs to begin with",
    description="Those that the package holds, each with what it shows and the path of its document.",
    responses={200: response_of("Designs to begin with.", json_of("ExampleList"))},
)
async def examples() -> Response:
    designs = await asyncio.to_thread(list_example_designs)
    entries = (
        ExampleEntry(design.name, design.title, design.words, place(f"/v1/examples/{design.name}"))
        for design in designs.values()
    )
    return record_response(ExampleList(tuple(entries)))


@router.get(
    "/v1/examples/{name}",
    operation_id="get_example",
    summary="A design to begin with",
    description="It stands alone: fiducials that the example has in a file of their own are in it. Accept: "
    "application/yaml has it as its author wrote it, with the comments.",
    responses={
        200: response_of("The design.", json_of("Design") | media_types(YAML, {"type": "string"}), Vary="VaryAccept")
    },
    openapi_extra=extra(_path_parameter("name", "Name of an example.", "demo"), problems=(404,)),
)
async def example(request: Request) -> Response:
    name, known = request.path_params["name"], await asyncio.to_thread(list_example_designs)
    if name not in known:
        raise TransportError("not-found", f"no example is called {name[:60]!r}", f"one of {', '.join(known)}")
    commented = takes(request, "accept", YAML)
    write = (lambda: write_example(name)) if commented else (lambda: write_json(read_example(name)))
    return Response(await asyncio.to_thread(write), headers={"Vary": "Accept"}, media_type=YAML if commented else JSON)


@router.get(
    "/v1/problems/{slug}",
    operation_id="get_problem_type",
    summary="What a class of problems means and what cures it",
    description="Where the field type of a problem leads.",
    responses={200: response_of("What a class of problems means and what cures it.", json_of("ProblemType"))},
    openapi_extra=extra(
        _path_parameter("slug", "Last part of the type of a problem.", "invalid-design"), problems=(404,)
    ),
)
async def problem_type(request: Request) -> Response:
    slug = request.path_params["slug"]
    if slug not in CATALOGUE:
        hint = ask_label(slug, CATALOGUE, f"one of {', '.join(CATALOGUE)}")
        raise TransportError("not-found", f"no class of problems is called {slug[:60]!r}", hint)
    return record_response(CATALOGUE[slug])


@router.get(
    "/openapi.json",
    operation_id="get_openapi",
    summary="This document",
    description="OpenAPI 3.1, as tailstack openapi prints it.",
    responses={200: response_of("This document.", media_types(JSON, {"type": "object"}))},
)
async def openapi(request: Request) -> Response:
    # putting it together takes seconds, which nobody else has to wait for
    return Response(await asyncio.to_thread(_document, request.app, place("")), media_type=JSON)


@lru_cache(maxsize=4)
def _document(app: FastAPI, root: str) -> bytes:
    made = app.openapi()
    servers = [{"url": root, "description": "this service"}] if root else made["servers"]
    return write_json({**made, "servers": servers}).encode()


for _path, _look in (("/health/live", liveness), ("/health/ready", readiness)):  # load balancers ask so
    router.add_api_route(_path, _look, methods=["HEAD"], include_in_schema=False)

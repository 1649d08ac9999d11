"""What a person sees who opens the address: the files of a web page, and what leads there.

The files are part of the package and hold no secret: they are given to everybody.  What the page then asks of the API
needs the credential that every other program needs.
"""

from __future__ import annotations

import asyncio
import gzip
import hashlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fastapi import APIRouter, Depends, Request, Response

from tailstack import __version__

from ..problems import TransportError
from ..shipped import find_manual
from .answers import JSON, place, record_response, tagged_response, takes
from .openapi import extra, json_of, media_types, response_of
from .service import query

router = APIRouter(tags=["information"], default_response_class=Response)
WORKBENCH = Path(__file__).parents[1] / "workbench"  # index.html, and assets/ whose names hold a hash of their content
DOCS_PAGE = Path(__file__).parents[1] / "docs_page"  # Swagger UI (openapi/docs_page.py), and what starts it
MANUAL = find_manual()
HTML = "text/html; charset=utf-8"
MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": HTML,
    ".ico": "image/x-icon",
    ".js": "text/javascript; charset=utf-8",
    ".json": JSON,
    ".md": "text/markdown; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".woff2": "font/woff2",
}
PACKED = frozenset({".css", ".html", ".js", ".json", ".md", ".svg", ".txt"})  # what becomes smaller by compressing
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
CURRENT = "no-cache"  # ask each time; what has not changed is not sent again
FOR_EVER = "public, max-age=31536000, immutable"


@dataclass(frozen=True, slots=True)
class Link:
    path: str
    """Path on this service."""
    title: str
    """What is there."""


@dataclass(frozen=True, slots=True)
class Index:
    """Where to go from here."""

    tailstack: str
    """Version of the service and its solver."""
    links: tuple[Link, ...]
    """What to read first."""


LINKS = (
    Link("/docs", "the API as a page on which every operation can be tried"),
    Link("/openapi.json", "the OpenAPI document: every path"),
    Link("/v1/examples", "designs to begin with"),
    Link("/v1/presets", "published C-arm geometries"),
    Link("/v1/schemas", "JSON Schemas of every document that is sent or answered"),
    Link("/health/ready", "whether requests should be sent here"),
)


@dataclass(frozen=True, slots=True)
class File:
    """A file as it is sent."""

    body: bytes
    packed: bytes | None  # by gzip; None where that gains nothing
    media_type: str
    tag: str


@cache
def read_files(folder: Path, pattern: str = "*") -> dict[str, File]:
    """The files of a folder of the package, read and compressed once; none where there is no such folder."""
    return {path.relative_to(folder).as_posix(): _read_file(path) for path in folder.glob(pattern) if path.is_file()}


def _read_file(path: Path) -> File:
    body = path.read_bytes()
    packed = gzip.compress(body, 9, mtime=0) if path.suffix in PACKED else None
    media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    return File(body, packed, media_type, hashlib.sha256(body).hexdigest()[:32])


async def send_file(
    request: Request, folder: Path, name: str, caching: str, policy: str | None = None, pattern: str = "*"
) -> Response:
    """A file of a folder of the package.  Raises TransportError 404 for any name that is not that of a file in it."""
    file = (await asyncio.to_thread(read_files, folder, pattern)).get(name)
    if file is None:
        raise TransportError("not-found", f"there is no file {name[:80]!r}", "GET / leads to the page that is there")
    headers = {"Cache-Control": caching, "X-Content-Type-Options": "nosniff", "Vary": "Accept-Encoding"}
    if policy is not None:
        headers |= {"Content-Security-Policy": policy, "Referrer-Policy": "no-referrer"}
        headers["Vary"] = "Accept, Accept-Encoding"
    body, tag = file.body, file.tag
    if file.packed is not None and takes(request, "accept-encoding", "gzip"):
        body, tag, headers["Content-Encoding"] = file.packed, f"{file.tag}-gzip", "gzip"
    return tagged_response(request, body, file.media_type, headers, tag)


@router.get(
    "/",
    operation_id="get_index",
    dependencies=[Depends(query())],
    summary="Where to go from here",
    description="Browsers, which ask for text/html, are shown a page; programs are told what there is.",
    responses={
        200: response_of(
            "Where to go from here.", json_of("Index") | media_types("text/html", {"type": "string"}), Vary="VaryAccept"
        ),
        307: response_of(
            "A browser: to /docs where the package holds no web page, to the address with a slash at its end.",
            Location="PageLocation",
            Cache_Control="CacheControl",
            Vary="VaryAccept",
        ),
    },
    openapi_extra=extra(problems=(422,)),
)
async def index(request: Request) -> Response:
    if not takes(request, "accept", "text/html"):
        links = tuple(Link(place(link.path), link.title) for link in LINKS)
        return record_response(Index(__version__, links), headers={"Vary": "Accept"})
    if not request.scope.get("raw_path", b"/").endswith(b"/"):  # of /tailstack the page would ask for files beside it
        return Response(b"", 307, {"Location": "/", "Cache-Control": CURRENT, "Vary": "Accept"})
    if "index.html" in await asyncio.to_thread(read_files, WORKBENCH):
        return await send_file(request, WORKBENCH, "index.html", CURRENT, POLICY)
    return Response(b"", 307, {"Location": "/docs", "Cache-Control": CURRENT, "Vary": "Accept"})


@router.get("/assets/{name}", include_in_schema=False)
async def asset(request: Request) -> Response:
    return await send_file(request, WORKBENCH / "assets", request.path_params["name"], FOR_EVER)


@router.get("/docs", include_in_schema=False)
async def docs(request: Request) -> Response:
    return await send_file(request, DOCS_PAGE, "index.html", CURRENT, POLICY)


@router.get("/docs/{name}", include_in_schema=False)
async def docs_file(request: Request) -> Response:
    return await send_file(request, DOCS_PAGE, request.path_params["name"], CURRENT)


@router.get("/manual/{name:path}", include_in_schema=False)
async def manual(request: Request) -> Response:
    return await send_file(request, MANUAL, request.path_params["name"], CURRENT, pattern="**/*.md")

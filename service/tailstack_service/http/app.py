"""The application: what it is made of, its start and its end."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI
from starlette.types import ASGIApp

from ..documents import to_json
from ..settings import Settings, settings_from
from .access import Access
from .computing import Lane
from .metrics import Metrics
from .middleware import RequestLog
from .routing import plain_routes
from .service import Service
from .storage import Storage
from .warmth import Warming

log = logging.getLogger("tailstack.service")
REPORT_WORKERS = 1  # rendering holds the GIL, and scores are computed in the same process
SETTLED_SECONDS = 1.5  # after which a service that has just become ready loads what is asked for less often


def create_app(settings: Settings | None = None, *, warm_up: bool = True) -> FastAPI:
    """The application with these settings, by default those of the environment (``TAILSTACK_*``).

    ``warm_up`` compiles the kernels in the background when the application starts; readiness tells when that is
    done.  The database is opened when it is first needed.  ``app.state.service.stopping`` ends every computation,
    wait and stream.  Raises RequestError for settings of authentication that cannot work.
    """
    settings = settings_from(os.environ) if settings is None else settings
    app = _Application(
        title="tailstack", docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False, lifespan=_lifespan
    )
    app.router.routes.extend(plain_routes())
    storage = Storage(settings.database_url)

    async def find_key(presented: str) -> Any:
        from ..store.keys import find_key as found

        return await storage.run(found, presented)

    async def note_use(key_id: str, tenant: str, address: str) -> None:
        from ..store.audit import note_use as note

        await storage.write(note, key_id, tenant, address)

    service = Service(
        settings=settings,
        stopping=threading.Event(),
        storage=storage,
        access=Access(settings, find_key, note_use),
        metrics=Metrics(),
        short=Lane("short", settings.short_workers, settings.max_waiting),
        reports=Lane("report", REPORT_WORKERS, settings.max_waiting),
        warmth="warming up" if warm_up else "ready",
        second_order="not asked for" if warm_up else "ready",
        settled=not warm_up,
    )
    app.state.service = service
    return app


class _Application(FastAPI):
    """Requests go from the log straight to their routes, without the six layers that are put around any application."""

    def openapi(self) -> dict[str, Any]:
        """The document of these routes, which say more of themselves than a signature could."""
        from .openapi import document

        if self.openapi_schema is None:
            self.openapi_schema = document()
        return self.openapi_schema

    def build_middleware_stack(self) -> ASGIApp:
        return RequestLog(self.router, self.state.service)


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    service: Service = app.state.service
    warming = Warming(lambda: _warm(service)) if service.warmth == "warming up" else None
    if warming is not None:
        warming.start()
    try:
        yield
    finally:
        service.stopping.set()
        for close in (service.short.close, service.reports.close, service.storage.close):
            await asyncio.to_thread(close)
        if warming is not None:
            await asyncio.to_thread(warming.end)


def _warm(service: Service) -> None:
    """Compile what requests will run, and make what writes the answer, so that the first one does not wait for it."""
    from tailstack.design import load_design
    from tailstack.scoring import score

    from .example import EXAMPLE_DESIGN, variants

    try:
        design = load_design(EXAMPLE_DESIGN)
        to_json(score(design))
        _keep_for_good()
        service.warmth = "ready"
        if service.stopping.wait(SETTLED_SECONDS):
            return
        # what is asked for less often; nobody has to wait for it to be ready
        for variant in map(load_design, variants()):
            if service.stopping.is_set():
                return
            score(variant)
        service.settled = True
        from tailstack.optimisation import influence

        influence(design)
    except Exception:
        log.exception("", extra={"action": "warm-up-failed"})
        if service.warmth != "ready":
            service.warmth = "failed"


def _keep_for_good() -> None:
    """What stands after the start stays until the end: the garbage collector need not look at it at every request."""
    gc.collect()
    gc.freeze()

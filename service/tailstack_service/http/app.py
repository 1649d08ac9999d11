"""The application: what it is made of, its start and its end."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI

from ..settings import Settings, settings_from
from . import events, information, jobs, posting, results
from .access import Access
from .metrics import Metrics
from .middleware import RequestLog
from .places import Places
from .refusals import HANDLERS
from .service import Service
from .signals import listen
from .storage import Storage

ROUTERS = (posting.router, jobs.router, events.router, results.router, information.router)


def create_app(settings: Settings | None = None, *, warm_up: bool = True) -> FastAPI:
    """The application with these settings, by default those of the environment (``TAILSTACK_*``).

    ``warm_up`` starts the computing processes, and compiles the kernels, when the application starts; readiness tells
    when that is done.  The database is opened when it is first needed.  ``app.state.service.stopping`` ends every
    computation, wait and stream.  Raises RequestError for settings of authentication that cannot work.
    """
    settings = settings_from(os.environ) if settings is None else settings
    app = _Application(
        title="tailstack", docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False, lifespan=_lifespan,
        exception_handlers=HANDLERS,
    )  # fmt: skip
    for router in ROUTERS:
        app.include_router(router)
    storage = Storage(settings.database_url)

    async def find_key(presented: str) -> Any:
        from ..store.keys import find_key as found

        return await storage.run(found, presented)

    async def note_use(key_id: str, tenant: str, address: str) -> None:
        from ..store.audit import note_use as note

        await storage.write(note, key_id, tenant, address)

    stopping = threading.Event()
    app.state.service = Service(
        settings=settings,
        stopping=stopping,
        storage=storage,
        access=Access(settings, find_key, note_use),
        metrics=Metrics(),
        places=Places(settings.short_workers, settings.max_waiting, settings.max_seconds, stopping, warm=warm_up),
    )
    app.add_middleware(RequestLog, service=app.state.service)
    return app


class _Application(FastAPI):
    def openapi(self) -> dict[str, Any]:
        """The document of these routes, which says more of them than a signature could."""
        from .openapi import document

        if self.openapi_schema is None:
            self.openapi_schema = document()
        return self.openapi_schema


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    service: Service = app.state.service
    with listen(service.stopping):
        service.places.begin()
        try:
            yield
        finally:
            await service.places.close()
            await asyncio.to_thread(service.storage.close)

"""Before the kernels are compiled: a computation waits for a little while, and is then told to come back."""

from __future__ import annotations

import asyncio
import time

from tailstack.errors import Problem

from ..problems import TransportError
from ..settings import variable
from .service import Service

LOOK_SECONDS = 0.02
RETRY_SECONDS = 5


async def warmed(service: Service) -> None:
    """Return when the kernels are compiled, or cannot be.  Raises TransportError 503 after ``warm_up_seconds``.

    From a cache they are there in a second or two, which is worth waiting for; compiling them takes a minute.
    """
    limit, setting = service.settings.warm_up_seconds, variable("warm_up_seconds")
    deadline = time.monotonic() + limit
    while service.places.warmth == "warming up" and not service.stopping.is_set():
        if time.monotonic() >= deadline:
            detail = f"the numerical kernels are still being compiled; waited {limit:g} s ({setting})"
            hint = "send the request again later: GET /health/ready answers 200 when they are there"
            raise TransportError(
                "warming-up", Problem("", "warming-up", detail, hint), {"Retry-After": str(RETRY_SECONDS)}
            )
        await asyncio.sleep(LOOK_SECONDS)

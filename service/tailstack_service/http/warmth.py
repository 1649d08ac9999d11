"""Before the kernels are compiled: a computation waits for a little while, and is then told to come back."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
import time
from collections.abc import Callable

from tailstack.errors import Problem

from ..problems import TransportError
from ..settings import variable
from .service import Service

log = logging.getLogger("tailstack.service")
LOOK_SECONDS = 0.02
RETRY_SECONDS = 5
END_SECONDS = 1.0


class Warming(threading.Thread):
    """Calls ``warm`` aside: it may take minutes, and a service that is told to stop does not wait for it."""

    def __init__(self, warm: Callable[[], None]) -> None:
        super().__init__(target=warm, name="tailstack-warming", daemon=True)

    def end(self) -> None:
        """Return when it has ended, or is not about to."""
        self.join(timeout=END_SECONDS)


def leave_if_compiling(exit_code: int) -> None:
    """End this process here and now if a compiler is still at work in it; otherwise do nothing.

    A compiler cannot be interrupted (an exception in the middle of it takes the process with it), and the interpreter's
    own end would free what it works on.  For a command that has nothing left to do.
    """
    if any(isinstance(thread, Warming) for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(exit_code)


async def warmed(service: Service) -> None:
    """Return when the kernels are compiled, or cannot be.  Raises TransportError 503 after ``warm_up_seconds``.

    From a cache they are there in a second or two, which is worth waiting for; compiling them takes a minute.
    """
    await _while_warming(service, lambda: service.warmth)


async def second_order_warmed(service: Service) -> None:
    """The same for the kernels that only second order runs: they are compiled when they are first asked for, aside, so
    that a stop does not wait for them."""
    if service.second_order == "not asked for":
        service.second_order = "warming up"
        Warming(lambda: _warm_second_order(service)).start()
    await _while_warming(service, lambda: service.second_order)


def _warm_second_order(service: Service) -> None:
    from tailstack.design import load_design
    from tailstack.scoring import score

    from .example import EXAMPLE_DESIGN

    try:
        score(load_design(EXAMPLE_DESIGN), second_order=True)
    except Exception:
        log.exception("", extra={"action": "warm-up-failed"})
    finally:
        service.second_order = "ready"  # a kernel that cannot be compiled is told to who asks, with his design


async def _while_warming(service: Service, warmth: Callable[[], str]) -> None:
    limit, setting = service.settings.warm_up_seconds, variable("warm_up_seconds")
    deadline = time.monotonic() + limit
    while warmth() == "warming up" and not service.stopping.is_set():
        if time.monotonic() >= deadline:
            raise TransportError(
                "warming-up",
                Problem(
                    "",
                    "warming-up",
                    f"the numerical kernels are still being compiled; waited {limit:g} s ({setting})",
                    "send the request again later: GET /health/ready answers 200 when they are there"
                    + ("" if service.warmth == "warming up" else ", but for those of second order"),
                ),
                {"Retry-After": str(RETRY_SECONDS)},
            )
        await asyncio.sleep(LOOK_SECONDS)

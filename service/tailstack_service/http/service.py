"""What every request shares: settings, lanes, the database, who may ask, what is counted."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Literal

from starlette.requests import Request

from ..settings import Settings
from .access import Access
from .computing import Lane
from .metrics import Metrics
from .storage import Storage

Warmth = Literal["warming up", "ready", "failed"]


@dataclass(slots=True, eq=False)
class Service:
    """One API process."""

    settings: Settings
    stopping: threading.Event  # ends computations, waits and event streams
    storage: Storage
    access: Access
    metrics: Metrics
    short: Lane  # scores, validations, conversions, checks of what becomes a job
    reports: Lane  # renderings
    warmth: Warmth  # of the kernels
    settled: bool  # every kernel that a score can need has run: none will be compiled in front of a client
    streams: int = 0  # event streams and waits that are open; touched by the event loop only

    def seat(self) -> bool:
        """Take one of the places for whoever stays connected; False when all are taken."""
        if self.streams >= self.settings.max_streams:
            return False
        self.streams += 1
        return True

    def leave(self) -> None:
        """Give the place back."""
        self.streams -= 1


def service_of(request: Request) -> Service:
    """The service that a request came to."""
    service: Service = request.app.state.service
    return service

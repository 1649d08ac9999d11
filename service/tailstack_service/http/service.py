"""What every request shares: settings, places to compute, the database, who may ask, what is counted."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

from starlette.requests import Request

from ..settings import Settings
from .access import Access
from .metrics import Metrics
from .places import Places
from .storage import Storage

Seat = Literal["seated", "share taken", "all taken"]


@dataclass(slots=True, eq=False)
class Service:
    """One API process."""

    settings: Settings
    stopping: threading.Event  # ends computations, waits and event streams
    storage: Storage
    access: Access
    metrics: Metrics
    places: Places  # for what is computed while the caller waits
    seated: Counter[str] = field(default_factory=Counter)  # streams and waits by tenant; the event loop's own

    def seat(self, tenant: str) -> Seat:
        """Take one of the places for whoever stays connected, if there is one: the tenant's share may be used up, so
        that no tenant keeps the others out, or all places."""
        if self.access.required and self.seated[tenant] >= self.settings.max_tenant_streams:
            return "share taken"
        if self.seated.total() >= self.settings.max_streams:
            return "all taken"
        self.seated[tenant] += 1
        return "seated"

    def leave(self, tenant: str) -> None:
        """Give the place back."""
        self.seated[tenant] -= 1
        if not self.seated[tenant]:
            del self.seated[tenant]


def service_of(request: Request) -> Service:
    """The service that a request came to."""
    service: Service = request.app.state.service
    return service

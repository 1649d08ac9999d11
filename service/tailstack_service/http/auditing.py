"""What a request leaves in the audit log."""

from __future__ import annotations

import logging
from typing import Any

from starlette.requests import Request

from tailstack.errors import TailstackError

from ..store import audit
from .service import service_of

log = logging.getLogger("tailstack.service")


async def note_policy(request: Request, terms: dict[str, Any]) -> None:
    """Note by what a gate of the caller was judged, if that differs from the last time.

    Without the database the gate is answered all the same, and the log says that it was not noted: an analytic gate
    needs none, and whoever could have it refused by stopping the database could stop the gate itself.
    """
    caller = request.state.caller
    try:
        await service_of(request).storage.write(audit.note_policy, caller.name, caller.tenant, terms)
    except TailstackError as error:
        told = {"action": "not-audited", "request": request.state.request_id, "tenant": caller.tenant}
        log.warning("%s", error, extra=told)

"""What endpoints declare in their signatures and decorators: the service, who may ask, which query means something."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import Depends, Request

from ..operations.request import refuse_query
from .access import Caller
from .service import Service, service_of


class Needs:
    """Admits callers who have a scope, and remembers who it was for the log."""

    def __init__(self, scope: str) -> None:
        self.scope = scope

    async def __call__(self, request: Request) -> Caller:
        caller: Caller = await service_of(request).access.admit(request, self.scope)
        request.state.caller = caller
        return caller


def query(*known: str) -> Callable[[Request], Awaitable[None]]:
    """Refuses every query parameter but these."""

    async def check(request: Request) -> None:
        refuse_query(request.query_params.multi_items(), known)

    return check


TheService = Annotated[Service, Depends(service_of)]

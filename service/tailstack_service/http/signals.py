"""How an API process learns that it is to end, and what it says of errors that are not its own."""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import h11

log = logging.getLogger("tailstack.service")
SIGNALS = (signal.SIGTERM, signal.SIGINT)


@contextmanager
def listen(stopping: threading.Event) -> Iterator[None]:
    """Set ``stopping`` as soon as a signal tells the server to stop, not when it has stopped.

    uvicorn tells an application only when every connection is closed, and those that wait or stream would wait for
    just that.  Its own handler is called next.  One of several API processes also ends when its parent has gone.
    """
    asyncio.get_running_loop().set_exception_handler(_say_briefly)
    if threading.current_thread() is not threading.main_thread():  # nobody can signal it: ``server.running_service``
        yield
        return
    previous = {number: signal.getsignal(number) for number in SIGNALS}

    def stop(number: int, frame: FrameType | None) -> None:
        if not stopping.is_set():  # an Event could be locked by the very thread that a signal interrupts
            stopping.set()
        handler = previous[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)

    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), name="tailstack-parent", daemon=True).start()
    for number in SIGNALS:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _end_with(parent: Any) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)


def _say_briefly(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """What a client does wrong after its answer has left cannot be answered, and is no defect of the service."""
    error = context.get("exception")
    if isinstance(error, h11.ProtocolError):
        log.warning("%s", error, extra={"action": "not-http"})
    else:
        loop.default_exception_handler(context)

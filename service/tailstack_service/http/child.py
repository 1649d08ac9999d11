"""One of several API processes: ``python -m tailstack_service.http.child FILE_DESCRIPTOR``, started by the supervisor.

It serves the listening socket that it inherits until SIGTERM, or until its stdin ends with the process that holds it.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from ..logs import log_to_stderr
from ..settings import settings_from


def main(descriptor: int) -> None:
    """Serve with the settings of the environment."""
    settings = settings_from(os.environ)
    log_to_stderr(settings.log_format)
    from .server import Server
    from .warmth import leave_if_compiling

    server = Server(settings)
    threading.Thread(target=_await_parent, args=(server.tell,), name="tailstack-parent", daemon=True).start()
    # before uvicorn listens to signals; and it raises them again once it has stopped
    signal.signal(signal.SIGTERM, lambda *_: server.tell())
    server.run(sockets=[socket.socket(fileno=descriptor)])
    leave_if_compiling(0)


def _await_parent(tell: Callable[[], None]) -> None:
    with suppress(OSError):
        while os.read(0, 4096):
            pass
    tell()


if __name__ == "__main__":
    main(int(sys.argv[1]))

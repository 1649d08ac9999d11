"""A process that a service keeps alive: its worker."""

from __future__ import annotations

import logging
import subprocess
import threading
import time
from collections.abc import Callable

log = logging.getLogger("tailstack.service")
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 10.0  # seconds before a process that ended is started again
GOOD_SECONDS = 30.0  # a process that lived so long did not fail at its start
STOP_SECONDS = 9.0  # for a process to end by itself when told to


class Kept:
    """A child process that is started again, more and more slowly, whenever it ends.  ``start`` makes the Popen.

    The child holds the other end of its stdin and ends with it, so that it never outlives this process.
    """

    def __init__(self, name: str, start: Callable[[], subprocess.Popen[bytes]]) -> None:
        self.name = name
        self._start = start
        self._changing = threading.Lock()
        self._stopping = threading.Event()
        self._process = start()
        self._told_at: float | None = None
        self._thread = threading.Thread(target=self._keep, name=f"tailstack-keep-{name}", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def _keep(self) -> None:
        pause, begun = FIRST_PAUSE, time.monotonic()
        while True:
            code = self._process.wait()
            if self._stopping.is_set():
                return
            pause = FIRST_PAUSE if time.monotonic() - begun > GOOD_SECONDS else pause
            log.warning(
                "",
                extra={"action": "child-ended", "kind": self.name, "pid": self.pid, "status": code, "seconds": pause},
            )
            if self._stopping.wait(pause):
                return
            pause = min(2 * pause, LONGEST_PAUSE)
            with self._changing:
                if self._stopping.is_set():
                    return
                begun = time.monotonic()
                try:
                    started = self._start()
                except OSError:  # no memory or no process to be had just now: the old one is waited for again
                    log.exception("", extra={"action": "child-not-started", "kind": self.name})
                    continue
                _close(self._process)
                self._process = started

    def tell(self) -> None:
        """Ask the process to end, and start no other.  Returns at once; may be called more than once."""
        self._stopping.set()
        self._told_at = self._told_at or time.monotonic()
        with self._changing:
            if self._process.poll() is None:
                self._process.terminate()

    def stop(self) -> None:
        """Return when the process has ended, killed if it takes too long."""
        self.tell()
        assert self._told_at is not None
        try:
            self._process.wait(max(self._told_at + STOP_SECONDS - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            log.warning("", extra={"action": "child-killed", "kind": self.name, "pid": self.pid})
            self._process.kill()
            self._process.wait()
        self._thread.join()
        _close(self._process)


def _close(process: subprocess.Popen[bytes]) -> None:
    if process.stdin is not None:
        process.stdin.close()

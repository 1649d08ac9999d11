"""Progress on stderr for whatever takes longer than a second: what runs, how far, how long still."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType
from typing import ClassVar, Self, TextIO

QUIET_SECONDS = 1.0  # shorter work says nothing
TERMINAL_EVERY, LOG_EVERY = 0.25, 10.0  # a log gets its first lines sooner: after 1, 3, 7, 15 s


class Progress:
    """``with Progress("verify") as progress: progress.report(done, total)``; a thread writes the line.

    One inside another speaks alone until it ends.
    """

    _open: ClassVar[list[Progress]] = []  # the innermost last

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        self.what = what
        self.stream = sys.stderr if stream is None else stream
        self.fraction = 0.0
        self.detail = ""
        self._begun = self._since = time.monotonic()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)
        self._shown = False

    def report(self, done: float, total: float, detail: str = "") -> None:
        """How far the work is; ``total`` 0 means that nobody knows."""
        if self.fraction == 0:
            self._since = time.monotonic()
        self.fraction = min(done / total, 1.0) if total else 0.0
        self.detail = detail

    def line(self) -> str:
        """One line of progress as it stands."""
        elapsed = time.monotonic() - self._begun
        parts = [f"{self.what}: {elapsed:.0f} s"]
        if 0 < self.fraction < 1:
            left = elapsed / self.fraction - elapsed
            parts.append(f"{100 * self.fraction:.0f} %, about {left:.0f} s left")
        return ", ".join([*parts, self.detail] if self.detail else parts)

    def __enter__(self) -> Self:
        self._open.append(self)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()
        self._open.remove(self)
        if self._shown and self._terminal:
            self._write("\r\x1b[K")

    @property
    def _terminal(self) -> bool:
        return self.stream.isatty()

    def _tick(self) -> None:
        wait = QUIET_SECONDS
        while not self._done.wait(wait):
            if self._open[-1] is not self:
                continue
            self._shown = True
            self._write(f"\r{self.line()[:98]}\x1b[K" if self._terminal else self.line() + "\n")
            wait = TERMINAL_EVERY if self._terminal else min(2 * wait, LOG_EVERY)

    def _write(self, text: str) -> None:
        try:
            self.stream.write(text)
            self.stream.flush()
        except (OSError, ValueError):  # nobody reads it any more
            self._done.set()

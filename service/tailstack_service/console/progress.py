"""Progress on stderr for whatever takes longer than a second: what runs, how far, how long still.

A terminal shows a bar as wide as it is; a log, which keeps every line, gets lines at growing distances.  When that is
is a matter of the clock alone: by one that stands still, as that of the tests does, nothing is said however long it
takes.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from typing import ClassVar, Self, TextIO

from ..clock import SYSTEM_CLOCK, Clock

QUIET_SECONDS = 1.0  # shorter work says nothing
TERMINAL_EVERY, LOG_EVERY = 0.25, 10.0  # a log gets its first lines sooner: after 1, 3, 7, 15 s
NARROWEST_BAR, COLUMNS = 10, 80  # of a bar; of a terminal that does not say how wide it is
PACE_SECONDS, PACE_FRACTION = 1.0, 0.1  # between reports, or done by the first, before a time is named
OVERDUE = 0.3  # what took so much longer than was thought still takes that part of it, at least


def say(text: str) -> None:
    """A line on stderr, in place of the line of progress, which comes again below it."""
    with Progress.writing:
        for progress in Progress.open_now:
            progress.erase()
        print(text, file=sys.stderr, flush=True)


class Progress:
    """``with Progress("verify") as progress: progress.report(done, total)``; a thread writes the line.

    One inside another speaks alone until it ends.
    """

    open_now: ClassVar[list[Progress]] = []  # the innermost last
    writing: ClassVar[threading.RLock] = threading.RLock()  # held by whoever writes on stderr

    usual_clock: ClassVar[Clock] = SYSTEM_CLOCK  # of those that are given none

    def __init__(self, what: str, stream: TextIO | None = None, *, clock: Clock | None = None) -> None:
        self.what = what
        self.stream = sys.stderr if stream is None else stream
        self.clock = self.usual_clock if clock is None else clock
        self.fraction = 0.0
        self._done_of_step = 0.0
        self.detail = ""
        self.preface = ""  # said once, on lines of its own, before the first line of progress
        self._begun = self.clock.monotonic()
        self._step_begun = 0.0  # seconds
        self._of_step = ""  # what the time left is of, where that is not the whole work
        self._first: tuple[float, float] | None = None  # report that said how far: when, seconds, and how far
        self._left: Callable[[float], float | None] = lambda _elapsed: None  # seconds, when so many have passed
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)
        self._shown = False

    @property
    def elapsed_seconds(self) -> float:
        """Since the beginning."""
        return self.clock.monotonic() - self._begun

    def report(self, done: float, total: float, detail: str = "") -> None:
        """How far the work is, which goes on as fast as it did; ``total`` 0 means that nobody knows.

        Less done than before is another step.
        """
        if done < self._done_of_step:
            self.begin_step()
        self._done_of_step = done
        self.fraction = min(done / total, 1.0) if total else 0.0
        self.detail = detail
        self._left = lambda _elapsed: None
        if not 0 < self.fraction < 1:
            return
        now = self.elapsed_seconds
        if self._first is None:
            self._first = now, self.fraction
        then, before = self._first
        if self.fraction > before and now - then >= PACE_SECONDS:  # what came before the first report is no part of it
            left = (1 - self.fraction) * (now - then) / (self.fraction - before)
        elif self.fraction >= PACE_FRACTION:
            left = (1 / self.fraction - 1) * (now - self._step_begun)
        else:  # too little is done: the time left would be that of loading, many times over
            return
        self._left = lambda elapsed: max(left - (elapsed - now), OVERDUE * (elapsed - now - left))

    def begin_step(self) -> None:
        """What is reported from now on is of a step, by its own pace; how long the others take nobody knows."""
        self._step_begun, self._first, self._of_step = self.elapsed_seconds, None, " of this step"

    def seconds_left(self) -> float | None:
        """As it stands now; None if nobody knows."""
        seconds = self._left(self.elapsed_seconds)
        return None if seconds is None else max(seconds, 0.0)

    def line(self) -> str:
        """One line of progress as it stands."""
        parts = [f"{self.what}: {self.elapsed_seconds:.0f} s"]
        left = self.seconds_left()
        if left is not None:
            parts.append(f"{100 * self.fraction:.0f} %, about {max(left, 1):.0f} s left{self._of_step}")
        return ", ".join([*parts, self.detail] if self.detail else parts)

    def bar(self, columns: int) -> str:
        """The same in exactly so many columns, as a bar; what does not fit beside it is left out."""
        left = self.seconds_left()
        if left is None or columns < len(self.what) + NARROWEST_BAR + 8:
            return self.line()[:columns]
        head = f"{self.what} {100 * self.fraction:3.0f} % "
        time = f"{max(left, 1):.0f} s" if left < 120 else f"{left / 60:.0f} min"
        tail = f" about {time} left{self._of_step}"
        room = columns - len(head) - NARROWEST_BAR
        parts = [tail, *(f", {part}" for part in self.detail.split(", ") if part)]
        while parts and sum(map(len, parts)) > room:  # whole parts: half a number would be another one
            parts.pop()
        tail = "".join(parts)
        width = columns - len(head) - len(tail)
        full = round(self.fraction * width)
        on, off = ("█", "░") if "utf" in (getattr(self.stream, "encoding", None) or "").lower() else ("#", ".")
        return head + on * full + off * (width - full) + tail

    def __enter__(self) -> Self:
        self.open_now.append(self)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()
        self.open_now.remove(self)
        self.erase()

    def erase(self) -> None:
        """Take the line of progress off the terminal."""
        if self._shown and self._terminal:
            self._write("\r\x1b[K")

    @property
    def _terminal(self) -> bool:
        return self.stream.isatty()

    def _columns(self) -> int:
        """Of the terminal, as wide as it is just now."""
        try:
            columns = os.get_terminal_size(self.stream.fileno()).columns
        except (OSError, ValueError):
            columns = 0
        return (columns or COLUMNS) - 1  # the last one would begin another line

    def _tick(self) -> None:
        wait = QUIET_SECONDS
        while not self.clock.wait(self._done, wait):
            if self.open_now and self.open_now[-1] is not self:
                continue
            with self.writing:
                if self.preface and not self._shown:
                    self._write(self.preface + "\n")
                self._shown = True
                self._write(f"\r{self.bar(self._columns())}\x1b[K" if self._terminal else self.line() + "\n")
            wait = TERMINAL_EVERY if self._terminal else min(2 * wait, LOG_EVERY)

    def _write(self, text: str) -> None:
        try:
            self.stream.write(text)
            self.stream.flush()
        except (OSError, ValueError):  # nobody reads it any more
            self._done.set()

"""Kernels that are not compiled yet: compiled in as many processes as there are processors, and said so meanwhile."""

from __future__ import annotations

import os
import subprocess
import tempfile
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, TextIO

from ..processes.interpreter import make_command, make_environment
from ..rendering.tables import wrap
from .progress import Progress

if TYPE_CHECKING:
    from tailstack.kernels.calls import KernelCall

    from ..clock import Clock

# What a verb computes, by the names of tailstack.kernels.calls; every other verb may compute everything
_COMPUTATIONS: dict[str, tuple[str, ...]] = {
    "score": ("score",),
    "score --batch": ("score", "batch"),
    "sweep": ("score",),
    "verify": ("score", "verify"),
    "gate": ("score", "verify"),
}
_lent: list[tempfile.TemporaryDirectory[str]] = []  # kept for as long as this process runs


def computations_of(verbs: Iterable[str]) -> set[str]:
    """The computations that these verbs may need."""
    from tailstack.kernels.calls import COMPUTATIONS

    return {name for verb in verbs for name in _COMPUTATIONS.get(verb, COMPUTATIONS)}


def compile_for(verbs: Iterable[str]) -> int:
    """Compile what these verbs call and nobody has compiled.  How many kernels that were."""
    from tailstack.kernels import store
    from tailstack.kernels.calls import calls_for

    calls = calls_for(computations_of(verbs))
    missing = [call for call in calls if call.file() is None]
    if missing and not store.kernels_without_store():
        _compile(missing)
    return len(missing)


CAUTION = 0.6  # pace of a machine that has shown none yet, of that on which the table was made
FASTEST = 1.6  # seconds that the time left falls by in a second: one kernel that was quick says little of the others
LEARNT_SECONDS = 12.0  # of the table, in one process: from so much on what was measured counts more than that


class CompilationProgress(Progress):
    """How many kernels are compiled, of how many, and how long the rest takes.

    By the pace that was measured: seconds of the table over seconds that passed, with a cautious machine's before
    there is much to measure, and with what is being compiled as far as that pace brings it.  The time that is named
    never rises and never goes: where the machine turns out slower, it stands until the rest is that short.
    """

    def __init__(
        self, calls: Sequence[KernelCall], processes: int, reason: str, stream: TextIO | None = None, *,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__("compiling kernels, once on this machine", stream, clock=clock)
        self.preface = wrap(reason, first="kernels are compiled: ", indent="  ") if reason else ""
        self._calls, self._processes = calls, processes
        self._count, self._seconds_done, self._busy = 0, 0.0, 0.0  # of the table, and of the processes
        self._under_way: dict[KernelCall, float] = {}  # what is being compiled, since when
        self._total = sum(call.seconds for call in calls)
        self._named = (0.0, inf)  # when seconds left were named last, and how many

    def begin(self, call: KernelCall) -> None:
        """One of them is being compiled."""
        self._under_way[call] = self.elapsed_seconds

    def note(self, call: KernelCall) -> None:
        """One of them is compiled."""
        self._count += 1
        self._seconds_done += call.seconds
        self._busy += self.elapsed_seconds - self._under_way.pop(call)

    def _seconds_left(self) -> float:
        pace = (LEARNT_SECONDS + self._seconds_done) / (LEARNT_SECONDS / CAUTION + self._busy)
        now, left = self.elapsed_seconds, self._total - self._seconds_done
        for call, since in self._under_way.items():
            left -= min(0.9 * call.seconds, pace * (now - since))
        left /= pace * self._processes
        then, before = self._named
        self._named = now, min(before, max(left, before - FASTEST * (now - then)) if before < inf else left)
        return self._named[1]

    def line(self) -> str:
        """One line of progress as it stands."""
        text = f"{self.what}: {self._count} of {len(self._calls)}"
        return f"{text}, about {max(1.0, self._seconds_left()):.0f} s" if self._count < len(self._calls) else text


def _compile(calls: Sequence[KernelCall]) -> None:
    """In processes of their own, each with the next of the calls until none is left, the slowest first."""
    from tailstack.kernels import store
    from tailstack.kernels.process import usable_cores

    reason = store.why_not_installed() if store.installed_directories() else ""
    # and not in the working directory, of which numba would take settings
    environment = {**make_environment(), "NUMBA_CACHE_DIR": os.path.abspath(store.writable_directory())}
    if not store.is_writable():
        try:
            place = tempfile.TemporaryDirectory(prefix="tailstack-kernels-")
        except FileNotFoundError:  # nothing can be written anywhere: each process compiles what it calls
            return
        _lent.append(place)
        store.lend_directory(Path(place.name))
        environment["NUMBA_CACHE_DIR"] = place.name
    waiting: SimpleQueue[KernelCall] = SimpleQueue()
    for call in calls:
        waiting.put(call)
    count = min(usable_cores(), len(calls))
    with CompilationProgress(calls, count, reason) as progress:
        threads = [
            threading.Thread(target=_drive, args=(waiting, environment, progress), daemon=True) for _ in range(count)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def _drive(waiting: SimpleQueue[KernelCall], environment: dict[str, str], progress: CompilationProgress) -> None:
    """One process, for as long as there are calls.  What is left when it breaks down is compiled where it is called."""
    from tailstack.kernels.calls import EVERY

    with suppress(Empty, OSError), subprocess.Popen(
        make_command("tailstack.kernels.calls"), env=environment, cwd=os.path.dirname(__file__), text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        while True:
            call = waiting.get_nowait()
            progress.begin(call)
            process.stdin.write(f"{EVERY.index(call)}\n")
            process.stdin.flush()
            if not process.stdout.readline():
                return
            progress.note(call)


def describe_calls(verbs: Iterable[str]) -> str:
    """Where the machine code is that these verbs call, and why it is not what came with the installation."""
    from tailstack.kernels import store
    from tailstack.kernels.calls import calls_for

    calls = calls_for(computations_of(verbs))
    places = [store.place_of(path) for path in (call.file() for call in calls) if path is not None]
    words = [f"{places.count(place)} {place}" for place in dict.fromkeys(places)]
    if len(places) < len(calls):
        words.append(f"{len(calls) - len(places)} not compiled yet")
    here = f"{len(calls)} kernels: {', '.join(words)}"
    reason = store.why_not_installed()
    return f"{here} ({reason})" if reason else here

"""Kernels that are not compiled yet: compiled in as many processes as there are processors, and said so meanwhile."""

from __future__ import annotations

import os
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

from tailstack.kernels.process import usable_cores

from ..processes.birth import make_command, make_environment
from ..rendering.text import wrap
from .progress import Progress

if TYPE_CHECKING:
    from tailstack.kernels.calls import KernelCall

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
    """Compile what these verbs call and nobody has compiled.  How many kernels are compiled now that were not."""
    from tailstack.kernels import store
    from tailstack.kernels.calls import calls_for

    calls = calls_for(computations_of(verbs))
    missing = [call for call in calls if call.file() is None]
    return _compile(missing) if missing and not store.kernels_without_store() else 0


def _compile(calls: Sequence[KernelCall]) -> int:
    """In processes of their own, each with the next of the calls until none is left, the slowest first."""
    from tailstack.kernels import store

    reason = store.why_not_installed() if store.installed_directories() else ""
    # and not in the working directory, of which numba would take settings
    environment = {**make_environment(), "NUMBA_CACHE_DIR": os.path.abspath(store.writable_directory())}
    if not store.is_writable():
        try:
            place = tempfile.TemporaryDirectory(prefix="tailstack-kernels-")
        except FileNotFoundError:  # nothing can be written anywhere: each process compiles what it calls
            return 0
        _lent.append(place)
        store.lend_directory(Path(place.name))
        environment["NUMBA_CACHE_DIR"] = place.name
    waiting: SimpleQueue[KernelCall] = SimpleQueue()
    for call in calls:
        waiting.put(call)
    count = min(usable_cores(), len(calls))
    compiled: list[KernelCall] = []
    with Progress("compiling kernels, once on this machine") as progress:
        progress.preface = wrap(reason, first="kernels are compiled: ", indent="  ") if reason else ""

        def tell() -> None:
            done, total = (sum(call.seconds for call in some) for some in (compiled, calls))  # on the table's machine
            progress.report(done, total, f"{len(compiled)} of {len(calls)}")

        tell()
        threads = [
            threading.Thread(target=_drive, args=(waiting, environment, compiled, tell), daemon=True)
            for _ in range(count)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    return len(compiled)


def _drive(
    waiting: SimpleQueue[KernelCall], environment: dict[str, str], compiled: list[KernelCall], tell: Callable[[], None]
) -> None:
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
            process.stdin.write(f"{EVERY.index(call)}\n")
            process.stdin.flush()
            if not process.stdout.readline():
                return
            compiled.append(call)
            tell()


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

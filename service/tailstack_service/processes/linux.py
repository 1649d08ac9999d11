"""What only Linux offers to computing processes, in one place, each with what is done elsewhere.

Elsewhere a computing process is started by itself and not forked, its memory has no limit, it is not killed by the end
of its parent but leaves when its stdin ends, and nobody sees whether a silent one computes.  With
``TAILSTACK_PLAIN_PROCESSES=1`` in the environment it is like that on Linux as well, as the tests of it need.

The limit on memory is one on what a process can write to (``RLIMIT_DATA``), close to what it uses: what goes beyond is
refused, and nobody is killed.  Address space says nothing: LLVM and BLAS reserve hundreds of megabytes of it that they
never touch.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from ..environment import PLAIN_PROCESSES

HERE = sys.platform == "linux" and os.environ.get(PLAIN_PROCESSES, "") in ("", "0")
PR_SET_PDEATHSIG = 1
OOM_SCORE = 500  # where memory runs out, the unit that took it ends, and not the worker or the database
RESIDENT = 1  # field of /proc/PID/statm: what is in memory
WAITS_FOR_SYSTEM = {"R", "D"}  # states of a thread that waits for a processor or a disk, which is no fault of its own
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def die_with_parent() -> None:
    """Be killed when the thread ends that started this process, and before others where memory runs out."""
    if HERE:
        import ctypes

        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:
            score.write(str(OOM_SCORE))


def resident_bytes() -> int:
    """Of this process in memory; 0 elsewhere."""
    if HERE:
        with suppress(OSError), open("/proc/self/statm", "rb") as pages:
            return int(pages.read().split()[RESIDENT]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def limit_memory(most_bytes: int) -> None:
    """For this process from now on; 0: no limit."""
    if HERE and most_bytes:
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = most_bytes if hard == resource.RLIM_INFINITY else min(most_bytes, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def read_processor_time(pid: int) -> tuple[float, bool] | None:
    """(seconds that all threads of a process have used, whether one of them waits for the system).

    None where it, or one of its threads, has just ended, and elsewhere.
    """
    ticks, waits, tasks = 0, False, Path(f"/proc/{pid}/task")
    if not HERE:
        return None
    try:
        for thread in os.listdir(tasks):
            # The name in parentheses may hold anything; state, then 10 fields, then ticks in user and kernel mode
            fields = (tasks / thread / "stat").read_text().rpartition(")")[2].split()
            waits |= fields[0] in WAITS_FOR_SYSTEM
            ticks += int(fields[11]) + int(fields[12])
    except (OSError, IndexError, ValueError):
        return None
    return ticks / TICKS_A_SECOND, waits

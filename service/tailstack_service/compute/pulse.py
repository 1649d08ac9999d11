"""The heartbeat of a computing process: the processor time that it uses, as the system counts it (Linux).

A process that computes uses processor time, also inside compiled code that holds the interpreter's lock for minutes,
where a thread of its own could not say that it is alive.  One that has a task and uses none at all is stopped or waits
for something that does not come.  An endless loop is not seen here: that is for the limits of time.
"""

from __future__ import annotations

import os
from pathlib import Path

WAITS_FOR_SYSTEM = {"R", "D"}  # for a processor, for a disk: nothing that the process could do about
LOOK_SECONDS = 1.0


class Pulse:
    """How long a process has been without a heartbeat; ``look`` is called about every ``LOOK_SECONDS``."""

    def __init__(self, pid: int) -> None:
        self._tasks = Path(f"/proc/{pid}/task")
        self._used = -1
        self.silent_seconds = 0.0

    def look(self, seconds: float) -> None:
        """``seconds`` have passed since the last look.

        Of a long time no more than two looks' worth counts: who was stopped together with the process (a container that
        is paused, say) would otherwise take its own absence for the process's.
        """
        used, waits = self._state()
        if used != self._used or waits:
            self._used, self.silent_seconds = used, 0.0
        else:
            self.silent_seconds += min(seconds, 2 * LOOK_SECONDS)

    def _state(self) -> tuple[int, bool]:
        """Clock ticks used by all threads, and whether one waits for the system (as if, where nothing can be read)."""
        used, waits = 0, False
        try:
            for thread in os.listdir(self._tasks):
                # The name in parentheses may hold anything; state, then 10 fields, then ticks in user and kernel mode
                told = (self._tasks / thread / "stat").read_text().rpartition(")")[2].split()
                waits |= told[0] in WAITS_FOR_SYSTEM
                used += int(told[11]) + int(told[12])
        except (OSError, IndexError, ValueError):  # it, or one of its threads, has just ended; or this is not Linux
            return self._used, True
        return used, waits

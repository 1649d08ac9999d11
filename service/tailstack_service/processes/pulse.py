"""The processor time of another process, as the system counts it (Linux).

A process that computes uses processor time, also inside compiled code that holds the interpreter's lock for minutes,
where a thread of its own could not say that it is alive; and it uses no more of it when the machine is busy.
"""

from __future__ import annotations

import os
from pathlib import Path

WAITS_FOR_SYSTEM = {"R", "D"}  # states of a thread that waits for a processor or a disk, which is no fault of its own
LOOK_SECONDS = 1.0
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


class Pulse:
    """What a process has used of the processor, and for how long nothing; ``look`` is called again and again."""

    def __init__(self, pid: int) -> None:
        self._tasks = Path(f"/proc/{pid}/task")
        self._ticks = -1
        self.silent_seconds = 0.0

    @property
    def used_seconds(self) -> float | None:
        """Of the processor, by all threads, at the last look; None where the system does not say."""
        return self._ticks / TICKS_A_SECOND if self._ticks >= 0 else None

    def look(self, seconds: float) -> None:
        """``seconds`` have passed since the last look.

        Of a long time no more than two looks' worth counts: who was stopped together with the process (a container that
        is paused, say) would otherwise take its own absence for the process's.
        """
        ticks, waits = self._read()
        if ticks != self._ticks or waits:
            self._ticks, self.silent_seconds = ticks, 0.0
        else:
            self.silent_seconds += min(seconds, 2 * LOOK_SECONDS)

    def _read(self) -> tuple[int, bool]:
        """Clock ticks used by all threads, and whether one waits for the system (as if, where nothing can be read)."""
        ticks, waits = 0, False
        try:
            for thread in os.listdir(self._tasks):
                # The name in parentheses may hold anything; state, then 10 fields, then ticks in user and kernel mode
                fields = (self._tasks / thread / "stat").read_text().rpartition(")")[2].split()
                waits |= fields[0] in WAITS_FOR_SYSTEM
                ticks += int(fields[11]) + int(fields[12])
        except (OSError, IndexError, ValueError):  # it, or one of its threads, has just ended; or this is not Linux
            return self._ticks, True
        return ticks, waits

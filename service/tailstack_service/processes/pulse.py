"""Whether another process computes, by the processor time that the system counts for it (``linux``).

A process that computes uses processor time, also inside compiled code that holds the interpreter's lock for minutes,
where a thread of its own could not say that it is alive; and it uses no more of it when the machine is busy.
"""

from __future__ import annotations

from .linux import read_processor_time

LOOK_SECONDS = 1.0


class Pulse:
    """What a process has used of the processor, and for how long nothing; ``look`` is called again and again."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self.used_seconds: float | None = None  # by all threads, at the last look; None where the system does not say
        self.silent_seconds = 0.0

    def look(self, seconds: float) -> None:
        """``seconds`` have passed since the last look.

        Of a long time no more than two looks' worth counts: who was stopped together with the process (a container that
        is paused, say) would otherwise take its own absence for the process's.
        """
        reading = read_processor_time(self._pid)
        if reading is None or reading[1] or reading[0] != self.used_seconds:
            self.silent_seconds = 0.0
        else:
            self.silent_seconds += min(seconds, 2 * LOOK_SECONDS)
        if reading is not None:
            self.used_seconds = reading[0]

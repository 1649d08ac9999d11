"""How many processors there are to compute with."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """Processors that this process may use: affinity counts, limits of CPU time (cgroups) do not."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

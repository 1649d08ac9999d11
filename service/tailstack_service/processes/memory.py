"""A limit of the system on the memory of a computing process (Linux): what goes beyond it is refused, nobody is killed.

What is counted is what a process can write to (``RLIMIT_DATA``), close to what it uses.  Address space says nothing:
LLVM and BLAS reserve hundreds of megabytes of it that they never touch.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from tailstack.errors import LimitError, Problem

from ..names import variable


def limit_memory(most_bytes: int) -> None:
    """For this process from now on; 0: no limit."""
    if sys.platform == "linux" and most_bytes:
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = most_bytes if hard == resource.RLIM_INFINITY else min(most_bytes, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


@contextmanager
def memory_within(more_bytes: int) -> Iterator[None]:
    """What is done here may take so many bytes more than are in use now.  Raises MemoryError as soon as it does.

    Only where the process has a limit: elsewhere the memory is that of whoever asks.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard == resource.RLIM_INFINITY:
        yield
        return
    resource.setrlimit(resource.RLIMIT_DATA, (min(hard, _bytes_in_use() + more_bytes), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _bytes_in_use() -> int:
    """As ``RLIMIT_DATA`` counts them, and the stack besides."""
    with suppress(OSError), open("/proc/self/statm", "rb") as pages:
        return int(pages.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def memory_error() -> LimitError:
    """What is said of a request that would take more."""
    detail = "what was asked for needs more memory than a computing process may take"
    hint = f"ask for less, or start the service with a higher {variable('max_process_bytes')}"
    return LimitError(Problem("", "too-much-memory", detail, hint))

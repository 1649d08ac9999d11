"""Processes that the tests start: none outlives the process of the tests, however that ends."""

from __future__ import annotations

import ctypes
import signal
import sys

_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def die_with_parent(sign: int = signal.SIGKILL) -> None:
    """For ``preexec_fn``: Linux sends the signal when the thread ends that started the process."""
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, sign)

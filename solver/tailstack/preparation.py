"""A hook that is called once before the first kernel is compiled in this process; none by default.

A command may have kernels compiled in several processes at once, and show how far that is.  It says so here, before it
knows whether kernels are needed and without loading the compiler; the kernels ask when one of them is missing.
"""

from __future__ import annotations

from collections.abc import Callable

_preparations: list[Callable[[], None]] = []


def prepare_with(prepare: Callable[[], None] | None) -> None:
    """Call this once, before the first kernel is compiled here; None: nothing."""
    _preparations[:] = [] if prepare is None else [prepare]


def prepare() -> bool:
    """Call the hook, once.  Whether something was done, so that it is worth looking for a kernel again."""
    if not _preparations:
        return False
    _preparations.pop()()
    return True

"""Names in a document: unique where they are given, known where they are used."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence

from ..errors import Problem


def unique(names: Sequence[str], pointer: Callable[[int], str], what: str) -> list[Problem]:
    """A problem for each name that was there before, at the ``pointer`` of its index."""
    if len(set(names)) == len(names):
        return []
    seen: set[str] = set()
    problems = []
    for index, name in enumerate(names):
        if name in seen:
            problems.append(
                Problem(pointer(index), "duplicate-name", f"two {what} are called {name[:60]!r}", "names are unique")
            )
        seen.add(name)
    return problems


def known(pointer: str, what: str, name: str, names: Sequence[str]) -> list[Problem]:
    if name in names:
        return []
    close = difflib.get_close_matches(name, names, 1)
    listing = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    hint = f"did you mean {close[0]}?" if close else f"known: {listing}"
    return [Problem(pointer, "unknown-name", f"no {what} is called {name[:60]!r}", hint)]

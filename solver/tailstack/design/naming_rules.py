"""Names in a document: unique where they are given, known where they are used."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from ..errors import Problem


def unique(named: Iterable[tuple[str, str]], what: str) -> list[Problem]:
    seen: set[str] = set()
    problems = []
    for pointer, name in named:
        if name in seen:
            problems.append(
                Problem(pointer, "duplicate-name", f"two {what} are called {name[:60]!r}", "names are unique")
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

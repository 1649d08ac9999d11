"""The verbs: those of operations, and those that have a module here."""

from __future__ import annotations

from functools import cache

FIRST = ("demo", "init", "example")
LAST = (
    "serve", "worker", "jobs", "db", "keys", "mcp", "words", "schema", "openapi", "doctor", "warm-up", "completion",
    "version",
)  # fmt: skip
SPELLINGS = {"optimize": "optimise"}  # of verbs, accepted as well
OWN = frozenset({*FIRST, *LAST, "gate", "report"})  # modules of this package: gate and report take more than a design


@cache
def verbs() -> tuple[str, ...]:
    """All verbs, in the order in which they are listed."""
    from ..operations.registry import VERB_OF

    of_operations = dict.fromkeys(verb.partition(" ")[0] for verb in VERB_OF.values())
    return (*FIRST, *of_operations, *LAST)

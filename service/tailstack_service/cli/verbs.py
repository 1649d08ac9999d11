"""The verbs: those of operations, and those that have a module of their own."""

from __future__ import annotations

from functools import cache

FIRST = ("demo", "init", "example")
LAST = (
    "serve", "worker", "jobs", "db", "keys", "mcp", "words", "schema", "openapi", "doctor", "warm-up", "completion",
    "version",
)  # fmt: skip
SPELLINGS = {"optimize": "optimise"}  # of verbs, accepted as well
# Verbs with a module of their own (gate and report take more than a design); it is in this package, if not said here
ELSEWHERE = {"mcp": "tailstack_service.integrations.mcp"}
OWN = frozenset({*FIRST, *LAST, "gate", "report"})


def module_of(verb: str) -> str:
    """The module of a verb of its own."""
    return ELSEWHERE.get(verb, f"{__package__}.{verb.replace('-', '_')}")


@cache
def verbs() -> tuple[str, ...]:
    """All verbs, in the order in which they are listed."""
    from ..operations.registry import VERB_OF

    of_operations = dict.fromkeys(verb.partition(" ")[0] for verb in VERB_OF.values())
    return (*FIRST, *of_operations, *LAST)

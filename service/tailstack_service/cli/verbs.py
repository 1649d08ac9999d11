"""The verbs, and what the command that has them is called where it was started."""

from __future__ import annotations

import os
import re

from ..names import COMMAND

VERBS = (
    "demo", "validate", "score", "verify", "optimise", "sweep", "study", "gate", "report", "convert", "serve", "worker",
    "jobs", "db", "keys", "schema", "openapi", "doctor", "version",
)  # fmt: skip
INSTALLED = "tailstack"


def program() -> str:
    """What a person types before the verb: ``tailstack``, or ``./run tailstack`` in a checkout."""
    return os.environ.get(COMMAND) or INSTALLED


def typed(text: str) -> str:
    """The text with the commands in it (``tailstack score ...``) as they can be typed here."""
    here = program()
    if here == INSTALLED:
        return text
    before = re.escape(here.removesuffix(INSTALLED))
    return re.sub(rf"(?<!{before})\b{INSTALLED} (?=({'|'.join(VERBS)})\b)", lambda _: f"{here} ", text)

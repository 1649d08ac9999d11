"""The verbs, and commands in a text as they can be typed where this one was started."""

from __future__ import annotations

import re

from ..console.program import INSTALLED, program

VERBS = (
    "demo", "validate", "score", "verify", "optimise", "sweep", "study", "gate", "report", "convert", "serve", "worker",
    "jobs", "db", "keys", "schema", "openapi", "doctor", "version",
)  # fmt: skip


def spell_commands(text: str) -> str:
    """The text with the commands in it (``tailstack score ...``) as they can be typed here."""
    here = program()
    if here == INSTALLED:
        return text
    before = re.escape(here.removesuffix(INSTALLED))
    return re.sub(rf"(?<!{before})\b{INSTALLED} (?=({'|'.join(VERBS)})\b)", lambda _: f"{here} ", text)

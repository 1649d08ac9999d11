"""What this command is called where it was started, and commands in a text as they can be spell_commands there."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable

from ..environment import COMMAND

INSTALLED = "tailstack"
_verbs: list[str] = []


def know_verbs(verbs: Iterable[str]) -> None:
    """Say which words after ``tailstack`` are verbs; the command does so when it starts."""
    _verbs[:] = verbs


def program() -> str:
    """What a person types before the verb: ``tailstack``, or ``./run tailstack`` in a checkout."""
    return os.environ.get(COMMAND) or INSTALLED


def spell_commands(text: str) -> str:
    """The text with the commands in it (``tailstack score ...``) as they can be spell_commands here."""
    here = program()
    if here == INSTALLED or not _verbs:
        return text
    before = re.escape(here.removesuffix(INSTALLED))
    return re.sub(rf"(?<!{before})\b{INSTALLED} (?=({'|'.join(_verbs)})\b)", lambda _: f"{here} ", text)

"""What this command is called where it was started."""

from __future__ import annotations

import os

from ..names import COMMAND

INSTALLED = "tailstack"


def program() -> str:
    """What a person types before the verb: ``tailstack``, or ``./run tailstack`` in a checkout."""
    return os.environ.get(COMMAND) or INSTALLED

"""``python -m tailstack``: the command ``tailstack`` of the same distribution.

The solver knows nothing of the command line, so the command is found by name when it is wanted.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module

if __name__ == "__main__":
    os.environ.setdefault("TAILSTACK_COMMAND", "python -m tailstack")  # what hints call the command
    try:
        program = import_module("tailstack_service.__main__")
    except Exception as error:
        print(f"tailstack: nothing was evaluated: the installation is damaged: {error}", file=sys.stderr)
        sys.exit(3)
    program.command()

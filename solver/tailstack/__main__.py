"""``python -m tailstack``: the command ``tailstack`` of the same distribution.

The solver knows nothing of the command line, so the command is found by name when it is wanted.
"""

from __future__ import annotations

import os
from importlib import import_module

if __name__ == "__main__":
    os.environ.setdefault("TAILSTACK_COMMAND", "python -m tailstack")  # what hints call the command
    import_module("tailstack_service.cli.main").command()

"""What ``tailstack``, ``python -m tailstack_service`` and ``./run`` begin with.

Exit code 1 says that a design fails, and nothing else: what keeps the program from beginning leaves with 3.  Nothing
but the standard library is loaded before that is sure.
"""

import sys
import traceback
from typing import NoReturn


def command() -> NoReturn:
    """The command line, and the end of the process with its exit code."""
    if sys.flags.optimize > 1:
        lost = "python -OO (PYTHONOPTIMIZE=2) leaves out the texts that schemas and help are made of"
        print(f"tailstack: nothing was evaluated: {lost}; -O is as fast", file=sys.stderr)
        sys.exit(3)
    try:
        from tailstack_service.cli.main import command as begin

        begin()
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception:
        traceback.print_exc()
        print("tailstack: nothing was evaluated: the installation is damaged, or this is a defect", file=sys.stderr)
        sys.exit(3)


if __name__ == "__main__":
    command()

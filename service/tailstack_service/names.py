"""Names in the environment: of settings, and of what commands and clients read besides."""

from __future__ import annotations

PREFIX = "TAILSTACK_"
COMMAND = "TAILSTACK_COMMAND"  # what the command is called where it was started; ./run says it
KEY = "TAILSTACK_KEY"  # the credential that commands send
PLAIN_PROCESSES = "TAILSTACK_PLAIN_PROCESSES"  # 1: computing processes as on a system that is not Linux
TRACEBACK = "TAILSTACK_TRACEBACK"  # anything: a defect shows where it happened
URL = "TAILSTACK_URL"  # the service that commands ask
OTHERS = (COMMAND, KEY, PLAIN_PROCESSES, TRACEBACK, URL)
OF_PROCESSES = (COMMAND, PLAIN_PROCESSES, TRACEBACK)  # that children are told; they have no use for a credential
OF_TESTS = "TAILSTACK_TESTS_"  # and whatever follows


def variable(name: str) -> str:
    """The environment variable of a setting."""
    return PREFIX + name.upper()

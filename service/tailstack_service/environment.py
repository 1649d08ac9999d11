"""What this program reads of its environment: variables by name, and the folders that it may write into.

Those are the user's (XDG base directory specification), and one for what is temporary.  A process may have neither: a
container whose user is only a number has no home, and a read-only system no folder for temporary files.  What can be
lent is lent, and said; for the rest a refusal names the variable to set.
"""

from __future__ import annotations

import os
import stat
from functools import cache
from pathlib import Path

from tailstack.errors import Problem, TailstackError

PREFIX = "TAILSTACK_"
COMMAND = "TAILSTACK_COMMAND"  # what the command is called where it was started; ./run says it
KEY = "TAILSTACK_KEY"  # the credential that commands send
COUNTERS = "PROMETHEUS_MULTIPROC_DIR"  # prometheus_client reads it: where API processes count together
PLAIN_PROCESSES = "TAILSTACK_PLAIN_PROCESSES"  # 1: computing processes as on a system that is not Linux
TRACEBACK = "TAILSTACK_TRACEBACK"  # anything: a defect shows where it happened
URL = "TAILSTACK_URL"  # the service that commands ask
OTHERS = (COMMAND, KEY, PLAIN_PROCESSES, TRACEBACK, URL)
OF_PROCESSES = (COMMAND, PLAIN_PROCESSES, TRACEBACK)  # that children are told; they have no use for a credential
OF_TESTS = "TAILSTACK_TESTS_"  # and whatever follows
CURE = "TAILSTACK_DATABASE or XDG_STATE_HOME names one that stays"


def variable(name: str) -> str:
    """The environment variable of a setting."""
    return PREFIX + name.upper()


class FolderError(TailstackError, slug="no-folder", title="There is no folder to write into"):
    """There is no folder that could be written into."""


def state_directory() -> Path:
    """Where a program keeps what it must not lose; without a home, a folder of this user's among the temporary ones.

    Raises FolderError where there is none of these.
    """
    if named := os.environ.get("XDG_STATE_HOME"):
        return Path(named) / "tailstack"
    home = _find_home()
    return lent_directory() if home is None else home / ".local" / "state" / "tailstack"


def has_home() -> bool:
    """Whether what is kept is in a folder that was named, or in the user's home."""
    return bool(os.environ.get("XDG_STATE_HOME")) or _find_home() is not None


def _find_home() -> Path | None:
    """The user's home, if something is kept there already, or could be."""
    try:
        home = Path.home()
    except RuntimeError:  # neither HOME nor an entry among the users
        return None
    state_folder = home / ".local" / "state" / "tailstack"
    there = next(folder for folder in (state_folder, *state_folder.parents) if folder.exists())
    return home if there == state_folder or os.access(there, os.W_OK | os.X_OK) else None


@cache
def lent_directory() -> Path:
    """A folder of this user's alone among the temporary ones.  Raises FolderError."""
    user = getattr(os, "getuid", lambda: 0)()
    folder = Path(temporary_directory()) / f"tailstack-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError as error:
        raise _refuse_lent(folder, error.strerror or str(error)) from None
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != user or status.st_mode & 0o077:
        raise _refuse_lent(folder, "others may write or read it")
    words = "this user has no home: jobs and results are kept in %s, which may be emptied; %s"
    import logging  # late, as tempfile below: 5 ms of every command

    log = logging.getLogger("tailstack.service")
    log.warning(words, folder, CURE, extra={"action": "home-lent"})
    return folder


def _refuse_lent(folder: Path, why: str) -> FolderError:
    detail = f"this user has no home, and {folder} cannot stand in for it: {why}"
    return FolderError(Problem("", "no-home", detail, CURE))


def temporary_directory() -> str:
    """Where temporary files go.  Raises FolderError, which names the variable that says another place."""
    import tempfile

    try:
        return tempfile.gettempdir()
    except FileNotFoundError:
        raise FolderError(no_temporary_folder()) from None


def no_temporary_folder() -> Problem:
    """What Python says where it finds no folder for temporary files, in words that help."""
    named = os.environ.get("TMPDIR")
    first = f"TMPDIR ({named}), " if named else ""
    detail = f"no temporary file can be written: {first}/tmp, /var/tmp and the working directory were tried"
    return Problem("", "no-temporary-folder", detail, "set TMPDIR to a folder that can be written")


def misses_temporary_folder(error: OSError) -> bool:
    """Whether an error is that of Python's ``tempfile`` that found no folder."""
    return isinstance(error, FileNotFoundError) and error.filename is None and "temporary directory" in str(error)

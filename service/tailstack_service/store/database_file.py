"""The file of a SQLite database: whether it is still the one that was opened, and whether its disk has room."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

from tailstack.errors import Problem

from .errors import StoreError, StoreUnavailable

ROOM_BYTES = 4 << 20  # of free disk, without which a service does not call itself ready
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


class DatabaseFile:
    """What ``path`` named when it was first looked at.

    A program goes on writing into a file that was deleted, or that another was put in the place of, and all of it is
    lost with the program's end.  The same holds of SQLite's write-ahead log beside it, ``path``-wal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        self._log = Path(f"{self.path}-wal")
        self._file_seen: tuple[int, int] | None = None
        self._log_seen: tuple[int, int] | None = None

    def require_same(self, *, and_log: bool = False) -> None:
        """Raise StoreError if the path leads to nothing, or to another file than before.

        ``and_log``: also for the log, which is there while a transaction is under way.
        """
        self._file_seen = _same(self.path, self._file_seen)
        # A file system without shared memory has no log: then there is none to be seen, and none to be missed
        if and_log and (self._log_seen is not None or self._log.exists()):
            self._log_seen = _same(self._log, self._log_seen)

    def require_room(self) -> None:
        """Raise StoreUnavailable unless ``ROOM_BYTES`` can be had on the disk, which are given back at once.

        They are really reserved, for a file without a name: that knows of quotas as well as of full disks.
        """
        try:
            with tempfile.TemporaryFile(dir=self.path.parent) as file:
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, ROOM_BYTES)
                else:
                    file.write(bytes(ROOM_BYTES))
                    file.flush()
        except OSError as error:
            if error.errno in _NO_ROOM:
                detail = f"the disk of {self.path} is full: {ROOM_BYTES >> 20} MB could not be reserved"
                hint = "make room, or give the service another disk; it is ready again by itself"
                raise StoreUnavailable(Problem("", "disk-full", detail, hint)) from None
            detail = f"nothing can be written beside {self.path}: {error.strerror or error}"
            raise StoreError(
                Problem(
                    "", "unusable-database", detail, "this user must be allowed to write the file and its directory"
                )
            ) from None


def _same(path: Path, seen: tuple[int, int] | None) -> tuple[int, int]:
    try:
        found = os.stat(path)
    except FileNotFoundError:
        found = None
    except OSError as error:
        hint = "the log of the system says what became of the disk"
        raise StoreError(Problem("", "unusable-database", f"{path}: {error.strerror or error}", hint)) from None
    if found is not None and (seen is None or seen == (found.st_dev, found.st_ino)):
        return found.st_dev, found.st_ino
    what = "was deleted" if found is None else "is another file than the one that was opened"
    hint = (
        "put the very file back; docs/deploy.md says how to save what is in one that was deleted, "
        "before tailstack is stopped and started again with what is there then"
    )
    raise StoreError(Problem("", "database-gone", f"{path} {what}; nothing is written", hint))

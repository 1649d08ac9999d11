"""A command in a machine that is not like ours: as a user of no name, without a home, with nowhere to write.

As ``docker run --user 23456 --read-only`` makes it, by the tools of util-linux.  The user may read everything, so that
it finds the interpreter wherever that is, and write nothing that others own.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from shlex import quote

import pytest
from service_scenes import ROOT

from family import COMMAND, SOURCES, die_with_parent, run_process
from tailstack.kernels.store import writable_directory

USER = 23456
_AS_USER = [
    "setpriv", f"--reuid={USER}", f"--regid={USER}", "--clear-groups", "--inh-caps=+dac_read_search",
    "--ambient-caps=+dac_read_search", "--",
]  # fmt: skip
# A checkout that lies in one of these stays where it is, read-only
_READ_ONLY = f"""
mount --bind {quote(str(ROOT))} /mnt
for place in /tmp /var/tmp /dev/shm; do mount -t tmpfs tmpfs "$place"; done
[ -d {quote(str(ROOT))} ] || {{ mkdir -p {quote(str(ROOT))} && mount --bind -o ro /mnt {quote(str(ROOT))}; }}
for place in /tmp /var/tmp /dev/shm; do mount -o remount,ro "$place"; done
umount /mnt
exec "$@"
"""


@cache
def _can_contain() -> bool:
    if shutil.which("setpriv") is None or shutil.which("unshare") is None:
        return False
    tried = subprocess.run(["unshare", "--mount", "sh", "-c", _READ_ONLY, "sh", *_AS_USER, "true"], check=False)
    return tried.returncode == 0


def contain(*arguments: str, read_only: bool = False) -> list[str]:
    """The command that runs Python so.  Skips the test where this machine does not let it."""
    if not _can_contain():
        pytest.skip("NOT TESTED: unshare and setpriv need root")
    away = ["unshare", "--mount", "sh", "-c", _READ_ONLY, "sh"] if read_only else []
    return [*away, *_AS_USER, sys.executable, "-P", *arguments]


def surroundings(**changes: str) -> dict[str, str]:
    """Nothing but what Python and the compiled kernels need: no HOME, no folder that is the user's."""
    own = {"PATH": os.defpath, "PYTHONPATH": SOURCES, "PYTHONDONTWRITEBYTECODE": "1", "LANG": "C.UTF-8"}
    return {**own, "OMP_NUM_THREADS": "1", "NUMBA_CACHE_DIR": str(writable_directory()), **changes}


def run_contained(
    *arguments: str, read_only: bool = False, cwd: Path | str = "/", **changes: str
) -> subprocess.CompletedProcess[str]:
    """A tailstack command, in such a machine."""
    command = contain(*COMMAND, *arguments, read_only=read_only)
    return run_process(*command, env=surroundings(**changes), cwd=cwd, preexec_fn=die_with_parent)

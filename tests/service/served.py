"""A real ``tailstack serve`` with its worker: a process of its own, a database in a temporary directory."""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from service_scenes import client_of

from family import SOURCES, TAILSTACK, started
from tailstack_service.cli.main import main
from waiting import LIMIT_SECONDS, until


@dataclass(frozen=True, slots=True)
class Served:
    """A running service: where it answers, what it was told, where it writes its log."""

    url: str
    environment: dict[str, str]
    log: Path
    process: subprocess.Popen[str]

    @property
    def pid(self) -> int:
        return self.process.pid

    def run(self, *arguments: str) -> str:
        """Standard output of another tailstack command on the same database.

        In this process, since starting one takes longer than most commands: test_processes.py starts them.
        """
        out, err = io.StringIO(), io.StringIO()
        with patch.dict(os.environ, self.environment, clear=True), redirect_stdout(out), redirect_stderr(err):
            code = main(arguments)
        assert code == 0, err.getvalue()
        return out.getvalue()

    def again(self) -> AbstractContextManager[subprocess.Popen[str]]:
        """Another service in the place of this one, which has ended: at its address, on its database."""
        command = (*TAILSTACK, "serve", "--port", self.url.rpartition(":")[2])
        return started(*command, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def environment(directory: Path, **changes: str) -> dict[str, str]:
    """Nothing of the caller's settings, and a SQLite file below ``directory``."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("TAILSTACK_")}
    own = {
        "TAILSTACK_DATABASE": f"sqlite:///{directory / 'jobs.sqlite3'}",
        "TAILSTACK_WORKER_PROCESSES": "1",  # every process more is two seconds of a core before the first request
        "TAILSTACK_SHORT_WORKERS": "1",
    }
    return {**kept, "PYTHONPATH": SOURCES, "OMP_NUM_THREADS": "1", **own, **changes}


@contextmanager
def serving(directory: Path, *arguments: str, **changes: str) -> Iterator[Served]:
    """A service as soon as it says where it listens; it and everything it started are killed when the block is left.

    It logs into a file, for a pipe that nobody reads is full after some hundred looks at it, and then it hangs.
    ``arguments`` are of ``tailstack serve``, ``changes`` of its environment.
    """
    log, variables = directory / "serve.log", environment(directory, **changes)
    command = (*TAILSTACK, "serve", "--port", "0", *arguments)
    with log.open("w") as stderr, started(*command, stderr=stderr, env=variables) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.match(r"serving on (http://\S+)", line)
        assert found, line + log.read_text()
        yield Served(found.group(1), variables, log, process)


@contextmanager
def served(directory: Path, *arguments: str, **changes: str) -> Iterator[Served]:
    """The same once it is ready; it is asked to stop, and only what does not is killed."""
    with serving(directory, *arguments, **changes) as running:
        with client_of(running.url) as client:

            def ready() -> bool:
                assert running.process.poll() is None, running.log.read_text()
                return client.get("/health/ready").status_code == 200

            until(ready, running.log.read_text)
        try:
            yield running
        finally:
            running.process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                running.process.wait(LIMIT_SECONDS)

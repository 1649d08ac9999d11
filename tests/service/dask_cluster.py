"""A Dask cluster of the tests' own: a scheduler and workers as processes on loopback, with TLS.

``conftest.py`` makes the fixture known.  Without ``distributed`` the tests that need it are skipped, loudly, unless
TAILSTACK_TESTS_REQUIRE lists ``dask``: then they fail.
"""

from __future__ import annotations

import importlib.util
import os
import runpy
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from postgres import free_ports, go_without
from service_scenes import ROOT

from family import die_with_parent
from waiting import LIMIT_SECONDS, until

# A cluster that waits looks at itself fifty times a second: three processes took 5 % of a core, and take 1 % so
QUIET = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "5s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "60s",
}


def make_certificates(directory: Path) -> None:
    """ca.pem, certificate.pem and key.pem, by the script that is shipped for a cluster, valid for a day."""
    runpy.run_path(str(ROOT / "docker" / "certificates.py"))["make"](directory, 1.0)


class Cluster:
    """A scheduler and ``workers`` workers of one thread each.  Whatever is killed, ``revive`` starts again."""

    def __init__(self, workers: int = 2, *, module_path: str | None = None) -> None:
        self.directory = Path(tempfile.mkdtemp(prefix="tailstack-dask-"))
        make_certificates(self.directory)
        # The kernel signals a process whose parent *thread* ends; this one lives as long as the test process
        self._parent = ThreadPoolExecutor(1, "dask")
        self._environment = {
            **os.environ,
            "PYTHONPATH": module_path or os.pathsep.join(p for p in sys.path if p),
            "DASK_TEMPORARY_DIRECTORY": str(self.directory),
            **QUIET,
        }
        self._log = self.directory / "cluster.log"
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes] | None] = [None] * workers
        try:
            self.port = self._start_on_free_port()
            self.revive()
        except BaseException:
            self.close()
            raise

    @property
    def address(self) -> str:
        return f"tls://127.0.0.1:{self.port}"

    @property
    def settings(self) -> dict[str, Any]:
        """What a worker of ours is told, as environment variables."""
        return {
            "TAILSTACK_ENGINE": "dask",
            "TAILSTACK_DASK_SCHEDULER": self.address,
            "TAILSTACK_DASK_CA_FILE": str(self.directory / "ca.pem"),
            "TAILSTACK_DASK_CERT_FILE": str(self.directory / "certificate.pem"),
            "TAILSTACK_DASK_KEY_FILE": str(self.directory / "key.pem"),
        }

    def revive(self) -> None:
        """Start what has ended; workers look for the scheduler by themselves."""
        if self.scheduler is None or self.scheduler.poll() is not None:
            self.scheduler = self._launch_scheduler()
        for place, worker in enumerate(self.workers):
            if worker is None or worker.poll() is not None:
                self.workers[place] = self._launch(
                    "dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                    "--dashboard-address", "127.0.0.1:0", "--host", "127.0.0.1", "--memory-limit", "0",
                    "--local-directory", str(self.directory), "--death-timeout", f"{LIMIT_SECONDS:.0f}",
                )  # fmt: skip

    def kill_scheduler(self) -> None:
        """Workers without a scheduler leave by themselves."""
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait(LIMIT_SECONDS)

    def kill_worker(self, place: int) -> None:
        worker = self.workers[place]
        assert worker is not None
        worker.kill()
        worker.wait(LIMIT_SECONDS)

    def close(self) -> None:
        for process in [*self.workers, self.scheduler]:
            if process is not None:
                if process.poll() is None:
                    process.kill()
                process.wait(LIMIT_SECONDS)
        self._parent.shutdown()
        shutil.rmtree(self.directory, ignore_errors=True)

    def log(self) -> str:
        return self._log.read_text(errors="replace") if self._log.exists() else ""

    def _launch(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [
            sys.executable, "-m", f"distributed.cli.{program}", *arguments, "--protocol", "tls",
            "--tls-ca-file", "ca.pem", "--tls-cert", "certificate.pem", "--tls-key", "key.pem",
        ]  # fmt: skip

        def start() -> subprocess.Popen[bytes]:
            with self._log.open("ab") as log:
                return subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self._environment,
                    cwd=self.directory, preexec_fn=die_with_parent,
                )  # fmt: skip

        return self._parent.submit(start).result(LIMIT_SECONDS)

    def _launch_scheduler(self) -> subprocess.Popen[bytes]:
        return self._launch(
            "dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard",
            "--dashboard-address", "127.0.0.1:0",
        )  # fmt: skip

    def _start_on_free_port(self) -> int:
        for self.port in free_ports():
            self.scheduler = self._launch_scheduler()
            if self._answers():
                return self.port
        raise RuntimeError(f"the Dask scheduler did not start:\n{self.log()[-2000:]}")

    def _answers(self) -> bool:
        """Whether somebody listens, once that is known."""
        scheduler = self.scheduler
        assert scheduler is not None

        def listens() -> bool:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=LIMIT_SECONDS).close()
            except OSError:
                return False
            return True

        until(lambda: scheduler.poll() is not None or listens(), self.log)
        return scheduler.poll() is None


def installed() -> bool:
    return importlib.util.find_spec("distributed") is not None


@pytest.fixture(scope="session")
def dask_cluster() -> Iterator[Cluster]:
    """The cluster of this test process: a scheduler and two workers."""
    if not installed():
        go_without("dask", "Dask is not installed (pip install 'tailstack[dask]')")
    import tailstack_service.jobs.engines.dask  # noqa: F401  # silences Dask's log once, for whatever test comes first

    with closing(
        Cluster(module_path=os.pathsep.join([*(p for p in sys.path if p), str(Path(__file__).parent)]))
    ) as cluster:
        yield cluster

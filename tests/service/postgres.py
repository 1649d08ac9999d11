"""A PostgreSQL server of the tests' own: Debian's binaries, a temporary directory, a free loopback port.

Each test process starts at most one and stops it at its end; each test gets a fresh database.  ``conftest.py`` makes
the fixtures known.  Without the binaries the tests that need them are skipped, loudly, unless TAILSTACK_TESTS_REQUIRE
lists ``postgresql``: then they fail.
"""

from __future__ import annotations

import math
import os
import pwd
import random
import secrets
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import psutil
import psycopg
import pytest
from psycopg import sql

from family import die_with_parent, run_process
from waiting import LIMIT_SECONDS, until

USER = "tailstack"


class Server:
    """One server.  ``stop`` and ``start`` may be called at any time; address and databases stay the same."""

    def __init__(self, binaries: Path) -> None:
        self.binaries = binaries
        self.password = secrets.token_urlsafe(12)
        self.account = _unprivileged_account()
        self.directory = Path(tempfile.mkdtemp(prefix="tailstack-postgresql-"))
        # The kernel signals a server whose parent *thread* ends; this one lives as long as the test process
        self._parent = ThreadPoolExecutor(1, "postgresql")
        self._process: subprocess.Popen[bytes] | None = None
        self._log = self.directory / "server.log"
        self._initialise()
        self.port = self._start_on_free_port()

    def url(self, database: str) -> str:
        return f"postgresql://{USER}:{self.password}@127.0.0.1:{self.port}/{database}"

    @property
    def running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def start(self) -> None:
        """Start the server and wait until it answers."""
        self._parent.submit(self._launch).result(LIMIT_SECONDS)

        def answers() -> bool:
            try:
                psycopg.connect(self.url("postgres"), connect_timeout=math.ceil(LIMIT_SECONDS)).close()
            except psycopg.OperationalError as error:
                if not self.running:
                    raise RuntimeError(f"PostgreSQL did not start: {error}\n{self._log.read_text()[-2000:]}") from None
                return False
            return True

        until(answers, lambda: f"PostgreSQL does not answer: {self._log.read_text()[-2000:]}")

    def stop(self) -> None:
        """As after a power cut: nothing is finished or flushed, the next start recovers."""
        if self._process is not None and self.running:
            self._process.send_signal(signal.SIGQUIT)
            try:
                self._process.wait(LIMIT_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(LIMIT_SECONDS)

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """All of its processes stand still: connections are taken by the system, and nothing is answered."""
        assert self._process is not None
        parent = psutil.Process(self._process.pid)
        parent.suspend()  # first: then there are no further children
        stopped = [parent, *parent.children(recursive=True)]
        for process in stopped[1:]:
            process.suspend()
        try:
            yield
        finally:
            for process in reversed(stopped):
                process.resume()

    def close(self) -> None:
        self.stop()
        self._parent.shutdown()
        shutil.rmtree(self.directory, ignore_errors=True)

    def create_database(self) -> str:
        """A fresh, empty database.  Returns its name."""
        name = f"test_{secrets.token_hex(6)}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(name)))
        return name

    def drop_database(self, name: str) -> None:
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(sql.SQL("DROP DATABASE IF EXISTS {} WITH (FORCE)").format(sql.Identifier(name)))

    def _initialise(self) -> None:
        password_file = self.directory / "password"
        password_file.write_text(self.password)
        if self.account is not None:
            for path in (self.directory, password_file):
                os.chown(path, self.account.pw_uid, self.account.pw_gid)
        command: list[str | Path] = [
            self.binaries / "initdb", "--pgdata", self.directory / "data", "--username", USER, "--no-sync",
            "--auth", "scram-sha-256", "--pwfile", password_file, "--encoding", "UTF8", "--locale", "C.UTF-8",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_SECONDS, **self._identity())
        if done.returncode != 0:
            raise RuntimeError(f"initdb failed: {done.stderr or done.stdout}")
        password_file.unlink()

    def _identity(self) -> dict[str, Any]:
        """PostgreSQL refuses to run as root."""
        if self.account is None:
            return {}
        return {"user": self.account.pw_uid, "group": self.account.pw_gid, "extra_groups": [], "cwd": "/"}

    def _launch(self) -> None:
        command: list[str | Path] = [
            self.binaries / "postgres", "-D", self.directory / "data", "-p", str(self.port),
            "-c", "listen_addresses=127.0.0.1", "-c", f"unix_socket_directories={self.directory}",
            "-c", "fsync=on", "-c", "shared_buffers=32MB", "-c", "max_connections=200",
        ]  # fmt: skip
        with self._log.open("ab") as log:
            self._process = subprocess.Popen[bytes](
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                preexec_fn=partial(die_with_parent, signal.SIGQUIT), **self._identity(),
            )  # fmt: skip

    def _start_on_free_port(self) -> int:
        for self.port in free_ports():
            try:
                self.start()
            except RuntimeError:
                if "Address already in use" not in self._log.read_text():
                    raise
                continue
            return self.port
        raise RuntimeError("no free port was found for PostgreSQL")


def free_ports() -> Iterator[int]:
    """Some at which nobody listens, below the range that the system hands to outgoing connections, so that they are
    still free at a restart."""
    for _ in range(20):
        port = random.SystemRandom().randrange(20_000, 32_000)
        with socket.socket() as probe:
            taken = probe.connect_ex(("127.0.0.1", port)) == 0
        if not taken:
            yield port


def _unprivileged_account() -> pwd.struct_passwd | None:
    if os.geteuid() != 0:
        return None
    for name in ("postgres", "nobody"):
        try:
            return pwd.getpwnam(name)
        except KeyError:
            continue
    raise RuntimeError("PostgreSQL does not run as root, and there is neither an account postgres nor nobody")


def find_binaries() -> Path | None:
    """The directory of initdb and postgres, the newest first."""
    candidates = sorted(
        Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: float(path.parent.name), reverse=True
    )
    configured = shutil.which("pg_config")
    if configured:
        done = run_process(configured, "--bindir", check=True)
        candidates.append(Path(done.stdout.strip()))
    found = shutil.which("postgres")
    if found:
        candidates.append(Path(found).resolve().parent)
    return next((path for path in candidates if (path / "initdb").exists() and (path / "postgres").exists()), None)


def go_without(name: str, missing: object) -> NoReturn:
    """A test without this program is left out and says so; where TAILSTACK_TESTS_REQUIRE (comma-separated) lists it, it
    fails."""
    if name in os.environ.get("TAILSTACK_TESTS_REQUIRE", "").replace(" ", "").split(","):
        pytest.fail(f"{missing}; TAILSTACK_TESTS_REQUIRE lists {name}")
    pytest.skip(f"NOT TESTED: {missing}")


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[Server]:
    """The server of this test process."""
    binaries = find_binaries()
    if binaries is None:
        go_without("postgresql", "PostgreSQL is not installed (Debian: apt-get install postgresql)")
    with closing(Server(binaries)) as server:
        yield server


@pytest.fixture
def postgres_url(postgres_server: Server) -> Iterator[str]:
    """A fresh, empty database of this test."""
    name = postgres_server.create_database()
    try:
        yield postgres_server.url(name)
    finally:
        postgres_server.drop_database(name)


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A fresh, empty database on each of the two systems in turn."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'state' / 'tailstack.sqlite3'}"
    url: str = request.getfixturevalue("postgres_url")
    return url

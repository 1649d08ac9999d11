"""A Dask cluster of the tests' own: a scheduler and workers as processes on loopback, with TLS.

``conftest.py`` makes the fixture known.  Without ``distributed`` the tests that need it are skipped, loudly, unless
TAILSTACK_TESTS_REQUIRE lists ``dask``: then they fail.
"""

from __future__ import annotations

import datetime
import importlib.util
import os
import random
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from postgres import go_without

from family import die_with_parent
from waiting import LIMIT_SECONDS, until

# A cluster that waits looks at itself fifty times a second: three processes took 5 % of a core, and take 1 % so
QUIET = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "5s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "60s",
}


@dataclass(frozen=True, slots=True)
class Certificates:
    """Paths of PEM files: an authority, and one pair that everybody in the cluster shows."""

    authority: Path
    certificate: Path
    key: Path


def make_certificates(directory: Path) -> Certificates:
    """An authority of this cluster's own and a certificate for loopback signed by it, valid for a day."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    now = datetime.datetime.now(datetime.UTC)
    authority_key, key = ec.generate_private_key(ec.SECP256R1()), ec.generate_private_key(ec.SECP256R1())
    issuer = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "tests of tailstack")])

    def signed(subject: x509.Name, public: ec.EllipticCurvePublicKey, extension: x509.ExtensionType) -> bytes:
        certificate = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer)
            .public_key(public)
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(minutes=5))
            .not_valid_after(now + datetime.timedelta(days=1))
            .add_extension(extension, critical=True)
            .sign(authority_key, hashes.SHA256())
        )
        return certificate.public_bytes(serialization.Encoding.PEM)

    files = Certificates(directory / "ca.pem", directory / "certificate.pem", directory / "key.pem")
    files.authority.write_bytes(
        signed(issuer, authority_key.public_key(), x509.BasicConstraints(ca=True, path_length=0))
    )
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "127.0.0.1")])
    files.certificate.write_bytes(
        signed(name, key.public_key(), x509.SubjectAlternativeName([x509.DNSName("localhost")]))
    )
    files.key.write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    files.key.chmod(0o600)
    return files


class Cluster:
    """A scheduler and ``workers`` workers of one thread each.  Whatever is killed, ``revive`` starts again."""

    def __init__(self, workers: int = 2, *, module_path: str | None = None) -> None:
        self.directory = Path(tempfile.mkdtemp(prefix="tailstack-dask-"))
        self.certificates = make_certificates(self.directory)
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
            "TAILSTACK_DASK_CA_FILE": str(self.certificates.authority),
            "TAILSTACK_DASK_CERT_FILE": str(self.certificates.certificate),
            "TAILSTACK_DASK_KEY_FILE": str(self.certificates.key),
        }

    def revive(self) -> None:
        """Start what has ended; workers look for the scheduler by themselves."""
        if self.scheduler is None or self.scheduler.poll() is not None:
            self.scheduler = self._launch(
                "dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard",
                "--dashboard-address", "127.0.0.1:0",
            )  # fmt: skip
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
        files = self.certificates
        command = [
            sys.executable, "-m", f"distributed.cli.{program}", *arguments, "--protocol", "tls",
            "--tls-ca-file", str(files.authority), "--tls-cert", str(files.certificate), "--tls-key", str(files.key),
        ]  # fmt: skip

        def start() -> subprocess.Popen[bytes]:
            with self._log.open("ab") as log:
                return subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self._environment,
                    cwd=self.directory, preexec_fn=die_with_parent,
                )  # fmt: skip

        return self._parent.submit(start).result(LIMIT_SECONDS)

    def _start_on_free_port(self) -> int:
        # Below the range that the system hands to outgoing connections, so that it is still free at a restart
        for _ in range(20):
            port = random.SystemRandom().randrange(20_000, 32_000)
            with socket.socket() as probe:
                try:
                    probe.bind(("127.0.0.1", port))
                except OSError:
                    continue
            self.port = port
            self.scheduler = self._launch(
                "dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard",
                "--dashboard-address", "127.0.0.1:0",
            )  # fmt: skip
            if self._answers():
                return port
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
        words = "Dask is not installed (pip install 'tailstack[dask]')"
        go_without("dask", words)
    import tailstack_service.jobs.engines.dask  # noqa: F401  # silences Dask's log once, for whatever test comes first

    with closing(
        Cluster(module_path=os.pathsep.join([*(p for p in sys.path if p), str(Path(__file__).parent)]))
    ) as cluster:
        yield cluster

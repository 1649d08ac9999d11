"""What only a real process shows: signals, pipes, streams, a service that starts and stops."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_scenes import EXAMPLES, ROOT, read_answer, small_design

DEMO = str(EXAMPLES / "demo.yaml")
PATH = os.pathsep.join([str(ROOT / "solver"), str(ROOT / "service")])
COMMAND = [sys.executable, "-m", "tailstack_service.cli.main"]


def environment(**changes: str) -> dict[str, str]:
    kept = {key: value for key, value in os.environ.items() if not key.startswith("TAILSTACK_")}
    return {**kept, "PYTHONPATH": PATH, "OMP_NUM_THREADS": "1", **changes}


def run(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    changes = options.pop("env", {})
    options |= {"capture_output": True, "text": True, "encoding": "utf-8", "timeout": 120}
    return subprocess.run([*COMMAND, *arguments], env=environment(**changes), **options)


def test_help_loads_nothing_heavy() -> None:
    """The promise of a quick --help, without a clock: what makes a start slow is not imported."""
    code = (
        "import sys; from tailstack_service.cli.main import main; main(['--help']);"
        "heavy = {'numpy', 'numba', 'scipy', 'casadi', 'pydantic', 'fastapi', 'uvicorn', 'yaml'};"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment(), timeout=60)
    assert done.stderr == "[]\n"


def test_stdout_is_utf8_json_whatever_the_terminal_speaks() -> None:
    done = run("validate", DEMO, env={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    design = small_design(name="Führung µ → 骨", requirements=None, optimise=None)
    done = run("score", "-", "--json", input=json.dumps(design), env={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["provenance"]["design_name"] == design["name"]
    assert run("score", "-", input=json.dumps(design), env={"PYTHONIOENCODING": "ascii"}).returncode == 0


def test_problems_from_stdin_name_it_and_its_line() -> None:
    done = run("score", "-", input="schema: tailstack/design/1\nname: 3\n")
    assert done.returncode == 2
    assert "<stdin>:2:7: /name: expected a text" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_reader_that_leaves_is_no_error() -> None:
    process = subprocess.Popen(
        [*COMMAND, "schema", "design"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait(timeout=60) == 0


def test_a_stream_that_cannot_be_written_is_not_an_answer(tmp_path: Path) -> None:
    """Standard output opened for reading only: every write fails, as on a full disk."""
    (tmp_path / "read-only").touch()
    with open(tmp_path / "read-only") as unwritable:
        done = subprocess.run(
            [*COMMAND, "schema"], stdout=unwritable, stderr=subprocess.PIPE, text=True, env=environment(), timeout=60
        )
    assert done.returncode == 3
    assert "next: " in done.stderr
    assert "Traceback" not in done.stderr


# --- serve ----------------------------------------------------------------------------------------


@contextmanager
def service(*arguments: str, **changes: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A service process on a free port; it is ended whatever happens."""
    process = subprocess.Popen(
        [*COMMAND, "serve", "--port", "0", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(**changes),
    )  # fmt: skip
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        found = re.match(r"serving on (http://\S+)", line)
        assert found, line
        yield process, found.group(1)
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def await_ready(url: str, seconds: float = 90.0) -> None:
    """Poll readiness (a cold compile cache takes a while)."""
    deadline = time.monotonic() + seconds
    while httpx.get(url + "/health/ready", timeout=30, trust_env=False).status_code != 200:
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.mark.parametrize(("sign", "code"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_serve_answers_and_stops_cleanly(sign: signal.Signals, code: int) -> None:
    with service() as (process, url):
        await_ready(url)
        assert httpx.get(url + "/health/live", trust_env=False).json() == {"status": "alive"}
        answer = httpx.post(url + "/v1/scores", json={"design": small_design()}, timeout=60, trust_env=False)
        assert answer.status_code == 200
        process.send_signal(sign)
        out, err = process.communicate(timeout=30)
        assert process.returncode == code
        assert out == ""
        assert "Traceback" not in err
        assert "action=answered method=POST path='/v1/scores' status=200" in err
    port = int(url.rsplit(":", 1)[1])
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind(("127.0.0.1", port))


def test_a_stop_ends_what_is_being_computed() -> None:
    with service(TAILSTACK_MAX_TRIALS="1000000000", TAILSTACK_MAX_SECONDS="600") as (process, url):
        await_ready(url)
        body = {"design": small_design(), "trials": 1_000_000_000}
        with httpx.Client(base_url=url, timeout=60, trust_env=False) as client:
            request = client.build_request("POST", "/v1/verifications", json=body)
            with socket.create_connection((client.base_url.host, client.base_url.port or 80)) as connection:
                head = "POST /v1/verifications HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
                content = request.content
                connection.sendall(head.encode() + b"Content-Length: %d\r\n\r\n" % len(content) + content)
                time.sleep(1.0)
                process.send_signal(signal.SIGTERM)
                connection.settimeout(30)
                status, rest = read_answer(connection)
        assert status == b"HTTP/1.1 503 Service Unavailable"
        assert b"/v1/problems/stopping" in rest
        assert process.wait(timeout=30) == 0


def test_a_taken_port_is_2_and_says_what_to_do() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        done = run("serve", "--port", str(taken.getsockname()[1]))
    assert done.returncode == 2
    assert "--port 0" in done.stderr


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "::", "example.org"])
def test_only_loopback_unless_told(host: str) -> None:
    done = run("serve", "--host", host, "--port", "0")
    assert done.returncode == 2
    assert "--allow-remote" in done.stderr


def test_remote_addresses_when_told() -> None:
    with service("--host", "0.0.0.0", "--allow-remote") as (_, url):
        local = url.replace("0.0.0.0", "127.0.0.1")
        assert httpx.get(local + "/health/live", trust_env=False).status_code == 200


@pytest.mark.parametrize("value", ["many", "-3", "1e3", "0"])
def test_a_bad_setting_is_2_and_named(value: str) -> None:
    done = run("serve", "--port", "0", env={"TAILSTACK_MAX_TRIALS": value})
    assert done.returncode == 2
    assert "TAILSTACK_MAX_TRIALS" in done.stderr


def test_an_interrupt_of_a_long_check_is_130() -> None:
    process = subprocess.Popen(
        [*COMMAND, "verify", DEMO, "--trials", "2000000000"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(),
    )  # fmt: skip
    assert process.stderr is not None
    line = process.stderr.readline()  # progress appears after a second
    assert line.startswith("verify: ")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "interrupted" in err
    assert "Traceback" not in err

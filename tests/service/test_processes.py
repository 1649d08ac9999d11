"""What only a real process shows: signals, pipes, streams, a service that starts and stops."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event as Flag
from typing import Any

import httpx
import psutil
import pytest
from openapi_scenes import ended_job
from served import serving
from service_scenes import EXAMPLES, ask, client_of, small_design

from family import COMMAND, TAILSTACK, run_python, started
from waiting import LIMIT_SECONDS, until

DEMO = str(EXAMPLES / "demo.yaml")


def run(*arguments: str, said: dict[str, str] | None = None, **options: Any) -> subprocess.CompletedProcess[str]:
    """A command as a process, with what ``said`` adds to its environment."""
    return run_python(*COMMAND, *arguments, said=said, encoding="utf-8", **options)


@pytest.mark.long
def test_stdout_is_utf8_json_whatever_the_terminal_speaks() -> None:
    done = run("validate", DEMO, said={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    design = small_design(name="Führung µ → 骨", requirements=None, optimise=None)
    done = run("score", "-", "--json", input=json.dumps(design), said={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["provenance"]["design_name"] == design["name"]
    assert run("score", "-", input=json.dumps(design), said={"PYTHONIOENCODING": "ascii"}).returncode == 0


def test_problems_from_stdin_name_it_and_its_line() -> None:
    done = run("score", "-", input="schema: tailstack/design/1\nname: 3\n")
    assert done.returncode == 2
    assert "<stdin>:2:7: /name: expected a text" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_reader_that_leaves_is_no_error() -> None:
    with started(*TAILSTACK, "schema", "design") as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(LIMIT_SECONDS) == 0


def test_a_stream_that_cannot_be_written_is_not_an_answer(tmp_path: Path) -> None:
    """Standard output opened for reading only: every write fails, as on a full disk."""
    (tmp_path / "read-only").touch()
    with open(tmp_path / "read-only") as unwritable:
        done = run("schema", stdout=unwritable)
    assert done.returncode == 3
    assert "next: " in done.stderr
    assert "Traceback" not in done.stderr


# --- serve ----------------------------------------------------------------------------------------


@contextmanager
def service(folder: Path, *arguments: str, **changes: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A service process on a free port with a database of its own, and its address."""
    with serving(folder, *arguments, **{"TAILSTACK_MAX_WAIT_SECONDS": "600", **changes}) as running:
        yield running.process, running.url


def stopped(
    process: subprocess.Popen[str], folder: Path, sign: signal.Signals = signal.SIGTERM, code: int = 0
) -> tuple[str, str]:
    """What a service that is told to stop has printed, and its log; it leaves with the code and without a traceback."""
    process.send_signal(sign)
    out, _ = process.communicate(timeout=LIMIT_SECONDS)
    err = (folder / "serve.log").read_text()
    assert process.returncode == code, err
    assert "Traceback" not in err
    return out, err


def family_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    return psutil.Process(process.pid).children(recursive=True)


def api_processes_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Those of several: multiprocessing starts them, as uvicorn does."""
    found = []
    for child in psutil.Process(process.pid).children():
        with suppress(psutil.NoSuchProcess):
            if child.status() != psutil.STATUS_ZOMBIE and "--multiprocessing-fork" in child.cmdline():
                found.append(child)
    return found


def check_gone(family: list[psutil.Process]) -> None:
    """Nobody is left of the processes that a service had started."""
    _, alive = psutil.wait_procs(family, timeout=LIMIT_SECONDS)
    assert not alive, [member.cmdline() for member in alive]


def running_worker(process: subprocess.Popen[str], other_than: int = 0) -> psutil.Process:
    """The worker beside a service, as soon as it is there."""

    def found() -> psutil.Process | None:
        for member in psutil.Process(process.pid).children():
            with suppress(psutil.NoSuchProcess):
                if "worker" in member.cmdline() and member.pid != other_than:
                    return member
        return None

    return until(found, lambda: "no worker was started")


def answers(url: str, path: str) -> bool:
    return ask("GET", url + path).status_code == 200


def await_ready(url: str) -> None:
    """Poll readiness (a cold compile cache takes a while)."""
    until(lambda: answers(url, "/health/ready"))


@pytest.mark.long
@pytest.mark.parametrize(("sign", "code", "api_processes"), [(signal.SIGTERM, 0, "2"), (signal.SIGINT, 130, "1")])
def test_serve_answers_and_stops_cleanly(tmp_path: Path, sign: signal.Signals, code: int, api_processes: str) -> None:
    with service(tmp_path, TAILSTACK_API_PROCESSES=api_processes) as (process, url):
        await_ready(url)
        assert ask("GET", url + "/health/live").json() == {"status": "alive"}
        answer = ask("POST", url + "/v1/scores", json={"design": small_design()})
        assert answer.status_code == 200
        job = ask("POST", url + "/v1/verifications", json={"design": small_design(), "trials": 1000})
        with client_of(url) as client:
            assert ended_job(client, f"/v1/jobs/{job.json()['id']}")["state"] == "succeeded"
        running_worker(process)
        family = family_of(process)
        # What computing processes are forked from, in which they are called like it: answers and jobs have one
        called = {each.pid: each for each in family if "tailstack_service.processes.nursery" in each.cmdline()}
        (nursery,) = (each for each in called.values() if each.ppid() not in called)
        assert nursery.ppid() == process.pid
        assert len(family) >= (1 if api_processes == "1" else 3)
        out, err = stopped(process, tmp_path, sign, code)
        check_gone(family)
        assert out == ""
        assert re.search(r"INFO tailstack\.service action=answered request=\w+ .*path=/v1/scores status=200", err)
    port = int(url.rsplit(":", 1)[1])
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind(("127.0.0.1", port))


MOMENTS: dict[str, Callable[[subprocess.Popen[str], str], object]] = {
    "at once": lambda process, url: True,
    "with a process beside it": lambda process, url: family_of(process),
    "when it answers": lambda process, url: answers(url, "/health/live"),
}


@pytest.mark.long(but=("with a process beside it-1",))
@pytest.mark.parametrize(
    ("moment", "api_processes"),
    [("at once", "1"), ("with a process beside it", "1"), ("when it answers", "2")],
)
def test_a_stop_that_comes_during_the_start_is_heard(tmp_path: Path, moment: str, api_processes: str) -> None:
    """What says where it listens can be stopped, although it has not begun to serve."""
    with service(tmp_path, "--no-worker", TAILSTACK_API_PROCESSES=api_processes) as (process, url):
        until(lambda: MOMENTS[moment](process, url))
        stopped(process, tmp_path)


@pytest.mark.long
def test_a_service_that_still_compiles_stops_all_the_same(tmp_path: Path) -> None:
    """With an empty cache of kernels: told to stop in the middle of compiling, which takes a minute."""
    cache = tmp_path / "cache"
    cache.mkdir()
    with service(tmp_path, "--no-worker", NUMBA_CACHE_DIR=str(cache)) as (process, url):
        response = ask("GET", url + "/health/ready")
        assert (response.status_code, response.json()["kernels"]) == (503, "warming up")
        until(lambda: any(path.is_file() for path in cache.rglob("*")))  # it has compiled one of them
        stopped(process, tmp_path)


def read_stream(client: httpx.Client, path: str, begun: Flag) -> str:
    """All that a stream of events says; ``begun`` is set when it says the first."""
    lines = []
    with client.stream("GET", path) as response:
        for line in response.iter_lines():
            lines.append(line)
            begun.set()
    return "\n".join(lines)


@pytest.mark.long
def test_a_stop_ends_waits_and_streams_and_loses_no_job(tmp_path: Path) -> None:
    with service(tmp_path, "--no-worker") as (process, url):
        await_ready(url)
        body = {"design": small_design(), "trials": 1000}
        with client_of(url) as client, ThreadPoolExecutor(2) as pool:
            job = client.post("/v1/verifications", json=body).json()
            waiting = pool.submit(client.post, "/v1/verifications", json=body, headers={"Prefer": "wait=600"})
            begun = Flag()
            stream = pool.submit(read_stream, client, job["links"]["events"], begun)
            assert begun.wait(LIMIT_SECONDS)
            until(lambda: len(client.get("/v1/jobs").json()["jobs"]) == 2)  # what is waited for is accepted
            process.send_signal(signal.SIGTERM)
            assert waiting.result(timeout=LIMIT_SECONDS).status_code == 202
            assert "event: state" in stream.result(timeout=LIMIT_SECONDS)
        assert process.wait(timeout=LIMIT_SECONDS) == 0
    with service(tmp_path) as (process, url), client_of(url) as client:
        for job_id in (job["id"], waiting.result().json()["id"]):
            text = client.get(f"/v1/jobs/{job_id}/events").text
            assert '"state":"succeeded"' in text


@pytest.mark.long
def test_a_worker_that_dies_is_replaced_and_a_log_for_machines_tells_of_it(tmp_path: Path) -> None:
    """The worker of a service is killed, and a job is asked for."""
    with service(tmp_path, TAILSTACK_LOG_FORMAT="json") as (process, url):
        await_ready(url)
        first = running_worker(process)
        first.kill()
        assert running_worker(process, other_than=first.pid).pid != first.pid
        headers = {"X-Request-ID": "trace-1", "Prefer": "wait=600"}
        body = {"design": small_design(), "trials": 1000}
        answer = ask("POST", url + "/v1/verifications", json=body, headers=headers)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_SECONDS)
    assert answer.status_code == 200
    log = (tmp_path / "serve.log").read_text()
    lines = [json.loads(line) for line in log.splitlines() if line.startswith("{")]
    assert [line["kind"] for line in lines if line.get("action") == "child-ended"] == ["worker"]
    job = answer.headers["location"].rpartition("/")[2]
    mine = {line["action"]: line for line in lines if line.get("request") == "trace-1"}
    assert {"accepted", "answered"} <= set(mine)
    assert mine["accepted"]["job"] == job
    assert (mine["answered"]["status"], mine["answered"]["level"]) == (200, "info")
    assert any(line["logger"] == "tailstack.worker" and line.get("job") == job for line in lines)


@pytest.mark.long
def test_one_of_several_api_processes_that_dies_is_replaced_and_counters_are_shared(tmp_path: Path) -> None:
    with service(tmp_path, "--no-worker", TAILSTACK_API_PROCESSES="2") as (process, url):
        await_ready(url)
        assert len(api_processes_of(process)) == 2
        for _ in range(20):  # on connections of their own, so that both take some
            assert answers(url, "/version")
        counted = sum(requests_counted(url, "/version") for _ in range(2)) / 2
        assert counted == 20
        killed = api_processes_of(process)[0]
        computing = killed.children(recursive=True)
        killed.kill()
        check_gone(computing)

        def replaced() -> bool:
            alive = api_processes_of(process)
            return len(alive) == 2 and killed not in alive

        until(replaced)
        await_ready(url)
        assert answers(url, "/version")
        assert requests_counted(url, "/version") == 21


def requests_counted(url: str, route: str) -> float:
    text = ask("GET", url + "/metrics").text
    found = re.search(rf'tailstack_http_requests_total{{method="GET",route="{route}",status="200"}} (\S+)', text)
    return float(found.group(1)) if found else 0.0


def test_a_database_that_cannot_be_had_is_said(tmp_path: Path, call: Any, loggers: None) -> None:
    code, _, err = call("serve", "--port", "0", "--database", f"sqlite:///{tmp_path}")
    assert code == 3, err


def test_a_taken_port_is_2_and_says_what_to_do(refused: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert "--port 0" in refused("serve", "--port", str(taken.getsockname()[1]))


def test_another_address_needs_authentication(refused: Any) -> None:
    for host in ("0.0.0.0", "192.0.2.1", "::", "example.org"):
        assert "TAILSTACK_AUTH=required" in refused("serve", "--host", host, "--port", "0")


@pytest.mark.long
def test_other_addresses_with_authentication(tmp_path: Path) -> None:
    with service(tmp_path, "--no-worker", "--host", "0.0.0.0", TAILSTACK_AUTH="required") as (_, url):
        local = url.replace("0.0.0.0", "127.0.0.1")
        assert ask("GET", local + "/health/live").status_code == 200
        assert ask("GET", local + "/v1/jobs").status_code == 401
        database = {"TAILSTACK_DATABASE": f"sqlite:///{tmp_path / 'jobs.sqlite3'}"}
        made = run("keys", "create", "--tenant", "a", "--name", "test", "--scope", "read", said=database)
        assert made.returncode == 0, made.stderr
        asked = run("jobs", "list", "--url", local, said={"TAILSTACK_KEY": made.stdout.strip()})
        assert (asked.returncode, asked.stdout) == (0, "")


def test_authentication_that_cannot_work_is_2_and_named(
    tmp_path: Path, refused: Any, loggers: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TAILSTACK_AUTH", "required")
    monkeypatch.setenv("TAILSTACK_JWT_KEY_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("TAILSTACK_JWT_ISSUER", "x")
    monkeypatch.setenv("TAILSTACK_API_PROCESSES", "2")
    assert "TAILSTACK_JWT_KEY_FILE" in refused("serve", "--port", "0")


@pytest.mark.parametrize(("sign", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, -signal.SIGTERM)])
def test_what_ends_a_long_check(sign: signal.Signals, code: int) -> None:
    with started(*TAILSTACK, "verify", DEMO, "--trials", "1000000000") as process:
        assert process.stderr is not None
        line = process.stderr.readline()  # of progress
        assert line.startswith("verify: ")
        process.send_signal(sign)
        out, err = process.communicate(timeout=LIMIT_SECONDS)
        assert process.returncode == code, err
        assert out == ""
        assert ("interrupted" in err) == (sign == signal.SIGINT)
        assert "Traceback" not in err


@pytest.mark.parametrize(
    "run",
    [
        # LLVM calls Python while a kernel is loaded, and whatever is raised there is lost
        "called = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))\n"
        "def run(_):\n"
        "    signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "    called()\n"
        "    signal.pause()\n",
        # functions are made so while libraries are loaded; under ``python -m`` CPython would end by the signal
        "run = lambda _: exec('raise KeyboardInterrupt')\n",
    ],
    ids=["that a library ignores", "of a text that is executed"],
)
def test_an_interrupt_is_heard_and_ends_with_the_code(run: str, tmp_path: Path) -> None:
    program = f"import ctypes, signal\nfrom tailstack_service.cli import main\n{run}main._run = run\nmain.command()\n"
    (tmp_path / "interrupted.py").write_text(program, encoding="utf-8")
    done = run_python("-m", "interrupted", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (130, "tailstack: interrupted\n")


def test_what_takes_too_much_memory_is_refused_and_the_process_goes_on() -> None:
    """Under the limit of the system: at once, and no matter who asks for it."""
    program = """
from functools import partial
from tailstack_service.operations.perform import perform_call
from tailstack_service.processes.birth import limit_memory
limit_memory(600_000_000)
refused = perform_call(partial(bytearray, 900_000_000))
print(refused.slug, refused.problems[0].hint)
"""
    done = run_python("-c", program)
    assert done.returncode == 0, done.stderr
    assert "limit-exceeded" in done.stdout
    assert "TAILSTACK_MAX_PROCESS_BYTES" in done.stdout

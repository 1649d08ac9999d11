"""Commands that ask a service: jobs, and a gate that it judges."""

from __future__ import annotations

import json
import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
from dask_cluster import make_certificates
from gate_scenes import BAD, GOOD, NEAR, STRICT, TODAY, waivers, write_documents
from service_scenes import answering, client_with, coplanar_design, http_answer, limited, small_design

from plain_data import read_cases
from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.console.remote import RemoteError, RemoteService, ServerSentEvent, read_events
from tailstack_service.jobs.store.keys import create_key
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.settings import Settings
from turned_clock import TurnedClock

QUICK = {"design": small_design(), "trials": 3000}
CLIENT = {"settings": Settings(worker_processes=1, max_trials=1_000_000_000), "worker": True}


def call(client: httpx.Client, *arguments: str) -> int:
    return main(["jobs", *arguments, "--url", str(client.base_url)])


def posted(client: httpx.Client, path: str, body: object) -> str:
    return str(client.post(path, json=body).json()["id"])


@pytest.mark.long
def test_a_job_is_followed_to_its_end_and_shown(client: httpx.Client, capsys: pytest.CaptureFixture[str]) -> None:
    job = posted(client, "/v1/verifications", QUICK)
    assert call(client, "follow", job) == 0
    out, err = capsys.readouterr()
    assert f"verification {job}: queued" in err
    assert f"verification {job}: succeeded" in err
    assert "100 %" in out
    assert "/v1/results/" in out
    assert call(client, "follow", job, "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["id"], record["state"]) == (job, "succeeded")
    assert call(client, "show", job) == 0
    assert "succeeded" in capsys.readouterr().out


@pytest.mark.long
def test_a_failed_job_leaves_with_the_code_of_its_problem(
    client: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    job = posted(client, "/v1/optimisations", {"design": limited(0.15), "starts": 1})
    assert call(client, "follow", job) == 1  # infeasible, as tailstack optimise says it
    out, _ = capsys.readouterr()
    assert "failed" in out
    assert "hint: " in out


def test_a_job_is_cancelled_once(client: httpx.Client, capsys: pytest.CaptureFixture[str]) -> None:
    job = posted(client, "/v1/verifications", {**QUICK, "trials": 400_000_000})
    assert call(client, "cancel", job, "--json") == 0
    assert json.loads(capsys.readouterr().out)["state"] == "cancelled"
    assert call(client, "follow", job) == 3
    capsys.readouterr()
    done = posted(client, "/v1/verifications", QUICK)
    assert call(client, "follow", done) == 0
    assert call(client, "cancel", done) == 3
    assert "there is nothing to cancel" in capsys.readouterr().err


def test_lists_go_over_pages(
    client: httpx.Client, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tailstack_service.cli.jobs.PAGE", 2)
    design = small_design(name="drill guide, reference structure with twelve beads")
    axes = [[{"pointer": "/views/0/fiducial_noise_px", "values": [0.1 + 0.01 * k]}] for k in range(5)]
    made = [posted(client, "/v1/sweeps", {"design": design, "axes": axis}) for axis in axes]
    assert call(client, "list", "--kind", "sweep", "--limit", "4", "--json") == 0
    assert [record["id"] for record in json.loads(capsys.readouterr().out)] == made[:0:-1]
    assert call(client, "list", "--kind", "sweep") == 0
    out = capsys.readouterr().out
    assert all(job in out for job in made)
    assert max(len(line) for line in out.splitlines()) <= 100
    assert call(client, "list", "--kind", "gate") == 0
    assert capsys.readouterr().out == ""


def test_unknown_jobs_and_silent_services(client: httpx.Client, capsys: pytest.CaptureFixture[str]) -> None:
    for action in ("show", "follow", "cancel"):
        for name, words in (
            ("01k4z8t5r2w7x3y9v6n1m0q8pc", "there is no job"),
            ("../../version", "there is nothing at"),
        ):
            assert call(client, action, name) == 2
            assert words in capsys.readouterr().err
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert main(["jobs", "list", "--url", f"http://127.0.0.1:{port}"]) == 3
    assert "tailstack serve" in capsys.readouterr().err


def test_hints_are_for_who_types_commands(
    client: httpx.Client,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    refused: Any,
) -> None:
    done = posted(client, "/v1/verifications", QUICK)
    assert call(client, "follow", done) == 0
    monkeypatch.setenv("TAILSTACK_COMMAND", "./run tailstack")
    for arguments, hint in (
        (("cancel", done), f"hint: ./run tailstack jobs show {done}"),
        (("show", done[::-1]), "hint: ./run tailstack jobs list shows"),
    ):
        call(client, *arguments)
        err = capsys.readouterr().err
        assert hint in err
        assert "GET /" not in err
    assert call(client, "list", "--kind", "gate", "--json") == 0
    assert call(client, "list", "--kind", "gate") == 0
    assert f"curl {client.base_url!s}/v1/verifications" in capsys.readouterr().err
    settings = Settings(auth="required", database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    with client_with(settings) as guarded:
        assert call(guarded, "list") == 2
        assert "hint: set TAILSTACK_KEY to an API key" in capsys.readouterr().err
        with closing(open_database(settings.database_url)) as db:
            _, secret = create_key(db, tenant="a", name="b", scopes=("read",), days=1.0)
        monkeypatch.setenv("TAILSTACK_KEY", secret)
        monkeypatch.setenv("TAILSTACK_URL", str(guarded.base_url))
        assert main(["jobs", "list", "--json"]) == 0
        assert capsys.readouterr().out == "[]\n"
        assert "hint: set TAILSTACK_KEY to a key with that scope" in refused(
            "jobs", "cancel", "01k4z8t5r2w7x3y9v6n1m0q8pc"
        )


STREAM = b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nConnection: close\r\n\r\n"


def test_a_stream_that_breaks_is_taken_up_with_the_last_id() -> None:
    first = STREAM + b'id: 1\nevent: state\ndata: {"state": "queued"}\n\nid: 2\nevent: progress\ndata: {"cut'
    rest = STREAM + b': still here\n\nid: 2\nevent: state\ndata: {"state":\ndata: "failed"}\n\n'
    with answering(first, http_answer(503, b"busy"), rest) as (url, heard):
        events = list(RemoteService(url, key="tsk_secret").events("x"))
    assert events == [
        ServerSentEvent("1", "state", {"state": "queued"}),
        ServerSentEvent("2", "state", {"state": "failed"}),
    ]
    assert b"last-event-id" not in heard[0].lower()
    assert b"last-event-id: 1\r\n" in heard[2].lower()
    assert all(b"Authorization: Bearer tsk_secret\r\n" in request for request in heard)


def test_a_key_is_not_carried_to_another_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAILSTACK_KEY", "tsk_secret")
    elsewhere = b"HTTP/1.1 303 See Other\r\nLocation: http://127.0.0.1:1/x\r\nContent-Length: 0\r\n\r\n"
    with answering(elsewhere) as (url, heard):
        assert RemoteService(url).ask("GET", "/v1/jobs/x/result").status_code == 303
    assert b"Bearer tsk_secret" in heard[0]


def test_answers_that_are_none_are_told_as_such() -> None:
    for body in (b"hello", b"[]", b'{"errors": 3}', b'{"errors": [], "type": 3, "title": "x"}', b"\xff"):
        with answering(http_answer(500, body)) as (url, _), pytest.raises(RemoteError) as raised:
            RemoteService(url, key="").ask("GET", "/v1/jobs")
        assert (raised.value.slug, raised.value.exit_code) == ("unexpected-answer", 3)
    for answer in (
        b"",
        b"HTTP/1.1 200 OK\r\nContent-Length: 10\r\n\r\n{}",
        b"220 mail.example\r\n",
        b"\x15\x03\x01\x00\x02\x02F",
    ):
        with answering(answer) as (url, _), pytest.raises(RemoteError) as raised:
            RemoteService(url, key="").ask("GET", "/v1/jobs")
        assert (raised.value.slug, raised.value.status, raised.value.exit_code) == ("unreachable", 0, 3)
        assert f"no answer from {url}: " in str(raised.value)
    with (
        answering(b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 5\r\n\r\nhello") as (url, _),
        pytest.raises(RemoteError, match="is this a tailstack"),
    ):
        list(RemoteService(url, key="").events("x"))


@pytest.mark.parametrize("body", [b"<html>Log in to this network</html>", b"", b"[]", b"{}"])
def test_a_page_of_somebody_else_is_no_list_of_jobs(body: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["list"], ["show", "x"], ["follow", "x"]):
        with answering(http_answer(200, body)) as (url, _):
            assert main(["jobs", *arguments, "--url", url]) == 3
        assert "is this a tailstack?" in capsys.readouterr().err


def test_lines_of_a_stream() -> None:
    text = b'data: {}\n\n: c\n\nevent: a\n\nid:7\ndata:{"a": 1}\nevent:b\r\n\r\ndata: {}\n'
    answer = httpx.Response(200, headers={"Content-Type": "text/event-stream"}, content=text)
    assert list(read_events(answer)) == [ServerSentEvent("", "message", {}), ServerSentEvent("7", "b", {"a": 1})]


def test_only_a_service_on_another_machine_is_asked_through_the_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = http_answer(200, b"{}")
    with answering(answer, answer) as (url, heard):
        monkeypatch.setenv("http_proxy", url)
        assert RemoteService("http://tailstack.invalid", key="").ask("GET", "/version").json() == {}
        for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
            monkeypatch.setenv(name, "http://127.0.0.1:1")
        assert RemoteService(url, key="").ask("GET", "/version").json() == {}
    asked = [request.partition(b" HTTP/1.1\r\n")[0] for request in heard]
    assert asked == [b"GET http://tailstack.invalid/version", b"GET /version"]


def test_a_certificate_that_nobody_vouches_for_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_certificates(tmp_path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "certificate.pem", tmp_path / "key.pem")
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def answer() -> None:
            with suppress(OSError), context.wrap_socket(listening.accept()[0], server_side=True):
                pass

        threading.Thread(target=answer, daemon=True).start()
        port = listening.getsockname()[1]
        assert main(["jobs", "list", "--url", f"https://localhost:{port}"]) == 3
    assert "certificate verify failed" in capsys.readouterr().err


@pytest.mark.long
def test_a_silent_service_is_not_waited_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening, pytest.raises(RemoteError, match="timed out"):
        RemoteService(f"http://127.0.0.1:{listening.getsockname()[1]}", key="").ask("GET", "/version", seconds=0.3)


@pytest.mark.parametrize("url", ["http://h:99999", "http://h:x", "http://[::1", "http://user:hush@h", "ftp://x",
                                 "file:///etc/passwd", "nonsense", ""])  # fmt: skip
def test_addresses_that_are_none_are_bad_usage(url: str, refused: Any) -> None:
    err = refused("jobs", "list", "--url", url)
    assert "internal error" not in err
    assert "hush" not in err


def test_a_stream_without_events_outlives_a_restart_of_the_service() -> None:
    """A job that waits for long says nothing; the patience counts from the moment when nobody answers."""
    quiet = STREAM + b": still here\n\n"
    rest = STREAM + b'id: 1\nevent: state\ndata: {"state": "failed"}\n\n'
    clock = TurnedClock(jumping=True)
    with answering(quiet, http_answer(503, b"busy"), rest) as (url, _):
        events = list(RemoteService(url, key="", clock=clock).events("x", patience=0.4))  # the first pause is longer
    assert [event.id for event in events] == ["1"]
    assert clock.waits == [0.5, 1.0]


# --- --remote: a service judges as the gate here does ---------------------------------------------


UNUSED = {"name": "seat", "tolerances": ["structure_conector.r?"], "min_half_width_deg": 0.05}
POLICY = {**STRICT, "rules": {**STRICT["rules"], "fiducial-spacing": {"min_mm": 80.0},  # type: ignore[dict-item]
                              "process-capability": {"processes": [UNUSED]}},
          "verification": {"max_trials": 20000}}  # fmt: skip


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with client_with(Settings(worker_processes=1), worker=True) as client:
        yield str(client.base_url)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with everything that a gate can meet: also a design whose fiducials stand in a file of their own."""
    monkeypatch.chdir(tmp_path)
    filed = limited(1.4)
    points = [point["position_mm"] for point in filed["fiducials"].pop("points")]
    rows = "".join(f"P{k},{x!r},{y!r},{z!r}\n" for k, (x, y, z) in enumerate(points))
    (tmp_path / "beads.csv").write_text("label,x_mm,y_mm,z_mm\n" + rows, encoding="utf-8")
    filed["fiducials"]["file"] = "beads.csv"
    documents = {
        "good.yaml": GOOD, "bad ü.yaml": BAD, "near.yaml": limited(NEAR), "flat.yaml": coplanar_design(),
        "filed.yaml": filed, "broken.yaml": {"schema": "tailstack/design/1", "name": "half"}, "policy.yaml": POLICY,
        "waivers.yaml": waivers(10, designs=["bad*"]),
    }  # fmt: skip
    write_documents(tmp_path, documents)
    monkeypatch.setattr("tailstack_service.cli.gate.today", lambda: TODAY)
    return tmp_path


def gate(*arguments: str) -> int:
    return main(["gate", "--policy", "policy.yaml", *arguments])


@pytest.mark.long("arguments0-1")
@pytest.mark.parametrize(("arguments", "code"), read_cases("gate", "remote"))
def test_the_answer_is_that_of_the_gate_here(folder: Path, url: str, arguments: list[str], code: int) -> None:
    lenient = {key: value for key, value in POLICY.items() if key != "rules"} | {"rules": STRICT["rules"]}
    (folder / "lenient.yaml").write_text(data_to_yaml(lenient), encoding="utf-8")
    if "base.json" in arguments:
        assert gate("near.yaml", "--mode", "analytic", "--on-inconclusive", "warn", "--format=json=base.json") == 1
        base = json.loads((folder / "base.json").read_text(encoding="utf-8"))
        base["provenance"]["tailstack_version"] = "0.0.1"
        (folder / "base.json").write_text(json.dumps(base, indent=2), encoding="utf-8")
    here = gate(*arguments, "--format=json=here.json", "--format=text=here.txt")
    there = gate(*arguments, "--format=json=there.json", "--format=text=there.txt", "--remote", url)
    assert (here, there) == (code, code)
    for end in ("json", "txt"):
        assert (folder / f"there.{end}").read_text("utf-8") == (folder / f"here.{end}").read_text("utf-8")


UNAUTHENTICATED = {
    "type": "/v1/problems/unauthenticated", "title": "Who are you?", "status": 401,
    "errors": [{"pointer": "", "code": "unauthenticated", "detail": "no key", "hint": ""}],
}  # fmt: skip


def test_a_key_is_sent_and_a_refusal_is_no_verdict(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TAILSTACK_KEY", "tsk_secret")
    with answering(http_answer(401, json.dumps(UNAUTHENTICATED).encode())) as (at, got):
        assert gate("good.yaml", "--mode", "analytic", "--remote", at, "--format=json=out.json") == 2
    assert b"authorization: bearer tsk_secret" in got[0].lower()
    assert b"tsk_secret" not in (folder / "out.json").read_bytes()
    assert json.loads((folder / "out.json").read_text())["verdict"] == "not evaluated"
    assert "tsk_secret" not in capsys.readouterr().err


RECORD_OF_ANOTHER = json.dumps({"schema": "tailstack/gate/1", "verdict": "pass", "exit_code": 0}).encode()


@pytest.mark.parametrize(
    "answer",
    [
        http_answer(200, b"<html>a proxy</html>"), http_answer(200, RECORD_OF_ANOTHER), http_answer(200, b""),
        http_answer(500, b"oops"), http_answer(503, b""), None,
    ],
    ids=["a page", "a record of another", "nothing", "500", "503", "it hangs up"],
)  # fmt: skip
def test_an_answer_that_is_none_leaves_with_3(folder: Path, answer: bytes | None) -> None:
    with answering(answer) as (at, _):
        assert gate("good.yaml", "--mode", "analytic", "--remote", at, "--format=json=out.json") == 3
    assert json.loads((folder / "out.json").read_text())["exit_code"] == 3


def test_a_record_about_other_designs_is_no_answer(folder: Path) -> None:
    assert gate("filed.yaml", "--mode", "analytic", "--format=json=other.json") == 1
    other = json.loads((folder / "other.json").read_text(encoding="utf-8"))
    other |= {"verdict": "pass", "exit_code": 0}
    with answering(http_answer(200, json.dumps(other).encode())) as (at, _):
        assert gate("good.yaml", "--mode", "analytic", "--remote", at) == 3


LOST = {
    "type": "/v1/problems/internal-error", "title": "Defect", "status": 500,
    "errors": [{"pointer": "/designs/0", "code": "internal-error", "detail": "lost", "hint": ""}],
}  # fmt: skip


@pytest.mark.parametrize(("state", "problem"), [("cancelled", None), ("failed", LOST)])
def test_a_job_that_does_not_succeed_is_no_verdict(folder: Path, state: str, problem: Any) -> None:
    job = {"schema": "tailstack/job/1", "id": "j1", "kind": "gate", "state": "queued", "problem": None}
    ended = json.dumps({**job, "state": state, "problem": problem}).encode()
    answers = ((202, json.dumps(job).encode()), (204, b""), (200, ended))
    with answering(*(http_answer(*answer) for answer in answers)) as (at, got):
        assert gate("good.yaml", "--remote", at, "--format=json=out.json") == 3
    assert [head.split(b" ")[1] for head in got] == [b"/v1/gates", b"/v1/jobs/j1/events", b"/v1/jobs/j1"]
    assert json.loads((folder / "out.json").read_text())["exit_code"] == 3

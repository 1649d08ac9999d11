"""What an operator sees: metrics that Prometheus reads, readiness, log lines for people and for machines."""

from __future__ import annotations

import ast
import io
import json
import logging
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families
from service_scenes import client_with, small_design

import tailstack_service
from tailstack_service.logs import JsonFormatter, TextFormatter, log_to_stderr
from tailstack_service.settings import Settings

CLIENT = {"settings": Settings(worker_processes=1), "worker": True}


def samples(client: httpx.Client) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    """Every sample of /metrics by name and labels."""
    response = client.get("/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(response.text)
        for sample in family.samples
    }


def test_requests_are_counted_by_route_and_never_by_path(client: httpx.Client) -> None:
    before = samples(client)
    for name in ("a", "b", "c"):
        client.get(f"/v1/jobs/{name}")
        client.get(f"/nowhere/{name}")
        client.request("BREW", f"/{name}")
        client.request(f"BREW-{name}", "/version")
    after = samples(client)

    def more(**labels: str) -> float:
        key = ("tailstack_http_requests_total", tuple(sorted(labels.items())))
        return after.get(key, 0.0) - before.get(key, 0.0)

    assert more(method="GET", route="/v1/jobs/{id}", status="404") == 3
    assert more(method="(none)", route="(none)", status="404") == 6
    assert more(method="(none)", route="(none)", status="405") == 3
    assert not any("nowhere" in str(key) or "BREW" in str(key) for key in after)
    assert after["tailstack_http_request_seconds_count", (("method", "GET"), ("route", "/v1/jobs/{id}"))] >= 3


@pytest.mark.long
def test_jobs_units_and_workers_are_read_from_the_database(client: httpx.Client) -> None:
    before = samples(client)
    body = {"design": small_design(), "trials": 1000}
    assert client.post("/v1/verifications", json=body, headers={"Prefer": "wait=60"}).status_code == 200
    after = samples(client)
    succeeded = ("tailstack_jobs", (("state", "succeeded"),))
    assert after[succeeded] - before[succeeded] == 1
    assert after["tailstack_units_recorded_total", ()] - before["tailstack_units_recorded_total", ()] >= 2
    assert after["tailstack_units_cpu_seconds_total", ()] > before["tailstack_units_cpu_seconds_total", ()]
    assert after["tailstack_workers_alive", ()] == 1
    assert after["tailstack_units_ready", ()] == after["tailstack_oldest_ready_unit_seconds", ()] == 0
    assert client.get("/health/ready").json() == {
        "status": "ready", "kernels": "ready", "database": "ready", "workers": 1,
    }  # fmt: skip


@pytest.mark.long
def test_what_waits_without_a_worker_shows() -> None:
    with client_with() as client:
        client.post("/v1/verifications", json={"design": small_design()})
        seen = samples(client)
        ready = client.get("/health/ready")
    assert (seen["tailstack_units_ready", ()], seen["tailstack_workers_alive", ()]) == (1, 0)
    assert (ready.status_code, ready.json()["workers"]) == (200, 0)


# --- logs -----------------------------------------------------------------------------------------


@pytest.fixture
def told(loggers: None) -> io.StringIO:
    """What the package's logger writes."""
    return io.StringIO()


def test_a_line_for_people(told: io.StringIO) -> None:
    log_to_stderr("text", stream=told)
    extra = {"action": "answered", "request": "r-1", "path": "/a b", "ms": 1.234, "nobody": "x", "job": None}
    logging.getLogger("tailstack.service").info("forged\nline", extra=extra)
    line = told.getvalue()
    assert line.endswith("Z INFO tailstack.service action=answered request=r-1 path='/a b' ms=1.2 forged\\nline\n")
    assert line[10] == "T"


def test_a_line_for_machines(told: io.StringIO) -> None:
    log_to_stderr("json", stream=told)
    try:
        raise ValueError("two\nlines")
    except ValueError:
        logging.getLogger("tailstack.service").exception("%s", "µ", extra={"action": "failed", "job": "j"})
    [line] = told.getvalue().splitlines()
    record: dict[str, Any] = json.loads(line)
    assert {"ts", "level", "logger", "message", "action", "job", "exception"} == set(record)
    assert (record["level"], record["message"], record["job"]) == ("error", "µ", "j")
    assert "ValueError: two\nlines" in record["exception"]


@pytest.mark.parametrize("formatter", [TextFormatter(), JsonFormatter()])
def test_numbers_and_odd_values_are_told(formatter: logging.Formatter) -> None:
    record = logging.LogRecord("tailstack", logging.INFO, __file__, 1, "", (), None)
    record.__dict__.update(status=200, path="\u202e\x1b[2J", ms=0.04, detail="")
    line = formatter.format(record)
    assert "\x1b" not in line
    assert "\n" not in line
    assert "200" in line


def test_libraries_are_quiet(told: io.StringIO) -> None:
    log_to_stderr("text", stream=told)
    logging.getLogger("sqlalchemy.engine").info("a statement with values")
    logging.getLogger("uvicorn.error").warning("something to know")
    assert "a statement" not in told.getvalue()
    assert "something to know" in told.getvalue()
    assert sys.stderr is not told


def test_what_a_stranger_sends_makes_no_long_line(client: httpx.Client, told: io.StringIO) -> None:
    log_to_stderr("json", stream=told)
    client.request("X" * 30_000, "/version")
    client.get("/" + "x" * 30_000)
    lines = [json.loads(line) for line in told.getvalue().splitlines()]
    answered = [line for line in lines if line.get("action") == "answered"]
    assert [line["status"] for line in answered] == [405, 404]
    assert max(len(line) for line in told.getvalue().splitlines()) < 1000


LOGGING = [f"log.{level}" for level in ("debug", "info", "warning", "error", "exception")]


def test_every_line_that_the_service_logs_is_a_sentence_with_an_action() -> None:
    """Read from the sources: most lines are about what a test can hardly bring about."""
    wrong = []
    for file in sorted(Path(tailstack_service.__file__).parent.rglob("*.py")):
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and ast.unparse(call.func) in LOGGING:
                sentence = ast.literal_eval(call.args[0]) if isinstance(call.args[0], ast.Constant) else "in a variable"
                words = [word for word in sentence.split() if word.isalpha()]
                if len(words) < 3 or "extra" not in {word.arg for word in call.keywords}:
                    wrong.append(f"{file.name}:{call.lineno}: {ast.unparse(call)}")
    assert not wrong

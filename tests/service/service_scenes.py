"""Designs and clients that the service's tests share."""

from __future__ import annotations

import copy
import json
import os
import random
import re
import shutil
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import pytest
from starlette.requests import Request

from tailstack_service.cli.main import main
from tailstack_service.http.server import running_service
from tailstack_service.operations.example import EXAMPLE_DESIGN
from tailstack_service.schemas import json_schema
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


def convert_by_libreoffice(path: Path, form: str, folder: Path | None = None) -> None:
    """A file as LibreOffice reads it, written in another format, into a folder or beside it."""
    if shutil.which("soffice") is None:
        pytest.skip("LibreOffice is not installed")
    own = f"-env:UserInstallation={(path.parent / 'profile').as_uri()}"
    command = ["soffice", own, "--headless", "--convert-to", form, "--outdir", str(folder or path.parent), str(path)]
    subprocess.run(command, check=True, capture_output=True, timeout=LIMIT_SECONDS)


def small_design(**changes: Any) -> dict[str, Any]:
    """The design of the OpenAPI examples, with top-level fields changed; None removes one."""
    design = {**copy.deepcopy(EXAMPLE_DESIGN), **changes}
    return {key: value for key, value in design.items() if value is not None}


def sound_design(**changes: Any) -> dict[str, Any]:
    """The small design with one fiducial moved, so that no two images overlap and nothing is remarked: an estimate
    decides its limits."""
    design = small_design(**changes)
    position = design["fiducials"]["points"][5]["position_mm"]
    position[0] += 6.0
    position[2] += 6.0
    return design


def limited(limit_mm: float, **changes: Any) -> dict[str, Any]:
    """The sound design with another limit at the tip."""
    return sound_design(requirements=[{"name": "tip-accuracy", "limit_mm": limit_mm}], **changes)


def coplanar_design() -> dict[str, Any]:
    """Eight fiducials in one plane: well formed, and it does not determine the projection."""
    design = small_design()
    for point in design["fiducials"]["points"]:
        point["position_mm"][2] = -40.0
    return design


def large_design(targets: list[dict[str, Any]]) -> dict[str, Any]:
    """As many fiducials as are admitted, 200, with these targets and one limit."""
    design, draw = small_design(optimise=None, requirements=[{"name": "all", "limit_mm": 1.5}]), random.Random(1)
    design["fiducials"]["points"] = [
        {"position_mm": [draw.uniform(-40, 40), draw.uniform(-40, 40), draw.uniform(-80, 5)]} for _ in range(200)
    ]
    design["targets"] = targets
    return design


def write_json(path: Path, data: Any) -> Path:
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def client_of(url: str, timeout: float = LIMIT_SECONDS, **options: Any) -> httpx.Client:
    """Speaks plain HTTP with a service at the address: it reads no proxies, and no certificates, which takes 20 ms."""
    return httpx.Client(base_url=url, timeout=timeout, trust_env=False, verify=False, **options)


def ask(method: str, url: str, **options: Any) -> httpx.Response:
    """The answer to one request by such a client."""
    with client_of("") as client:
        return client.request(method, url, **options)


@contextmanager
def client_with(settings: Settings | None = None, *, worker: bool = False) -> Iterator[httpx.Client]:
    """A client of a service that runs in this process, over a real connection; jobs end only with a worker."""
    with (
        running_service(settings or Settings(worker_processes=1), warm_up=False, worker=worker) as (host, port),
        client_of(f"http://{host}:{port}") as client,
    ):
        yield client


class Caller:
    """Stands for the request of a client that stays, or leaves."""

    def __init__(self, tenant: str = "a", gone: bool = False) -> None:
        self.gone = gone
        self.state = SimpleNamespace(caller=SimpleNamespace(tenant=tenant))

    async def is_disconnected(self) -> bool:
        return self.gone

    def request(self) -> Request:
        return cast(Request, self)


def http_answer(status: int, body: bytes) -> bytes:
    return f"HTTP/1.1 {status} X\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n".encode() + body


@contextmanager
def answering(*answers: bytes | None) -> Iterator[tuple[str, list[bytes]]]:
    """A server that reads one request after the other and says these bytes; None: it hangs up.  Gives its address, and
    what it was told: heads, with what came along of the bodies."""
    got: list[bytes] = []

    def answer_all() -> None:
        for answer in answers:
            connection, _ = listener.accept()
            with connection:
                first, rest = read_answer(connection)
                got.append(first + b"\r\n" + rest)
                if answer is not None:
                    connection.sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(LIMIT_SECONDS)
        thread = threading.Thread(target=answer_all, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}", got
        thread.join(LIMIT_SECONDS)


def read_answer(connection: socket.socket) -> tuple[bytes, bytes]:
    """(first line, headers and body) of one message, read as far as its Content-Length says or to the end; a request
    without one has no body."""
    received = b""
    while True:
        head, found, body = received.partition(b"\r\n\r\n")
        length = re.search(rb"content-length: (\d+)", head, re.IGNORECASE)
        if found and ((length and len(body) >= int(length.group(1))) or (not length and not head.startswith(b"HTTP/"))):
            break
        more = connection.recv(65536)
        if not more:
            break
        received += more
    status, _, rest = received.partition(b"\r\n")
    return status, rest


def commands(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """What runs a command: exit code, stdout, stderr."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert os.environ.get("TAILSTACK_TRACEBACK") or "Traceback" not in captured.err
        return code, captured.out, captured.err

    return run


def luminance(colour: str) -> float:
    """published: relative luminance of sRGB, WCAG 2.2."""
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def check_problem(response: Any, status: int, slug: str) -> dict[str, Any]:
    """Assert that a response is a complete problem document; return it."""
    from jsonschema import Draft202012Validator

    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    document: dict[str, Any] = response.json()
    Draft202012Validator(json_schema("problem")).validate(document)
    assert document["type"] == f"/v1/problems/{slug}", document
    assert document["status"] == status
    assert document["request_id"] == response.headers["x-request-id"]
    assert document["errors"]
    return document

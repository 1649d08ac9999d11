"""The whole main job on a real C-arm design, over HTTP on an embedded service; writes what came out."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

from .answer import Answer, exit_code_of

HELP = "the whole main job on a real design, over HTTP"

NAME = "demo.yaml"
PRECISION = 0.005
REQUEST_SECONDS = 300.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", metavar="DIR", default="out/demo", help="directory for what comes out (default %(default)s)"
    )


def demo_text() -> str:
    """The demo design: beside this module in an installed wheel, in ``examples/`` in a checkout."""
    shipped = files("tailstack_service.cli").joinpath(NAME)
    if shipped.is_file():
        return shipped.read_text(encoding="utf-8")
    return (Path(__file__).resolve().parents[3] / "examples" / NAME).read_text(encoding="utf-8")


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design import design_to_data, load_design
    from tailstack.design.loading import data_to_yaml

    from ..documents import read_record
    from ..http.server import running_service
    from ..rendering.demo import before_after_text, chapter
    from ..rendering.optimisation import optimisation_text
    from ..rendering.score import score_text
    from ..rendering.verification import verification_text
    from .design_input import coloured_output

    colour = coloured_output()
    output = Path(arguments.output)
    output.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()

    def tell(text: str) -> None:
        print(f"[{time.monotonic() - begun:5.1f} s] {text}", file=sys.stderr, flush=True)

    def show(title: str, text: str) -> None:
        sys.stdout.write(chapter(title, colour) + text)
        sys.stdout.flush()

    def keep(name: str, content: bytes) -> None:
        (output / name).write_bytes(content)

    text = demo_text()
    design = design_to_data(load_design(text))
    tell("starting the service on a free loopback port")
    with running_service(demo_settings()) as (host, port):
        url = f"http://{host}:{port}"
        wait_until_ready(url, tell)
        tell(f"service ready at {url}; POST /v1/scores")
        body = post(url + "/v1/scores", {"design": design})
        score = read_record("score", body)
        keep("score.json", body)
        show("Score: first order", score_text(score, colour=colour))

        tell(f"POST /v1/verifications, to {100 * PRECISION:g} %")
        body = post(url + "/v1/verifications", {"design": design, "precision": PRECISION, "seed": 1})
        before = read_record("verification", body)
        keep("verification.json", body)
        show("Check: Monte Carlo on the full chain", verification_text(before, colour=colour))

        tell("POST /v1/optimisations, a few seconds per start")
        body = post(url + "/v1/optimisations", {"design": design})
        optimised = read_record("optimisation", body)
        keep("optimisation.json", body)
        keep("optimised.yaml", data_to_yaml(optimised.design).encode())
        show("Optimised: layout and rotational tolerances", optimisation_text(optimised, colour=colour))

        tell("POST /v1/scores and /v1/verifications of the optimised design")
        score_after = read_record("score", post(url + "/v1/scores", {"design": optimised.design}))
        again = {"design": optimised.design, "precision": PRECISION, "seed": 2}
        after = read_record("verification", post(url + "/v1/verifications", again))
        show("Before -> after", before_after_text(score, before, score_after, after, optimised))
        tell("stopping the service")
    names = ", ".join(sorted(path.name for path in output.iterdir()))
    closing = f"\nwritten to {output}/: {names}\nnext: tailstack score {output}/optimised.yaml\n"
    return Answer(closing, exit_code_of(after.verdict))


def demo_settings() -> Any:
    """Settings of the embedded service: the defaults, with the time a slow machine needs."""
    from dataclasses import replace

    from ..settings import Settings

    return replace(Settings(), max_seconds=REQUEST_SECONDS)


def wait_until_ready(url: str, tell: Callable[[str], None], seconds: float = REQUEST_SECONDS) -> None:
    """Poll readiness; the first run on a machine compiles the kernels.  Raises RequestError."""
    import urllib.error
    import urllib.request

    from tailstack.errors import Problem

    from ..problems import RequestError

    begun = said = time.monotonic()
    status = ""
    while time.monotonic() - begun < seconds:
        try:
            with urllib.request.urlopen(url + "/health/ready", timeout=10) as answer:
                if answer.status == 200:
                    return
        except urllib.error.HTTPError as error:
            status = json.loads(error.read()).get("status", "")
        if status == "failed":
            break
        if time.monotonic() - said > 3:
            said = time.monotonic()
            tell("compiling the kernels (the first run on a machine; later runs read them from a cache)")
        time.sleep(0.05)
    raise RequestError(Problem("", "not-ready", f"the service did not become ready: {status}", "tailstack doctor"))


def post(url: str, request: dict[str, Any]) -> bytes:
    """The body of a 200 answer.  Raises TransportError with the first problem of any other."""
    import urllib.error
    import urllib.request

    from tailstack.errors import Problem

    from ..problems import TransportError

    content = json.dumps(request).encode()
    headers = {"Content-Type": "application/json"}
    try:
        call = urllib.request.Request(url, content, headers)
        with urllib.request.urlopen(call, timeout=REQUEST_SECONDS + 30) as answer:
            return bytes(answer.read())
    except urllib.error.HTTPError as error:
        document = json.loads(error.read())
        first = document["errors"][0]
        problem = Problem(first["pointer"], first["code"], first["detail"], first["hint"])
        raise TransportError(document["type"].rpartition("/")[2], problem) from None

"""The whole main job on a real C-arm design, over HTTP on an embedded service; writes what came out."""

from __future__ import annotations

import argparse
import hashlib
import logging
from collections.abc import Callable, Iterator
from functools import partial
from itertools import groupby
from math import dist
from shlex import quote
from typing import TYPE_CHECKING

from tailstack.extras import require_extras
from tailstack.results.digits import decimal, decimals_of, number, percent_change

from ..clock import SYSTEM_CLOCK, Clock
from ..console.command_line import Answer, add_details, exit_code_of, program
from ..console.files import writable_directory
from ..console.progress import Progress
from ..logs import log_to_stderr
from ..operations.editors import write_document
from ..rendering.text import visible, wrap
from ..shipped import example_folder

if TYPE_CHECKING:
    from tailstack.results import Optimisation, Verification

    from ..console.remote import RemoteService

HELP = "the whole main job on a real design, over HTTP"

NAME = "demo.yaml"
PRECISION = 0.005
READY_SECONDS = 600.0  # a slow machine compiles for a while
FIRST_WORD_SECONDS, WORD_SECONDS = 3.0, 20.0
FIRST_TIME = "about two minutes the first time on a machine, several on a busy one; later runs read them from a cache"
REPORT_SECONDS = 60.0
LOOK_SECONDS = 0.05  # between looks whether the service is ready


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_details(parser)
    parser.add_argument(
        "-o", "--output", metavar="DIR", default="out/demo", help="directory for what comes out (default %(default)s)"
    )


def demo_text() -> str:
    return (example_folder() / NAME).read_text(encoding="utf-8")


def run(arguments: argparse.Namespace) -> Answer:
    require_extras("optimise", "serve", "report")

    from tailstack.design import design_to_data, load_design
    from tailstack.design.write import data_to_yaml

    from ..console.remote import RemoteService, compute_remotely
    from ..http.server import running_service
    from ..schemas import read_record
    from ..settings import default_settings

    log_to_stderr(level=logging.WARNING)
    output = writable_directory(arguments.output, "-o")

    progress = Progress("demo")

    def announce(text: str) -> None:
        progress.begin_step()
        progress.report(0, 0, text)

    def follow(done: float, total: float) -> None:
        progress.report(done, total, progress.detail)

    def save(name: str, content: bytes) -> None:
        (output / name).write_bytes(content)

    design = design_to_data(load_design(demo_text()))
    announce("starting the service on a free loopback port, a worker beside it")
    with progress, running_service(default_settings(), worker=True, worker_log=output / "worker.log") as (host, port):
        service = RemoteService(f"http://{host}:{port}", key="")
        compute = partial(compute_remotely, service, report=follow)
        wait_until_ready(service, announce)
        announce(f"first estimate: POST {service.url}/v1/scores")
        body = service.ask("POST", "/v1/scores", {"design": design}).content
        save("score.json", body)

        announce(f"checking the design by simulation: POST /v1/verifications, to {100 * PRECISION:g} %")
        body = compute("/v1/verifications", {"design": design, "precision": PRECISION, "seed": 1})
        before = read_record("verification", body)
        save("verification.json", body)

        announce("looking for a better one: POST /v1/optimisations, a second or two per start")
        body = compute("/v1/optimisations", {"design": design})
        result = f"/v1/results/{hashlib.sha256(body).hexdigest()}"
        optimised = read_record("optimisation", body)
        save("optimisation.json", body)
        write_document(output / "optimised.yaml", data_to_yaml(optimised.design), tell=False)

        announce("checking the better one: POST /v1/verifications")
        body = compute("/v1/verifications", {"design": optimised.design, "precision": PRECISION, "seed": 2})
        after = read_record("verification", body)

        announce(f"writing the report: GET {result}/report?format=html")
        save("report.html", service.ask("GET", f"{result}/report?format=html", seconds=REPORT_SECONDS).content)
        announce("stopping the service")
    closing = summary_text(before, after, optimised)
    closing += f"report: {(output / 'report.html').resolve()}\n"
    closing += f"next:   {program()} score {quote(str(output / 'optimised.yaml'))}\n"
    return Answer(closing, exit_code_of(after.verdict))


def wait_until_ready(
    service: RemoteService, announce: Callable[[str], None], seconds: float = READY_SECONDS, *,
    clock: Clock = SYSTEM_CLOCK,
) -> None:  # fmt: skip
    """Poll readiness; the first run on a machine compiles the kernels.  Raises RemoteError."""
    from ..console.remote import RemoteError

    begun = clock.monotonic()
    next_word = begun + FIRST_WORD_SECONDS
    while True:
        try:
            service.ask("GET", "/health/ready")
            return
        except RemoteError as error:
            if clock.monotonic() - begun > seconds or error.status != 503:
                raise
        if clock.monotonic() > next_word:
            first = next_word == begun + FIRST_WORD_SECONDS
            next_word = clock.monotonic() + WORD_SECONDS
            announce(f"compiling the kernels: {FIRST_TIME}" if first else "still compiling")
        clock.sleep(LOOK_SECONDS)


# --- its own text: before and after -----------------------------------------------------------------------


def summary_text(before: Verification, after: Verification, result: Optimisation) -> str:
    """The lines that matter: the verdict before and after, what was changed, what that costs."""
    lines = [visible(before.provenance.design_name)]
    for words, side in (("before:", before), ("after:", after)):
        for check in side.verdict.checks:
            decimals = decimals_of((check,))
            low, high = (decimal(end, decimals) for end in check.interval)
            value = decimal(check.value, decimals)
            lines.append(
                f"{words:<8}{side.verdict.status}: {check.headline} at {visible(check.target)} {value} {check.unit} "
                f"({low} to {high}), limit {check.limit:g} {check.unit}"
            )
    return "\n".join([*lines, *_change_lines(result)]) + "\n"


def _change_lines(result: Optimisation) -> Iterator[str]:
    """What the optimiser changed: how many fiducials and how far, each interface's half-widths, the cost."""
    pairs = ((each.before_mm, each.after_mm) for each in result.moved)
    distances = [distance for old, new in pairs if old and new and (distance := dist(old, new))]
    if distances:
        line = f"changed: {len(distances)} fiducials moved, by {min(distances):.0f} to {max(distances):.0f} mm"
        if result.cost_before and result.moves is not None and result.moves.objective_left is not None:
            line += f"; cost of that: {percent_change(result.moves.objective_left, result.moves.objective_moved)}"
        yield line
    for _, group in groupby(result.tolerances, lambda tolerance: tolerance.contributor):
        tolerances = tuple(group)
        name = tolerances[0].label.removesuffix(f" {tolerances[0].component}")
        yield wrap(f"half-widths of {visible(name)}:", first="  ", indent="    ")
        changes: dict[str, list[str]] = {}
        for tolerance in tolerances:
            unit = "°" if tolerance.unit == "deg" else f" {tolerance.unit}"
            change = f"±{tolerance.before_half_width:.2g} -> ±{tolerance.after_half_width:.2g}{unit}"
            changes.setdefault(change, []).append(tolerance.component)
        words = ", ".join(f"{' '.join(components)} {change}" for change, components in changes.items())
        yield wrap(words, first="    ", indent="    ")
    if result.cost_before and result.cost_after is not None:
        costs = f"{number(result.cost_before)} -> {number(result.cost_after)}"
        yield f"  cost of these tolerances: {costs} ({100 * (result.cost_after / result.cost_before - 1):+.0f} %)"

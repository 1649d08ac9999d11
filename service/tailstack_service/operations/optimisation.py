"""Move fiducials and set tolerances at least cost under the design's limits, verified by Monte Carlo."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from shlex import quote
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from tailstack.errors import NotConvergedError
from tailstack.results import Optimisation

from ..console.command_line import INTERRUPTED, Answer, add_design, exit_code_of, program, read_design
from ..console.files import add_force
from ..console.flags import Flag, add_flags
from ..console.progress import Progress
from ..documents import to_json
from .operation import (
    Again,
    Call,
    Command,
    Csv,
    Demand,
    HeldDesign,
    LateImport,
    Operation,
    Options,
    Repetition,
    Seed,
    Starts,
    run_function,
    within,
)

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..settings import Settings
    from .request import Request
    from .revision import OutputFiles

# The stages in their order, and what their steps are called
STAGES = {
    "view": "aim of the views", "programme": "programme", "start": "start", "polish": "polishing",
    "settle": "exact law", "check": "check", "front": "point of the front", "move": "layout with fewer moves",
}  # fmt: skip
STOPPING = "stopping: checking the best design found so far; press Ctrl-C again to leave without it"


class OptimisationOptions(Options):
    """Where the search begins."""

    seed: Annotated[Seed | None, Flag("seed (default: the design's)")] = None
    """Seed of the starts; absent: optimise/seed of the design."""
    starts: Annotated[Starts | None, Flag("starting layouts (default: the design's)")] = None
    """Number of starts; absent: optimise/starts of the design."""
    gap: Annotated[Annotated[float, Field(gt=0, lt=1)] | None, Flag(metavar="GAP")] = Field(None, examples=[0.01])
    """No more starts once the best is that near, relative, to what no layout undercuts; absent: all."""


def _arguments(call: Call) -> dict[str, Any]:
    return call.arguments() | {"progress": None if call.progress is None else _share(call.progress)}


def _share(progress: Callable[[float, float], None]) -> Callable[[str, int, int, float | None], None]:
    """What the optimiser calls after each step, as stages done of all stages."""
    stages = list(STAGES)
    return lambda stage, done, total, least: progress(stages.index(stage) + done / max(total, 1), len(stages))


def _check(request: Request, settings: Settings) -> None:
    """An ``optimise`` section without contradictions that can change anything.  Raises RefusedAt, LimitError."""
    within(request.options.starts, "max_starts", settings, "/starts")
    check_freedom(request, settings, starts_of_design=request.options.starts is None)


def check_freedom(request: Request, settings: Settings, *, starts_of_design: bool) -> None:
    """A design that the optimiser can change.  Raises RefusedAt."""
    from tailstack.design import check_design
    from tailstack.optimisation import influence

    section = request.design.document.optimise
    if starts_of_design and section is not None:
        request.refuse_by(lambda _: within(section.starts, "max_starts", settings, "/optimise/starts"))
    request.refuse_by(check_design)
    request.refuse_by(influence)


def _hold(record: Optimisation) -> tuple[HeldDesign, ...]:
    return (
        HeldDesign("new design", record.design, record.provenance.design_sha256),
        HeldDesign("design before", record.design_before, None),
    )


def _repeat(again: Repetition) -> Again:
    record: Optimisation = again.record
    proof, (new, before) = record.certificate, again.designs
    if not again.fast:
        return Again(OPERATION.run(Call((before,), OptimisationOptions.of_record(proof))))
    from tailstack.verification import prepare

    first = prepare(new, sampled=False).first_order_mm
    check = proof.verification
    targets = tuple(replace(target, first_order_p95_mm=first[target.name]) for target in check.targets)
    same = replace(check.provenance, design_sha256=new.sha256)
    made = replace(record, provenance=replace(record.provenance, design_sha256=new.sha256))
    made = replace(made, certificate=replace(proof, verification=replace(check, targets=targets, provenance=same)))
    return Again(made, "the optimiser and its check")


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("--csv", action="store_true", help="print one line of CSV for each tolerance that was free")
    parser.add_argument("-o", "--output", metavar="NEW", help="write the new design here (.yaml or .json)")
    words = "with -o: write the new fiducials beside it (.mrk.json, .csv or .fcsv), to which the new design refers"
    parser.add_argument("--fiducials-out", metavar="FILE", help=words)
    add_force(parser)
    add_flags(parser, OptimisationOptions)


def _run(arguments: argparse.Namespace) -> Answer:
    from .revision import patch_text, read_output_files, write_results

    files = read_output_files(arguments)
    design = read_design(arguments.design)
    outcome = _search(design, arguments, files)
    if outcome is None:
        return Answer("", INTERRUPTED)
    result, stopped = outcome
    write_results(design, result, files)
    code = INTERRUPTED if stopped else exit_code_of(result.certificate.verification.verdict)
    changes = "" if files.design is not None else patch_text(design, result)
    if files.design is not None or not changes:
        following = f"next: {program()} verify {quote(str(files.design or arguments.design))}"
    else:
        following = f"next: {program()} optimise {quote(str(arguments.design))} -o NEW.yaml   (writes the new design)"
    if arguments.json:
        print(following, file=sys.stderr)
        return Answer(to_json(result), code)
    if arguments.csv and OPERATION.csv is not None:
        print(following, file=sys.stderr)
        return Answer(OPERATION.csv.write(result), code)
    patch = ""
    if files.design is None:
        name = design.source.file or "the design"
        if changes:
            patch = f"\nwhat to change in {name} (a merge patch, RFC 7396):\n{changes}\n"
        else:
            patch = f"\nnothing to change in {name}: it is what the search came to.\n"
    return Answer(f"{OPERATION.write(result)}{patch}{following}\n", code)


def _search(design: Design, arguments: argparse.Namespace, files: OutputFiles) -> tuple[Optimisation, bool] | None:
    """The result, and whether the search was stopped; None if it was stopped before it had found anything."""
    from tailstack import optimise
    from tailstack.optimisation import influence

    from ..console.refusals import report_error
    from ..rendering.document import findings_text
    from .revision import refuse_unasked_points

    options = OptimisationOptions.of_flags(arguments)

    if known := findings_text(influence(design)):
        print(known, file=sys.stderr, flush=True)
    wanted = design.document.optimise
    assert wanted is not None  # or influence had refused the design
    refuse_unasked_points(files, moves_fiducials=bool(wanted.box or wanted.region or wanted.regions))
    with Progress("optimise") as progress, stopped_by_signals() as stop:
        try:
            told = reporter(progress, wanted.goal)
            result = optimise(design, **options.model_dump(), progress=told, stop=stop.ask)
            stop.ask()  # a second signal may have come since the last poll
        except NotConvergedError as error:
            if error.problems[0].code != "stopped":
                raise
            report_error(error, arguments)
            return None
    return result, stop.ask()


# --- progress and stopping ------------------------------------------------------------------------


def reporter(progress: Progress, objective: str) -> Callable[[str, int, int, float | None], None]:
    """What the optimiser calls after each step: how far its stage is, and the incumbent."""
    what = "quantile over limit" if objective == "quantile" else "cost"
    best, last = float("inf"), ""

    def report(stage: str, done: int, total: int, least: float | None) -> None:
        nonlocal best, last
        if stage != last:
            progress.begin_step()
            last = stage
        if stage in ("view", "move"):  # it may end sooner
            progress.report(done, total + 1, f"{STAGES[stage]} {done}, at most {total}")
            return
        known = ""
        if least is not None and stage in ("check", "front"):  # of the design that was checked
            known = f", {what} {least:.5g}"
        elif least is not None and stage == "start":
            best = min(best, least)
            known = f", least {what} so far {best:.5g}"
        progress.report(done, total, f"{STAGES[stage]} {done} of {total}{known}")

    return report


@dataclass(slots=True)
class Signals:
    """How many SIGINT and SIGTERM have come."""

    count: int = 0

    def ask(self) -> bool:
        """Whether to stop.  Raises KeyboardInterrupt after a second signal: one that comes while a solver is inside
        its own code is swallowed there, so it is raised again at every poll."""
        if self.count > 1:
            raise KeyboardInterrupt
        return self.count == 1


@contextmanager
def stopped_by_signals() -> Iterator[Signals]:
    """The first SIGINT or SIGTERM is a wish to stop, the next one raises KeyboardInterrupt."""
    stop = Signals()

    def handle(_number: int, _frame: FrameType | None) -> None:
        stop.count += 1
        if stop.count > 1:
            raise KeyboardInterrupt
        print(("\n" if sys.stderr.isatty() else "") + STOPPING, file=sys.stderr, flush=True)

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


OPERATION = Operation(
    name="optimisation",
    verb="optimise",
    path="/v1/optimisations",
    summary="Placement and tolerances at least cost",
    description="Places fiducials and sets tolerances as the design's section optimise asks, and answers with a new "
    "design that passed a Monte Carlo check.",
    title="answer of optimise: the new design and its certificate",
    options=OptimisationOptions,
    example={"starts": 2, "seed": 1},
    record=lambda: Optimisation,
    run=run_function(LateImport("tailstack", "optimise"), "threads", arguments=_arguments),
    cut=True,
    check=_check,
    document=LateImport("..report.chapters.optimisation", "optimisation_document"),
    exit_code=lambda record: exit_code_of(record.certificate.verification.verdict),
    hold=_hold,
    demand=lambda record: Demand(starts=record.certificate.starts, starts_at="/certificate/starts", checks=0),
    repeat=_repeat,
    csv=Csv("tolerance that was free", LateImport("..report.chapters.optimisation", "changes_csv")),
    command=Command(_add_arguments, _run),
)

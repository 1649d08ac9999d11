"""Move fiducials and set tolerances at least cost under the design's limits, verified by Monte Carlo."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from tailstack.results import Optimisation

from ..console.answer import INTERRUPTED, Answer, exit_code_of
from ..console.arguments import add_design, coloured_output, read_design, whole
from ..console.editors import write_document
from ..console.files import replace_file, writable
from ..console.program import program
from ..console.progress import Progress
from .operation import Again, Call, Command, Demand, HeldDesign, Operation, Repetition
from .options import Options, Seed, within

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..settings import Settings
    from .sent import Request

DOCUMENTS, PICTURES = (".yaml", ".yml", ".json"), (".svg",)
# In their order, with rough shares of the time.
STAGES = {"start": 6.0, "count": 6.0, "grades": 2.0, "check": 1.0, "front": 6.0}
STOPPING = "stopping: checking the best design found so far; press Ctrl-C again to leave without it"


class OptimisationOptions(Options):
    """Where the search begins."""

    seed: Seed | None = Field(None, description="Seed of the starts; absent: optimise/seed of the design.")
    starts: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Number of starts; absent: optimise/starts of the design."
    )


def _optimise(call: Call) -> Optimisation:
    from tailstack.optimisation import optimise

    return optimise(call.design, seed=call.options.seed, starts=call.options.starts)


def _check(request: Request, settings: Settings) -> None:
    """An ``optimise`` section without contradictions that can change anything.  Raises Placed, LimitError."""
    within(request.options.starts, "max_starts", settings, "/starts")
    check_freedom(request, settings, starts_of_design=request.options.starts is None)


def check_freedom(request: Request, settings: Settings, *, starts_of_design: bool) -> None:
    """A design that the optimiser can change.  Raises Placed."""
    from tailstack.design import check_design
    from tailstack.optimisation import influence

    section = request.design.document.optimise
    if starts_of_design and section is not None:
        request.refuse_by(lambda _: within(section.starts, "max_starts", settings, "/optimise/starts"))
    request.refuse_by(check_design)
    request.refuse_by(influence)


def _text(record: Optimisation, colour: bool) -> str:
    from ..rendering.optimisation import optimisation_text

    return optimisation_text(record, colour=colour)


def _document(record: Optimisation, sha256: str) -> Any:
    from ..report.chapters.optimisation import optimisation_document

    return optimisation_document(record, sha256)


def _hold(record: Optimisation) -> tuple[HeldDesign, ...]:
    return (
        HeldDesign("new design", record.design, record.provenance.design_sha256),
        HeldDesign("design before", record.design_before, None),
    )


def _repeat(again: Repetition) -> Again:
    record: Optimisation = again.record
    proof, (new, before) = record.certificate, again.designs
    if not again.fast:
        return Again(_optimise(Call((before,), OptimisationOptions(seed=proof.seed, starts=proof.starts))))
    from tailstack.scoring import score

    first = {target.name: target.p95_mm for target in score(new).targets}
    check = proof.verification
    targets = tuple(replace(target, first_order_p95_mm=first[target.name]) for target in check.targets)
    same = replace(check.provenance, design_sha256=new.sha256)
    made = replace(record, provenance=replace(record.provenance, design_sha256=new.sha256))
    made = replace(made, certificate=replace(proof, verification=replace(check, targets=targets, provenance=same)))
    return Again(made, "the optimiser and its check")


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("-o", "--output", metavar="NEW", help="write the new design here (.yaml or .json)")
    parser.add_argument("--picture", metavar="FILE", help="draw the layout before and after (.svg)")
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), metavar="N", help="seed (default: the design's)")
    parser.add_argument("--starts", type=whole(1, 256), metavar="N", help="starting layouts (default: the design's)")


def _run(arguments: argparse.Namespace) -> Answer:
    output = None if arguments.output is None else writable(arguments.output, DOCUMENTS)
    picture = None if arguments.picture is None else writable(arguments.picture, PICTURES)
    design = read_design(arguments.design)

    from tailstack import optimise
    from tailstack.errors import NotConvergedError
    from tailstack.optimisation import influence

    from ..console.refusals import report_error
    from ..documents import to_json
    from ..rendering.optimisation import optimisation_text
    from ..rendering.verdict import findings_text

    if known := findings_text(influence(design), False):
        print(known, file=sys.stderr, flush=True)
    wanted = design.document.optimise
    assert wanted is not None  # or influence had refused the design
    with Progress("optimise") as progress, stopped_by_signals() as stop:
        try:
            result = optimise(
                design,
                seed=arguments.seed,
                starts=arguments.starts,
                progress=reporter(progress, wanted.goal),
                stop=stop.ask,
            )
            stop.ask()  # a second signal may have come since the last poll
        except NotConvergedError as error:
            if error.problems[0].code != "stopped":
                raise
            report_error(error, arguments)
            return Answer("", INTERRUPTED)
    write_results(design, result, output, picture)
    code = INTERRUPTED if stop.ask() else exit_code_of(result.certificate.verification.verdict)
    if output is None:
        following = f"next: {program()} optimise {arguments.design} -o NEW.yaml   (keeps the new design)"
    else:
        following = f"next: {program()} verify {output}"
    if arguments.json:
        print(following, file=sys.stderr)
        return Answer(to_json(result), code)
    return Answer(f"{optimisation_text(result, colour=coloured_output())}{following}\n", code)


# --- progress and stopping ------------------------------------------------------------------------


def reporter(progress: Progress, objective: str) -> Callable[[str, int, int, float | None], None]:
    """What the optimiser calls after each step: fraction of the whole, step, incumbent."""
    expected = {"start", "check"} | ({"front"} if objective == "pareto" else set())
    what = "quantile over limit" if objective == "quantile" else "cost"
    furthest, best = 0.0, float("inf")

    def report(stage: str, done: int, total: int, least: float | None) -> None:
        nonlocal furthest, best
        expected.add(stage)
        shares = [STAGES[name] for name in STAGES if name in expected]
        reached = [name for name in STAGES if name in expected].index(stage)  # what comes before it is over
        furthest = max(furthest, (sum(shares[:reached]) + shares[reached] * done / total) / sum(shares))
        known = ""
        if least is not None and stage in ("check", "front"):  # of the design that was checked
            known = f", {what} {least:.5g}"
        elif least is not None:
            best = min(best, least)
            known = f", least {what} so far {best:.5g}"
        progress.report(furthest, 1.0, f"{stage} {done} of {total}{known}")

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


# --- files ----------------------------------------------------------------------------------------


def write_results(design: Design, result: Optimisation, output: Path | None, picture: Path | None) -> None:
    """The new design and the picture, each whole or not at all; says on stderr what was written."""
    drawn = None if picture is None else picture_text(design, result)
    if output is not None:
        write_document(output, design_text(result.design, output))
        print(f"wrote {output}", file=sys.stderr)
    if picture is not None and drawn is not None:
        replace_file(picture, drawn)
        print(f"wrote {picture}", file=sys.stderr)


def design_text(data: dict[str, object], path: Path) -> str:
    """A design as its file's ending asks for."""
    from tailstack.design.write import data_to_yaml, to_json

    if path.suffix.lower() == ".json":
        return to_json(data)
    return data_to_yaml(data)


def picture_text(design: Design, result: Optimisation) -> str:
    """The layout before and after, as SVG."""
    from tailstack.design import load_design

    from ..report.scene_picture import draw_layouts

    title = f"{design.name}: layout before and after optimisation"
    return draw_layouts(load_design(result.design), design, title)


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
    run=_optimise,
    cut=True,
    check=_check,
    text=_text,
    document=_document,
    exit_code=lambda record: exit_code_of(record.certificate.verification.verdict),
    hold=_hold,
    demand=lambda record: Demand(starts=record.certificate.starts, starts_at="/certificate/starts", checks=0),
    repeat=_repeat,
    command=Command(_add_arguments, _run),
)

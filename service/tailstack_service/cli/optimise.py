"""Move fiducials and set tolerances at least cost under the design's limits, verified by Monte Carlo."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from ..console.answer import INTERRUPTED, Answer, exit_code_of
from ..console.arguments import add_design, coloured_output, read_design, whole
from ..console.files import replace_file, writable
from ..console.program import program
from ..console.progress import Progress

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.results import Optimisation

HELP = "placement and tolerances at least cost"

DOCUMENTS, PICTURES = (".yaml", ".yml", ".json"), (".svg",)
# In their order, with rough shares of the time.
STAGES = {"start": 6.0, "count": 6.0, "grades": 2.0, "check": 1.0, "front": 6.0}
STOPPING = "stopping: checking the best design found so far; press Ctrl-C again to leave without it"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("-o", "--output", metavar="NEW", help="write the new design here (.yaml or .json)")
    parser.add_argument("--picture", metavar="FILE", help="draw the layout before and after (.svg)")
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), metavar="N", help="seed (default: the design's)")
    parser.add_argument("--starts", type=whole(1, 256), metavar="N", help="starting layouts (default: the design's)")


def run(arguments: argparse.Namespace) -> Answer:
    output = None if arguments.output is None else writable(arguments.output, DOCUMENTS)
    picture = None if arguments.picture is None else writable(arguments.picture, PICTURES)
    design = read_design(arguments.design)

    from tailstack import optimise
    from tailstack.errors import NotConvergedError
    from tailstack.optimisation import influence

    from ..documents import to_json
    from ..rendering.optimisation import optimisation_text
    from ..rendering.verdict import findings_text
    from .refusals import report_error

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
                progress=reporter(progress, wanted.wanted),
                stop=stop.wanted,
            )
            stop.wanted()  # a second signal may have come since the last poll
        except NotConvergedError as error:
            if error.problems[0].code != "stopped":
                raise
            report_error(error, arguments)
            return Answer("", INTERRUPTED)
    write_results(design, result, output, picture)
    code = INTERRUPTED if stop.wanted() else exit_code_of(result.certificate.verification.verdict)
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

    def wanted(self) -> bool:
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
    texts: dict[Path, str] = {}
    if output is not None:
        texts[output] = design_text(result.design, output)
    if picture is not None:
        texts[picture] = picture_text(design, result)
    for path, text in texts.items():
        replace_file(path, text)
        print(f"wrote {path}", file=sys.stderr)


def design_text(data: dict[str, object], path: Path) -> str:
    """A design as its file's ending asks for."""
    from tailstack.design.write import data_to_yaml, to_json

    if path.suffix.lower() == ".json":
        return to_json(data)
    return data_to_yaml(data)


def picture_text(design: Design, result: Optimisation) -> str:
    """The layout before and after, as SVG."""
    from tailstack.design import compile_design, load_design

    from ..rendering.layout_picture import layout_svg

    new = compile_design(load_design(result.design))
    return layout_svg(compile_design(design), new, f"{design.name}: layout before and after optimisation")

"""Bench measurements against prediction: bias and spread with intervals, calibrated tests, Q-Q of the tail, and how
large which contributor would have to be to explain a difference.

The file is CSV whose header names the measured quantity and its unit (um, mm, cm, m), one of
  x_mm,y_mm,z_mm (where the point came to lie, connector frame) · error_x_mm,error_y_mm,error_z_mm · error_mm
  with any of level, installation, trial, target before them, or summary statistics: level,n,mean_mm,sd_mm.
rx_deg ... tz_mm state the installation error that a level sets.  Exit code 0: no difference is seen, 1: they differ,
4: nothing in the file can be tested.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from ..console.answer import FAIL, INCONCLUSIVE, PASS, Answer
from ..console.arguments import add_design, read_design, whole
from ..console.files import writable_figure, write_figure
from ..console.progress import Progress
from .operation import Call, Command, LateImport, Operation
from .options import Options, Seed

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.studies.bench.compare import StudyComparison
    from tailstack.studies.bench.file import Measurements

    from ..settings import Settings
    from .sent import Request


EXIT_CODE = {"agrees": PASS, "differs": FAIL, "not testable": INCONCLUSIVE}
MEASUREMENTS = "level,error_mm\nL0,0.31\nL0,0.28\nL0,0.35\nL0,0.30\n"


class ComparisonStudyOptions(Options):
    """What was measured, and with what."""

    measurements: Annotated[str, Field(min_length=1)] = Field(
        description="The measurements, as CSV whose header names quantity and unit (docs/studies.md).",
        examples=[MEASUREMENTS],
    )
    name: Annotated[str, Field(min_length=1, max_length=400, pattern=r"^[^\x00-\x1f\x7f]*$")] = Field(
        "measurements.csv", description="What the record calls the measurements."
    )
    error: Literal["tcp", "localisation"] = Field("tcp", description="Which error was measured.")
    instrument_sd_mm: Annotated[float, Field(ge=0, le=1000)] = Field(
        0.0, description="Standard deviation of the measuring instrument, mm per coordinate; 0: taken as exact."
    )
    seed: Seed = Field(0, description="Seed of the prediction.")


def _read(design: Design, content: Path | bytes, name: str | None = None) -> Measurements:
    """Raises MeasurementError with the line and the reason."""
    from tailstack.design import compile_design
    from tailstack.studies.bench.file import read_measurements

    return read_measurements(content, [target.name for target in compile_design(design).targets], name)


def _compare(call: Call, measured: Measurements) -> StudyComparison:
    from tailstack.studies.bench.compare import study_comparison

    options = call.options
    return study_comparison(
        call.design,
        measured,
        error=options.error,
        seed=options.seed,
        instrument_sd_mm=options.instrument_sd_mm,
        threads=call.threads,
        progress=call.progress,
    )


def _study(call: Call) -> StudyComparison:
    content = call.options.measurements.encode("utf-8", "surrogatepass")
    return _compare(call, _read(call.design, content, call.options.name))


def _check(request: Request, settings: Settings) -> None:
    """A design that determines an answer, measurements that can be read.  Raises Placed, MeasurementError."""
    from tailstack.design import check_design

    request.refuse_by(check_design)
    _read(request.design, request.options.measurements.encode("utf-8", "surrogatepass"), request.options.name)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("--measurements", required=True, metavar="FILE", help="what was measured (.csv)")
    parser.add_argument(
        "--error", choices=("tcp", "localisation"), default="tcp", help="which error was measured (default %(default)s)"
    )
    parser.add_argument(
        "--instrument-sd", dest="instrument_sd_mm", type=_length, default=0.0, metavar="MM",
        help="standard deviation of the measuring instrument, mm per coordinate (default 0: taken as exact)",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed (default %(default)s)")
    parser.add_argument("--figure", metavar="FILE", help="draw means and Q-Q plots (.svg)")
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def _length(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a length in mm; got {text!r}") from None
    if not 0 <= value <= 1000:
        raise argparse.ArgumentTypeError(f"expected 0 to 1000 mm; got {text}")
    return value


def _run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)

    from ..documents import to_json
    from ..rendering.studies.comparison import comparison_text
    from ..report.study_charts import draw_bench

    figure = None if arguments.figure is None else writable_figure(arguments.figure)
    measured = _read(design, Path(arguments.measurements))
    options = ComparisonStudyOptions(
        name=arguments.measurements,
        measurements="-",  # they are read from the file, so that refusals name it
        error=arguments.error,
        instrument_sd_mm=arguments.instrument_sd_mm,
        seed=arguments.seed,
    )
    with Progress("study compare") as progress:
        call = Call((design,), options, threads=arguments.threads, progress=progress.report)
        result = _compare(call, measured)
    if figure is not None:
        write_figure(figure, draw_bench(result))
    code = EXIT_CODE[result.verdict]
    if arguments.json:
        return Answer(to_json(result), code)
    return Answer(comparison_text(result), code)


OPERATION = Operation(
    name="study-comparison",
    verb="study compare",
    path="/v1/studies/compare",
    summary="Bench measurements against prediction",
    description="Bias and spread with intervals, calibrated tests, Q-Q of the tail, and how large which contributor "
    "would have to be to explain a difference.",
    title="answer of study compare: bench measurements against prediction",
    options=ComparisonStudyOptions,
    example={"measurements": MEASUREMENTS},
    record=LateImport("tailstack.studies.bench.compare", "StudyComparison").load,
    run=_study,
    check=_check,
    yaml=False,
    text=LateImport("..rendering.studies.comparison", "comparison_text"),
    document=LateImport("..report.chapters.studies", "bench_document"),
    exit_code=lambda record: EXIT_CODE[record.verdict],
    command=Command(_add_arguments, _run),
    threads=True,
)

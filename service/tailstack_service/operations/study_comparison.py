"""Bench measurements against prediction: bias and spread with intervals, calibrated tests, Q-Q of the tail, and how
large which contributor would have to be to explain a difference.

The file is CSV whose header names the measured quantity and its unit (um, mm, cm, m), one of
  x_mm,y_mm,z_mm (where the point came to lie, connector frame) · error_x_mm,error_y_mm,error_z_mm · error_mm
  with any of level, installation, trial, target before them, or summary statistics: level,n,mean_mm,sd_mm.
rx_deg ... tz_mm state the installation error that a level sets.  Exit code 0: no difference is seen, 1: they differ,
4: nothing in the file can be tested.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tailstack.measures import PointError

from ..console.answer import FAIL, INCONCLUSIVE, PASS
from ..console.flags import NO_FLAG, Flag
from .operation import Call, FigureFile, LateImport, Operation
from .options import Options, Seed

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.studies.bench.compare import StudyComparison
    from tailstack.studies.bench.file import Measurements

    from ..settings import Settings
    from .request import Request


EXIT_CODE = {"agrees": PASS, "differs": FAIL, "not testable": INCONCLUSIVE}
MEASUREMENTS = "level,error_mm\nL0,0.31\nL0,0.28\nL0,0.35\nL0,0.30\n"


MEASURED = Flag("what was measured (.csv)", metavar="FILE", of_file=True)
INSTRUMENT = Flag(
    "standard deviation of the measuring instrument, mm per coordinate (default 0: taken as exact)",
    name="instrument-sd",
    metavar="MM",
)


class ComparisonStudyOptions(Options):
    """What was measured, and with what."""

    measurements: Annotated[str, Field(min_length=1), MEASURED] = Field(
        description="The measurements, as CSV whose header names quantity and unit (docs/studies.md).",
        examples=[MEASUREMENTS],
    )
    name: Annotated[str, Field(min_length=1, max_length=400, pattern=r"^[^\x00-\x1f\x7f]*$"), NO_FLAG] = Field(
        "measurements.csv", description="What the record calls the measurements."
    )
    error: PointError = Field("tcp", description="Which error was measured.")
    instrument_sd_mm: Annotated[float, Field(ge=0, le=1000), INSTRUMENT] = Field(
        0.0, description="Standard deviation of the measuring instrument, mm per coordinate; 0: taken as exact."
    )
    seed: Annotated[Seed, Flag("seed")] = Field(0, description="Seed of the prediction.")


def _read(design: Design, content: Path | bytes, name: str | None = None) -> Measurements:
    """Raises MeasurementError with the line and the reason."""
    from tailstack.design import compile_design
    from tailstack.studies.bench.file import read_measurements

    return read_measurements(content, [target.name for target in compile_design(design).targets], name)


def _study(call: Call) -> StudyComparison:
    from tailstack.studies.bench.compare import study_comparison

    options = call.options
    if call.typed:
        measured = _read(call.design, Path(options.measurements))
    else:
        measured = _read(call.design, options.measurements.encode("utf-8", "surrogatepass"), options.name)
    return study_comparison(
        call.design,
        measured,
        error=options.error,
        seed=options.seed,
        instrument_sd_mm=options.instrument_sd_mm,
        threads=call.threads,
        progress=call.progress,
    )


def _check(request: Request, settings: Settings) -> None:
    """A design that determines an answer, measurements that can be read.  Raises RefusedAt, MeasurementError."""
    from tailstack.design import check_design

    request.refuse_by(check_design)
    _read(request.design, request.options.measurements.encode("utf-8", "surrogatepass"), request.options.name)


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
    document=LateImport("..report.studies.bench", "bench_document"),
    exit_code=lambda record: EXIT_CODE[record.verdict],
    threads=True,
    figure=FigureFile("means and Q-Q plots", LateImport("..report.studies.bench", "draw_bench")),
)

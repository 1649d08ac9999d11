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
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from tailstack.measures import PointError

from ..console.command_line import FAIL, INCONCLUSIVE, PASS
from ..console.flags import NO_FLAG, Flag
from .operation import Call, Options, Seed
from .study import refuse_undetermined, study_operation

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.studies.bench.file import Measurements

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

    measurements: Annotated[str, Field(min_length=1), MEASURED] = Field(examples=[MEASUREMENTS])
    """The measurements, as CSV whose header names quantity and unit (docs/measurements.md)."""
    name: Annotated[str, Field(min_length=1, max_length=400, pattern=r"^[^\x00-\x1f\x7f]*$"), NO_FLAG] = (
        "measurements.csv"
    )
    """What the record calls the measurements."""
    error: PointError = "tcp"
    """Which error was measured."""
    instrument_sd_mm: Annotated[float, Field(ge=0, le=1000), INSTRUMENT] = 0.0
    """Standard deviation of the measuring instrument, mm per coordinate; 0: taken as exact."""
    seed: Annotated[Seed, Flag("seed")] = 0
    """Seed of the prediction."""


def _read(design: Design, content: Path | bytes, name: str | None = None) -> Measurements:
    """Raises MeasurementError with the line and the reason."""
    from tailstack.design import compile_design
    from tailstack.studies.bench.file import read_measurements

    return read_measurements(content, [target.name for target in compile_design(design).targets], name)


def _arguments(call: Call) -> dict[str, Any]:
    told = call.arguments()
    name, sent = told.pop("name"), told["measurements"]
    if call.typed:
        return {**told, "measurements": _read(call.design, Path(sent))}
    return {**told, "measurements": _read(call.design, sent.encode("utf-8", "surrogatepass"), name)}


def _check(request: Request) -> None:
    """Measurements that can be read, too.  Raises MeasurementError."""
    refuse_undetermined(request)
    _read(request.design, request.options.measurements.encode("utf-8", "surrogatepass"), request.options.name)


OPERATION = study_operation(
    "comparison",
    verb="compare",
    module="bench.compare",
    summary="Bench measurements against prediction",
    description="Bias and spread with intervals, calibrated tests, Q-Q of the tail, and how large which contributor "
    "would have to be to explain a difference.",
    title="answer of study compare: bench measurements against prediction",
    options=ComparisonStudyOptions,
    example={"measurements": MEASUREMENTS},
    arguments=_arguments,
    check=_check,
    exit_code=lambda record: EXIT_CODE[record.verdict],
    figure="means and Q-Q plots",
)

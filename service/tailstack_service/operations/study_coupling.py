"""Installation error and noise, simulated each by itself and together, and held against their sums.

As designed and at fixed installation errors of the structure, in both readings: the structure really moves
(physical), or the coordinates told to the estimator do.
"""

from __future__ import annotations

import argparse
from typing import Annotated, Any, Self

from pydantic import Field

from tailstack.measures import PointError

from ..console.flags import Flag
from .operation import Call, Demand, Options, Seed
from .study import study_operation

LEAST_TRIALS, MOST_TRIALS = 8192, 2**24  # of each case


class InstallationLevel(Options):
    """A fixed installation error of the structure."""

    rotation_deg: Annotated[float, Field(ge=-45, le=45)] = Field(examples=[1.0])
    """About each axis through the pivot, deg."""
    translation_mm: Annotated[float, Field(ge=-1000, le=1000)] = Field(examples=[2.0])
    """Along (1, 1, 1), mm."""


def _parse_level(text: str) -> dict[str, float]:
    try:
        rotation, translation = (float(part) for part in text.split(","))
        if not (abs(rotation) <= 45 and abs(translation) <= 1000):
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected DEG,MM like 1,2 (at most 45 deg and 1000 mm); got {text!r}"
        ) from None
    return {"rotation_deg": rotation, "translation_mm": translation}


WORDS = (
    "a fixed installation error: DEG about each axis through the pivot, MM along (1, 1, 1); may be repeated "
    "(default 1,2 and 2,5)"
)
LEVELS = Flag(WORDS, name="level", metavar="DEG,MM", parse=_parse_level, repeats=True, in_query="level")
TRIALS = Flag("trials of each case (default 262144; fewer with many targets or an unusual model)")


class CouplingOptions(Options):
    """Which installation errors, and how each case is sampled."""

    levels: Annotated[Annotated[list[InstallationLevel], Field(min_length=1, max_length=50)] | None, LEVELS] = Field(
        None, examples=[[{"rotation_deg": 1.0, "translation_mm": 2.0}]]
    )
    """Fixed installation errors beside the design as it is; absent: 1 deg, 2 mm and 2 deg, 5 mm."""
    error: PointError = "tcp"
    """Which error."""
    trials: Annotated[Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] | None, TRIALS] = None
    """Trials of each case; absent: 262144, fewer with many targets."""
    seed: Annotated[Seed, Flag("seed")] = 0
    """Seed of every case."""

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        levels = dict.fromkeys((c.rotation_deg, c.translation_mm) for c in record.cases if c.rotation_deg is not None)
        return super().of_record(record, levels=[{"rotation_deg": r, "translation_mm": t} for r, t in levels])


def _arguments(call: Call) -> dict[str, Any]:
    told = call.arguments()
    if "levels" in told:
        told["levels"] = [tuple(level.values()) for level in told["levels"]]
    return told


OPERATION = study_operation(
    "coupling",
    summary="Is the tail of installation error and noise together more than the parts?",
    description="Installation error and noise together against the parts (noise gain, quadrature, plain sum, first "
    "order), as designed and at fixed installation errors of the structure, in both readings of such an error.",
    title="answer of study coupling: the tail together against its parts, with intervals",
    options=CouplingOptions,
    example={"levels": [{"rotation_deg": 1.0, "translation_mm": 2.0}], "trials": 8192},
    arguments=_arguments,
    demand=lambda record: Demand.of_cases(record.trials, len(record.cases), "Monte Carlo of every case"),
    figure="the ratios",
    target=True,
)

"""Bench measurements against prediction: bias and spread with intervals, calibrated tests, Q-Q.

The tests hold the bench as it was run (so many installations, so many trials each) against benches simulated through
the full chain.  An installation is drawn once and stays: the mean of a bench is compared with the law of such means,
the spread with what is drawn at each trial.

What it says in sentences is decided by its tests and intervals alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from ...design import Design
from ...errors import OutOfRangeError, Problem
from ...measures import MEASURE, PointError
from ...results import Finding, Interval, Provenance, Validity
from ...results.record import Published
from ...scoring import checked_system, provenance, trust_of
from ...system import System
from .file import Measurements, read_measurements
from .levels import (
    CONFIDENCE,
    UNKNOWN,
    BenchDraws,
    LevelCompared,
    SpreadCompared,
    compare_level,
    count_benches,
    count_tests,
    describe_bench,
)
from .statistics import TestName, holm

Progress = Callable[[float, float], None]


def study_comparison(
    design: Design | System,
    measurements: Path | bytes | Measurements,
    *,
    error: PointError = "tcp",
    seed: int = 0,
    instrument_sd_mm: float = 0.0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StudyComparison:
    """Compare a file of bench measurements with what the design predicts.

    error: which error was measured.  instrument_sd_mm: standard deviation per coordinate of the instrument, added to
    the prediction at each trial.  Raises DesignError, IllPosedError; MeasurementError with line and reason; LimitError
    where there are too many levels and trials for tests of all of them together;
    OutOfRangeError where the design predicts no spread at all, or error norms are to be compared with a design that
    has components without a law.
    """
    system, _, _ = checked_system(design)
    if not (np.isfinite(instrument_sd_mm) and 0 <= instrument_sd_mm <= 1e3):
        detail = f"the instrument's standard deviation is 0 to 1000 mm; got {instrument_sd_mm:g}"
        raise OutOfRangeError(Problem("", "out-of-range", detail))
    names = [target.name for target in system.targets]
    read = measurements if isinstance(measurements, Measurements) else read_measurements(measurements, names)
    benches = [describe_bench(system, read, group, error, instrument_sd_mm) for group in read.groups]
    count = count_benches([bench.trials for bench in benches], sum(map(count_tests, benches)), 1 - CONFIDENCE)
    draws = BenchDraws(seed, count, instrument_sd_mm=instrument_sd_mm, threads=threads)
    compared: list[LevelCompared] = []
    firsts: dict[str, int] = {}
    for bench in benches:
        first = firsts.setdefault(bench.group.level, len(firsts) << 36)
        report = None if progress is None else partial(_report_part, progress, len(compared), len(benches))
        compared.append(compare_level(bench, error, replace(draws, first=first), report))
    levels = _adjust_p_values(compared)
    verdict = judge_levels(levels)
    models = {bench.model.target.name: bench.model for bench in benches}
    return StudyComparison(
        schema="tailstack/study-comparison/1",
        error=error,
        frame=MEASURE[error].frame,
        file=MeasuredFile(read.name, read.sha256, read.form, read.unit, read.rows, read.notes),
        seed=seed,
        confidence=CONFIDENCE,
        instrument_sd_mm=instrument_sd_mm,
        levels=levels,
        verdict=verdict,
        conclusions=write_conclusions(levels, verdict),
        findings=(*_state_assumptions(read, instrument_sd_mm), *find_remarks(levels)),
        validity=trust_of(system, models),
        provenance=provenance(system, simulated=True, also=("drift of the bench and its datum",)),
    )


def _report_part(progress: Progress, number: int, count: int, share: float) -> None:
    """What part ``number`` of ``count`` reports its share to."""
    progress((number + share) / count, 1.0)


def _state_assumptions(read: Measurements, instrument_sd_mm: float) -> tuple[Finding, ...]:
    message = (
        "one structure on one robot: manufacturing and hand-eye error are the same in the whole file; both interfaces "
        "are drawn anew at each installation, noise, repeatability and load at each trial"
    )
    notes = [Finding("one-structure", "note", message)]
    if read.form == "summary" or not read.states_installations:
        known = "summary statistics" if read.form == "summary" else "no column installation"
        message = f"{known}: the trials of a level are taken as one installation, mounted once"
        notes.append(Finding("one-installation", "note", message))
    stated = [group for group in read.groups if group.deliberate is not None]
    if len({group.level for group in read.groups}) > 1 and not stated:
        message = (
            "the file does not state what installation error its levels set (columns rx_deg ... tz_mm): every level is "
            "held against the design as it stands"
        )
        notes.append(Finding("levels-not-stated", "warning", message))
    if instrument_sd_mm == 0:
        message = "the instrument is taken as exact; --instrument-sd MM adds its own error to the prediction"
        notes.append(Finding("exact-instrument", "note", message))
    return tuple(notes)


def _adjust_p_values(levels: Sequence[LevelCompared]) -> tuple[LevelCompared, ...]:
    """p-values of all tests of the file adjusted for their number, and what each test says."""
    adjusted = iter(holm([test.p_value for level in levels for test in level.tests]))
    compared = []
    for level in levels:
        tests = []
        for test in level.tests:
            p = next(adjusted)
            differs = p < 1 - CONFIDENCE
            tests.append(replace(test, p_adjusted=p, differs=differs, says=describe_test(level, test.test, differs)))
        compared.append(replace(level, tests=tuple(tests)))
    return tuple(compared)


Verdict = Literal["agrees", "differs", "not testable"]


def judge_levels(levels: Sequence[LevelCompared]) -> Verdict:
    tests = [test for level in levels for test in level.tests]
    if not tests:
        return "not testable"
    return "differs" if any(test.differs for test in tests) else "agrees"


def describe_test(level: LevelCompared, test: TestName, differs: bool) -> str:
    """One line on what a test found."""
    if test == "mean":
        if not differs:
            return "the mean is one of those that such a bench would give"
        if level.bias is not None:
            out = [
                f"{axis} by {_measure_excess(value, ends):+.3g} mm"
                for axis, value, ends in zip("xyz", level.bias.measured_mm, level.bias.predicted_range_mm, strict=True)
                if _measure_excess(value, ends)
            ]
            where = f": outside the predicted range in {', '.join(out)}" if out else ": no axis alone, but together"
            return f"the mean is not one that such a bench would give{where}"
        side = "above" if level.norm.measured_mm > level.norm.predicted_mm else "below"
        return f"the mean error is {side} what such a bench would give"
    if test == "tail":
        return "the largest tenth is " + ("not " if differs else "") + "as such a bench would give"
    spread = level.spread if test == "spread" else level.spread_between
    what = "the spread from trial to trial" if test == "spread" else "the spread between installations"
    found = "is not as predicted" if differs else "cannot be told from the prediction"
    return f"{what} {found}{_write_ratio(spread)}"


def _measure_excess(value: float, ends: Interval) -> float:
    """How far a value is out of an interval; 0 inside."""
    return min(value - ends[0], 0.0) + max(value - ends[1], 0.0)


def _write_ratio(spread: SpreadCompared | None) -> str:
    if spread is None:
        return ""
    if spread.interval is None:
        return f": {spread.ratio:.3g} times"
    low, high = spread.interval
    return f": {spread.ratio:.3g} times ({low:.3g} .. {high:.3g})"


def find_remarks(levels: Sequence[LevelCompared]) -> Iterator[Finding]:
    """What the numbers of the file themselves give away."""
    for level in levels:
        if level.not_tested:
            yield Finding("not-tested", "warning", f"level {level.level} at {level.target}: {level.not_tested}")
        elif level.spread is not None and level.spread.measured_mm == 0:
            message = f"level {level.level} at {level.target}: all trials are alike to the last digit"
            yield Finding("no-spread", "warning", message)
    if any(level.trials is None for level in levels):
        message = (
            f"where the number of trials is not stated, the prediction beside it is of benches of {UNKNOWN} trials"
        )
        yield Finding("assumed-trials", "note", message)


def write_conclusions(levels: Sequence[LevelCompared], verdict: Verdict) -> tuple[str, ...]:
    """The verdict and, where there is a difference, which tests see it."""
    tests = [(level, test) for level in levels for test in level.tests]
    if verdict == "not testable":
        return ("Nothing in the file can be tested against the prediction; it is only shown beside it.",)
    if verdict == "agrees":
        ratios = [level.spread for level in levels if level.tests and level.spread is not None]
        sentences = [f"None of {len(tests)} tests tells the measurements from the prediction (5 % for all together)."]
        known = [spread.interval for spread in ratios if spread.interval is not None]
        if known:
            low, high = min(ends[0] for ends in known), max(ends[1] for ends in known)
            sentences.append(
                f"That is not equality: a spread {low:.2g} to {high:.2g} times the predicted one would look the same."
            )
        return tuple(sentences)
    differing = [(level, test) for level, test in tests if test.differs]
    return (
        f"{len(differing)} of {len(tests)} tests tell the measurements from the prediction (5 % for all together).",
        *(f"Level {level.level} at {level.target}: {test.says} (p = {test.p_value:.2g})." for level, test in differing),
    )


@dataclass(frozen=True, slots=True)
class MeasuredFile:
    name: str
    """Name of the file."""
    sha256: str
    """SHA-256 of its bytes, hexadecimal."""
    form: Literal["points", "vectors", "norms", "summary"]
    """What it holds: points, error vectors, error norms, or summary statistics."""
    unit: str
    """Unit of the lengths in it."""
    rows: int
    """Rows that were read."""
    notes: tuple[str, ...]
    """What was done to the numbers on the way."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyComparison(Published):
    """Bench measurements against the prediction of a design."""

    schema: Literal["tailstack/study-comparison/1"]
    error: PointError
    """Error that was measured: tcp (at the tool) or localisation (of the target)."""
    frame: str
    """Frame of vectors: con or tcp."""
    file: MeasuredFile
    """The measurements."""
    seed: int
    """Seed of the simulated benches."""
    confidence: float
    """Confidence of intervals and of all tests together, 0 to 1."""
    instrument_sd_mm: float
    """Standard deviation of the instrument per coordinate, which is added to the prediction, mm."""
    levels: tuple[LevelCompared, ...]
    """Every level at every target."""
    verdict: Literal["agrees", "differs", "not testable"]
    """What all tests together say."""
    conclusions: tuple[str, ...]
    """What can be said of the comparison."""
    findings: tuple[Finding, ...]
    """Remarks about design and measurements."""
    validity: Validity
    """How far the linearisation can be trusted."""
    provenance: Provenance

"""Bench measurements against prediction: bias and spread with intervals, calibrated tests, Q-Q, what would explain it.

The tests hold the bench as it was run (so many installations, so many trials each) against benches simulated through
the full chain.  An installation is drawn once and stays: the mean of a bench is compared with the law of such means,
the spread with what is drawn at each trial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..design import Design
from ..errors import OutOfRangeError, Problem
from ..results import Finding
from ..scoring import FRAMES, NOT_INCLUDED, checked_system, provenance, trust_of
from ..system import System
from .comparison_bench import benches_for, least_benches
from .comparison_explaining import explanations
from .comparison_file import Measurements, read_measurements
from .comparison_levels import CONFIDENCE, Bench, ErrorName, bench_of, compared, offset, planned, stated_of
from .comparison_linear import Scene, sampled_law
from .comparison_records import Explanation, LevelCompared, MeasuredFile, StudyComparison
from .comparison_statistics import holm
from .comparison_words import conclusions, findings_of, said_of_test, verdict_of

SAME_RATIO = 0.005  # error over reprojection error of two rows, as printed with three digits
SHARE_OF_BENCHES = 0.5  # of the work that progress is told of
FEWEST_EXPLAINING = 199  # benches of the first-order law

Progress = Callable[[float, float], None]


def study_comparison(
    design: Design | System,
    measurements: Path | bytes | Measurements,
    *,
    error: ErrorName = "tcp",
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
    benches = [bench_of(system, read, group, error, instrument_sd_mm) for group in read.groups]
    count = benches_for([bench.trials for bench in benches], sum(map(planned, benches)), 1 - CONFIDENCE)
    found: list[LevelCompared] = []
    firsts: dict[str, int] = {}
    for number, bench in enumerate(benches):
        first = firsts.setdefault(bench.group.level, len(firsts) << 36)

        def told(share: float, before: int = number) -> None:
            if progress is not None:
                progress(SHARE_OF_BENCHES * (before + share) / len(benches), 1.0)

        found.append(compared(bench, error, seed, first, count, instrument_sd_mm, threads, told))
    levels = _adjusted(found)
    explained = _explained(benches, levels, error, seed, instrument_sd_mm, threads, progress)
    verdict = verdict_of(levels)
    models = {bench.model.target.name: bench.model for bench in benches}
    return StudyComparison(
        schema="tailstack/study-comparison/1",
        error=error,
        frame=FRAMES[error],
        file=MeasuredFile(read.name, read.sha256, read.form, read.unit, read.rows, read.notes),
        seed=seed,
        confidence=CONFIDENCE,
        instrument_sd_mm=instrument_sd_mm,
        levels=levels,
        explanations=explained,
        verdict=verdict,
        conclusions=conclusions(levels, explained, verdict),
        findings=(*_assumptions(system, read, instrument_sd_mm), *findings_of(levels, SAME_RATIO)),
        validity=trust_of(system, models),
        provenance=provenance(
            system, (*(line for line in NOT_INCLUDED if "second order" not in line), "drift of the bench and its datum")
        ),
    )


def _assumptions(system: System, read: Measurements, instrument_sd_mm: float) -> tuple[Finding, ...]:
    message = (
        "one structure on one robot: manufacturing and hand-eye error are the same in the whole file; both interfaces "
        "are drawn anew at each installation, noise, repeatability and load at each trial"
    )
    notes = [Finding("one-structure", "note", message)]
    if read.form != "summary" and not read.states_installations:
        message = "no column installation: the trials of a level are taken as one installation, mounted once"
        notes.append(Finding("one-installation", "note", message))
    if read.form == "summary":
        message = "summary statistics: the trials of a level are taken as one installation, mounted once"
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


def _adjusted(levels: Sequence[LevelCompared]) -> tuple[LevelCompared, ...]:
    """p-values of all tests of the file adjusted for their number, and what each test says."""
    raw = [test.p_value for level in levels for test in level.tests]
    adjusted = iter(holm(raw))
    found = []
    for level in levels:
        tests = []
        for test in level.tests:
            p = next(adjusted)
            differs = p < 1 - CONFIDENCE
            tests.append(replace(test, p_adjusted=p, differs=differs, says=said_of_test(level, test.test, differs)))
        found.append(replace(level, tests=tuple(tests)))
    return tuple(found)


# --- explanations ---------------------------------------------------------------------------------


def _explained(
    benches: Sequence[Bench],
    levels: Sequence[LevelCompared],
    error: ErrorName,
    seed: int,
    instrument_sd_mm: float,
    threads: int | None,
    progress: Progress | None,
) -> tuple[Explanation, ...]:
    """Of every target, over all its levels that could be tested."""
    tested = [bench for bench, level in zip(benches, levels, strict=True) if level.benches]
    targets = list(dict.fromkeys(bench.group.target for bench in tested))
    found: list[Explanation] = []
    for number, target in enumerate(targets):

        def told(share: float, before: int = number) -> None:
            if progress is not None:
                progress(SHARE_OF_BENCHES + (1 - SHARE_OF_BENCHES) * (before + share) / len(targets), 1.0)

        here = [bench for bench in tested if bench.group.target == target]
        least = least_benches(sum(map(planned, here)), 1 - CONFIDENCE, FEWEST_EXPLAINING)
        room = sum(bench.trials for bench in here)
        scenes = [
            Scene(
                target=target,
                sizes=bench.sizes,
                errors=None if bench.vectors is None else bench.vectors - offset(bench),
                norms=bench.norms,
                summary=stated_of(bench),
                expected=bench.expected,
                law=sampled_law(
                    bench.system, bench.place, error, bench.sizes, seed, instrument_sd_mm, least=least, trials=room
                ),
            )
            for bench in here
        ]
        found += explanations(scenes, 1 - CONFIDENCE, threads, told)
    return tuple(found)

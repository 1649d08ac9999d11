"""One level at one target: bias and spread with intervals, calibrated tests, ordered errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import stdtrit

from ..errors import IllPosedError, OutOfRangeError, Problem
from ..estimation.checks import check_geometry
from ..propagation.linear import LinearModel, linearise
from ..results import Interval
from ..scoring import vector3
from ..system import Array, Law, System
from .comparison_bench import at_level, expected, simulated
from .comparison_file import Group, Measurements, Summary
from .comparison_records import (
    BiasCompared,
    ComparisonTest,
    Intervals3,
    LevelCompared,
    NormCompared,
    QuantilePoint,
    SpreadCompared,
    TailShape,
    TestName,
)
from .comparison_statistics import (
    LEAST_FOR_TAIL,
    Expected,
    bench_mean,
    departure,
    distance,
    installation_means,
    moments_of,
    norm_statistics,
    p_value,
    pooled_sd,
    simulated_norm_statistics,
    tail_mean,
    two_sided,
)
from .comparison_table import refusal, shown
from .comparison_words import UNKNOWN

CONFIDENCE = 0.95
MOST_QUANTILES = 60

ErrorName = Literal["tcp", "localisation"]


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """One group, in the error's own terms, and what the design predicts for it."""

    group: Group
    system: System  # at the group's level
    place: int  # of the target
    model: LinearModel
    expected: Expected
    vectors: Array | None  # (n, 3) mm in the frame of the error
    norms: Array | None  # (n,) mm
    sizes: tuple[int, ...]
    box: Array  # (3, b) mm: bounded components at their half-widths
    reason: str  # why nothing can be tested, or ""

    @property
    def trials(self) -> int:
        """Of a simulated bench."""
        return sum(self.sizes or (UNKNOWN,))


def bench_of(system: System, read: Measurements, group: Group, error: ErrorName, instrument_sd_mm: float) -> Bench:
    here = _at_level(system, read, group)
    place = [target.name for target in system.targets].index(group.target)
    model = linearise(here, here.targets[place])
    box = _bounded(model, error)
    vectors = norms = None
    sizes, reason = group.sizes, ""
    if read.form == "summary":
        assert group.summary is not None
        sizes = (group.summary.n,) if group.summary.n else ()
        if group.summary.mean_mm == 0 and not group.summary.sd_mm:
            reason = "its error is zero, without any spread: the level is its own reference, not a measurement"
        elif group.summary.n is None:
            reason = "the number of trials is not stated"
    elif read.form == "norms":
        norms = group.values_mm
    else:
        vectors = group.values_mm
        if read.form == "points":
            turn = here.T_tcp_con[:3, :3] if error == "tcp" else np.eye(3)
            vectors = (vectors - here.targets[place].position_mm) @ turn.T
        norms = np.linalg.norm(vectors, axis=1)
    if box.shape[1] and vectors is None:
        detail = "error norms cannot be held against components without a law (distribution: bounded)"
        raise OutOfRangeError(
            Problem("/interfaces", "bounded", detail, "give the components a distribution, or measure points")
        )
    return Bench(
        group, here, place, model, expected(model, error, instrument_sd_mm), vectors, norms, sizes, box, reason
    )


def _at_level(system: System, read: Measurements, group: Group) -> System:
    """Raises MeasurementError for a level at which the design cannot be imaged."""
    here = at_level(system, group.deliberate)
    if here is not system:
        try:
            check_geometry(here)
        except IllPosedError as error:
            detail = f"level {shown(group.level)} cannot be measured: {error.problems[0].detail}"
            hint = "is the installation error of the level (rx_deg ... tz_mm) in the right unit?"
            raise refusal(read.name, group.line, "ill-posed-geometry", detail, hint) from None
    return here


def planned(bench: Bench) -> int:
    """How many tests a bench will have."""
    if bench.reason:
        return 0
    if bench.group.summary is not None:
        return len(stated_of(bench) or ())
    several = (sum(bench.sizes) > len(bench.sizes)) + (len(bench.sizes) > 1)
    return 1 + several + (sum(bench.sizes) >= LEAST_FOR_TAIL)


def _bounded(model: LinearModel, error: str) -> Array:
    """(3, b) mm: what each component without a law does at its half-width."""
    columns = [
        model.gain(block, error)[:, j] * block.half_width[j]
        for block in model.blocks
        for j, law in enumerate(block.laws)
        if law is Law.BOUNDED and block.half_width[j] > 0
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((3, 0))


def offset(bench: Bench) -> Array:
    """(3,) mm: of all the bounded components can do, what brings the prediction nearest to the measured mean."""
    if not bench.box.shape[1] or bench.vectors is None:
        return np.zeros(3)
    factor = np.linalg.cholesky(bench.expected.of_mean(bench.sizes))
    gap = bench_mean(bench.vectors[None], bench.sizes)[0] - bench.expected.mean
    best = lsq_linear(np.linalg.solve(factor, bench.box), np.linalg.solve(factor, gap), bounds=(-1, 1))
    return np.asarray(bench.box @ best.x)


def compared(
    bench: Bench,
    error: ErrorName,
    seed: int,
    first: int,
    count: int,
    instrument_sd_mm: float,
    threads: int | None,
    told: Callable[[float], None],
) -> LevelCompared:
    group = bench.group
    sizes = bench.sizes or (UNKNOWN,)
    errors = simulated(
        bench.system, bench.place, error, sizes, seed=seed, first=first, count=count,
        instrument_sd_mm=instrument_sd_mm, threads=threads, progress=told,
    )  # fmt: skip
    norms = np.linalg.norm(errors, axis=2)
    tested = bool(bench.sizes) and not bench.reason
    degrees = np.array([180 / np.pi] * 3 + [1.0] * 3)
    stated = None if group.deliberate is None else tuple(float(v) for v in group.deliberate * degrees)
    reprojection = None if group.summary is None else group.summary.reprojection_px
    ratio = group.summary.mean_mm / reprojection if group.summary is not None and reprojection else None
    return LevelCompared(
        level=group.level,
        target=group.target,
        trials=sum(bench.sizes) or None,
        installations=len(bench.sizes) or 1,
        deliberate_deg_mm=stated,  # type: ignore[arg-type]
        benches=len(errors) if tested else 0,
        bias=None if bench.vectors is None else _bias(bench, errors),
        norm=_norm(bench, norms, tested),
        spread=_spread(bench, errors, norms, tested),
        spread_between=_spread_between(bench, errors, norms),
        tests=tests_of(bench, errors, norms) if tested else (),
        quantiles=() if bench.norms is None else _quantiles(bench.norms, norms),
        ratio_to_reprojection_mm_per_px=ratio,
        not_tested=bench.reason,
        tail_shape=_tail_shape(group.summary, norms),
    )


def _tail_shape(summary: Summary | None, norms: Array) -> TailShape | None:
    """Where a summary's P95 stands, beside the median of simulated benches (m, n)."""
    if summary is None or summary.p95_mm is None or summary.mean_mm <= 0:
        return None
    means, deviations, tails = norms.mean(axis=1), norms.std(axis=1, ddof=1), np.quantile(norms, 0.95, axis=1)
    moves = bool((deviations > 0).all())
    return TailShape(
        p95_over_mean=summary.p95_mm / summary.mean_mm,
        standard_deviations=(summary.p95_mm - summary.mean_mm) / summary.sd_mm if summary.sd_mm else None,
        predicted_p95_over_mean=float(np.median(tails / means)) if moves else 1.0,
        predicted_standard_deviations=float(np.median((tails - means) / deviations)) if moves else None,
    )


def _range(values: Array) -> Interval:
    low, high = np.quantile(values, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return (float(low), float(high))


def _mean_interval(values: Array, sizes: Sequence[int]) -> Interval:
    """Student's interval of the mean of values (n,): of this installation, or of installations where there are more."""
    if len(sizes) > 1:
        values = installation_means(values[None], sizes)[0]
    count = len(values)
    half = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * float(values.std(ddof=1)) / sqrt(count)
    return (float(values.mean()) - half, float(values.mean()) + half)


def _bias(bench: Bench, errors: Array) -> BiasCompared:
    assert bench.vectors is not None
    means = bench_mean(errors, bench.sizes)
    return BiasCompared(
        measured_mm=vector3(bench_mean(bench.vectors[None], bench.sizes)[0]),
        interval_mm=_three([_mean_interval(column, bench.sizes) for column in bench.vectors.T]),
        interval_of="installations of this kind" if len(bench.sizes) > 1 else "this installation",
        predicted_mm=vector3(means.mean(axis=0)),
        predicted_range_mm=_three([_range(column) for column in means.T]),
    )


def _three(intervals: Sequence[Interval]) -> Intervals3:
    x, y, z = intervals
    return (x, y, z)


def _norm(bench: Bench, norms: Array, tested: bool) -> NormCompared:
    means = bench_mean(norms, bench.sizes or (norms.shape[1],))
    summary = bench.group.summary
    interval: Interval | None
    if summary is not None:
        measured, interval = summary.mean_mm, None
        if tested and summary.n and summary.sd_mm is not None:
            half = float(stdtrit(summary.n - 1, (1 + CONFIDENCE) / 2)) * summary.sd_mm / sqrt(summary.n)
            interval = (measured - half, measured + half)
    else:
        assert bench.norms is not None
        measured = float(bench_mean(bench.norms[None], bench.sizes)[0])
        interval = _mean_interval(bench.norms, bench.sizes)
    return NormCompared(measured, interval, float(means.mean()), _range(means))


def _ratio(of: Literal["vectors", "norms"], found: float, simulated: Array, known: bool = True) -> SpreadCompared:
    """A spread against those of benches; its interval assumes the predicted shape, scaled."""
    predicted = sqrt(float((simulated**2).mean()))
    low, high = _range(simulated / predicted)
    ratio = found / predicted
    return SpreadCompared(of, found, predicted, ratio, (ratio / high, ratio / low) if known and low > 0 else None)


def _spread(bench: Bench, errors: Array, norms: Array, tested: bool) -> SpreadCompared | None:
    sizes = bench.sizes or (UNKNOWN,)
    if sum(sizes) == len(sizes):
        return None
    if bench.vectors is not None:
        found = moments_of(bench.vectors[None], sizes).within
        within = moments_of(errors, sizes).within
        assert found is not None
        assert within is not None
        return _ratio("vectors", sqrt(np.trace(found[0])), np.sqrt(np.trace(within, axis1=1, axis2=2)))
    summary = bench.group.summary
    if summary is not None:
        return None if summary.sd_mm is None else _ratio("norms", summary.sd_mm, pooled_sd(norms, sizes), tested)
    assert bench.norms is not None
    return _ratio("norms", float(pooled_sd(bench.norms[None], sizes)[0]), pooled_sd(norms, sizes))


def _spread_between(bench: Bench, errors: Array, norms: Array) -> SpreadCompared | None:
    if len(bench.sizes) < 2:
        return None
    if bench.vectors is not None:
        found, between = moments_of(bench.vectors[None], bench.sizes).between, moments_of(errors, bench.sizes).between
        assert found is not None
        assert between is not None
        return _ratio("vectors", sqrt(np.trace(found[0])), np.sqrt(np.trace(between, axis1=1, axis2=2)))
    assert bench.norms is not None
    found_sd = float(installation_means(bench.norms[None], bench.sizes).std(axis=1, ddof=1)[0])
    return _ratio("norms", found_sd, installation_means(norms, bench.sizes).std(axis=1, ddof=1))


# --- tests ----------------------------------------------------------------------------------------


def tests_of(bench: Bench, errors: Array, norms: Array) -> tuple[ComparisonTest, ...]:
    """Every test of a bench against simulated ones: errors (R, n, 3), norms (R, n), mm."""
    found = _vector_tests(bench, errors) if bench.vectors is not None else _norm_tests(bench, norms)
    if bench.norms is not None and len(bench.norms) >= LEAST_FOR_TAIL:
        found.append(_test("tail", float(tail_mean(bench.norms[None])[0]), tail_mean(norms), True))
    return tuple(found)


def _test(name: TestName, statistic: float, simulated: Array, both: bool) -> ComparisonTest:
    p = p_value(statistic, simulated, both_sides=both)
    return ComparisonTest(name, statistic, "both" if both else "upper", p, p, False, "")


def _vector_tests(bench: Bench, errors: Array) -> list[ComparisonTest]:
    assert bench.vectors is not None
    sizes, law = bench.sizes, bench.expected
    here, many = moments_of(bench.vectors[None], sizes), moments_of(errors, sizes)
    about, freedom, several = law.of_mean(sizes), sum(sizes) - len(sizes), len(sizes) - 1
    # Bounded components are put where they serve the prediction best; benches have them at their centres, so that the
    # p-value can only be too large.
    at = distance(here.mean - law.mean - offset(bench), about)[0]
    tests = [_test("mean", float(at), distance(many.mean - law.mean, about), False)]
    if here.within is not None and many.within is not None:
        at = departure(here.within, law.shot, freedom)[0]
        tests.append(_test("spread", float(at), departure(many.within, law.shot, freedom), two_sided(freedom, True)))
    if here.between is not None and many.between is not None:
        between = law.between(sizes)
        at, reference = departure(here.between, between, several)[0], departure(many.between, between, several)
        tests.append(_test("between installations", float(at), reference, two_sided(several, True)))
    return tests


def _norm_tests(bench: Bench, norms: Array) -> list[ComparisonTest]:
    names: list[TestName] = ["mean"]
    if sum(bench.sizes) > len(bench.sizes):
        names.append("spread")
    if len(bench.sizes) > 1:
        names.append("between installations")
    found = norm_statistics(bench.norms, stated_of(bench), bench.sizes)
    many = simulated_norm_statistics(norms, bench.sizes)
    return [_test(name, at, sample, True) for name, at, sample in zip(names, found, many, strict=False)]


def stated_of(bench: Bench) -> tuple[float, ...] | None:
    """Mean and, where it is given, standard deviation of summary statistics, mm."""
    summary = bench.group.summary
    if summary is None:
        return None
    return (summary.mean_mm,) if summary.sd_mm is None else (summary.mean_mm, summary.sd_mm)


def _quantiles(measured: Array, norms: Array) -> tuple[QuantilePoint, ...]:
    """Ordered norms against the same places in simulated benches; all of them, or the upper tail and a few below."""
    count = len(measured)
    ranks = np.arange(count)
    if count > MOST_QUANTILES:
        below = np.linspace(0, count - MOST_QUANTILES // 2 - 1, MOST_QUANTILES // 2).astype(int)
        ranks = np.unique(np.concatenate([below, ranks[-MOST_QUANTILES // 2 :]]))
    ordered, many = np.sort(measured), np.sort(norms, axis=1)[:, ranks]
    levels = [(1 - CONFIDENCE) / 2, 0.5, (1 + CONFIDENCE) / 2]
    low, middle, high = np.quantile(many, levels, axis=0)
    return tuple(
        QuantilePoint(
            probability=float((rank + 0.5) / count),
            measured_mm=float(ordered[rank]),
            predicted_mm=float(middle[k]),
            envelope_mm=(float(low[k]), float(high[k])),
            outside=not low[k] <= ordered[rank] <= high[k],
        )
        for k, rank in enumerate(ranks)
    )

"""A bench as it was run, simulated through the full chain, and held against what was measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tailstack.fields import INTERFACES

from ...errors import IllPosedError, LimitError, OutOfRangeError, Problem
from ...estimation.checks import check_geometry
from ...geometry.arrays import Array
from ...kernels.process import usable_cores
from ...laws import Drawn
from ...measures import POINT_ERRORS, PointError
from ...montecarlo.chain import draw, evaluate, standard_normals
from ...montecarlo.plan import ChainPlan, compile_plan
from ...people_tables import quote as shown
from ...propagation.linear import LinearModel, linearise
from ...results import Interval, Vector3
from ...scoring import vector3
from ...system import Effect, System
from .file import Group, Measurements, refusal
from .statistics import (
    LEAST_FOR_TAIL,
    LEAST_FREEDOM,
    Expected,
    TestName,
    bench_mean,
    departure,
    distance,
    installation_means,
    moments_of,
    norm_statistics,
    p_value,
    tail_mean,
)

Intervals3 = tuple[Interval, Interval, Interval]


@dataclass(frozen=True, slots=True)
class BiasCompared:
    """Mean error vector of all trials, mm, in the frame of the error."""

    measured_mm: Vector3
    """Measured mean error vector, in the frame of the error, mm."""
    interval_mm: Intervals3
    """Confidence interval of each component by itself, mm."""
    interval_of: Literal["this installation", "installations of this kind"]
    """What the interval is of: this installation's mean, or that of installations of this kind."""
    predicted_mm: Vector3
    """Predicted mean error vector, mm."""
    predicted_range_mm: Intervals3
    """Where the mean of 95 % of such benches would be, each component by itself, mm."""


@dataclass(frozen=True, slots=True)
class NormCompared:
    """Mean error norm of all trials, mm."""

    measured_mm: float
    """Measured mean of the error's norm, mm."""
    interval_mm: Interval | None
    """Confidence interval of it, of this installation or of installations, mm; null for summary statistics without n.
    """
    predicted_mm: float
    """Predicted mean, mm."""
    predicted_range_mm: Interval
    """Where the mean of 95 % of such benches would be, mm."""


@dataclass(frozen=True, slots=True)
class SpreadCompared:
    """Standard deviation from trial to trial, within installations, or between their means."""

    of: Literal["vectors", "norms"]
    """vectors: root of the trace of the covariance; norms: standard deviation of the norms."""
    measured_mm: float
    """Measured spread, mm."""
    predicted_mm: float
    """Predicted spread, mm."""
    ratio: float
    """Measured over predicted."""
    interval: Interval | None
    """Confidence interval of the ratio, as if the law had the predicted shape; null without n."""


@dataclass(frozen=True, slots=True)
class ComparisonTest:
    """One test of one level at one target."""

    test: TestName
    """What is tested."""
    statistic: float
    """The test's statistic."""
    sides: Literal["upper", "both"]
    """Whether large values alone count, or small ones too."""
    p_value: float
    """How often a bench as predicted would be as far off, 0 to 1."""
    p_adjusted: float
    """The same for all tests of the file together (Holm)."""
    differs: bool
    """Whether the adjusted one is below one less the confidence."""
    says: str
    """What the test says, in a sentence."""


@dataclass(frozen=True, slots=True)
class QuantilePoint:
    """One ordered error norm against the same place in simulated benches."""

    probability: float
    """Place in the ordered error norms, 0 to 1."""
    measured_mm: float
    """Measured norm there, mm."""
    predicted_mm: float
    """Median over simulated benches, mm."""
    envelope_mm: Interval
    """Where 95 % of benches are, at this place alone, mm."""
    outside: bool
    """Whether the measured norm is outside of it."""


@dataclass(frozen=True, slots=True)
class LevelCompared:
    """One level at one target."""

    level: str
    """Name of the level in the file."""
    target: str
    """Name of the target."""
    trials: int | None
    """Trials; null for summary statistics without n."""
    installations: int
    """Installations that the trials belong to."""
    deliberate_deg_mm: tuple[float, float, float, float, float, float] | None
    """Installation error that was set on purpose: rx, ry, rz in deg and tx, ty, tz in mm; null where none was stated.
    """
    benches: int
    """Simulated benches; 0 when nothing could be tested."""
    bias: BiasCompared | None
    """Mean error vectors; null for norms and summaries."""
    norm: NormCompared
    """Mean norms."""
    spread: SpreadCompared | None
    """Spread from trial to trial within installations; null where nothing can be said of it."""
    spread_between: SpreadCompared | None
    """Spread of the means of two or more installations; null for one."""
    tests: tuple[ComparisonTest, ...]
    """The tests."""
    quantiles: tuple[QuantilePoint, ...]
    """Ordered norms against simulated benches."""
    not_tested: str
    """Why nothing was tested; empty where it was."""


CONFIDENCE = 0.95
UNKNOWN = 100  # trials that are simulated where their number is not stated: only the prediction is shown
MOST_QUANTILES = 60
Progress = Callable[[float], None]  # with the share that is done


@dataclass(frozen=True, slots=True)
class BenchDraws:
    """Which benches are simulated, and with what."""

    seed: int
    count: int  # of benches
    first: int = 0  # index of the first trial: benches of one seed do not share deviates unless they should
    instrument_sd_mm: float = 0.0  # standard deviation per coordinate of the instrument, drawn at each trial
    threads: int | None = None  # None: one for each core


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


def describe_bench(
    system: System, read: Measurements, group: Group, error: PointError, instrument_sd_mm: float
) -> Bench:
    here = _reach_level(system, read, group)
    place = [target.name for target in system.targets].index(group.target)
    model = linearise(here, here.targets[place])
    box = np.hstack([np.zeros((3, 0)), *(block.bounded_columns_mm(error) for block in model.blocks)])
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
        hint = "give the components a distribution, or measure points"
        raise OutOfRangeError(Problem("/interfaces", "bounded", detail, hint))
    return Bench(group, here, place, model, expect(model, error, instrument_sd_mm), vectors, norms, sizes, box, reason)


def _reach_level(system: System, read: Measurements, group: Group) -> System:
    """Raises MeasurementError for a level at which the design cannot be imaged."""
    here = set_level(system, group.deliberate)
    if here is not system:
        try:
            check_geometry(here)
        except IllPosedError as error:
            detail = f"level {shown(group.level)} cannot be measured: {error.problems[0].detail}"
            hint = "is the installation error of the level (rx_deg ... tz_mm) in the right unit?"
            raise refusal(read.name, group.line, "ill-posed-geometry", detail, hint) from None
    return here


def count_tests(bench: Bench) -> int:
    """How many tests a bench will have."""
    if bench.reason:
        return 0
    if bench.group.summary is not None:
        return len(_measured_norm_statistics(bench))
    several = (sum(bench.sizes) > len(bench.sizes)) + (len(bench.sizes) > 1)
    return 1 + several + (sum(bench.sizes) >= LEAST_FOR_TAIL)


def choose_offset(bench: Bench) -> Array:
    """(3,) mm: of all the bounded components can do, what brings the prediction nearest to the measured mean."""
    if not bench.box.shape[1] or bench.vectors is None:
        return np.zeros(3)
    from scipy.optimize import lsq_linear  # a third of a second that no other command should wait for

    factor = np.linalg.cholesky(bench.expected.of_mean(bench.sizes))
    gap = bench_mean(bench.vectors[None], bench.sizes)[0] - bench.expected.mean
    best = lsq_linear(np.linalg.solve(factor, bench.box), np.linalg.solve(factor, gap), bounds=(-1, 1))
    return np.asarray(bench.box @ best.x)


def compare_level(
    bench: Bench, error: PointError, draws: BenchDraws, progress: Progress | None = None
) -> LevelCompared:
    """A level against simulated benches: moments, spread, tests, quantiles."""
    group = bench.group
    sizes = bench.sizes or (UNKNOWN,)
    errors = simulate_benches(bench.system, bench.place, error, sizes, draws, progress)
    norms = np.linalg.norm(errors, axis=2)
    tested = bool(bench.sizes) and not bench.reason
    degrees = np.array([180 / np.pi] * 3 + [1.0] * 3)
    stated = None if group.deliberate is None else tuple(float(v) for v in group.deliberate * degrees)
    return LevelCompared(
        level=group.level,
        target=group.target,
        trials=sum(bench.sizes) or None,
        installations=len(bench.sizes) or 1,
        deliberate_deg_mm=stated,  # type: ignore[arg-type]
        benches=len(errors) if tested else 0,
        bias=None if bench.vectors is None else _compare_bias(bench, errors),
        norm=_compare_norm(bench, norms),
        spread=_compare_spread(bench, errors, norms, "spread"),
        spread_between=_compare_spread(bench, errors, norms, "between installations"),
        tests=test_bench(bench, errors, norms) if tested else (),
        quantiles=() if bench.norms is None else _compare_quantiles(bench.norms, norms),
        not_tested=bench.reason,
    )


def _middle_share(values: Array) -> Interval:
    low, high = np.quantile(values, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return (float(low), float(high))


def _mean_interval(values: Array, sizes: Sequence[int]) -> Interval:
    """Student's interval of the mean of values (n,): of this installation, or of installations where there are more."""
    if len(sizes) > 1:
        values = installation_means(values[None], sizes)[0]
    count = len(values)
    half = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * float(values.std(ddof=1)) / sqrt(count)
    return (float(values.mean()) - half, float(values.mean()) + half)


def _compare_bias(bench: Bench, errors: Array) -> BiasCompared:
    assert bench.vectors is not None
    means = bench_mean(errors, bench.sizes)
    return BiasCompared(
        measured_mm=vector3(bench_mean(bench.vectors[None], bench.sizes)[0]),
        interval_mm=_three([_mean_interval(column, bench.sizes) for column in bench.vectors.T]),
        interval_of="installations of this kind" if len(bench.sizes) > 1 else "this installation",
        predicted_mm=vector3(means.mean(axis=0)),
        predicted_range_mm=_three([_middle_share(column) for column in means.T]),
    )


def _three(intervals: Sequence[Interval]) -> Intervals3:
    x, y, z = intervals
    return (x, y, z)


def _compare_norm(bench: Bench, norms: Array) -> NormCompared:
    means, summary = bench_mean(norms, bench.sizes or (norms.shape[1],)), bench.group.summary
    measured = _measured_norm_statistics(bench)["mean"]
    interval = None if bench.norms is None else _mean_interval(bench.norms, bench.sizes)
    if summary is not None and not bench.reason and summary.n and summary.sd_mm is not None:
        half = float(stdtrit(summary.n - 1, (1 + CONFIDENCE) / 2)) * summary.sd_mm / sqrt(summary.n)
        interval = (measured - half, measured + half)
    return NormCompared(measured, interval, float(means.mean()), _middle_share(means))


def _measured_norm_statistics(bench: Bench) -> dict[TestName, float]:
    """Those of :func:`norm_statistics` that the file has or states, mm."""
    summary = bench.group.summary
    if summary is not None:
        return {"mean": summary.mean_mm, **({} if summary.sd_mm is None else {"spread": summary.sd_mm})}
    assert bench.norms is not None
    return {name: float(values[0]) for name, values in norm_statistics(bench.norms[None], bench.sizes).items()}


MOMENT_OF = {"spread": "within", "between installations": "between"}


def _compare_spread(bench: Bench, errors: Array, norms: Array, name: TestName) -> SpreadCompared | None:
    """A spread against those of benches; its interval assumes the predicted shape, scaled."""
    of: Literal["vectors", "norms"]
    sizes = bench.sizes or (UNKNOWN,)
    if bench.vectors is None:
        of, measured = "norms", _measured_norm_statistics(bench).get(name)
        if measured is None:
            return None
        simulated = norm_statistics(norms, sizes)[name]
    else:
        here, many = (getattr(moments_of(each, sizes), MOMENT_OF[name]) for each in (bench.vectors[None], errors))
        if here is None:
            return None
        of, measured, simulated = "vectors", sqrt(np.trace(here[0])), np.sqrt(np.trace(many, axis1=1, axis2=2))
    predicted = sqrt(float((simulated**2).mean()))
    low, high = _middle_share(simulated / predicted)
    ratio = measured / predicted
    known = bool(bench.sizes) and not bench.reason and low > 0
    return SpreadCompared(of, measured, predicted, ratio, (ratio / high, ratio / low) if known else None)


# --- tests ----------------------------------------------------------------------------------------


def test_bench(bench: Bench, errors: Array, norms: Array) -> tuple[ComparisonTest, ...]:
    """Every test of a bench against simulated ones: errors (R, n, 3), norms (R, n), mm."""
    tests = _test_vectors(bench, errors) if bench.vectors is not None else _test_norms(bench, norms)
    if bench.norms is not None and len(bench.norms) >= LEAST_FOR_TAIL:
        tests.append(_test("tail", float(tail_mean(bench.norms[None])[0]), tail_mean(norms), True))
    return tuple(tests)


def _test(name: TestName, statistic: float, simulated: Array, both: bool) -> ComparisonTest:
    p = p_value(statistic, simulated, both_sides=both)
    return ComparisonTest(name, statistic, "both" if both else "upper", p, p, False, "")


def _test_vectors(bench: Bench, errors: Array) -> list[ComparisonTest]:
    assert bench.vectors is not None
    sizes, law = bench.sizes, bench.expected
    here, many = moments_of(bench.vectors[None], sizes), moments_of(errors, sizes)
    about, freedom, several = law.of_mean(sizes), sum(sizes) - len(sizes), len(sizes) - 1
    # Bounded components are put where they serve the prediction best; benches have them at their centres, so that the
    # p-value can only be too large.
    at = distance(here.mean - law.mean - choose_offset(bench), about)[0]
    tests = [_test("mean", float(at), distance(many.mean - law.mean, about), False)]
    if here.within is not None and many.within is not None:
        at = departure(here.within, law.shot, freedom)[0]
        tests.append(_test("spread", float(at), departure(many.within, law.shot, freedom), freedom < LEAST_FREEDOM))
    if here.between is not None and many.between is not None:
        between = law.between(sizes)
        at, reference = departure(here.between, between, several)[0], departure(many.between, between, several)
        tests.append(_test("between installations", float(at), reference, several < LEAST_FREEDOM))
    return tests


def _test_norms(bench: Bench, norms: Array) -> list[ComparisonTest]:
    many = norm_statistics(norms, bench.sizes)
    return [_test(name, at, many[name], True) for name, at in _measured_norm_statistics(bench).items()]


def _compare_quantiles(measured: Array, norms: Array) -> tuple[QuantilePoint, ...]:
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


ROWS = 2_000_000  # simulated trials of a file that there is room for
MOST_ROWS = 4_000_000  # and that the tests of a file may need: half a minute
LEAST_REPLICATES, MOST_REPLICATES = 499, 4_999
ROWS_AT_A_TIME = 8192
INSTRUMENT_STREAM = 64  # of the generator; 0 and 1 are the chain's own


def set_level(system: System, deliberate: Array | None) -> System:
    """The system with a level's installation error (6,) rad, mm on top of the known bias of the structure's mount."""
    if deliberate is None or not deliberate.any():
        return system
    mount = system.structure_connector
    return replace(system, structure_connector=replace(mount, known=mount.known + deliberate))


def count_benches(trials: Sequence[int], tests: int, alpha: float) -> int:
    """How many benches are simulated of each group of a file: as many as its tests need, more where there is room.

    trials: of each group.  Raises LimitError where the tests together need more than can be simulated.
    """
    least, every = count_least_benches(tests, alpha), sum(trials)
    if least * every > MOST_ROWS:
        needed = f"{every:,} trials and {tests} tests need {least * every:,} simulated trials"
        detail = f"{needed}; at most {MOST_ROWS:,} are made"
        hint = "put fewer levels, targets or trials into a file; several files are compared one by one"
        raise LimitError(Problem("", "too-many", detail, hint))
    return max(min(ROWS // every, MOST_REPLICATES), least)


def count_least_benches(tests: int, alpha: float) -> int:
    """So many that a two-sided p-value can fall below alpha shared among the tests, with room to spare."""
    return max(LEAST_REPLICATES, ceil(3 * tests / alpha))


def simulate_benches(
    system: System, target: int, error: str, sizes: Sequence[int], draws: BenchDraws, progress: Progress | None = None
) -> Array:
    """Errors (R, n, 3) mm of R simulated benches; bounded components stand at their centres."""
    plan = compile_plan(system)
    trials = sum(sizes)
    at_once = max(1, ROWS_AT_A_TIME // trials)
    starts = range(0, draws.count, at_once)
    errors = np.empty((draws.count, trials, 3))

    def simulate(start: int) -> None:
        stop = min(start + at_once, draws.count)
        first = draws.first + start * trials
        z = draw(plan, draws.seed, np.arange(first, first + (stop - start) * trials, dtype=np.int64))
        z = share_draws(plan, z, sizes)
        errors[start:stop] = evaluate(plan, z)[:, target, POINT_ERRORS.index(error)].reshape(stop - start, trials, 3)

    with ThreadPoolExecutor(usable_cores() if draws.threads is None else draws.threads) as pool:
        for done, _ in enumerate(pool.map(simulate, starts), 1):
            if progress is not None:
                progress(done / len(starts))
    if draws.instrument_sd_mm > 0:
        noise = standard_normals(draws.seed, INSTRUMENT_STREAM, draws.count * trials, 3)
        errors += draws.instrument_sd_mm * noise.reshape(errors.shape)
    return errors


def share_draws(plan: ChainPlan, z: Array, sizes: Sequence[int]) -> Array:
    """Deviates (R n, d) in which a bench's trials share what is drawn once, and an installation's its mounting."""
    trials = sum(sizes)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    bench: NDArray[np.int64] = np.arange(len(z)) // trials * trials
    installation = bench + np.tile(np.repeat(starts, sizes), len(z) // trials)
    system = plan.system
    owners = {"unit": bench, "installation": installation}
    drawn = {effect.name: draw_time(effect) for effect in (*system.links, *system.effects, *system.errors_of_points)}
    for block in plan.blocks:
        if (owner := owners.get(drawn[block.name])) is not None:
            z[:, block.start : block.stop] = z[owner, block.start : block.stop]
    return z


def expect(model: LinearModel, error: str, instrument_sd_mm: float) -> Expected:
    """Mean and covariances to first order.  Raises OutOfRangeError where nothing varies from shot to shot."""
    parts = {"unit": np.zeros((3, 3)), "installation": np.zeros((3, 3)), "shot": instrument_sd_mm**2 * np.eye(3)}
    for block in model.blocks:
        parts[draw_time(block.effect)] += block.covariance(error)
    if not np.linalg.eigvalsh(parts["shot"])[0] > 1e-12:
        detail = f"the design predicts no spread of the {error} error from trial to trial in some direction"
        raise OutOfRangeError(Problem("/views", "no-noise", detail, "state the noise of the views, or --instrument-sd"))
    return Expected(model.bias_mm(error), parts["unit"], parts["installation"], parts["shot"])


def draw_time(effect: Effect) -> str:
    """What an effect is drawn with: the bench as a whole ("unit"), an "installation", a "shot".

    An installation mounts the structure and the connector anew; whatever else stays with a unit is the structure, the
    C-arm or the robot of the bench, and stays with it.
    """
    if effect.drawn is Drawn.SHOT:
        return "shot"
    return "installation" if effect.drawn is Drawn.MOUNTING or effect.name in INTERFACES else "unit"

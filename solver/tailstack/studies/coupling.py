"""Is the tail of installation error and noise together more than the parts?  Measured, with intervals.

Every comparison runs on the same deviates: what differs is the geometry alone.  With e(i, n) the error of the full
chain under installation error i and noise n, the parts are e(i, 0) and e(0, n), the noise seen at the biased geometry
is e(i, n) - e(i, 0), and e(i, 0) + e(0, n) is what the error would be if the two did not couple.

Installation errors are compared as designed and at fixed levels; what is said of them, the intervals alone decide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import ceil, floor, hypot, log10, radians, sqrt
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from ..contributors import columns_of, error_law, law_of
from ..design import Design
from ..errors import IllPosedError, LimitError, OutOfRangeError, Problem, StudyError
from ..estimation.checks import check_geometry
from ..geometry.arrays import Array
from ..kernels.process import usable_cores
from ..laws import BETWEEN_SHOTS, Drawn
from ..measures import POINT_ERRORS, PointError
from ..montecarlo.chain import draw, evaluate
from ..montecarlo.plan import ChainPlan, compile_plan
from ..montecarlo.tables import INSTALLATION, SHOT
from ..propagation.linear import LinearModel, chain_of, linearise_all
from ..results import Interval, Provenance, Validity
from ..results.record import Published
from ..results.verdicts import P95
from ..scoring import provenance
from ..system import Reading, System, put_links
from ..tail.declared import law_quantile
from ..verification import prepare
from .sections import SECTIONS, estimate_by_sections, take_quantile

LEAST_TRIALS = SECTIONS * 256  # a section's own P95 then has a dozen trials beyond it

Coupling = Literal["more", "less", "none seen"]


@dataclass(frozen=True, slots=True)
class Ratio:
    """A ratio of two sampled numbers, from the same trials."""

    value: float
    """The ratio."""
    interval: Interval
    """Its confidence interval."""
    first_order: float | None
    """The same ratio to first order; null where it is 1 by definition."""


@dataclass(frozen=True, slots=True)
class CouplingCase:
    """One installation error, in one reading, at one target.  All P95 are of the error norm, mm."""

    reading: Literal["physical", "eq18"]
    """Reading of the installation error."""
    installation: str
    """as designed, or the level in words."""
    rotation_deg: float | None
    """Of a level: about each axis, deg; null as designed."""
    translation_mm: float | None
    """Of a level: along (1, 1, 1), mm; null as designed."""
    target: str
    """Name of the target."""
    p95_together_mm: float
    """P95 of installation error and noise together, mm."""
    p95_installation_mm: float
    """P95 without noise, mm."""
    p95_noise_mm: float
    """P95 of the noise at the nominal geometry, mm."""
    p95_vector_sum_mm: float
    """P95 of the error without noise plus the noise at the nominal geometry, trial by trial, mm."""
    p95_first_order_mm: float
    """P95 of the first-order law, linearised at the biased geometry, mm."""
    nu: float
    """Validity number of depths and crossing, the larger of both geometries'; beyond 0.2 the noise has no standard
    deviation."""
    largest_share: float
    """Largest share of one trial in the sum of squares of the noise, the larger of both geometries'."""
    noise_rms_biased_mm: float | None
    """Root mean square of what the noise adds to the localisation error, installed, mm; null where there is no
    standard deviation."""
    noise_rms_nominal_mm: float | None
    """The same at the nominal geometry, mm; null where there is no standard deviation."""
    gain: Ratio | None
    """Ratio of the two; null where there is no standard deviation."""
    against_quadrature: Ratio
    """P95 together over the root of the sum of squares of the parts."""
    against_sum: Ratio
    """P95 together over the sum of the parts."""
    against_vector_sum: Ratio
    """Together over the vector sum: of the means of the norms between their 94 % and 96 % quantiles."""
    against_first_order: Ratio
    """P95 together over that of the first-order law."""
    coupling: Coupling
    """What the interval of `against_vector_sum` says."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyCoupling(Published):
    """Is the tail of installation error and noise together more than the parts?"""

    schema: Literal["tailstack/study-coupling/1"]
    error: PointError
    """Error that is studied: tcp (at the tool) or localisation (of the target)."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95."""
    seed: int
    """Seed of the trials."""
    trials: int
    """Trials of each case, with the same deviates in all of them."""
    confidence: float
    """Confidence of each interval by itself, 0 to 1."""
    interval_method: str
    """How intervals are made, in words."""
    installation: str
    """Contributors that count as installation error."""
    noise: str
    """Contributors that count as noise."""
    cases: tuple[CouplingCase, ...]
    """Every installation error in every reading at every target."""
    conclusions: tuple[str, ...]
    """What can be said of the cases."""
    validity: Validity
    """How far the linearisation can be trusted."""
    provenance: Provenance


ROOM, MOST = 2**23, 2**25  # trials times targets of a case: by default, and at most (2 GB)
TRIALS = 2**18  # by default
TRIALS_BEYOND = 2**15  # and where first order fails: noise that large sends many a trial to the plain SVD
PILOT, FAILS = 2**11, 1.25  # trials that tell; P95 of the noise over or under first order's by this much
NO_DEVIATION = 0.2  # nu from which the localisation error has no standard deviation (a ratio that may divide by zero)
MOST_SHARE = 0.02  # of one trial in a sum of squares; of 8192 Gaussian errors the largest has 0.002
WINDOW = 0.01  # on either side of P95: the vector sum is compared over this share of the trials
CONFIDENCE = 0.95
LOCALISED = POINT_ERRORS.index("localisation")
LEVELS = ((1.0, 2.0), (2.0, 5.0))  # degrees, mm: the paper's L1 and L2
METHOD = (
    f"sectioning: {SECTIONS} sections of consecutive trials, Student's t with {SECTIONS - 1} degrees of freedom about "
    "the estimate from all trials; numerator and denominator of a section share their deviates"
)
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Norms:
    """What is kept of the trials of one case at one target; all (trials,)."""

    together: Array  # mm
    installation: Array  # mm
    vector_sum: Array  # mm
    gain_squared: Array  # mm^2: what noise adds to the localisation error at the biased geometry


@dataclass(frozen=True, slots=True, eq=False)
class _Still:
    """The trials at the nominal geometry, noise alone, at one target."""

    noise: Array  # (trials,) mm
    gain_squared: Array  # (trials,) mm^2: of the localisation error
    vectors: Array  # (3, trials) mm


def study_coupling(
    design: Design | System,
    *,
    trials: int | None = None,
    seed: int = 0,
    levels: Sequence[Level] = LEVELS,
    error: PointError = "tcp",
    threads: int | None = None,
    progress: Progress | None = None,
) -> StudyCoupling:
    """Compare installation error and noise together with the parts, as designed and at fixed installation errors.

    levels: (rotation deg, translation mm) of the structure-connector interface: the same angle about each axis
    through its pivot, then the translation along (1, 1, 1)/sqrt(3), everything else in place.  trials: of each case,
    rounded up to a multiple of the sections; the digits depend on it and on the seed, not on ``threads``.
    Raises DesignError, IllPosedError; StudyError for a level that turns fiducials out of sight; OutOfRangeError
    for fewer than ``LEAST_TRIALS`` trials, a level that is not one, or a design that draws nothing at each shot.
    """
    ready = prepare(design)
    system = ready.system
    nominal = remove_biases(system)
    readings = (replace(system, reading=reading) for reading in Reading)
    cases = [case for each in readings for case in list_cases(each, nominal, levels, error)]
    at_rest = compile_plan(nominal, held=BETWEEN_SHOTS)
    if not any(view.fiducial_noise_px or view.target_noise_px for view in system.views):
        detail = "the views have no noise, so there is nothing that could couple with the installation error"
        raise OutOfRangeError(Problem("/views", "no-noise", detail, "state fiducial_noise_px and target_noise_px"))
    models = linearise_all(chain_of(nominal))
    beyond = ready.trust.expected_error_percent is None or _fails(at_rest, models, error, seed)
    size = ceil(_choose_trials(trials, len(system.targets), beyond) / SECTIONS)
    sampler = _Sampler(at_rest, seed, size, POINT_ERRORS.index(error), threads, progress, 1 + len(cases))
    still = sampler.still()
    records = []
    for number, case in enumerate(cases, 1):
        norms = sampler.of(case, still, number)
        records += [
            _compare_case(case, target.name, error, norms[place], still[place], models[target.name])
            for place, target in enumerate(system.targets)
        ]
    return StudyCoupling(
        schema="tailstack/study-coupling/1",
        error=error,
        quantile=P95,
        seed=seed,
        trials=size * SECTIONS,
        confidence=CONFIDENCE,
        interval_method=METHOD,
        installation=name_sources(models[system.targets[0].name], held=True),
        noise=name_sources(models[system.targets[0].name], held=False),
        cases=tuple(records),
        conclusions=(*write_conclusions(records), *(case.remark for case in cases if case.remark)),
        validity=ready.trust,
        provenance=provenance(system, simulated=True),
    )


def _choose_trials(asked: int | None, targets: int, beyond: bool) -> int:
    """Trials of each case: as asked, or what the design's noise and its number of targets afford."""
    affordable = TRIALS_BEYOND if beyond else TRIALS
    wanted = min(affordable, max(ROOM // targets, LEAST_TRIALS)) if asked is None else asked
    if wanted < LEAST_TRIALS:
        detail = f"at least {LEAST_TRIALS} trials are needed for the intervals; got {wanted}"
        raise OutOfRangeError(Problem("", "too-few-trials", detail, f"--trials {TRIALS}"))
    if wanted * targets > MOST:
        detail = f"{wanted:,} trials at {targets} targets are more than the {MOST:,} that are held at a time"
        raise LimitError(Problem("", "too-many", detail, f"--trials {MOST // targets}"))
    return wanted


def _fails(at_rest: ChainPlan, models: dict[str, LinearModel], error: PointError, seed: int) -> bool:
    """Whether a few trials of the noise alone are far from first order, whatever its validity number says."""
    z = _keep_stream(at_rest, draw(at_rest, seed, np.arange(PILOT, dtype=np.int64)), SHOT)
    norms = np.linalg.norm(evaluate(at_rest, z)[:, :, POINT_ERRORS.index(error)], axis=2).T
    for model, sample in zip(models.values(), norms, strict=True):
        columns = columns_of(model, error)
        quiet = law_of(np.zeros(3), columns.only(~columns.constant_in(BETWEEN_SHOTS)))
        ratio = take_quantile(sample, P95) / law_quantile(quiet, P95).quantile_mm
        if not 1 / FAILS < ratio < FAILS:
            return True
    return False


# --- sampling -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Sampler:
    """Runs the sections of a case; every case sees the same deviates."""

    at_rest: ChainPlan
    seed: int
    size: int  # trials of a section
    metric: int
    threads: int | None
    progress: Progress | None
    runs: int

    def _draw_block(self, number: int) -> tuple[slice, Array]:
        at = slice(number * self.size, (number + 1) * self.size)
        return at, draw(self.at_rest, self.seed, np.arange(at.start, at.stop, dtype=np.int64))

    def _each(self, section: Callable[[int], None], run: int) -> None:
        with ThreadPoolExecutor(usable_cores() if self.threads is None else self.threads) as pool:
            for done, _ in enumerate(pool.map(section, range(SECTIONS)), 1):
                if self.progress is not None:
                    self.progress(run * SECTIONS + done, self.runs * SECTIONS)

    def still(self) -> list[_Still]:
        """Noise at the nominal geometry, by target."""
        by_target = np.empty((len(self.at_rest.system.targets), 5, SECTIONS * self.size))

        def section(number: int) -> None:
            at, z = self._draw_block(number)
            errors = evaluate(self.at_rest, _keep_stream(self.at_rest, z, SHOT))
            by_target[:, 0, at] = np.linalg.norm(errors[:, :, self.metric], axis=2).T
            by_target[:, 1, at] = (errors[:, :, LOCALISED] ** 2).sum(axis=2).T
            by_target[:, 2:, at] = np.moveaxis(errors[:, :, self.metric], 0, -1)

        self._each(section, 0)
        return [_Still(rows[0], rows[1], rows[2:]) for rows in by_target]

    def of(self, case: InstallationCase, still: Sequence[_Still], run: int) -> list[_Norms]:
        """What is kept of a case, by target."""
        by_target = np.empty((len(still), 4, SECTIONS * self.size))

        def section(number: int) -> None:
            at, z = self._draw_block(number)
            inputs, alone = z, _keep_stream(self.at_rest, z, INSTALLATION)
            if case.level is not None:  # it stands still: its error without noise is one vector
                inputs, alone = _keep_stream(self.at_rest, z, SHOT), np.zeros((1, z.shape[1]))
            together = [evaluate(plan, inputs) for plan in case.plans]
            quiet = [evaluate(plan, alone) for plan in case.plans]
            for place, which in enumerate(case.plan_of):
                e, rest = together[which][:, place], quiet[which][:, place]
                by_target[place, 0, at] = np.linalg.norm(e[:, self.metric], axis=1)
                by_target[place, 1, at] = np.linalg.norm(rest[:, self.metric], axis=1)
                by_target[place, 2, at] = np.linalg.norm(rest[:, self.metric] + still[place].vectors[:, at].T, axis=1)
                by_target[place, 3, at] = ((e[:, LOCALISED] - rest[:, LOCALISED]) ** 2).sum(axis=1)

        self._each(section, run)
        return [_Norms(*rows) for rows in by_target]


def _keep_stream(plan: ChainPlan, z: Array, stream: int) -> Array:
    """The deviates of one stream, the others at their centre."""
    deviates = np.zeros_like(z)
    for block in plan.blocks:
        if block.stream == stream:
            deviates[:, block.start : block.stop] = z[:, block.start : block.stop]
    return deviates


# --- what the samples say -------------------------------------------------------------------------


def average_near(values: Array, p: float) -> float:
    """Mean of the order statistics of values (n,) between the quantiles ``p - WINDOW`` and ``p + WINDOW``.

    Two samples that differ trial by trial by less than their order statistics lie apart have the same trial at a
    quantile, and its own difference is all that a ratio of quantiles then sees, however many trials there are; the
    mean over a share of the trials sees theirs, and sections see it as the whole does.
    """
    count = len(values)
    low, high = ceil(count * (p - WINDOW)) - 1, ceil(count * (p + WINDOW))
    return float(np.partition(values, (low, high - 1))[low:high].mean())


def _estimate_ratio(estimate: Callable[[slice], float], trials: int, first_order: float | None = None) -> Ratio:
    return Ratio(*estimate_by_sections(estimate, trials, CONFIDENCE), first_order)


def _compare_case(
    case: InstallationCase, target: str, error: PointError, norms: _Norms, still: _Still, resting: LinearModel
) -> CouplingCase:
    trials = len(still.noise)
    first = _predict(case, case.models[target], resting, error)

    def p95(values: Array) -> Callable[[slice], float]:
        return lambda part: take_quantile(values[part], P95)

    together, installed, noise = p95(norms.together), p95(norms.installation), p95(still.noise)
    added, every = p95(norms.vector_sum), slice(0, trials)

    def over(denominator: Callable[[slice], float], predicted: float | None) -> Ratio:
        return _estimate_ratio(lambda part: together(part) / denominator(part), trials, predicted)

    def rms(squares: Array, part: slice) -> float:
        return sqrt(float(squares[part].mean()))

    nu = max(case.models[target].nonlinearity.divisor, resting.nonlinearity.divisor)
    shared = max(float(squares.max() / squares.sum()) for squares in (norms.gain_squared, still.gain_squared))
    spread = nu <= NO_DEVIATION and shared <= MOST_SHARE
    gain = _estimate_ratio(
        lambda part: rms(norms.gain_squared, part) / rms(still.gain_squared, part), trials, first.gain
    )
    against_added = _estimate_ratio(
        lambda part: average_near(norms.together[part], P95) / average_near(norms.vector_sum[part], P95),
        trials,
        first.together / first.vector_sum,
    )
    return CouplingCase(
        reading=case.reading.value,
        installation=case.name,
        rotation_deg=None if case.level is None else case.level[0],
        translation_mm=None if case.level is None else case.level[1],
        target=target,
        p95_together_mm=together(every),
        p95_installation_mm=installed(every),
        p95_noise_mm=noise(every),
        p95_vector_sum_mm=added(every),
        p95_first_order_mm=first.together,
        nu=nu,
        largest_share=shared,
        noise_rms_biased_mm=rms(norms.gain_squared, every) if spread else None,
        noise_rms_nominal_mm=rms(still.gain_squared, every) if spread else None,
        gain=gain if spread else None,
        against_quadrature=over(
            lambda part: hypot(installed(part), noise(part)), first.together / hypot(first.installation, first.noise)
        ),
        against_sum=over(
            lambda part: installed(part) + noise(part), first.together / (first.installation + first.noise)
        ),
        against_vector_sum=against_added,
        against_first_order=over(lambda part: first.together, None),
        coupling=tell_coupling(against_added),
    )


@dataclass(frozen=True, slots=True)
class _FirstOrder:
    """P95 to first order, mm, and the ratio of noise gains."""

    together: float
    installation: float
    noise: float
    vector_sum: float  # with the noise of the nominal geometry
    gain: float


def _predict(case: InstallationCase, model: LinearModel, still: LinearModel, error: str) -> _FirstOrder:
    at = error_law(model, error, P95)
    once = at.columns.constant_in(BETWEEN_SHOTS)
    shot, mounted = at.columns.only(~once), at.columns.only(once & (case.level is None))
    at_rest = columns_of(still, error)
    quiet = at_rest.only(~at_rest.constant_in(BETWEEN_SHOTS))
    # Of a level only the interface's own displacement counts, and bounded components stand at their centres.
    mean = at.worst.mean_mm if case.level is None else model.bias_mm(error)
    zero = np.zeros(3)
    spread = [noise_variance(linear) for linear in (model, still)]
    return _FirstOrder(
        together=law_quantile(law_of(mean, mounted, shot), P95).quantile_mm,
        installation=law_quantile(law_of(mean, mounted), P95).quantile_mm,
        noise=law_quantile(law_of(zero, quiet), P95).quantile_mm,
        vector_sum=law_quantile(law_of(mean, mounted, quiet), P95).quantile_mm,
        gain=sqrt(spread[0] / spread[1]),
    )


def noise_variance(model: LinearModel) -> float:
    """mm^2: trace of the covariance that the noise, all that is drawn at each shot, gives the localisation error."""
    noise = (block for block in model.blocks if block.effect.drawn is Drawn.SHOT)
    return sum(float((block.columns_mm("localisation") ** 2).sum()) for block in noise)


Level = tuple[float, float]  # degrees about each axis, mm along (1, 1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class InstallationCase:
    """One installation error in one reading."""

    reading: Reading
    level: Level | None  # None: as designed
    plans: tuple[ChainPlan, ...]  # one for each worst vertex of bounded components
    plan_of: tuple[int, ...]  # of each target
    models: dict[str, LinearModel]
    remark: str = ""  # what is not imaged there

    @property
    def name(self) -> str:
        return "as designed" if self.level is None else name_level(self.level)


def name_level(level: Level) -> str:
    return f"{level[0]:g} deg + {level[1]:g} mm"


def level_torsor(level: Level) -> Array:
    """(6,) rad, mm: one angle about each axis, a translation along (1, 1, 1)/sqrt(3).  Raises OutOfRangeError."""
    rotation_deg, translation_mm = level
    if not (abs(rotation_deg) <= 45 and abs(translation_mm) <= 1000):
        detail = (
            f"a level is at most 45 deg about each axis and 1000 mm; got {rotation_deg:g} deg and {translation_mm:g} mm"
        )
        raise OutOfRangeError(Problem("", "level", detail))
    return np.array([radians(rotation_deg)] * 3 + [translation_mm / sqrt(3)] * 3)


def remove_biases(system: System) -> System:
    """The system without any known error: in mounts, load and all other effects."""

    links = [replace(link, known=np.zeros_like(link.known)) for link in system.links]
    effects = tuple(replace(effect, known=np.zeros_like(effect.known)) for effect in system.effects)
    return replace(put_links(system, links), effects=effects)


def name_sources(model: LinearModel, *, held: bool) -> str:
    """What counts as installation error (held from shot to shot, and all that is known) or as noise, in words."""
    own = [block for block in model.blocks if (block.effect.drawn is not Drawn.SHOT) == held]
    words = [*(["all that is known"] if held else []), *(block.effect.words for block in own)]
    levels = [level for level in Drawn if level in {block.effect.drawn for block in own}] or [Drawn.UNIT]
    drawn = " or ".join(f"once per {level}" for level in levels) if held else "at each shot"
    return "; ".join(dict.fromkeys(words)) + f": drawn {drawn}"


def list_cases(system: System, nominal: System, levels: Sequence[Level], error: str) -> Iterable[InstallationCase]:
    """As designed, with bounded components at their worst ends, and the levels, in the reading of ``system``."""
    models = linearise_all(chain_of(system))
    ends = [tuple(sorted(error_law(m, error, P95).worst.vertex(m).items())) for m in models.values()]
    distinct = list(dict.fromkeys(ends))
    plans = tuple(compile_plan(system, vertex=dict(vertex)) for vertex in distinct)
    yield InstallationCase(system.reading, None, plans, tuple(distinct.index(vertex) for vertex in ends), models)
    for level in levels:
        mount = replace(nominal.structure_connector, known=level_torsor(level))
        moved = replace(nominal, reading=system.reading, structure_connector=mount)
        remark, plan = _check_level(moved, level), compile_plan(moved)
        yield InstallationCase(system.reading, level, (plan,), (0,) * len(ends), linearise_all(chain_of(moved)), remark)


def _check_level(moved: System, level: Level) -> str:
    """What is not imaged at a level, or "".  Raises StudyError where the level leaves nothing to be estimated.

    Outside an image, the study goes on as if the detector were large enough: a paper's level may be larger than a
    field of view.
    """
    unbounded = replace(moved, views=tuple(replace(view, image_size_px=None) for view in moved.views))
    try:
        check_geometry(unbounded)
    except IllPosedError as error:
        detail = f"at {name_level(level)}, {moved.reading.value} reading: {error.problems[0].detail}"
        raise StudyError(Problem("", "level", detail, "name a smaller --level")) from None
    try:
        check_geometry(moved)
    except IllPosedError as error:
        return (
            f"At {name_level(level)}, {moved.reading.value} reading, {error.problems[0].detail}: there the study takes "
            "the detector as large enough."
        )
    return ""


ROUNDING = 1e-9  # relative: what double precision leaves of an identity


def tell_side(ratio: Ratio) -> int:
    """1 above one, -1 below, 0 where the interval (or rounding) does not tell."""
    if abs(ratio.value - 1) <= ROUNDING:
        return 0
    return int(ratio.interval[0] > 1) - int(ratio.interval[1] < 1)


def tell_coupling(ratio: Ratio) -> Coupling:
    return ("none seen", "more", "less")[tell_side(ratio)]


def widen(ratio: Ratio, count: int) -> Ratio:
    """The same with an interval of which ``count`` hold together (Bonferroni); its own holds by itself."""
    alone, together = (float(stdtrit(SECTIONS - 1, 1 - (1 - CONFIDENCE) / (2 * m))) for m in (1, count))
    low, high = ratio.interval
    half = (high - low) / 2 * together / alone
    return replace(ratio, interval=(ratio.value - half, ratio.value + half))


def write_percent(ratio: Ratio) -> str:
    """How far a ratio is from one: ``+3.02 %``, with one to six decimals, so many that the half-width of the interval
    has two digits."""
    half = 50 * (ratio.interval[1] - ratio.interval[0])
    decimals = min(max(1 - floor(log10(max(half, 1e-7))), 1), 6)
    return f"{round(100 * (ratio.value - 1), decimals) + 0.0:+.{decimals}f} %"


def write_conclusions(cases: Sequence[CouplingCase]) -> tuple[str, ...]:
    """What holds for all cases together, in sentences that only their intervals, widened to hold together, decide."""
    return (_judge_sum(cases), _judge_quadrature(cases), _judge_first_order(cases))


def _judge_sum(cases: Sequence[CouplingCase]) -> str:
    sides = [tell_side(widen(case.against_vector_sum, len(cases))) for case in cases]
    more, less = sides.count(1), sides.count(-1)
    over = sum(tell_side(widen(case.against_sum, len(cases))) > 0 for case in cases)
    furthest = max((abs(case.against_vector_sum.value - 1) for case in cases), default=0.0)
    no_more, added = "Together they make no more than their sum: in", "that of both added shot by shot"
    if not more and not less:
        sentence = f"{no_more} no case is P95 told from {added}"
    elif not more:
        sentence = f"{no_more} {less} of {len(cases)} cases P95 is less than {added}"
        sentence += ", in the others no difference is seen" if less < len(cases) else ""
    else:
        sentence = f"In {more} of {len(cases)} cases P95 is more than {added}"
        sentence += f", in {less} it is less" if less else ""
    sentence += f" (largest difference {100 * furthest:.2g} %; all intervals together 95 %)"
    exceeded = f"is exceeded in {over} of {len(cases)} cases" if over else "is exceeded nowhere"
    return f"{sentence}. The plain sum of both P95 {exceeded}."


MOVES = {"physical": "the structure moves", "eq18": "the assumed coordinates move"}  # by reading


def _judge_quadrature(cases: Sequence[CouplingCase]) -> str:
    above = [case for case in cases if tell_side(widen(case.against_quadrature, len(cases))) > 0]
    if not above:
        return "P95 is nowhere seen above the root of the sum of squares of the parts."
    most = max(above, key=lambda case: case.against_quadrature.value)
    predicted = 100 * ((most.against_quadrature.first_order or 1.0) - 1)
    return (
        f"P95 is above the root of the sum of squares of the parts in {len(above)} of {len(cases)} cases, at most by "
        f"{write_percent(most.against_quadrature)} ({most.installation}, {MOVES[most.reading]}); the estimate, where "
        f"they only add, says {predicted:+.2f} % there. So do not combine a known displacement and noise by squares."
    )


def _judge_first_order(cases: Sequence[CouplingCase]) -> str:
    ends = [end for case in cases for end in widen(case.against_first_order, len(cases)).interval]
    return (
        "P95 against the estimate, all intervals together: "
        f"{100 * (min(ends) - 1):+.2f} .. {100 * (max(ends) - 1):+.2f} %."
    )

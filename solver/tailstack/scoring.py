"""The first-order score: bias, covariance, the tail under the declared laws, bounds, budget, verdict."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, product
from math import inf, isinf, isnan
from typing import Any

import numpy as np

from .budget import budget, list_levers, worth_of
from .contributors import ErrorLaw, error_law, risk_of_units, value_of
from .cures import ask_label
from .design import Design, check_design
from .effects import EFFECTS
from .errors import DesignError, OutOfRangeError, Problem
from .estimation.checks import examine
from .estimation.missed import NEGLIGIBLE, probability_unanswered
from .geometry.arrays import Array
from .geometry.rotation import transform_points
from .kernels.sources import digest_of_package
from .laws import Drawn
from .losses import PAIRS_UP_TO, LossSearch, Shots, probability_of_none
from .measures import MEASURE, POINTS
from .measures.measure import Site
from .propagation.linear import ErrorModel, LinearModel, chain_of, covariance_block_diagonal, linearise_all, models_of
from .propagation.validity import (
    error_percent,
    refuse_outside_range,
    second_order_moments,
    widen_validity,
    worst_validity,
)
from .reliability import slip_reliabilities
from .results import (
    Check,
    Finding,
    Interval,
    Lever,
    Loss,
    Losses,
    Matrix3,
    MeasureResult,
    MetricScore,
    PerUnit,
    Provenance,
    Score,
    SecondOrder,
    Severity,
    TargetCovariance,
    TargetScore,
    TitleBlock,
    Validity,
    Vector3,
    ViewCheck,
)
from .results.quality import ppk_of
from .results.score import SHOTS, FiftyShots
from .results.verdicts import BREACHES_MM, MISSED, P95, UNBOUNDED, Breach, MeasureShare, decisive_check
from .system import INTRINSICS_WORDS, Requirement, System
from .tail.bounds import bounds
from .tail.declared import LawReading, LawSummary, LinearLaw, MixedLaw, PairLaw
from .tail.gaussian import norm_quantile
from .tail.per_unit import UnitRisk
from .verdict import conclude, judge
from .version import __version__

MOST_RELATED = 64  # targets of which covariances are told: 2016 pairs, 1 MB
T_15 = 2.1314  # of Student's law with 15 degrees of freedom, as 16 scramblings have them: 95 % on both sides


def not_included(system: System, *, simulated: bool = False, missed: bool = False) -> tuple[str, ...]:
    """What no number of this design includes.

    simulated: of the whole chain, not of its first order; missed: the record says what missed fiducials do.
    """
    lines = [
        "an uneven detector, motion during a shot",
        *(kind.not_modelled(system) for kind in EFFECTS),
        "fiducials mistaken for one another" + ("" if missed else " or missed"),
        "" if simulated else "products of two random errors (second order)",
        "whatever the design document does not list",
    ]
    return tuple(line for line in lines if line)


def score(
    design: Design | System,
    *,
    second_order: bool = False,
    losses: bool = True,
    reliability: bool = False,
    fifty_shots: bool = False,
    covariances: bool = False,
    targets: Collection[str] | None = None,
) -> Score:
    """Score a design to first order, every target and requirement.

    Bias (mm) and covariance (mm2) are those of the error at the tool, in tcp, and of the located target, in con; P95 is
    the quantile of the error's norm under the declared laws, mm; the budget has each source of error by itself.

    ``second_order`` adds the second-order correction where its series holds (milliseconds; refused, with the reason,
    where it does not).  ``losses``: whether the worst loss of one fiducial and of two is looked for, half as long
    again, and how far each lever leads by itself.  ``reliability`` adds, for each view and fiducial, the smallest slip
    of its image that a test of residuals notices, and what one below it does.  ``fifty_shots`` adds what fifty shots
    come to that stand for all, of the requirement that decides.  ``covariances`` adds the covariance of the errors at
    every two targets, (3, 3) mm2 of those at the tool, in tcp, and as located, in con.  ``targets``: names of those
    that are told, with their budgets, beside the one at which the design is decided and the one with the largest P95;
    without it all of them.  Validity, verdict, losses and measures are of all targets either way.  Raises DesignError
    for a document that breaks its rules and for a name that no target has, IllPosedError for a geometry that does not
    determine the answer, OutOfRangeError for covariances of too many targets.
    """
    system, findings, views = checked_system(design)
    chain = chain_of(system)
    models = linearise_all(chain)
    search = LossSearch(chain, models) if losses or system.loss_probability else None
    trust = trust_of(system, models)
    metrics = _score_metrics(system, models, search)
    checks = tuple(
        check_requirement(requirement, name, trust, metrics[name, requirement.error])
        for requirement in system.requirements
        for name in requirement.targets
    )
    decides, derived = decisive_check(checks), system.derived_metrics
    judged = {(name, item.error) for item in system.requirements for name in item.targets}
    if search is not None and system.loss_probability:
        trust = trust_over_shots(trust, search)
        findings += (_remark_missed(search, trust),)
    with_levers = losses and not system.loss_probability  # which rest on the budgets of all targets
    told = _choose_targets(targets, decides, metrics, models)
    scored = tuple(
        _score_target(system, metrics[name, "tcp"], metrics[name, "localisation"], second_order)
        for name in (models if with_levers else told)
    )
    return Score(
        schema="tailstack/score/1",
        targets=tuple(each for each in scored if each.name in told),
        validity=trust,
        views=views,
        verdict=conclude(checks, findings, basis_of("first order", system)),
        provenance=provenance(system, missed=bool(system.loss_probability)),
        losses=_losses(system, search, checks, metrics) if losses and search is not None else (),
        reliability=slip_reliabilities(chain, models) if reliability else (),
        measures=tuple(_score_measure(metrics[each.key], each.site, each.key in judged) for each in derived),
        levers=tuple(_levers(design, system, metrics, scored)) if with_levers else (),
        fifty_shots=_draw_fifty(decides, metrics[decides.target, decides.error]) if fifty_shots and decides else None,
        covariances=tuple(_relate_targets(models)) if covariances else (),
    )


def _choose_targets(
    asked: Collection[str] | None,
    decides: Check | None,
    metrics: Mapping[tuple[str, str], ErrorScore],
    every: Collection[str],
) -> list[str]:
    """Names of those that a score tells, in their order.  Raises DesignError."""
    if asked is None:
        return list(every)
    if unknown := [name for name in asked if name not in every]:
        detail = f"no target is called {unknown[0]!r}; there are {', '.join(list(every)[:20])}"
        raise DesignError(Problem("/targets", "unknown-target", detail, ask_label(unknown[0], list(every))))
    widest = max(every, key=lambda name: metrics[name, "tcp"].summary.quantile.quantile_mm)
    told = {*asked, widest, *([] if decides is None else [decides.target])}
    return [name for name in every if name in told]


def _levers(
    design: Design | System, system: System, metrics: Mapping[tuple[str, str], ErrorScore], told: Sequence[TargetScore]
) -> Iterator[Lever]:
    for item in _requirements_of(system):
        models = [metrics[name, item.error].model for name in item.targets]
        by_budget = item.error == "tcp" and item.is_quantile and item.risk == "pooled" and item.quantile == P95
        budgets = [each.contributors for each in told if by_budget and each.name in item.targets]
        yield from list_levers(None if isinstance(design, System) else design.document, item, models, budgets)


@dataclass(frozen=True, slots=True)
class TargetErrors(MetricScore):
    """What a picture of the errors at one target needs: the TCP error, and the localisation error below it."""

    name: str
    localisation: MetricScore


@dataclass(frozen=True, slots=True)
class Errors:
    """The errors of a design without budget, risk of units and validity, which take most of a score's time."""

    targets: tuple[TargetErrors, ...]


def score_errors(design: Design) -> Errors:
    """What ``score`` says of the errors themselves, to the last digit.  Raises DesignError, IllPosedError."""
    system, _, _ = checked_system(design)
    chain = chain_of(system)
    models = linearise_all(chain)
    search = LossSearch(chain, models) if system.loss_probability else None
    every = _score_metrics(system, models, search)
    pairs = ((name, _metric(every[name, "tcp"]), _metric(every[name, "localisation"])) for name in models)
    return Errors(tuple(TargetErrors(**_fields(tcp), name=name, localisation=located) for name, tcp, located in pairs))


def _fields(metric: MetricScore) -> dict[str, Any]:
    return {field: getattr(metric, field) for field in MetricScore.__dataclass_fields__}


def _requirements_of(system: System) -> tuple[Requirement, ...]:
    """Every requirement; without one, P95 of the error at the tool without a limit."""
    every = tuple(target.name for target in system.targets)
    return system.requirements or (Requirement("", "tcp", P95, inf, P95, every),)


def _losses(
    system: System, search: LossSearch, checks: tuple[Check, ...], metrics: dict[tuple[str, str], ErrorScore]
) -> tuple[Losses, ...]:
    """What losses do to every requirement; without one, to P95 of the error at the tool."""
    losses = []
    for item in _requirements_of(system):
        if not item.is_quantile:  # what is lost is looked for by quantiles
            continue
        if any(search.metrics[name, item.error].site.other_shot for name in item.targets):  # and in one shot
            continue
        p, values = item.quantile, [check.value for check in checks if check.requirement == item.name]
        if item.risk == "pooled" and (system.loss_probability or not values):
            values = [metrics[name, item.error].read(p).quantile.quantile_mm for name in item.targets]
        pair = len(system.fiducial_labels) <= PAIRS_UP_TO
        single, double = (_loss(search, item, lost) if lost == 1 or pair else None for lost in (1, 2))
        assert single is not None
        limit = None if isinf(item.limit) else item.limit
        mixture = None if MEASURE[item.error].paired else search.mixture(item.error, p, item.targets)
        losses.append(Losses(item.name, limit, max(values), single, double, mixture, MEASURE[item.error].unit))
    return tuple(losses)


def _loss(search: LossSearch, item: Requirement, lost: int) -> Loss:
    """The worst loss of so many; where each unit has a limit, the one that is worst for all units together."""
    loss = search.worst(lost, item.error, item.quantile, item.targets)
    if item.units_fraction is None or loss.value is None:
        return loss
    return replace(loss, value=worth_of(item, search.model_without(loss.target, item.error, loss.lost)))


def checked_system(design: Design | System) -> tuple[System, tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """Compile and check a design, or check a system.  Raises DesignError, IllPosedError."""
    if isinstance(design, System):
        return design, *examine(design)
    return check_design(design)


def trust_of(system: System, models: dict[str, LinearModel]) -> Validity:
    """The validity of first order at the worst target, of shots in which no fiducial is missed."""
    return worst_validity([(model.nonlinearity, model.turns) for model in models.values()], system)


def trust_over_shots(trust: Validity, search: LossSearch) -> Validity:
    """The validity of P95 over all shots at the worst target and error; trust: of those that miss no fiducial."""
    worst = 0.0
    for name, measure in product(search.models, POINTS):
        shots = search.shots(name, measure.name, P95)
        value, (low, high) = shots.value(P95), shots.interval(P95)
        if value > 0:
            worst = max(worst, high / value - 1, value / low - 1 if low > 0 else inf)
    return widen_validity(trust, 100 * worst)


def basis_of(how: str, system: System) -> str:
    """What a verdict rests on: first order or Monte Carlo, and whether it is of shots that miss fiducials, too."""
    return f"{how}, {MISSED}" if system.loss_probability else how


def _remark_missed(search: LossSearch, trust: Validity) -> Finding:
    """That a verdict is of all shots, and where first order cannot say what those with fiducials missed come to."""
    name = max(search.models, key=lambda each: search.shots(each, "tcp", P95).beyond_limits)
    shots = search.shots(name, "tcp", P95)
    none = probability_of_none(search.system.loss_probability)
    message = (
        f"in {1 - none:.2%} of shots a fiducial or more is missed, as often as the design says; quantiles, mean of the "
        "worst 5 %, exceedance and verdict are of all shots, budget and risk of each unit of those that miss none"
    )
    if paired := [metric.measure.words for metric in search.system.derived_metrics if metric.measure.paired]:
        message += f"; {paired[0]}: of those that miss none, so the estimate decides no limit of it"
    if trust.expected_error_percent is None:
        message += f"; {shots.open_words}: how far the estimate is from a simulation is not known"
    severity: Severity = "note" if trust.expected_error_percent else "warning"
    return Finding("missed-fiducials", severity, message, "/fiducials/loss_probability", shots.beyond_limits)


@dataclass(frozen=True, eq=False)
class ErrorScore:
    """One measure at one of its sites: its model, its law at the worst vertex, and what is read off that when it is
    asked for.

    Where the design says how often fiducials are missed, ``summary`` is of all shots; ``at`` is of those that miss
    none.
    """

    model: ErrorModel
    at: ErrorLaw
    limit: float | None
    search: LossSearch | None = None  # where fiducials are missed

    @cached_property
    def summary(self) -> LawReading | LawSummary:
        """About P95."""
        shots = self.shots(P95)
        return self.read(P95) if shots is None else shots.law.summary(P95, self.limit)

    @cached_property
    def read(self) -> Callable[[float], LawReading]:
        """What its law says about a quantile, at the vertex that is worst for it; no fiducial missed."""
        return cache(lambda quantile: LawReading(self.law_at(quantile).law, quantile, self.limit))

    @property
    def times_apart(self) -> float:
        """As the model has it."""
        return self.model.times_apart(self.at.error)

    @cached_property
    def law_at(self) -> Callable[[float], ErrorLaw]:
        """At the vertex that is worst for a quantile."""
        alike = not self.at.worst.signs
        return cache(lambda q: self.at if q == P95 or alike else error_law(self.model, self.at.error, q))

    @property
    def has_losses(self) -> bool:
        """Whether fiducials are missed in some shots."""
        return self.search is not None

    def shots(self, quantile: float) -> Shots | None:
        """All shots, where fiducials are missed in some of them; of two ends no law of these is known."""
        if self.search is None or MEASURE[self.at.error].paired:
            return None
        return self.search.shots(self.model.site, self.at.error, quantile)

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean (3,) and covariance (3, 3)."""
        shots = self.shots(P95)
        if shots is None:
            return self.at.law.mean, self.at.total_covariance
        return shots.law.mean, shots.law.total_covariance

    @cached_property
    def unit_risk(self) -> Callable[[float, float | None, float, Drawn], UnitRisk]:
        """:func:`risk_of_units` at a quantile, a limit, a fraction and a level; no fiducial missed."""
        return cache(lambda quantile, *of: risk_of_units(self.model, self.law_at(quantile), quantile, *of))


def _score_metrics(
    system: System, models: dict[str, LinearModel], search: LossSearch | None
) -> dict[tuple[str, str], ErrorScore]:
    """Every measure wherever it is read, by the names of site and measure."""
    every = models_of(system, models) if search is None else search.every
    return {(name, error): _score_error(system, model, error, search) for (name, error), model in every.items()}


def _score_error(system: System, model: ErrorModel, error: str, search: LossSearch | None) -> ErrorScore:
    limit = tightest_limit(system, model.site, error)
    found = ErrorScore(model, error_law(model, error, P95), limit, search if system.loss_probability else None)
    if found.has_losses:  # first: from which lattices a mixture is read depends on what was asked before
        _ = found.summary
    return found


def _score_measure(error: ErrorScore, site: Site, judged: bool) -> MeasureResult:
    measure, summary, (mean, total) = MEASURE[error.at.error], error.summary, error.moments
    limited, size = site.is_scalar and error.limit is not None, np.linalg.norm(mean.reshape(-1, 3), axis=1).max()
    return MeasureResult(
        measure=measure.name,
        site=error.model.site,
        words=measure.words,
        unit=measure.unit,
        known=float(mean[0] if site.is_one_sided else size),
        mean=summary.mean_norm_mm,
        p95=summary.quantile.quantile_mm,
        p95_interval=None,
        cvar95=summary.cvar_mm,
        limit=error.limit,
        exceedance_probability=summary.exceedance,
        breaches=()
        if site.corridor_mm is None or error.has_losses
        else _score_breaches(error.at.law, site.corridor_mm),
        ppk=ppk_of(error.limit or 0.0, float(mean[0]), float(np.sqrt(total[0, 0])), site.is_one_sided)
        if limited
        else None,
        shares=_share_out(error) if judged else (),
    )


def _share_out(error: ErrorScore) -> tuple[MeasureShare, ...]:
    """By contributor, of which the images of two targets are one."""
    squares: defaultdict[tuple[str, str, str], float] = defaultdict(float)
    for block in error.model.blocks:
        key = block.contributor, block.label, str(block.effect.drawn)
        squares[key] += float((block.columns_mm(error.at.error) ** 2).sum())
    whole = sum(squares.values()) or 1.0
    ordered = sorted(squares.items(), key=lambda item: -item[1])
    return tuple(MeasureShare(*key, variance_share=square / whole) for key, square in ordered)


def _draw_fifty(check: Check, error: ErrorScore) -> FiftyShots:
    """Of what a check limits."""
    measure, shots = MEASURE[check.error], error.shots(check.quantile)
    law = MixedLaw([error.law_at(check.quantile).law], np.ones(1)) if shots is None else shots.law
    values = [None if isnan(value) else value for value in law.middles(SHOTS).tolist()]
    limit = check.limit if check.beyond is None else check.beyond
    beyond = error.read(check.quantile).beyond(limit) if shots is None else law.exceedance(limit)
    return FiftyShots(f"{measure.words}, {check.target}", measure.unit, tuple(values), limit, beyond)


def _relate_targets(models: Mapping[str, LinearModel]) -> Iterator[TargetCovariance]:
    """Of every two; what acts on the image of a target (``Effect.of_target``) they do not have in common.

    Raises OutOfRangeError.
    """
    if len(models) > MOST_RELATED:
        detail = f"{len(models)} targets, samples of regions counted, make {len(models) * (len(models) - 1) // 2} pairs"
        hint = f"covariances are told of at most {MOST_RELATED} targets"
        raise OutOfRangeError(Problem("/targets", "too-many-targets", detail, hint))
    columns = {
        (name, point.name): np.hstack([b.columns_mm(point.name) for b in model.blocks if not b.effect.of_target])
        for name, model in models.items()
        for point in POINTS
    }
    for first, second in combinations(models, 2):
        own = (columns[first, point.name] @ columns[second, point.name].T for point in POINTS)
        yield TargetCovariance(first, second, *map(matrix3, own))


def _score_breaches(law: LinearLaw, corridor_mm: float) -> tuple[Breach, ...]:
    """Each with the interval of 95 % that its sampling leaves."""
    pair, found = PairLaw(law, P95, fine=True), []
    for beyond_mm in BREACHES_MM:
        value, error = pair.exceedance_with_error(corridor_mm + beyond_mm)
        half = T_15 * error
        found.append(Breach(beyond_mm, value, (max(value - half, 0.0), min(value + half, 1.0))))
    return tuple(found)


def _score_target(system: System, tcp: ErrorScore, localisation: ErrorScore, second_order: bool) -> TargetScore:
    model, at = tcp.model, tcp.at
    assert isinstance(model, LinearModel)  # of the error at one target
    whole = tcp.read(P95).quantile
    return TargetScore(
        name=model.target.name,
        **_fields(_metric(tcp)),
        localisation=_metric(localisation),
        block_diagonal_p95_mm=norm_quantile(P95, at.worst.mean_mm, covariance_block_diagonal(model, "tcp")),
        contributors=budget(model, at, whole),
        worst_vertex=at.worst.names,
        per_unit=_per_unit(system, tcp),
        second_order=_second_order(system, tcp)
        if second_order
        else SecondOrder("not requested", "ask for it with --second-order"),
        extrapolation=model.extrapolation,
        budget_p95_mm=whole.quantile_mm,
        position_tcp_mm=vector3(transform_points(system.T_tcp_con, model.target.position_mm)),
    )


def _metric(error: ErrorScore) -> MetricScore:
    summary, (mean, total) = error.summary, error.moments
    return MetricScore(
        frame=MEASURE[error.at.error].frame,
        bias_mm=vector3(mean),
        covariance_mm2=matrix3(total),
        std_mm=vector3(np.sqrt(np.diag(total))),
        mean_norm_mm=summary.mean_norm_mm,
        p95_mm=summary.quantile.quantile_mm,
        law=summary.quantile.method,
        law_error_mm=summary.quantile.error_mm,
        bounds_mm=bounds(P95, mean, total),
        cvar95_mm=summary.cvar_mm,
        limit_mm=error.limit,
        exceedance_probability=summary.exceedance,
    )


def _per_unit(system: System, tcp: ErrorScore) -> PerUnit:
    """At the tightest requirement on each unit of the TCP error; without one, P95 at the target's limit."""
    each = [item for item in _list_requirements(system, tcp.model.site, "tcp") if item.level is Drawn.UNIT]
    quantile, fraction, limit_mm = P95, P95, tcp.limit
    if each:
        own = min(each, key=lambda item: item.limit)
        quantile, limit_mm, fraction = own.quantile, own.limit, own.units_fraction or P95
    risk = tcp.unit_risk(quantile, limit_mm, fraction, Drawn.UNIT)
    usual = risk if (quantile, fraction) == (P95, P95) else tcp.unit_risk(P95, None, P95, Drawn.UNIT)
    return PerUnit(
        limit_mm=limit_mm,
        yield_fraction=risk.yield_fraction,
        yield_standard_error=risk.yield_standard_error,
        p95_of_units_mm=usual.value_mm,
        p95_of_units_standard_error_mm=usual.standard_error_mm,
        quantile=quantile,
        units_fraction=fraction,
        value_mm=risk.value_mm,
        standard_error_mm=risk.standard_error_mm,
    )


def _second_order(system: System, tcp: ErrorScore) -> SecondOrder:
    """Second-order mean and covariance of the TCP error, where their series holds."""
    from .montecarlo.chain import evaluate
    from .montecarlo.plan import compile_plan

    model, worst = tcp.model, tcp.at.worst
    assert isinstance(model, LinearModel)
    try:
        plan = compile_plan(replace(system, loss_probability=()), vertex=worst.vertex(model))
        refuse_outside_range(model.nonlinearity.divisor, plan.dimension)
    except OutOfRangeError as error:
        return SecondOrder("refused", error.problems[0].detail)
    index = system.targets.index(model.target)
    gains = np.hstack([block.columns_mm("tcp") for block in model.blocks])
    shift, covariance = second_order_moments(lambda z: evaluate(plan, z)[:, index, 0], plan.standard_std, gains)
    return SecondOrder(
        "applied",
        "mean and covariance to second order; P95 of the Gaussian law with them",
        vector3(shift),
        vector3(np.sqrt(np.diag(covariance))),
        norm_quantile(P95, worst.mean_mm + shift, covariance),
    )


OPEN: Interval = (0.0, inf)  # nothing is known


def check_requirement(requirement: Requirement, target: str, trust: Validity, error: ErrorScore) -> Check:
    """A requirement held against the estimate at one target, of the error that it limits.

    trust: of shots in which no fiducial is missed.
    """
    p, fraction, shots = requirement.quantile, requirement.units_fraction, error.shots(requirement.quantile)
    if not requirement.is_quantile:
        return _check_statistic(requirement, target, trust, error)
    met, why, measure = None, "", MEASURE[requirement.error]
    level, percent = requirement.level or Drawn.UNIT, error_percent(trust, p) * error.times_apart
    if fraction is not None:
        risk = error.unit_risk(p, requirement.limit, fraction, level)
        value, met = risk.value_mm, risk.yield_fraction
        # Where the sampling of units leaves the value, and the error of the linearisation about both ends of that.
        doubt = 3 * risk.standard_error_mm
        interval = _error_band(max(value - doubt, 0.0), percent)[0], _error_band(value + doubt, percent)[1]
        if error.has_losses:
            interval, why = OPEN, f"no estimate is known of the risk of each {level} where fiducials are missed"
    elif shots is not None:
        value, interval, why = shots.value(p), shots.interval(p), shots.why_open(p)
    else:
        value = error.read(p).quantile.quantile_mm
        interval = _error_band(value, percent)
    if error.has_losses and measure not in POINTS:
        interval, why = OPEN, f"no estimate is known of {measure.words} where fiducials are missed"
    if error.model.doubt:
        interval = OPEN
        why = f"how far the estimate of {measure.words} is from a simulation is not known: {error.model.doubt}"
    pooled = shots if fraction is None else None
    if pooled is not None and isinf(pooled.bound(p)):
        why += "; the value is that of the shots that are looked at and leave an answer"
    return judge(requirement, target, value, interval, met, missed=pooled is not None, open_because=why)


def _check_statistic(requirement: Requirement, target: str, trust: Validity, error: ErrorScore) -> Check:
    """A requirement on what is no quantile; where fiducials are missed, its value is that of all shots.

    The interval is that of errors which are by so much smaller or larger as first order may err.
    """
    p, limit, row, measure = requirement.quantile, requirement.limit, requirement.row, MEASURE[requirement.error]
    own = value_of(requirement)
    shots, reading = error.shots(p), error.read(p)
    if own is not None and error.at.worst.signs:  # another vertex may be worst for it
        reading = LawReading(error_law(error.model, error.at.error, p, own).law, p)
    if row.unit:  # a probability is that of its own limit
        reading = reading.at_limit(limit)
    assert row.of_law is not None  # or it would be a quantile
    value = row.of_law(reading if shots is None else shots.law.summary(p, limit))
    assert value is not None
    why = ""
    doubt = error.model.doubt
    if doubt or not row.calibrated:
        of = f"the {row.name} of {measure.words}"
        why = f"how far the estimate of {of} is from a simulation is not known" + (doubt and f": {doubt}")
    elif error.search is not None:
        why = f"no estimate is known of the {row.name} of {measure.words} where fiducials are missed"
        if not row.unit and probability_unanswered(error.search.system) >= NEGLIGIBLE:
            why = UNBOUNDED
    percent = error_percent(trust, row.trusted_as(p)) * error.times_apart
    if why or isinf(percent):
        return judge(requirement, target, value, OPEN, missed=shots is not None, open_because=why)
    times = 1 + percent / 100
    ends = (value / times, value * times)
    if row.unit:
        ends = (reading.beyond(limit * times), reading.beyond(limit / times))
    return judge(requirement, target, value, ends)


def _error_band(value: float, percent: float) -> Interval:
    """Where the full chain's quantile lies if the linearisation is as good as its calibration says."""
    if isinf(percent):
        return OPEN
    return (value / (1 + percent / 100), value * (1 + percent / 100))


def tightest_limit(system: System, target: str, error: str) -> float | None:
    """Smallest limit that a requirement sets on single errors of this kind at this target, all units together, mm."""
    stated = _list_requirements(system, target, error)
    limits = [r.limit for r in stated if r.risk == "pooled" and r.row.by_quantile]
    return min(limits) if limits else None


def _list_requirements(system: System, target: str, error: str) -> list[Requirement]:
    return [item for item in system.requirements if item.error == error and target in item.targets]


def provenance(
    system: System, *, simulated: bool = False, missed: bool = False, also: tuple[str, ...] = ()
) -> Provenance:
    """What a record was made of.

    simulated: by the whole chain; missed: it says what missed fiducials do; also: what else no number of it includes.
    """
    return Provenance(
        design_name=system.name,
        design_sha256=system.design_sha256,
        tailstack_version=__version__,
        reading=str(system.reading),
        rotation_form=str(system.rotation_form),
        triangulation=str(system.triangulation),
        notes=system.notes,
        not_included=(*not_included(system, simulated=simulated, missed=missed), *_taken_for_exact(system), *also),
        estimator=str(system.estimator),
        sources_sha256=digest_of_package(),
        assumed=system.assumed,
        document=None if system.title_block is None else TitleBlock(**system.title_block),
    )


def _taken_for_exact(system: System) -> tuple[str, ...]:
    """What the estimator believes without a doubt that the design states."""
    if not system.estimator.believes_intrinsics:
        return ()
    views = zip(system.views, system.believed_errors, strict=True)
    exact = [view.name for view, error in views if error is None]
    believed = dict.fromkeys(INTRINSICS_WORDS[name] for name in system.estimator.traits.believes)
    told = f"errors of {' and '.join(believed)}, which the design takes for exact ({', '.join(exact)})"
    shape = "errors of the pixels' shape (ratio of the focal lengths, skew), which the estimator takes for exact"
    return (told, shape) if exact else (shape,)


def vector3(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return (x, y, z)


def matrix3(values: Array) -> Matrix3:
    a, b, c = (vector3(row) for row in values)
    return (a, b, c)

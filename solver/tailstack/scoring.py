"""The first-order score: bias, covariance, the tail under the declared laws, bounds, budget, verdict.

The budget says what each contributor does to the quantile of the error at one target.  A contributor is one block of
the linear model; its components are the block's scalar sources.  Image noise and manufacturing errors, whose scalars
are all alike, are one line each; a mount has a line per component and one for all of it together (a six-component
installation error read as one contributor)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isinf, sqrt
from typing import NamedTuple

import numpy as np

from .arrays import Array
from .contributors import ErrorLaw, Part, WorstCase, error_law, law_of, unit_for_people, worst_case
from .design import Design, check_design
from .errors import OutOfRangeError
from .estimation.checks import examine
from .propagation.linear import Block, LinearModel, covariance_block_diagonal, largest_rotation_rad, linearise_all
from .propagation.second_order import refuse_outside_range, second_order_moments
from .propagation.validity import error_percent, validity
from .results import (
    Check,
    Contributor,
    Finding,
    Interval,
    Matrix3,
    MetricScore,
    PerUnit,
    Provenance,
    Score,
    SecondOrder,
    TargetScore,
    Validity,
    Vector3,
    ViewCheck,
)
from .system import Law, Requirement, System
from .tail.bounds import bounds
from .tail.declared import LawBudget, LawQuantile, LawSummary, law_budget, law_quantile, law_summary, without_group
from .tail.gaussian import norm_quantile
from .tail.per_unit import UnitRisk, unit_risk
from .verdict import conclude, judge
from .version import __version__

P95 = 0.95
BESIDE = 100.0  # numerical errors of a metric without a requirement, against those of one with: 1e-5 mm instead of 1e-7
FRAMES = {"tcp": "tcp", "localisation": "con"}
NOT_INCLUDED = (
    "image distortion, detector flatness, motion during or between shots",
    "wrong correspondences and missed fiducials",
    "centroid bias of large spheres (0.05 px for 10 mm balls)",
    "products of two random errors (second order)",
    "whatever the design document does not list",
)


def vector3(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return (x, y, z)


def matrix3(values: Array) -> Matrix3:
    a, b, c = (vector3(row) for row in values)
    return (a, b, c)


def checked_system(design: Design | System) -> tuple[System, tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """Compile and check a design, or check a system.  Raises DesignError, IllPosedError."""
    if isinstance(design, System):
        return design, *examine(design)
    return check_design(design)


def provenance(system: System, not_included: tuple[str, ...] = NOT_INCLUDED) -> Provenance:
    return Provenance(
        design_name=system.name,
        design_sha256=system.design_sha256,
        tailstack_version=__version__,
        reading=str(system.reading),
        rotation_form=str(system.rotation_form),
        triangulation=str(system.triangulation),
        notes=system.notes,
        not_included=not_included,
    )


def tightest_limit(system: System, target: str, error: str) -> float | None:
    """Smallest limit that a requirement sets on this error at this target, all units together, mm."""
    limits = [r.limit_mm for r in _required(system, target, error) if r.risk == "pooled"]
    return min(limits) if limits else None


def _required(system: System, target: str, error: str) -> list[Requirement]:
    return [item for item in system.requirements if item.error == error and target in item.targets]


def _metric(at: ErrorLaw, found: LawSummary, limit_mm: float | None) -> MetricScore:
    mean, total = at.law.mean, at.total_covariance
    return MetricScore(
        frame=FRAMES[at.error],
        bias_mm=vector3(mean),
        covariance_mm2=matrix3(total),
        std_mm=vector3(np.sqrt(np.diag(total))),
        mean_norm_mm=found.mean_norm_mm,
        p95_mm=found.quantile.quantile_mm,
        law=found.quantile.method,
        law_error_mm=found.quantile.error_mm,
        bounds_mm=bounds(P95, mean, total),
        cvar95_mm=found.cvar_mm,
        limit_mm=limit_mm,
        exceedance_probability=found.exceedance,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """An error at a target: its law, its P95, and the risks per unit that were found already."""

    model: LinearModel
    at: ErrorLaw
    p95_mm: float
    risks: dict[tuple[float, float | None, float], UnitRisk] = field(default_factory=dict)

    def unit_risk(self, quantile: float, limit_mm: float | None, fraction: float) -> UnitRisk:
        """Installation drawn once per unit, noise, repeatability and load at each shot."""
        asked = (quantile, limit_mm, fraction)
        if asked not in self.risks:
            at = self.at if quantile == P95 else error_law(self.model, self.at.error, quantile)
            parts = tuple(zip(self.model.blocks, at.parts, strict=True))
            installed = law_of(at.worst.mean_mm, [part for block, part in parts if block.per_unit])
            shot = law_of(np.zeros(3), [part for block, part in parts if not block.per_unit])
            self.risks[asked] = unit_risk(installed, shot, quantile, limit_mm, fraction, log2_units=7)
        return self.risks[asked]


def _per_unit(system: System, target: str, known: _Known, limit_mm: float | None) -> PerUnit:
    """At the tightest requirement on each unit of the TCP error; without one, P95 at the target's limit."""
    each = [item for item in _required(system, target, "tcp") if item.risk == "per_unit"]
    quantile, fraction = P95, P95
    if each:
        own = min(each, key=lambda item: item.limit_mm)
        quantile, limit_mm, fraction = own.quantile, own.limit_mm, own.units_fraction or P95
    risk = known.unit_risk(quantile, limit_mm, fraction)
    usual = risk if (quantile, fraction) == (P95, P95) else known.unit_risk(P95, None, P95)
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


def _second_order(system: System, index: int, model: LinearModel, worst: WorstCase) -> SecondOrder:
    """Second-order mean and covariance of the TCP error, where their series holds."""
    from .montecarlo import compile_plan, evaluate

    plan = compile_plan(system, vertex=worst.vertex(model))
    try:
        refuse_outside_range(model.nonlinearity.divisor, plan.inputs)
    except OutOfRangeError as error:
        return SecondOrder("refused", error.problems[0].detail)
    gains = np.hstack([block.tcp * block.std for block in model.blocks])
    shift, covariance = second_order_moments(lambda z: evaluate(plan, z)[:, index, 0], plan.standard_std, gains)
    return SecondOrder(
        "applied",
        "mean and covariance to second order; P95 of the Gaussian law with them",
        vector3(shift),
        vector3(np.sqrt(np.diag(covariance))),
        norm_quantile(P95, worst.mean_mm + shift, covariance),
    )


def trust_of(system: System, models: dict[str, LinearModel]) -> Validity:
    """The validity of first order at the worst target."""
    numbers = max((model.nonlinearity for model in models.values()), key=lambda each: each.nu)
    return validity(numbers, system, max(largest_rotation_rad(model) for model in models.values()))


def _error_band(value_mm: float, trust: Validity, quantile: float) -> Interval:
    """Where the full chain's quantile lies if the linearisation is as good as its calibration says."""
    percent = error_percent(trust, quantile)
    if isinf(percent):
        return (0.0, inf)
    return (value_mm / (1 + percent / 100), value_mm * (1 + percent / 100))


def _checks(system: System, trust: Validity, known: dict[tuple[str, str], _Known]) -> tuple[Check, ...]:
    return tuple(
        _check(requirement, name, trust, known[name, requirement.error])
        for requirement in system.requirements
        for name in requirement.targets
    )


def _check(requirement: Requirement, target: str, trust: Validity, known: _Known) -> Check:
    p, fraction = requirement.quantile, requirement.units_fraction
    if fraction is None:
        value = known.p95_mm
        if p != P95:
            value = law_quantile(error_law(known.model, requirement.error, p).law, p).quantile_mm
        return judge(requirement, target, value, _error_band(value, trust, p))
    risk = known.unit_risk(p, requirement.limit_mm, fraction)
    # Where the sampling of units leaves the value, and the error of the linearisation about both ends of that.
    doubt = 3 * risk.standard_error_mm
    low, _ = _error_band(max(risk.value_mm - doubt, 0.0), trust, p)
    _, high = _error_band(risk.value_mm + doubt, trust, p)
    return judge(requirement, target, risk.value_mm, (low, high), risk.yield_fraction)


def score(design: Design | System, *, second_order: bool = False) -> Score:
    """Score a design to first order, every target and requirement.

    ``second_order`` adds the second-order correction where its series holds (milliseconds; refused, with the reason,
    where it does not).  Raises DesignError for a document that breaks its rules and IllPosedError for a
    geometry that does not determine the answer.
    """
    system, findings, views = checked_system(design)
    models = linearise_all(system)
    trust = trust_of(system, models)
    targets = []
    known = {}
    for index, (name, model) in enumerate(models.items()):
        metrics, quantiles = {}, {}
        for error in FRAMES:
            at = error_law(model, error, P95)
            limit = tightest_limit(system, name, error)
            found = law_summary(at.law, P95, limit, relaxed=1.0 if error == "tcp" or limit is not None else BESIDE)
            metrics[error] = _metric(at, found, limit)
            quantiles[error] = found.quantile
            known[name, error] = _Known(model, at, found.quantile.quantile_mm)
        metric, at = metrics["tcp"], known[name, "tcp"].at
        contributors = budget(model, at, quantiles["tcp"])
        targets.append(
            TargetScore(
                name=name,
                **{field: getattr(metric, field) for field in MetricScore.__dataclass_fields__},
                localisation=metrics["localisation"],
                block_diagonal_p95_mm=norm_quantile(P95, at.worst.mean_mm, covariance_block_diagonal(model, "tcp")),
                contributors=contributors,
                worst_vertex=at.worst.names,
                per_unit=_per_unit(system, name, known[name, "tcp"], metric.limit_mm),
                second_order=_second_order(system, index, model, at.worst)
                if second_order
                else SecondOrder("not requested", "ask for it with --second-order"),
                extrapolation=model.extrapolation,
            )
        )
    return Score(
        schema="tailstack/score/1",
        targets=tuple(targets),
        validity=trust,
        views=views,
        verdict=conclude(_checks(system, trust, known), findings, "first order"),
        provenance=provenance(system),
    )


LIGHT = 1e-2  # share s of variance below which a line is removed to first order: an error of about s^2, 1e-4 at most

Removal = tuple[Array | None, tuple[int, ...]]  # what to take from a law: a Gaussian covariance, columns


class Line(NamedTuple):
    """One line of the budget before its numbers: some sources of one block."""

    block: Block
    component: str
    sources: tuple[int, ...]
    number: int  # of the block
    place: int  # of its number among those of all sources, followed by those of all blocks


def lines_of(model: LinearModel) -> tuple[Line, ...]:
    lines = []
    start, whole = 0, sum(len(block.units) for block in model.blocks)
    for number, block in enumerate(model.blocks):
        count = len(block.units)
        if not block.grouped:
            lines += [Line(block, name, (j,), number, start + j) for j, name in enumerate(block.components)]
        if block.grouped or count > 1:
            lines.append(Line(block, "all", tuple(range(count)), number, whole + number))
        start += count
    return tuple(lines)


@dataclass(frozen=True, slots=True, eq=False)
class _Sources:
    """All K scalar sources of a model, in the order of its blocks."""

    gain: Array  # (3, K)
    std: Array  # (K,)
    half_width: Array  # (K,)
    starts: list[int]  # of the blocks
    other: list[int]  # those that are not normal
    held: list[int]  # those of them that are a column of the law, in its order

    def of_lines(self, values: Array, lines: tuple[Line, ...]) -> list[list[float]]:
        """Of quantities (Q, K) of all sources, their sums over those of each line."""
        all_of = np.concatenate([values, np.add.reduceat(values, self.starts, axis=1)], axis=1)
        found: list[list[float]] = all_of[:, [line.place for line in lines]].tolist()
        return found


def _sources(model: LinearModel, at: ErrorLaw) -> _Sources:
    starts: list[int] = []
    other: list[int] = []
    held: list[int] = []
    start = 0
    for block, part in zip(model.blocks, at.parts, strict=True):
        starts.append(start)
        end = start + len(block.laws)
        if len(part.sources) == len(block.laws):
            other += range(start, end)
            held += range(start, end)
        elif part.columns is not None:
            other += [start + j for j, law in enumerate(block.laws) if law is not Law.NORMAL]
            held += [start + j for j in part.sources]
        start = end
    return _Sources(
        np.concatenate([model.gain(block, at.error) for block in model.blocks], axis=1),
        np.concatenate([block.std for block in model.blocks]),
        np.concatenate([block.half_width for block in model.blocks]),
        starts,
        other,
        held,
    )


def _removal(line: Line, at: ErrorLaw, gain: Array, first: list[int]) -> Removal:
    """What taking a line away takes from the law; gain: (3, k) of its block; first: column of each block."""
    part, start = at.parts[line.number], first[line.number]
    if len(line.sources) > 1:
        return part.covariance, tuple(range(start, start + len(part.sources)))
    j = line.sources[0]
    if line.block.laws[j] is Law.NORMAL:
        scaled = gain[:, j] * line.block.std[j]
        return scaled[:, None] * scaled, ()
    return None, tuple(start + k for k, source in enumerate(part.sources) if source == j)


def _first_columns(parts: tuple[Part, ...]) -> list[int]:
    starts = [0]
    for part in parts:
        starts.append(starts[-1] + len(part.sources))
    return starts


def _by_variance(sources: _Sources, numbers: LawBudget) -> Array:
    """(K,) mm: derivative of the quantile by the logarithm of each source's variance; 0 for bounded sources."""
    scaled = sources.gain * sources.std
    slopes = np.asarray((scaled * (numbers.dr_dcovariance @ scaled)).sum(axis=0))
    slopes[sources.other] = 0.0
    slopes[sources.held] = numbers.dr_dlog_column / 2
    return slopes


def _by_half_width(
    model: LinearModel, sources: _Sources, by_variance: Array, numbers: LawBudget, signs: dict[tuple[str, int], float]
) -> Array:
    """(K,) mm per native unit: derivative of the quantile by each half-width; a bounded source moves the mean."""
    slopes = np.asarray(2 * by_variance / np.where(sources.half_width > 0, sources.half_width, 1.0))
    if signs:
        names = [(block.contributor, j) for block in model.blocks for j in range(len(block.laws))]
        for k, name in enumerate(names):
            if name in signs:
                slopes[k] = signs[name] * float(numbers.dr_dmean @ sources.gain[:, k])
    return slopes


def _without_light(quantile_mm: float, by_variance: float) -> float:
    """Quantile without a line of share s below LIGHT: its square is nearly linear in the variance, off by some s^2."""
    return sqrt(max(quantile_mm * (quantile_mm - 2 * by_variance), 0.0))


def budget(model: LinearModel, at: ErrorLaw, total: LawQuantile) -> tuple[Contributor, ...]:
    """The lines of the budget of the law's quantile at the worst vertex, in the order of the chain."""
    variance = float(np.trace(at.total_covariance))
    lines, sources = lines_of(model), _sources(model, at)
    squares = (sources.gain**2).sum(axis=0)  # of one native unit each
    lengths, own = sources.of_lines(np.stack([squares, squares * sources.std**2]), lines)
    shares = [value / variance for value in own] if variance > 0 else [0.0] * len(lines)
    heavy = [k for k, share in enumerate(shares) if share > LIGHT]
    first = _first_columns(at.parts)
    removals = [_removal(lines[k], at, model.gain(lines[k].block, at.error), first) for k in heavy]
    numbers = law_budget(at.law, total.p, removals, total)
    by_variance = _by_variance(sources, numbers)
    by_half_width = _by_half_width(model, sources, by_variance, numbers, at.worst.signs)
    light, slopes = sources.of_lines(np.stack([by_variance, by_half_width]), lines)
    without = [_without_light(total.quantile_mm, slope) for slope in light]
    for k, found in zip(heavy, numbers.without, strict=True):
        without[k] = found.quantile_mm
    if signs := at.worst.signs:
        for k, line in enumerate(lines):
            if any((line.block.contributor, j) in signs for j in line.sources):
                without[k] = _without_bounded(model, at, line, total.p)
    return tuple(map(_row, lines, shares, without, lengths, slopes))


def _row(line: Line, share: float, without_mm: float, square: float, slope: float) -> Contributor:
    """A line with its numbers, those of one unit only where all its sources are alike; square: of the gains' length."""
    block, j = line.block, line.sources[0]
    law = block.laws[j]
    if len(line.sources) > 1 and not (block.grouped and bool((block.half_width == block.half_width[0]).all())):
        named = str(law) if block.laws.count(law) == len(block.laws) else "mixed"
        return Contributor(
            block.contributor, line.component, named, None, "", None, None, share, None, without_mm, block.label
        )
    unit, factor = unit_for_people(block.units[j])
    half_width, std = float(block.half_width[j]) * factor, float(block.std[j]) * factor
    sensitivity, slope = sqrt(square) / factor, slope / factor
    return Contributor(  # by place: names would be a quarter of the time
        block.contributor,
        line.component,
        str(law),
        half_width,
        unit,
        std,
        sensitivity,
        share,
        slope,
        without_mm,
        block.label,
    )


def _without_bounded(model: LinearModel, at: ErrorLaw, line: Line, quantile: float) -> float:
    """Quantile with a line removed that has bounded sources: the others may then be worst at another vertex."""
    gone = frozenset((line.block.contributor, j) for j in line.sources)
    mean = worst_case(model, at.error, quantile, without=gone).mean_mm
    removal = _removal(line, at, model.gain(line.block, at.error), _first_columns(at.parts))
    return law_quantile(without_group(law_of(mean, at.parts), *removal), quantile).quantile_mm

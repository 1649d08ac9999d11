"""The same design under each estimator: what knowing the intrinsics is worth, and what it costs to be wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..contributors import error_law
from ..design import Design, compile_design
from ..effects.intrinsics import UNITS, intrinsics_error
from ..errors import OutOfRangeError, Problem, TailstackError
from ..estimation.checks import examine
from ..geometry.arrays import Array
from ..propagation.linear import chain_of, linearise_all
from ..results import Interval, Provenance
from ..results.record import Published
from ..results.verdicts import P95
from ..scoring import provenance, trust_of
from ..system import ESTIMATORS, INTRINSICS, EstimatorTraits, Law, Place, Sources, System
from ..tail.declared import law_quantile
from ..verification import verify

ROUGH_FOCAL, ROUGH_PX = 0.01, 10.0  # of a C-arm whose data sheet is known
LEAST_SCALE = 0.02  # of the structure, down to which it is shrunk
HARDLY = 0.01  # a difference of P95 that nobody need care about


@dataclass(frozen=True, slots=True)
class EstimatorCase:
    """The design under one estimator."""

    estimator: str
    """What each view is estimated as: dlt, reprojection, pose_with_prior or pose."""
    needs: str
    """What has to be known for it."""
    reason: str
    """Why the design has no answer under it; empty: it has one."""
    target: str | None
    """Target with the largest P95; null without an answer."""
    p95_mm: float | None
    """P95 of the error at the tool there by first order, intrinsics as far off as is stated, mm."""
    p95_exact_mm: float | None
    """The same with intrinsics that are exact, mm."""
    validity: str
    """How far first order can be trusted here."""
    simulated_p95_mm: float | None
    """P95 there by simulation, mm; null where none was asked for."""
    simulated_interval_mm: Interval | None
    """Its two-sided interval of 95 %, mm."""
    same_size_mm: float | None
    """Extent of a structure of this shape that would do as well under this estimator as the design does under dlt, mm;
    null of dlt itself, and where no smaller structure would."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyEstimators(Published):
    """The same design under each estimator."""

    schema: Literal["tailstack/study-estimators/1"]
    focal_rel_sd: float
    """Standard deviation of the assumed focal length, relative, where a view of the design says nothing of its own."""
    principal_point_px_sd: float
    """The same of each coordinate of the assumed principal point, px."""
    trials: int
    """Trials of each simulation; 0: none was asked for."""
    seed: int
    """Seed of the simulations."""
    extent_mm: float
    """Largest distance between two fiducials of the design, mm."""
    cases: tuple[EstimatorCase, ...]
    """One of each estimator, from the one that knows nothing to the one that knows most."""
    conclusions: tuple[str, ...]
    """What they say, in sentences."""
    provenance: Provenance
    """What was computed from what, and what it does not include."""


def study_estimators(
    design: Design | System,
    *,
    focal_rel_sd: float = ROUGH_FOCAL,
    principal_point_px_sd: float = ROUGH_PX,
    trials: int = 0,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> StudyEstimators:
    """Score a design under every estimator, with the same errors of its assumed intrinsics.

    A view that says nothing of its intrinsics is taken to know them to ``focal_rel_sd`` (relative) and
    ``principal_point_px_sd``, and to be wrong by as much.  ``trials``: of a simulation of each, 0 for none.
    Raises OutOfRangeError where no estimator has an answer.
    """
    # With all fiducials in every shot: what missing them does is no property of the estimator alone.
    base = replace(design if isinstance(design, System) else compile_design(design), loss_probability=())
    doubted = _with_doubt(base, focal_rel_sd, principal_point_px_sd)
    cases, reference = [], None
    for place, estimator in enumerate(ESTIMATORS):
        case = _case(replace(doubted, estimator=estimator), trials, seed, threads, reference)
        if place == 0:
            reference = case.p95_mm
        cases.append(case)
        if progress is not None:
            progress(place + 1, len(ESTIMATORS))
    if all(case.p95_mm is None for case in cases):
        raise OutOfRangeError(Problem("", "no-estimator", f"no estimator has an answer: {cases[-1].reason}"))
    extent = _extent(base)
    return StudyEstimators(
        schema="tailstack/study-estimators/1",
        focal_rel_sd=focal_rel_sd,
        principal_point_px_sd=principal_point_px_sd,
        trials=trials,
        seed=seed,
        extent_mm=extent,
        cases=tuple(cases),
        conclusions=_conclusions({case.estimator: case for case in cases}, extent),
        provenance=provenance(doubted),
    )


def _with_doubt(system: System, focal: float, centre_px: float) -> System:
    """The system whose views all say how well their intrinsics are known and how wrong they are."""
    spread = np.array([focal, centre_px, centre_px])
    sources = Sources(INTRINSICS, (Law.NORMAL,) * 3, spread, np.ones(3), UNITS, np.eye(3))
    views = tuple(replace(view, intrinsics_prior=view.intrinsics_prior or (focal, centre_px)) for view in system.views)
    rough = [
        intrinsics_error(view.name, np.zeros(3), sources)
        for view in system.views
        if not system.effects_at(Place.INTRINSICS, view.name)
    ]
    return replace(system, views=views, effects=(*system.effects, *rough))


def _case(system: System, trials: int, seed: int, threads: int | None, reference_mm: float | None) -> EstimatorCase:
    needs = system.estimator.traits.needs
    try:
        examine(system)
        target, value, trust = _worst(system)
        told = system.effects_at(Place.INTRINSICS)
        exact = replace(system, effects=tuple(effect for effect in system.effects if effect not in told))
        _, exact_value, _ = _worst(exact)
        checked = verify(system, trials=trials, seed=seed, threads=threads) if trials else None
    except TailstackError as error:
        reason = error.problems[0].detail
        return EstimatorCase(str(system.estimator), needs, reason, None, None, None, "", None, None, None)
    simulated = next((each for each in checked.targets if each.name == target), None) if checked else None
    same = None
    if reference_mm is not None and system.estimator.believes_intrinsics:
        same = _same_size(system, reference_mm)
    return EstimatorCase(
        estimator=str(system.estimator),
        needs=needs,
        reason="",
        target=target,
        p95_mm=value,
        p95_exact_mm=exact_value,
        validity=trust,
        simulated_p95_mm=simulated.p95_mm if simulated else None,
        simulated_interval_mm=simulated.p95_interval_mm if simulated else None,
        same_size_mm=same,
    )


def _worst(system: System) -> tuple[str, float, str]:
    """The target with the largest P95 at the tool, that P95, mm, and how far first order can be trusted."""
    models = linearise_all(chain_of(system))
    laws = {name: error_law(model, "tcp", P95).law for name, model in models.items()}
    quantiles = {name: law_quantile(law, P95).quantile_mm for name, law in laws.items()}
    target = max(quantiles, key=quantiles.__getitem__)
    return target, quantiles[target], trust_of(system, models).status


def _extent(system: System) -> float:
    points = system.fiducials_mm
    return float(np.linalg.norm(points[:, None] - points, axis=2).max())


def _same_size(system: System, reference_mm: float) -> float | None:
    """Extent, mm, of a structure of this shape whose P95 is the reference; None where the whole one exceeds it."""
    centre = system.fiducials_mm.mean(axis=0)

    def p95_mm(scale: float) -> float:
        points: Array = centre + scale * (system.fiducials_mm - centre)
        return _worst(replace(system, fiducials_mm=points))[1]

    low, high = LEAST_SCALE, 1.0
    if p95_mm(high) > reference_mm:
        return None
    if p95_mm(low) > reference_mm:
        for _ in range(12):  # to a four-thousandth
            middle = (low + high) / 2
            low, high = (low, middle) if p95_mm(middle) <= reference_mm else (middle, high)
    else:
        high = low
    return high * _extent(system)


def _first(cases: dict[str, EstimatorCase], kind: Callable[[EstimatorTraits], bool]) -> EstimatorCase:
    """The case of the first estimator in the table of a kind."""
    return next(cases[str(estimator)] for estimator, traits in ESTIMATORS.items() if kind(traits))


def _conclusions(cases: dict[str, EstimatorCase], extent_mm: float) -> tuple[str, ...]:
    """What a designer needs of it."""
    dlt = _first(cases, lambda traits: not traits.believes)
    prior = _first(cases, lambda traits: traits.takes_prior)
    pose = _first(cases, lambda traits: traits.believes == INTRINSICS and not traits.takes_prior)
    sentences = []
    if dlt.p95_mm is None:
        sentences.append(f"Without known intrinsics this design has no answer: {dlt.reason}.")
    if prior.p95_mm is not None and dlt.p95_mm is not None:
        saved = 1 - prior.p95_mm / dlt.p95_mm
        if abs(saved) < HARDLY:
            sentences.append(
                f"The estimator hardly matters here: P95 is {dlt.p95_mm:.3f} mm without known intrinsics and "
                f"{prior.p95_mm:.3f} mm with them; what is left comes from the mechanics and the target's images."
            )
        else:
            sentences.append(
                f"Intrinsics that are known as stated, and weighed by that, take P95 from {dlt.p95_mm:.3f} to "
                f"{prior.p95_mm:.3f} mm ({-100 * saved:+.0f} %)."
            )
        if prior.same_size_mm is not None and saved >= HARDLY:
            at_most = "at most " if prior.same_size_mm <= LEAST_SCALE * extent_mm * 1.001 else ""
            sentences.append(
                f"A structure of {at_most}{prior.same_size_mm:.0f} mm with known intrinsics does as well as this one "
                f"of {extent_mm:.0f} mm without."
            )
    if pose.p95_mm is not None and pose.p95_exact_mm is not None:
        cost = pose.p95_mm - pose.p95_exact_mm
        less = "" if prior.p95_mm is None else f"; weighing them as a prior leaves {prior.p95_mm:.3f} mm"
        sentences.append(
            f"Taking the intrinsics for exact while they are off as stated costs {cost:.3f} mm "
            f"({pose.p95_exact_mm:.3f} to {pose.p95_mm:.3f} mm){less}."
        )
    return tuple(sentences)

"""The numbers of radiostereometry (ISO 16087): marker models, lines that miss each other, and double examinations.

Two examinations of a patient in whom nothing has moved share what is drawn once per unit (the cage as it was made); all
else is drawn anew.  What comes out to have moved is the difference of both, so its variance is twice that of one: a
precision of 1.96 standard deviations has a factor of the square root of 2 in it.  The patient lies in the same place
both times: that the cage errs otherwise elsewhere is left out.

An estimate is to first order, and exact for every law, as it is made of second moments.  A simulation draws pairs of
shots on the full chain: markers are fitted from one to the other, the other body put back to where it was first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from math import ceil, erf, exp, pi, sqrt

import numpy as np

from ..design import Design, check_design
from ..errors import DesignError, Problem
from ..geometry.arrays import Array
from ..laws import Drawn
from ..measures import MEASURE
from ..measures.measure import MeasuredBody, Site
from ..measures.rigid_fit import (
    BodyFit,
    condition_number,
    cross_matrices,
    mean_in_order,
    put_back,
    turn_vectors,
    turn_weights,
)
from ..montecarlo.chain import run_indices
from ..montecarlo.estimators import interval_ranks
from ..montecarlo.plan import compile_plan
from ..propagation.linear import Chain, LinearModel, chain_of, common_of, join, linearise_all, shift_together
from ..propagation.nonlinearity import aim_at, row_errors
from ..results.radiostereometry import CrossingLines, DoubleExaminations, MarkerModel, Radiostereometry
from ..scoring import vector3
from ..system import System

PAIRS = 2**14
PER_CALL = 2**13
Z_95 = 1.96  # as ISO 16087 has it
Models = dict[str, LinearModel]


def radiostereometry(design: Design, *, seed: int = 0, pairs: int = 0) -> Radiostereometry:
    """The numbers of every body; pairs: of examinations that are simulated, 0 for none.

    Shots that miss a fiducial are left out.  Raises DesignError, also for a design without bodies, IllPosedError.
    """
    refuse_without_bodies(design)
    system, _, _ = check_design(design)
    system = replace(system, loss_probability=())
    chain = chain_of(system)
    models = linearise_all(chain)
    effects = [block.effect for block in next(iter(models.values())).blocks]
    labels = {anew: [each.label for each in effects if is_anew(each.drawn) is anew] for anew in (True, False)}
    drawn = _draw_pairs(system, seed, pairs) if pairs else None
    names: dict[tuple[str, ...], str | None] = {body.targets: body.name for body in system.bodies}
    marked = dict.fromkeys(name for body in system.bodies for name in body.targets)
    return Radiostereometry(
        bodies=tuple(_describe(system, body, names.get(body.against), models, drawn) for body in system.bodies),
        crossing_lines=tuple(line for name in marked for line in _cross_lines(chain, models[name])),
        drawn_anew=tuple(dict.fromkeys(labels[True])),
        kept=tuple(dict.fromkeys(labels[False])),
        pairs=pairs or None,
    )


def refuse_without_bodies(design: Design) -> None:
    """Raises DesignError."""
    if not design.document.bodies:
        detail = "radiostereometry is of bodies that are known by their markers, and the design has none"
        hint = "bodies: [{name: implant, targets: [three or more]}]"
        raise DesignError(Problem("/bodies", "missing-field", detail, hint))


def is_anew(drawn: Drawn) -> bool:
    """Whether what is drawn so often is drawn anew at the second examination."""
    return not drawn.is_held(Drawn.UNIT)


def _describe(
    system: System, body: MeasuredBody, against: str | None, models: Models, drawn: tuple[Array, Array] | None
) -> MarkerModel:
    fit = BodyFit(system, body)
    of_trials = (None,) * 3 if drawn is None else _estimate(*_migrate(system, fit, *drawn))
    condition = condition_number(fit.points)
    return MarkerModel(body.name, against, len(fit.points), condition, _expect(system, body, fit, models), *of_trials)


# --- to first order ------------------------------------------------------------------------------------------------


def _expect(system: System, body: MeasuredBody, fit: BodyFit, models: Models) -> DoubleExaminations:
    """Of the difference of two examinations, whose covariance is twice that of what one draws anew."""

    def differ(name: str, site: Site) -> Array:
        """(n,) standard deviations of n linear numbers of the errors at targets."""
        blocks = join(models, MEASURE[name], site).blocks
        columns = [block.columns_mm(name) for block in blocks if is_anew(block.effect.drawn)]
        return np.asarray(np.sqrt(2 * (np.hstack(columns) ** 2).sum(axis=1)))

    rotation, translation = (
        Z_95 * differ(name, next(site for site in MEASURE[name].sites(system) if site.name == body.name))
        for name in ("rotation", "translation")
    )
    left = differ("tcp", Site(body.name, _left_of_fit(fit)))
    fitting = sqrt(float((left**2).sum()) / len(fit.points))
    return DoubleExaminations(vector3(rotation), vector3(translation), fitting, None, None)


def _left_of_fit(fit: BodyFit) -> dict[str, Array]:
    """By target, (3 K, 6): what is left of the errors of the K points of a body by the rigid motion that fits them."""
    count = len(fit.points)
    arms = cross_matrices(fit.points - fit.points.mean(axis=0))
    weights = {}
    for k, (name, turn) in enumerate(zip(fit.targets, turn_weights(fit.points), strict=True)):
        left = arms @ turn - np.eye(3) / count
        left[k] += np.eye(3)
        weights[name] = np.hstack([left.reshape(3 * count, 3), np.zeros((3 * count, 3))])
    return weights


def _cross_lines(chain: Chain, model: LinearModel) -> Iterator[CrossingLines]:
    """Of a marker, in every two views: what moves the rows of triangulation moves each ray across itself."""
    imaging, views = chain.imaging, [view.name for view in chain.system.views]
    centres = chain.weights @ imaging.points / chain.weights.sum(axis=1)[:, None]
    shifts, _ = shift_together(chain.system, chain.mounts.first, model.target)
    common = common_of(chain, shifts)
    aim = aim_at(imaging.projections, centres, model.reconstructed_mm, chain.matrix_covariance, common)
    noise = imaging.estimation.noise_of(1)
    random = row_errors(aim._replace(common=common.random), noise, unit=False)[3, 3]
    still = aim._replace(common=common.steady, covariance=np.zeros_like(aim.covariance))
    known = row_errors(still, np.zeros_like(noise), unit=False)[3, 3]
    rays = np.cross(aim.rows[:, 0], aim.rows[:, 1])
    for first, second in combinations(range(len(views)), 2):
        across = np.cross(rays[first], rays[second])
        across /= np.linalg.norm(across)
        weights = np.zeros(2 * len(views))
        for v, sign in ((first, 1), (second, -1)):
            weights[2 * v : 2 * v + 2] = sign * (across @ np.linalg.pinv(aim.rows[v]))
        spread, shift = (sqrt(max(float(weights @ each @ weights), 0.0)) for each in (random, known))
        mean = shift if not spread else spread * sqrt(2 / pi) * exp(-((shift / spread) ** 2) / 2)
        mean += shift * erf(shift / spread / sqrt(2)) if spread else 0.0
        yield CrossingLines(model.site, (views[first], views[second]), mean, sqrt(spread**2 + shift**2))


# --- by simulation -------------------------------------------------------------------------------------------------


def _draw_pairs(system: System, seed: int, pairs: int) -> tuple[Array, Array]:
    """(T, 6, n) errors at all targets of first and second examinations, two shots of each of n units."""
    plan = compile_plan(system, shots_per_unit=2)
    parts = [
        run_indices(plan, seed, first, min(PER_CALL, 2 * pairs - first)).errors
        for first in range(0, 2 * pairs, PER_CALL)
    ]
    errors = np.concatenate(parts, axis=-1).reshape(len(system.targets), 6, 2 * pairs)
    return errors[..., 0::2], errors[..., 1::2]


def _migrate(system: System, fit: BodyFit, first: Array, second: Array) -> tuple[Array, Array]:
    """(7, n) squares of the six components of a body's migration and of its fitting error, deg^2 and mm^2; (n,) mm
    total point motion."""
    names = [target.name for target in system.targets]
    own, others = ([names.index(name) for name in marked] for marked in (fit.targets, fit.against))
    change = (second - first)[:, :3]
    points, beside = fit.points[:, :, None] + first[own, :3], fit.others[:, :, None] + first[others, :3]
    moved = put_back(points, change[own], beside, change[others])
    turn, shift = turn_vectors(points, moved), mean_in_order(moved)
    left = put_back(points, change[own], points, change[own])
    squares = np.concatenate([turn**2, shift**2, (left**2).sum(axis=1).mean(axis=0)[None]])
    return squares, np.sqrt((moved**2).sum(axis=1).max(axis=0))


def _estimate(squares: Array, motion: Array) -> tuple[DoubleExaminations, DoubleExaminations, DoubleExaminations]:
    """What was found, and both ends of its interval: of means by the central limit theorem, of P95 by ranks."""
    count = len(motion)
    ranks = (ceil(0.95 * count), *interval_ranks(count, 0.95, 0.95))
    found = []
    for sign, rank in zip((0, -1, 1), ranks, strict=True):
        means = [each.mean(axis=-1) + sign * Z_95 * each.std(axis=-1) / sqrt(count) for each in (squares, motion)]
        roots = np.sqrt(np.maximum(means[0], 0.0))
        precision, p95 = Z_95 * roots[:6], np.sort(motion)[rank - 1]
        whole = vector3(precision[:3]), vector3(precision[3:])
        found.append(DoubleExaminations(*whole, float(roots[6]), float(means[1]), float(p95)))
    return found[0], found[1], found[2]

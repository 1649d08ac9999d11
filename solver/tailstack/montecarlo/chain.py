"""Trials by index or by given deviates: the kernel, with every flagged trial redone by the plain form.

The same chain by the plain estimators of ``tailstack.estimation`` (singular value decompositions, Gauss-Newton steps)
is for flagged trials, where no reduction is exact or steps do not converge: NumPy, batched over trials, about a
hundred times slower than the kernel and without its conditions.  So are all trials in which small angles stretch what
an estimator takes for rigid.

Where a design says how often fiducials are missed, the shots of a run are sorted by which of them are: those of one
pattern run together, by a plan whose views do not see them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import NotConvergedError, OutOfRangeError, Problem
from ..estimation.least_squares import estimate_views, locate, weights_at_rest
from ..estimation.missed import hide_fiducials, leave_answers
from ..estimation.resection import project
from ..estimation.triangulation import reprojection_rms
from ..geometry.arrays import Array
from ..geometry.rotation import torsor_transform, transform_points
from ..laws import BETWEEN_SHOTS
from ..measures.measure import Site
from ..system import Law, Reading, System, Weighing
from .kernel import Draws, Results, run_trials, scratch_size
from .plan import LAW_CODE, ChainPlan, compile_plan, replan
from .streams import draw_columns, stream_key
from .tables import EXECUTION, MANUFACTURED, MOUNTS, SHOT, arm_slot, beads_slot, images_slot, intrinsics_slot, shot_slot

PLAIN_BATCH = 1024  # trials of the plain form at once: about 5 MB of design matrices at 12 fiducials
EVALUATE_BATCH = 8192
PLANS = 64
LOSS_STREAM, OTHER_STREAM = 4, 5  # 0 and 1 are the trials' own, 2 and 3 those of radial sampling
_NOT_GIVEN = np.empty((0, 0))
_NO_KEYS = np.zeros(2, dtype=np.uint64)


def norms_of(errors: Array, one_sided: bool = False) -> Array:
    """(n,) of errors (3, n), in their unit; infinite for a shot without an answer.  one_sided: of the one number that
    varies what is above 0."""
    norms = np.maximum(errors[0], 0.0) if one_sided else np.linalg.norm(errors, axis=0)
    return np.where(np.isnan(norms), np.inf, norms)


class TrialResults(NamedTuple):
    """Results of one run of trials, in the order of their indices."""

    errors: Array  # (T, 2, 3, n): TCP error in tcp, localisation error in con; mm; NaN for a shot without an answer
    redone: int  # trials that the plain form redid because the kernel's answer was not proven
    reprojection: Array | None  # (n,) px; NaN likewise
    missed: int = 0  # shots in which a fiducial is missed

    def norms(self, target: int, metric: int) -> Array:
        """(n,) mm; infinite for a shot without an answer."""
        return norms_of(self.errors[target, metric])


def measure_trials(plan: ChainPlan, seed: int, first: int, errors: Array) -> Array:
    """:func:`measure_errors` of trials first ... of this seed, with another shot of each where a site asks for it."""
    if not any(metric.site.other_shot for metric in plan.system.derived_metrics):
        return measure_errors(plan.system, errors)
    return measure_errors(plan.system, errors, run_other_shots(plan, seed, first, errors.shape[-1]))


def run_other_shots(plan: ChainPlan, seed: int, first: int, count: int) -> Array:
    """Errors (T, 2, 3, n) of another shot, of the same unit and mounting, of trials first ... first + count - 1."""
    indices = np.arange(first, first + count, dtype=np.int64)
    z, columns = draw(plan, seed, indices), columns_of_shots(plan)
    z[:, columns] = draw(plan, seed, indices, OTHER_STREAM)[:, columns]
    return np.moveaxis(evaluate(plan, z), 0, -1)


@lru_cache(maxsize=PLANS)
def columns_of_shots(plan: ChainPlan) -> NDArray[np.int64]:
    """The deviates that are drawn at each shot, not once per unit or mounting."""
    blocks = compile_plan(plan.system, held=BETWEEN_SHOTS).blocks
    return np.concatenate([np.arange(each.start, each.stop) for each in blocks if each.stream == SHOT])


def measure_errors(system: System, errors: Array, others: Array | None = None) -> Array:
    """(M, 3, n) of ``system.metrics``, each in its unit, of errors (T, 2, 3, n) as trials have them; contiguous.

    others: those of another shot of each (``Site.other_shot``).  By plain sums: BLAS picks its order of summation by
    processor.
    """
    targets, _, _, count = errors.shape
    both = np.ascontiguousarray(errors).reshape(targets, 6, count)
    points = both.reshape(-1, 3, count)
    derived = system.derived_metrics
    if not derived:
        return points
    names = [target.name for target in system.targets]
    at = dict(zip(names, both, strict=True))
    apart = at if others is None else dict(zip(names, others.reshape(targets, 6, count), strict=True))

    def read(site: Site) -> Array:
        own = at | {site.other_shot: apart[site.other_shot]} if site.other_shot else at
        if site.exact is not None:
            return site.exact(own)
        return np.asarray(sum((weights[:, :, None] * own[name]).sum(axis=1) for name, weights in site.weights.items()))

    return np.concatenate([points, [read(site) for _, site in derived]])


def _allocate_scratch(size: int) -> Array:
    """Scratch that starts on a 64-byte line: eight lanes never straddle two."""
    raw = np.empty(size + 8)
    shift = (-raw.ctypes.data // 8) % 8
    return raw[shift : shift + size]


def _keys(seed: int) -> NDArray[np.uint64]:
    if seed < 0:
        raise OutOfRangeError(Problem("", "seed", f"a seed is a non-negative integer, got {seed}"))
    return np.array([stream_key(seed, 0), stream_key(seed, 1)])


def _pad(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """To a multiple of eight, by repeating the last index."""
    return np.concatenate([indices, np.repeat(indices[-1:], -len(indices) % 8)])


def draw(plan: ChainPlan, seed: int, indices: NDArray[np.int64], stream: int | None = None) -> Array:
    """Standardised deviates z (n, d) of the trials with these indices (columns: see ``plan``); stream: from which all
    of them come, in place of their own."""
    trials = _pad(np.asarray(indices, dtype=np.int64))
    out = np.empty((plan.dimension, len(trials)))
    scratch = _allocate_scratch(8 * plan.dimension)
    keys = _keys(seed) if stream is None else np.array([stream_key(seed, stream)] * 2)
    units = trials // plan.shots_per_unit if stream is None else trials
    draw_columns(plan.tables.segments, keys, units, trials, scratch, out)
    return np.ascontiguousarray(out[:, : len(indices)].T)


def standard_normals(seed: int, stream: int, count: int, dimension: int) -> Array:
    """(count, dimension) N(0, 1) from a stream of its own (2 or more; 0 and 1 are the trials')."""
    return _draw_stream(seed, stream, np.arange(count, dtype=np.int64), dimension, Law.NORMAL)


def _draw_stream(seed: int, stream: int, indices: NDArray[np.int64], dimension: int, law: Law) -> Array:
    """(n, dimension) standardised deviates of one law."""
    trials = _pad(indices)
    out = np.empty((dimension, len(trials)))
    key = stream_key(seed, stream)
    segments = np.array([[0, dimension, LAW_CODE[law], 0]], dtype=np.int64)
    draw_columns(segments, np.array([key, key]), trials, trials, _allocate_scratch(8 * dimension), out)
    return out[:, : len(indices)].T


def draw_losses(plan: ChainPlan, seed: int, indices: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n, N) which fiducials the shots with these indices miss: each by itself, in all views of the shot at once."""
    probability = np.array(plan.system.loss_probability or (0.0,) * len(plan.system.fiducial_labels))
    uniform = _draw_stream(seed, LOSS_STREAM, indices, len(probability), Law.UNIFORM)
    return np.asarray((1 + uniform) / 2 < probability)


def _run(
    plan: ChainPlan, keys: NDArray[np.uint64], trials: NDArray[np.int64], given: Array, reprojection: bool
) -> Results:
    """The kernel's results; of what it does not follow every trial is flagged."""
    n = len(trials)
    flags = np.empty(n) if plan.runs_in_lanes else np.ones(n)
    results = Results(np.empty(6 * len(plan.system.targets) * n), flags, np.empty(n if reprojection else 0))
    if not plan.runs_in_lanes:
        return results
    draws = Draws(keys, trials // plan.shots_per_unit, trials, given)
    run_trials(plan.tables, draws, results, _allocate_scratch(int(scratch_size(plan.tables.counts))))
    return results


def _redo(
    plan: ChainPlan,
    z: Array,
    columns: NDArray[np.int64],
    errors: Array,
    rms: Array | None = None,
    *,
    missed: bool = False,
) -> None:
    """Overwrite these columns of ``errors`` (T, 2, 3, n) by the plain chain of their deviates.

    Raises NotConvergedError where an estimate does not converge: such a trial has no answer, and those after its
    batch are not looked at.  Where fiducials are missed, that is one of the things that may become of a shot.
    """
    for start in range(0, len(columns), PLAIN_BATCH):
        part = columns[start : start + PLAIN_BATCH]
        exact, reprojection = evaluate_plainly(plan, z[start : start + PLAIN_BATCH])
        errors[..., part] = np.moveaxis(exact, 0, -1)
        if rms is not None:
            rms[part] = reprojection
        lost = int((~np.isfinite(exact).all(axis=(1, 2, 3))).sum())
        if lost and not missed:
            seen = errors.shape[-1] if part[-1] == columns[-1] else int(part[-1]) + 1
            estimator = plan.system.estimator
            detail = f"in {lost} of {seen} trials the estimate by {estimator} does not converge"
            hint = "the noise is too large for these fiducials: add some, spread them, or see the errors of dlt"
            raise NotConvergedError(Problem("/model/estimator", "estimate-not-found", detail, hint))


def run_indices(plan: ChainPlan, seed: int, first: int, count: int, *, reprojection: bool = False) -> TrialResults:
    """Trials first ... first + count - 1 of this seed, with what fiducials they miss."""
    indices = np.arange(first, first + count, dtype=np.int64)
    if not plan.system.loss_probability:
        return _run_at(plan, seed, indices, reprojection)
    lost = draw_losses(plan, seed, indices)
    errors = np.full((len(plan.system.targets), 2, 3, count), np.nan)
    rms = np.full(count, np.nan) if reprojection else None
    redone = 0
    for part, missed, columns in _group_shots(plan, lost):
        own = _run_at(part, seed, indices[columns], reprojection, missed=missed)
        errors[..., columns] = own.errors
        redone += own.redone
        if rms is not None:
            rms[columns] = own.reprojection
    return TrialResults(errors, redone, rms, int(lost.any(axis=1).sum()))


def _group_shots(
    plan: ChainPlan, lost: NDArray[np.bool_]
) -> Iterator[tuple[ChainPlan, NDArray[np.bool_] | None, NDArray[np.int64]]]:
    """Shots by which fiducials they miss, rows of ``lost`` (n, N): the plan of each pattern that leaves an answer, the
    pattern (None: nothing), and its rows."""
    some = lost.any(axis=1)
    if not some.all():  # most shots, which need no sorting
        yield plan, None, np.flatnonzero(~some)
    rows = np.flatnonzero(some)
    bits = np.packbits(lost[rows], axis=1)
    order = np.lexsort(bits.T)
    bits, rows = bits[order], rows[order]
    starts = np.flatnonzero(np.append(True, (bits[1:] != bits[:-1]).any(axis=1))) if len(rows) else rows
    groups = [group for group in np.split(rows, starts[1:]) if len(group)]
    patterns = lost[[int(group[0]) for group in groups]]
    answered = np.flatnonzero(leave_answers(plan.system, patterns))
    plans = replan(plan, patterns[answered])
    yield from zip(plans, patterns[answered], (groups[k] for k in answered.tolist()), strict=True)


def _run_at(
    plan: ChainPlan,
    seed: int,
    indices: NDArray[np.int64],
    reprojection: bool,
    *,
    missed: NDArray[np.bool_] | None = None,
) -> TrialResults:
    """Trials with these indices, all of them by one plan; missed: the fiducials (N,) that it was made without."""
    count = len(indices)
    shape = (len(plan.system.targets), 2, 3)
    errors, flags, rms = _run(plan, _keys(seed), _pad(indices), _NOT_GIVEN, reprojection)
    errors, rms = errors.reshape(*shape, -1)[..., :count], rms[:count]
    columns = np.flatnonzero(flags[:count])
    if len(columns):
        rest = plan if missed is None else replace(plan, system=hide_fiducials(plan.system, missed))
        z = draw(plan, seed, indices[columns])
        _redo(rest, z, columns, errors, rms if reprojection else None, missed=missed is not None)
    return TrialResults(errors, len(columns), rms if reprojection else None)


def evaluate(plan: ChainPlan, z: Array) -> Array:
    """Errors (n, T, 2, 3), mm, of standardised deviates z (n, d); axis 2: TCP (tcp), localisation (con).

    Of shots that miss no fiducial: what is missed is no deviate.  Raises OutOfRangeError when z has not
    ``plan.dimension`` columns.
    """
    z = np.asarray(z, dtype=np.float64)
    if z.ndim != 2 or z.shape[1] != plan.dimension:
        detail = f"z must be (n, {plan.dimension}), one column per random input; got {z.shape}"
        raise OutOfRangeError(Problem("", "deviates-shape", detail))
    out = np.empty((len(z), len(plan.system.targets), 2, 3))
    for start in range(0, len(z), EVALUATE_BATCH):
        part = z[start : start + EVALUATE_BATCH]
        trials = np.arange(len(part) + (-len(part)) % 8)
        given = np.zeros((max(plan.dimension, 1), len(trials)))
        given[: plan.dimension, : len(part)] = part.T
        errors, flags, _ = _run(plan, _NO_KEYS, trials, given, False)
        errors = errors.reshape(len(plan.system.targets), 2, 3, -1)[..., : len(part)]
        columns = np.flatnonzero(flags[: len(part)])
        if len(columns):
            _redo(plan, part[columns], columns, errors)
        out[start : start + len(part)] = np.moveaxis(errors, -1, 0)
    return out


def evaluate_plainly(plan: ChainPlan, z: Array) -> tuple[Array, Array]:
    """Errors (n, T, 2, 3) mm and reprojection RMS (n,) px of standardised deviates z (n, d), by the plain estimators.

    Axis 2: TCP error (tcp), localisation error (con).  NaN where an estimate does not converge.
    """
    system, tables = plan.system, plan.tables
    count, views, targets = len(system.fiducials_mm), len(system.views), len(system.targets)
    trials = len(z)
    eq18 = system.reading is Reading.EQ18
    points = np.broadcast_to(system.fiducials_mm, (trials, count, 3))
    true = points
    if tables.counts[MANUFACTURED]:
        start = tables.starts[0]
        true = points + tables.spread * z[:, start : start + 3 * count].reshape(trials, count, 3)

    def act(slot: int, rows: int) -> Array:
        """(n, rows): what the random sources of a slot do."""
        offset, sources = tables.gain_starts[slot]
        gain = tables.gains[offset : offset + rows * sources].reshape(rows, sources)
        start = tables.starts[1 + slot]
        return np.asarray(z[:, start : start + sources] @ gain.T)

    def transform(slot: int) -> Array:
        return torsor_transform(tables.torsors[slot] + act(slot, 6), tables.pivots[slot], system.rotation_form)

    grown = tables.growth + act(beads_slot(views), 3 * (count + 1)).reshape(trials, count + 1, 3)
    true = true + grown[:, :count] @ tables.out_of_frame.reshape(3, 3).T
    transforms = [transform(slot) for slot in MOUNTS]
    assumed = transform_points(transforms[0], points) if eq18 else points
    true = true if eq18 else transform_points(transforms[0], true)

    drawn = z[:, : 2 * views * (count + targets)].reshape(trials, views, count + targets, 2)
    per = tables.noise[:, [0] * count + [1] * targets]
    along_v = per[..., 1] * drawn[..., 0] + per[..., 2] * drawn[..., 1]
    noise = np.stack([per[..., 0] * drawn[..., 0], along_v], axis=-1)
    at_shots = (transform_points(transform(shot_slot(views, v)), true) for v in range(views))
    exact = np.stack([project(view.projection, at) for view, at in zip(system.views, at_shots, strict=True)], axis=1)
    drawn_shifts = [act(images_slot(views, v), 2 * (count + targets)).reshape(trials, -1, 2) for v in range(views)]
    shifts = tables.image_shifts + np.stack(drawn_shifts, axis=1)
    images = exact + shifts[:, :, :count] + noise[:, :, :count]
    wrong = np.stack([act(intrinsics_slot(views, v), 3) + tables.intrinsics[v, 5:8] for v in range(views)], axis=1)
    estimates = estimate_views(system, assumed, images, wrong)
    reprojection = reprojection_rms(estimates, assumed, images, system.sees)

    weighed = system.triangulation.traits.weighing is Weighing.BY_NOISE
    executed = act(EXECUTION, 3) + tables.execution_bias
    amounts = (act(arm_slot(views), len(tables.twists)) + tables.screwed).T
    errors = np.empty((trials, targets, 2, 3))
    tcp_con = system.T_tcp_con
    for t, target in enumerate(system.targets):
        seen = np.stack([project(view.projection, target.position_mm[None])[0] for view in system.views])
        noisy = seen + shifts[:, :, count + t] + noise[:, :, count + t]
        weights = weights_at_rest(system, target) if weighed else None
        located = locate(system, estimates, noisy, assumed, weights)
        errors[:, t, 1] = located - target.position_mm
        tool = transform_points(transforms[1], located[:, None]) + grown[:, count:]
        for twist, amount in zip(tables.twists, amounts, strict=True):
            moved = np.cross(twist[:3], tool) + twist[3:]
            sine, versed = (np.sin(amount), 1 - np.cos(amount)) if twist[:3].any() else (amount, 0 * amount)
            tool = tool + sine[:, None, None] * moved + versed[:, None, None] * np.cross(twist[:3], moved)
        tool = transform_points(transforms[2], transform_points(tcp_con, tool[:, 0])[:, None])[:, 0]
        errors[:, t, 0] = tool + executed - transform_points(tcp_con, target.position_mm)
    return errors, reprojection

"""Shots that miss fiducials: whether what is left still has an answer, and how probable one without is."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, reduce
from itertools import combinations, count
from math import comb

import numpy as np
from numpy.typing import NDArray

from ..errors import IllPosedError
from ..system import System
from .checks import FLAT, examine, look
from .resection import COPLANAR, SINGULAR, design_matrix, hartley_similarity, homogeneous

SYSTEMS, PATTERNS = 64, 2**17  # of missed fiducials, of which is kept whether they leave an answer
LOOKED_AT = 1000  # patterns, those that miss fewest fiducials first, of which a design is asked whether they do
NEGLIGIBLE = 1e-9  # probability of what no fleet of robots sees happen


def hide_fiducials(system: System, lost: NDArray[np.bool_]) -> System:
    """The system in which no view sees these fiducials (N,)."""
    labels = np.array(system.fiducial_labels)
    views = tuple(
        replace(view, sees=tuple(labels[(seen > 0) & ~lost].tolist()))
        for view, seen in zip(system.views, system.sees, strict=True)
    )
    return replace(system, views=views, loss_probability=())


@lru_cache(maxsize=SYSTEMS)
def _verdicts_of(system: System) -> dict[bytes, bool]:
    """By pattern of missed fiducials whether what is left has an answer, as far as it was asked."""
    return {}


def leave_answers(system: System, patterns: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(S,) whether what is left without the fiducials missed (S, N) has an answer, and is not refused by itself."""
    known = _verdicts_of(system)
    if len(known) > PATTERNS:
        known.clear()
    keys = [pattern.tobytes() for pattern in patterns]
    new = [k for k, key in enumerate(keys) if key not in known]
    if new:
        surely = find_surely_answered(system, (system.sees > 0) & ~patterns[new, None])
        for k, sure in zip(new, surely.tolist(), strict=True):
            known[keys[k]] = sure or _passes(hide_fiducials(system, patterns[k]))
    return np.array([known[key] for key in keys], dtype=np.bool_)


def _passes(system: System) -> bool:
    try:
        examine(system)
    except IllPosedError:
        return False
    return True


@lru_cache(maxsize=SYSTEMS)
def probability_unanswered(system: System) -> float:
    """With which a shot misses so many fiducials that it has no answer: at least that, and all but what only patterns
    beyond the first ``LOOKED_AT`` add."""
    if not system.loss_probability:
        return 0.0
    each, sees, fewest = np.array(system.loss_probability), system.sees > 0, system.estimator.traits.fewest_fiducials
    lossy = np.flatnonzero(each)
    of_number = reduce(np.convolve, [np.array([1 - p, p]) for p in each[lossy]], np.ones(1))  # of lossy ones missed
    unanswered, looked_at = 0.0, 0
    for lost in count():
        looked_at += comb(len(lossy), lost)
        if lost > len(lossy) or looked_at > LOOKED_AT or of_number[lost:].sum() < NEGLIGIBLE:
            break
        which = np.array(list(combinations(lossy, lost)), dtype=np.intp)
        patterns = np.zeros((len(which), len(each)), dtype=np.bool_)
        np.put_along_axis(patterns, which, True, 1)
        weights = np.where(patterns, each, 1 - each).prod(axis=1)
        enough = (sees & ~patterns[:, None]).sum(axis=2).min(axis=1) >= fewest
        enough[enough] = leave_answers(system, patterns[enough])
        unanswered += float(weights[~enough].sum())
    return unanswered + float(of_number[max(lost, len(each) - fewest + 1) :].sum())


def find_surely_answered(system: System, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(S,) of views that see these of the fiducials (S, V, N): whether ``examine`` surely does not refuse them, where
    it does not refuse the system itself.  What is left of a structure may be too little, or flat, or determine no view:
    it is ten times as far from that as it has to be."""
    poses, points = system.estimator.believes_intrinsics, system.fiducials_mm
    surely = np.ones(len(seen), dtype=np.bool_)
    for v, each in enumerate(look(replace(system, views=tuple(replace(view, sees=None) for view in system.views)))):
        masks, which = np.unique(seen[:, v], axis=0, return_inverse=True)
        sizes, sound = masks.sum(axis=1), np.zeros(len(masks), dtype=np.bool_)
        for size in np.unique(sizes[sizes >= max(system.estimator.traits.fewest_fiducials, 4)]).tolist():
            rows = np.flatnonzero(sizes == size)
            columns = np.nonzero(masks[rows])[1].reshape(len(rows), size)
            left = points[columns]
            centred = left - left.mean(axis=1, keepdims=True)
            _, values, axes = np.linalg.svd(centred, full_matrices=False)
            good = values[:, 2] > 10 * COPLANAR * values[:, 0]
            if poses:  # no other pose is looked for
                extents = np.ptp(centred @ np.swapaxes(axes, 1, 2), axis=1)
                good &= extents[:, 2] > 1.001 * FLAT * extents[:, 1]
            else:
                own = homogeneous(left) @ np.swapaxes(hartley_similarity(left), 1, 2)
                images = each.images[columns]
                imaged = homogeneous(images) @ np.swapaxes(hartley_similarity(images), 1, 2)
                matrix = design_matrix(own, imaged[..., :2])
                squares = np.linalg.eigvalsh(np.swapaxes(matrix, 1, 2) @ matrix)
                good &= squares[:, 1] > (10 * SINGULAR) ** 2 * squares[:, 11]
            sound[rows] = good
        surely &= sound[which.reshape(-1)]
    return surely

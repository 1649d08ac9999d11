"""The first-order model split into what the optimiser can change and what it cannot.

At the biased geometry a mount, the hand-eye and the execution act on the error through gains that do not
depend on the layout (DLT absorbs a rigid displacement exactly); only image noise and manufacturing errors
see the fiducials.  The constants come from :func:`~tailstack.propagation.linear.linearise`, the rest from
the same :func:`~tailstack.propagation.noise.noise_gains` that the score runs, here on symbols.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..propagation.linear import estimator_geometry, linearise
from ..propagation.noise import noise_gains
from ..system import Array, Law, System, Target
from ..tail.approximation import pearson_wh_quantile_squared, square_cumulants
from .problem import PlacementProblem
from .symbols import Duck, plain, times

LAYOUT_BLOCKS = ("fiducial_noise:", "target_noise:", "fiducial_manufacturing")


@dataclass(frozen=True, slots=True, eq=False)
class Estimator:
    """What the layout enters through, the same for every target."""

    projections: Array  # (V, 3, 4) effective, |p3| = 1
    told: Array  # (3, 3): fiducials as the estimator is told them are X @ told.T + told_shift_mm
    told_shift_mm: Array  # (3,)
    fiducial_px: Array  # (V,) standard deviations
    target_px: Array  # (V,)
    manufacturing_std_mm: Array  # (N, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Mean (3,), covariance (3, 3), and the displacement (3,) at one end of each source that is not normal, mm."""

    mean: Duck
    covariance: Duck
    uniform: tuple[Duck, ...]
    triangular: tuple[Duck, ...]

    def squared_quantile(self, p: float, sqrt: Callable[[Any], Any]) -> Duck:
        """The smooth closed form of the p-quantile of ``|e|^2``, mm^2."""
        cumulants = square_cumulants(self.mean, self.covariance, self.uniform, self.triangular)
        return pearson_wh_quantile_squared(p, cumulants, sqrt)


@dataclass(frozen=True, slots=True, eq=False)
class TargetTerms:
    """One target: constants of the linear model that no free variable changes."""

    target: Target
    reconstructed_mm: Array  # (3,) as the estimator sees it, noise-free
    to_error: Array  # (3, 3): displacement of the triangulated point to the error the requirement limits
    bias_mm: Array  # (3,)
    covariance: Array  # (3, 3) mm^2 of the fixed sources that are not image-side
    uniform: tuple[Array, ...]  # (3,) mm at one end of those of them that are uniform
    triangular: tuple[Array, ...]  # and triangular
    bounded: Array  # (3, B) mm at the positive end of each fixed bounded source
    bounded_keys: tuple[tuple[str, int], ...]  # (contributor, source) of those
    free_gain: Array  # (3, K) mm per native unit of each free half-width
    free_keys: tuple[tuple[str, int], ...]


def estimator_of(system: System) -> Estimator:
    projections, told, per_error = estimator_geometry(system)
    # In the physical reading the estimator is told X itself, in the Eq 18 reading the displaced X.
    return Estimator(
        projections=projections,
        told=per_error,
        told_shift_mm=told[0] - per_error @ system.fiducials_mm[0],
        fiducial_px=np.array([view.fiducial_noise_px for view in system.views]),
        target_px=np.array([view.target_noise_px for view in system.views]),
        manufacturing_std_mm=system.manufacturing_std_mm,
    )


def terms_of(problem: PlacementProblem, target: Target) -> TargetTerms:
    """Constants at one target.  They do not depend on the layout, so a singular one is scattered first."""
    error = problem.requirement.error
    system = problem.system
    if problem.free_fiducials and is_flat(system.fiducials_mm):
        scattered = system.fiducials_mm.copy()
        unit = np.random.default_rng(0).uniform(size=(len(problem.free_fiducials), 3))
        scattered[list(problem.free_fiducials)] = problem.box_mm[0] + unit * (problem.box_mm[1] - problem.box_mm[0])
        system = replace(system, fiducials_mm=scattered)
    model = linearise(system, target)
    free = {(item.contributor, item.component): k for k, item in enumerate(problem.half_widths)}
    covariance, free_gain = np.zeros((3, 3)), np.zeros((3, len(free)))
    columns: dict[Law, list[Array]] = {Law.UNIFORM: [], Law.TRIANGULAR: []}
    bounded: dict[tuple[str, int], Array] = {}
    free_keys = [("", 0)] * len(free)
    for block in model.blocks:
        if block.contributor.startswith(LAYOUT_BLOCKS):
            continue
        gain = model.gain(block, error)
        for j, (component, law) in enumerate(zip(block.components, block.laws, strict=True)):
            position = free.get((block.contributor, component))
            if position is not None:
                free_gain[:, position] = gain[:, j]
                free_keys[position] = (block.contributor, j)
            elif law is Law.BOUNDED:
                bounded[block.contributor, j] = gain[:, j] * block.half_width[j]
            else:
                covariance += np.outer(gain[:, j], gain[:, j]) * block.std[j] ** 2
                if law in columns and block.half_width[j] > 0:
                    columns[law].append(gain[:, j] * block.half_width[j])
    return TargetTerms(
        target=target,
        reconstructed_mm=model.reconstructed_mm,
        to_error=model.tcp_from_localisation if error == "tcp" else np.eye(3),
        bias_mm=model.bias_mm(error),
        covariance=covariance,
        uniform=tuple(columns[Law.UNIFORM]),
        triangular=tuple(columns[Law.TRIANGULAR]),
        bounded=np.array(list(bounded.values())).T.reshape(3, -1),
        bounded_keys=tuple(bounded),
        free_gain=free_gain,
        free_keys=tuple(free_keys),
    )


def is_flat(fiducials_mm: Array) -> bool:
    """Whether fiducials (N, 3) lie in one plane, to rounding: the resection then has no answer."""
    values = np.linalg.svd(fiducials_mm - fiducials_mm.mean(axis=0), compute_uv=False)
    return bool(values[2] <= 1e-9 * values[0])


def image_covariance(estimator: Estimator, terms: TargetTerms, fiducials: Duck) -> Duck:
    """(3, 3) mm^2 of image noise and manufacturing errors, in the frame of the limited error.

    fiducials (N, 3) mm: floats or an object array of symbols.
    """
    points = fiducials @ plain(estimator.told).T + plain(estimator.told_shift_mm)
    views, count = len(estimator.projections), points.shape[0]
    kind = points.dtype
    fiducial, target = np.zeros((views, count, 3, 2), kind), np.zeros((views, 3, 2), kind)
    manufacturing, perspective = np.zeros((views, count, 3, 3), kind), np.zeros((views, count, 2), kind)
    noise_gains(
        plain(estimator.projections),
        points,
        plain(terms.reconstructed_mm),
        fiducial,
        target,
        manufacturing,
        perspective,
    )
    total = np.zeros((3, 3), kind)
    for v in range(views):
        columns = fiducial[v].transpose(1, 0, 2).reshape(3, 2 * count)
        total = total + (columns @ columns.T) * float(estimator.fiducial_px[v] ** 2)
        total = total + (target[v] @ target[v].T) * float(estimator.target_px[v] ** 2)
    if estimator.manufacturing_std_mm.any():
        shared = manufacturing.sum(axis=0)
        for i in range(count):
            scaled = shared[i] @ plain(estimator.told) * plain(estimator.manufacturing_std_mm[i])
            total = total + scaled @ scaled.T
    to_error = plain(terms.to_error)
    return to_error @ total @ to_error.T


def moments(
    problem: PlacementProblem, terms: TargetTerms, image: Duck, half_width: Duck, signs: Duck, free_signs: Duck
) -> Moments:
    """Moments of the error at one target.

    image (3, 3) from :func:`image_covariance`; half_width (K,) native unit; ``signs`` (B,) and
    ``free_signs`` (K,) say at which end each bounded source is held (the latter only read where the law is
    bounded).  All but the problem may be symbols.
    """
    laws = free_laws(problem)
    mean = plain(terms.bias_mm) + plain(terms.bounded) @ signs
    covariance = plain(terms.covariance) + image
    columns = {Law.UNIFORM: [*map(plain, terms.uniform)], Law.TRIANGULAR: [*map(plain, terms.triangular)]}
    for k, (law, per_half_width) in enumerate(laws):
        gain = plain(terms.free_gain[:, k])
        if law is Law.BOUNDED:
            mean = mean + times(gain, free_signs[k] * half_width[k])
            continue
        covariance = covariance + times(np.outer(gain, gain), (per_half_width * half_width[k]) ** 2)
        if law in columns:
            columns[law].append(times(gain, half_width[k]))
    return Moments(mean, covariance, tuple(columns[Law.UNIFORM]), tuple(columns[Law.TRIANGULAR]))


def free_laws(problem: PlacementProblem) -> tuple[tuple[Law, float], ...]:
    """Law and standard deviation per half-width of each free half-width."""
    found = []
    for free in problem.half_widths:
        mounts = (problem.system.interface_1, problem.system.interface_2)
        sources = next(mount.sources for mount in mounts if mount.name == free.contributor)
        j = sources.names.index(free.component)
        unit = Law.NORMAL if sources.laws[j] is Law.NORMAL else sources.laws[j]
        per = {Law.NORMAL: 1 / float(sources.coverage_factor[j]), Law.UNIFORM: 3**-0.5, Law.TRIANGULAR: 6**-0.5}
        found.append((unit, per.get(unit, 0.0)))
    return tuple(found)

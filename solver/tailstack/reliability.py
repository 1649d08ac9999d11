"""The smallest slip of a fiducial's image that the residuals of its view give away, and what one below it does.

A bead whose centroid slips, or that is taken for its neighbour, leaves residuals in its view.  Baarda's test asks of
one bead whether its two image coordinates fit the others: with S the covariance of the images (noise, and each bead's
own manufacturing error) and J their slopes by what the estimator is free to choose, the residuals hold

    Q = S^-1 - S^-1 J (J'S^-1 J + L)^-1 J'S^-1

of the information, L that of a prior; whichever weights the estimator itself used, for all that vanish on J give the
same.  A slip d of one bead is noticed with the stated power when ``d'B d >= lambda``, B its 2x2 block of Q and lambda
the noncentrality at which a chi-square of two degrees of freedom exceeds its level so often.  The smallest noticed slip
in its worst direction is ``sqrt(lambda / smallest eigenvalue of B)``; what an unnoticed one does to a target with the
gain G of this bead is at most ``sqrt(lambda . largest eigenvalue of G B^-1 G')`` (internal and external reliability:
Baarda 1968).
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, chndtr

from .geometry.arrays import Array
from .geometry.camera import image_of
from .propagation.linear import Chain, LinearModel
from .propagation.noise import image_slopes
from .propagation.nonlinearity import motion_of_images
from .results import SlipReliability
from .system import ALL_UNKNOWNS, POSE_UNKNOWNS, Effect, Place

LEVEL, POWER = 0.001, 0.80  # of the test of one bead
BLIND = 1e-9  # of the information of an image coordinate: what is left is nothing


def slip_reliabilities(chain: Chain, models: dict[str, LinearModel]) -> tuple[SlipReliability, ...]:
    """For every view and every fiducial that it sees, the largest effect first; what is never noticed before all."""
    noticed = _noncentrality(LEVEL, POWER)
    reliabilities = []
    for v, view in enumerate(chain.system.views):
        seen = np.flatnonzero(chain.weights[v])
        blocks = _information(chain, v, seen)
        unmix = np.linalg.inv(chain.imaging.estimation.factors_of(0)[v])
        gains = {
            name: next(b.gain("tcp") for b in model.blocks if _is_noise_of_fiducials(b.effect, view.name))
            for name, model in models.items()
        }
        for block, i in zip(blocks, seen.tolist(), strict=True):
            label = chain.system.fiducial_labels[i]
            if block is None:
                reliabilities.append(SlipReliability(view.name, label, None, None, next(iter(models))))
                continue
            slip = sqrt(noticed / max(float(np.linalg.eigvalsh(block)[0]), 1e-300))
            inverse = np.linalg.inv(block)
            effects = {}
            for name, gain in gains.items():
                own = gain[:, 2 * i : 2 * i + 2] @ unmix
                effects[name] = sqrt(noticed * max(float(np.linalg.eigvalsh(own @ inverse @ own.T)[-1]), 0.0))
            target = max(effects, key=effects.__getitem__)
            reliabilities.append(SlipReliability(view.name, label, slip, effects[target], target))
    return tuple(sorted(reliabilities, key=lambda item: -np.inf if item.effect_mm is None else -item.effect_mm))


def _is_noise_of_fiducials(effect: Effect, view: str) -> bool:
    return effect.is_grouped and effect.acts_at(Place.IMAGES, view) and not effect.of_target


def _information(chain: Chain, v: int, seen: NDArray[np.intp]) -> list[Array | None]:
    """(2, 2) px^-2 of what a view's residuals say of each fiducial that it sees; None: a direction of which nothing."""
    imaging = chain.imaging
    projection, points = imaging.projections[v], imaging.points[seen]
    unknowns = imaging.estimation.unknowns or ALL_UNKNOWNS
    centre = points.mean(axis=0)
    middle = projection @ np.append(centre, 1.0)
    slopes = np.zeros((len(seen), 2, 11))
    for point, out in zip(points, slopes, strict=True):
        image_slopes(projection, point, centre, image_of(middle), unknowns, out)
    rows = slopes[:, :, :unknowns].reshape(-1, unknowns)
    rows = rows / np.linalg.norm(rows, axis=0)
    noise = max(float(imaging.estimation.noise[v, 0]), 1e-9)
    spread = chain.system.manufacturing_std_mm[seen][:, None, :]
    made = motion_of_images(projection, points) @ imaging.per_error * spread
    factor = imaging.estimation.factors_of(0)[v]
    own = made @ made.transpose(0, 2, 1) + noise**2 * (factor @ factor.T)  # (n, 2, 2) px^2
    weight = np.zeros((2 * len(seen), 2 * len(seen)))
    for k, covariance in enumerate(own):
        weight[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.inv(covariance)
    normal = rows.T @ weight @ rows
    if unknowns < ALL_UNKNOWNS:
        sought = range(POSE_UNKNOWNS, unknowns)
        scale = np.linalg.norm(slopes[:, :, sought].reshape(-1, len(sought)), axis=0)
        normal[sought, sought] += imaging.estimation.precision[v, : len(sought)] / noise**2 / scale**2
    left = weight - weight @ rows @ np.linalg.solve(normal, rows.T @ weight)
    information: list[Array | None] = []
    for k in range(len(seen)):
        block = left[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        whole = weight[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        blind = np.linalg.eigvalsh(block)[0] < BLIND * np.linalg.eigvalsh(whole)[0]
        information.append(None if blind else block)
    return information


def _noncentrality(level: float, power: float) -> float:
    """Of a chi-square of two degrees of freedom that exceeds its own ``level`` point with this power."""
    from scipy.optimize import brentq  # as few scores ask for reliability

    limit = float(chdtri(2, level))
    return float(brentq(lambda value: 1.0 - chndtr(limit, 2, value) - power, 0.0, 200.0, xtol=1e-12))

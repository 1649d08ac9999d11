"""The same job by other means: what a user would write first, and what others' tools make of it.

Every function draws ``trials`` samples of the performance scene (12 fiducials, AP and LAT, 0.5 px, two mounts
of three rotations and three translations: 64 normal deviates a trial) and returns the norms of the TCP error.
"""

from __future__ import annotations

import numpy as np

from tailstack.arrays import Array
from tailstack.system import System

DEVIATES = 64


def scaled_deviates(system: System, rng: np.random.Generator, trials: int) -> Array:
    """(trials, 64): fiducial noise of both views, target noise of both views, torsors 1 and 2, in px, rad and mm."""
    mounts = (system.structure_connector, system.connector_flange)
    noise = [np.full(2 * len(system.fiducials_mm), v.fiducial_noise_px) for v in system.views]
    noise += [np.full(2, v.target_noise_px) for v in system.views]
    scale = np.concatenate([*noise, *[m.sources.std for m in mounts]])
    return rng.standard_normal((trials, len(scale))) * scale


def rotations(angles: Array) -> Array:
    """Rx Ry Rz for (..., 3) angles, rad."""
    (cx, cy, cz), (sx, sy, sz) = np.moveaxis(np.cos(angles), -1, 0), np.moveaxis(np.sin(angles), -1, 0)
    rows = [
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def moved(points: Array, torsor: Array, pivot: Array) -> Array:
    """(..., N, 3) points displaced by (..., 6) torsors about a pivot."""
    turned = (points - pivot) @ np.swapaxes(rotations(torsor[..., :3]), -1, -2)
    return np.asarray(turned + pivot + torsor[..., None, 3:])


def images(projection: Array, points: Array) -> Array:
    seen = points @ projection[:, :3].T + projection[:, 3]
    return np.asarray(seen[..., :2] / seen[..., 2:])


def similarity(points: Array) -> tuple[Array, Array]:
    """Hartley's centre (..., d) and scale (...)."""
    centre = points.mean(axis=-2)
    spread = np.sqrt(((points - centre[..., None, :]) ** 2).sum(-1).mean(-1))
    return centre, np.sqrt(points.shape[-1]) / spread


def equations(points: Array, seen: Array) -> Array:
    """(..., 2N, 12) rows of the resection from (N, 3) and (..., N, 2), both normalised."""
    x = np.broadcast_to(np.append(points, np.ones((len(points), 1)), axis=1), (*seen.shape[:-1], 4))
    zero = np.zeros_like(x)
    u_rows = np.concatenate([x, zero, -seen[..., :1] * x], axis=-1)
    v_rows = np.concatenate([zero, x, -seen[..., 1:] * x], axis=-1)
    return np.concatenate([u_rows, v_rows], axis=-2)


def split(system: System, z: Array) -> tuple[list[Array], list[Array], Array, Array]:
    count = len(system.fiducials_mm)
    fiducial = [z[..., 2 * count * v : 2 * count * (v + 1)].reshape(*z.shape[:-1], count, 2) for v in range(2)]
    rest = z[..., 4 * count :]
    return fiducial, [rest[..., 0:2], rest[..., 2:4]], rest[..., 4:10], rest[..., 10:16]


def observe(system: System, z: Array) -> tuple[list[Array], list[Array], Array]:
    """Images of fiducials and target in both views for a batch of deviates, and the second torsor."""
    fiducial, aim, first, second = split(system, z)
    true = moved(system.fiducials_mm, first, system.structure_connector.pivot_mm)
    target = system.targets[0].position_mm
    seen = [images(v.projection, true) + n for v, n in zip(system.views, fiducial, strict=True)]
    aimed = [images(v.projection, target[None])[0] + n for v, n in zip(system.views, aim, strict=True)]
    return seen, aimed, second


def finish(system: System, found: Array, second: Array) -> Array:
    end = moved(found[..., None, :], second, system.connector_flange.pivot_mm)[..., 0, :]
    return np.linalg.norm(end - system.targets[0].position_mm, axis=-1)


def batched_svd(system: System, rng: np.random.Generator, trials: int) -> Array:
    """Vectorised NumPy: `numpy.linalg.svd` over a batch."""
    return batched_chain(system, scaled_deviates(system, rng, trials))


def batched_chain(system: System, z: Array) -> Array:
    seen, aimed, second = observe(system, z)
    centre, scale = similarity(system.fiducials_mm)
    points = (system.fiducials_mm - centre) * scale
    rows = []
    for x, t in zip(seen, aimed, strict=True):
        middle, zoom = similarity(x)
        matrix = equations(points, (x - middle[..., None, :]) * zoom[..., None, None])
        p = np.linalg.svd(matrix, full_matrices=False)[2][..., -1, :].reshape(-1, 3, 4)
        p = p / np.linalg.norm(p[:, 2, :3], axis=-1)[:, None, None]
        local = (t - middle) * zoom[..., None]
        # Undo the image scale so that both views' rows are in pixels times depth.
        rows.append((local[..., None] * p[:, 2:3] - p[:, :2]) / zoom[..., None, None])
    solution = np.linalg.svd(np.concatenate(rows, axis=-2), full_matrices=False)[2][..., -1, :]
    return finish(system, solution[:, :3] / solution[:, 3:] / scale + centre, second)


def loop_svd(system: System, rng: np.random.Generator, trials: int) -> Array:
    """A loop over trials with `numpy.linalg.svd`: what a user writes first."""
    return np.array([batched_chain(system, z[None])[0] for z in scaled_deviates(system, rng, trials)])


def opencv(system: System, rng: np.random.Generator, trials: int) -> Array:
    """OpenCV: `SVDecomp` for the resection, `triangulatePoints` for the target, one trial at a time."""
    import cv2

    centre, scale = similarity(system.fiducials_mm)
    points = (system.fiducials_mm - centre) * scale
    norms = np.empty(trials)
    for k, z in enumerate(scaled_deviates(system, rng, trials)):
        seen, aimed, second = observe(system, z)
        found, local = [], []
        for x, t in zip(seen, aimed, strict=True):
            middle, zoom = similarity(x)
            null = cv2.SVDecomp(equations(points, (x - middle) * zoom))[2][-1].reshape(3, 4)
            found.append(null / np.linalg.norm(null[2, :3]))
            local.append((t - middle) * zoom)
        solution = cv2.triangulatePoints(found[0], found[1], local[0][:, None], local[1][:, None])[:, 0]
        norms[k] = finish(system, solution[:3] / solution[3] / scale + centre, second)
    return norms


def openturns(system: System, rng: np.random.Generator, trials: int) -> Array:
    """OpenTURNS: a Monte Carlo experiment through a vectorised Python function."""
    import openturns as ot

    ot.RandomGenerator.SetSeed(int(rng.integers(2**31)))
    deviates = ot.MonteCarloExperiment(ot.Normal(DEVIATES), trials).generate()
    unit = [v.fiducial_noise_px for v in system.views for _ in range(2 * len(system.fiducials_mm))]
    unit += [v.target_noise_px for v in system.views for _ in range(2)]
    scale = np.concatenate([unit, system.structure_connector.sources.std, system.connector_flange.sources.std])
    chain = ot.PythonFunction(DEVIATES, 1, func_sample=lambda z: batched_chain(system, np.asarray(z) * scale)[:, None])
    return np.asarray(chain(deviates))[:, 0]

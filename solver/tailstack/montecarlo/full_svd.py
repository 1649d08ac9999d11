"""The same chain by full singular value decompositions: for flagged trials, and where no reduction is exact.

Plain NumPy on the estimator of ``tailstack.estimation``, batched over trials: about a hundred times
slower than the kernel, without its conditions.
"""

from __future__ import annotations

import numpy as np

from ..estimation.resection import project, resect
from ..estimation.triangulation import reprojection_rms, triangulate
from ..geometry.rotation import torsor_transform, transform_points
from ..system import Array, Reading
from .plan import ChainPlan


def errors_by_svd(plan: ChainPlan, z: Array) -> tuple[Array, Array]:
    """Errors (n, T, 2, 3) mm and reprojection RMS (n,) px of standardised deviates z (n, d).

    Axis 2: TCP error (tcp), localisation error (con).
    """
    system, tables = plan.system, plan.tables
    count, views, targets = len(system.fiducials_mm), len(system.views), len(system.targets)
    trials = len(z)
    eq18 = system.reading is Reading.EQ18
    points = np.broadcast_to(system.fiducials_mm, (trials, count, 3))
    true = points
    if tables.counts[3]:
        start = tables.starts[0]
        true = points + tables.spread * z[:, start : start + 3 * count].reshape(trials, count, 3)

    transforms = []
    for k, mount in enumerate((system.interface_1, system.interface_2, system.hand_eye)):
        offset, sources = tables.gain_starts[k]
        gain = tables.gains[offset : offset + 6 * sources].reshape(6, sources)
        start = tables.starts[1 + k]
        torsor = tables.torsors[k] + z[:, start : start + sources] @ gain.T
        transforms.append(torsor_transform(torsor, mount.pivot_mm, system.rotation_form))
    told = transform_points(transforms[0], points) if eq18 else points
    true = true if eq18 else transform_points(transforms[0], true)

    noise = z[:, : 2 * views * (count + targets)].reshape(trials, views, count + targets, 2)
    sigma = tables.noise[:, None, :]  # (V, 1, kind)
    exact = np.stack([project(view.projection, true) for view in system.views], axis=1)
    images = exact + sigma[:, :, :1] * noise[:, :, :count]
    estimates = resect(told[:, None], images)
    reprojection = reprojection_rms(estimates, told, images)

    offset, sources = tables.gain_starts[3]
    gain = tables.gains[offset : offset + 3 * sources].reshape(3, sources)
    executed = z[:, tables.starts[4] : tables.starts[4] + sources] @ gain.T + tables.execution_bias
    errors = np.empty((trials, targets, 2, 3))
    tcp_con = system.T_tcp_con
    for t, target in enumerate(system.targets):
        seen = np.stack([project(view.projection, target.position_mm[None])[0] for view in system.views])
        noisy = seen + sigma[:, 0, 1:] * noise[:, :, count + t]
        found = triangulate(estimates, noisy, told, system.triangulation)
        errors[:, t, 1] = found - target.position_mm
        tool = transform_points(transforms[1], found[:, None])
        tool = transform_points(transforms[2], transform_points(tcp_con, tool[:, 0])[:, None])[:, 0]
        errors[:, t, 0] = tool + executed - transform_points(tcp_con, target.position_mm)
    return errors, reprojection

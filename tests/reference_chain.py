"""The full nonlinear chain, one trial at a time, written plainly for the tests (SVD, 4x4 matrices).

It follows docs/conventions.md step by step and shares nothing with ``propagation`` or ``montecarlo``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tailstack.arrays import Array
from tailstack.estimation.least_squares import estimate_views, locate, row_weights
from tailstack.estimation.resection import project
from tailstack.estimation.triangulation import triangulate
from tailstack.system import IntrinsicsError, Reading, RotationForm, System, Target, Triangulation, no_sources


def rotation(angles: Array, form: RotationForm) -> Array:
    rx, ry, rz = angles
    if form is RotationForm.SMALL_ANGLE:
        return np.array([[1, -rz, ry], [rz, 1, -rx], [-ry, rx, 1]])
    x = np.array([[1, 0, 0], [0, np.cos(rx), -np.sin(rx)], [0, np.sin(rx), np.cos(rx)]])
    y = np.array([[np.cos(ry), 0, np.sin(ry)], [0, 1, 0], [-np.sin(ry), 0, np.cos(ry)]])
    z = np.array([[np.cos(rz), -np.sin(rz), 0], [np.sin(rz), np.cos(rz), 0], [0, 0, 1]])
    return x @ y @ z


def move(torsor: Array, pivot: Array, form: RotationForm, points: Array) -> Array:
    return (points - pivot) @ rotation(torsor[:3], form).T + pivot + torsor[3:]


@lru_cache(maxsize=8)
def weights_at_rest(system: System, target: Target) -> Array | None:
    """Of the weighted triangulation: those of the structure at its bias, without noise."""
    if system.triangulation is not Triangulation.WEIGHTED:
        return None
    mount, form = system.structure_connector, system.rotation_form
    moved = move(mount.bias, mount.pivot_mm, form, system.fiducials_mm)
    told = moved if system.reading is Reading.EQ18 else system.fiducials_mm
    truly = system.fiducials_mm if system.reading is Reading.EQ18 else moved
    estimates = estimate_views(system, told, np.stack([project(view.projection, truly) for view in system.views]))
    aims = np.stack([project(view.projection, target.position_mm[None])[0] for view in system.views])
    return row_weights(system, estimates, told, triangulate(estimates, aims, told))


def run(system: System, target: Target, inputs: dict[str, Array]) -> dict[str, Array]:
    """One trial.  ``inputs``: contributor -> native values (missing: zero).  Returns the two error vectors."""
    form = system.rotation_form

    def torsor(mount):
        return mount.bias + mount.sources.direction @ inputs.get(mount.name, np.zeros(mount.sources.count))

    points = system.fiducials_mm
    true = points + inputs.get("fiducial_manufacturing", np.zeros(points.size)).reshape(points.shape)
    first = torsor(system.structure_connector)
    told = points
    if system.reading is Reading.PHYSICAL:
        true = move(first, system.structure_connector.pivot_mm, form, true)
    else:
        told = move(first, system.structure_connector.pivot_mm, form, points)
    imaged, seen, wrong = [], [], []
    for view in system.views:
        noise = inputs.get(f"fiducial_noise:{view.name}", np.zeros(2 * len(points))).reshape(-1, 2)
        imaged.append(project(view.projection, true) + noise)
        noise = inputs.get(f"target_noise:{view.name}", np.zeros(2))
        seen.append(project(view.projection, target.position_mm[None])[0] + noise)
        error = view.intrinsics_error or IntrinsicsError(np.zeros(3), no_sources(3))
        drawn = inputs.get(f"assumed_intrinsics:{view.name}", np.zeros(error.sources.count))
        wrong.append(error.bias + error.sources.direction @ drawn)
    estimates = estimate_views(system, told, np.stack(imaged), np.stack(wrong))
    found = locate(system, estimates, np.stack(seen), told, weights_at_rest(system, target))
    moved = move(torsor(system.connector_flange), system.connector_flange.pivot_mm, form, found)
    to_tool = system.T_tcp_flange @ system.T_flange_con
    tool = (to_tool @ np.append(moved, 1))[:3]
    tool = move(torsor(system.hand_eye), system.hand_eye.pivot_mm, form, tool)
    tool = tool + system.execution_bias_mm
    tool = tool + system.execution.direction @ inputs.get("execution", np.zeros(system.execution.count))
    return {
        "localisation": found - target.position_mm,
        "tcp": tool - (to_tool @ np.append(target.position_mm, 1))[:3],
    }

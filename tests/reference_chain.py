"""The full nonlinear chain, one trial at a time, written plainly for the tests (SVD, 4x4 matrices).

It follows docs/conventions.md step by step and shares nothing with ``propagation`` or ``montecarlo``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg import expm, rq

from scenes import effect_named
from tailstack.estimation.least_squares import estimate_views, locate, row_weights
from tailstack.estimation.resection import homogeneous, project
from tailstack.estimation.triangulation import triangulate
from tailstack.geometry.arrays import Array
from tailstack.geometry.rotation import RotationForm
from tailstack.montecarlo.plan import ChainPlan
from tailstack.system import Reading, System, Target, Triangulation, View


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
    moved = move(mount.known, mount.pivot_mm, form, system.fiducials_mm)
    told = moved if system.reading is Reading.EQ18 else system.fiducials_mm
    truly = system.fiducials_mm if system.reading is Reading.EQ18 else moved
    estimates = estimate_views(system, told, np.stack([project(view.projection, truly) for view in system.views]))
    aims = np.stack([project(view.projection, target.position_mm[None])[0] for view in system.views])
    return row_weights(system, estimates, told, triangulate(estimates, aims, told))


def field(effect: Any, images: Array, coefficients: Array) -> Array:
    """Shift (n, 2) px of image points: coefficient by coefficient, in the order of their names."""
    names = effect.sources.names
    x, y = ((images - effect.centre_px) / effect.half_diagonal_px).T
    shift = np.zeros_like(images)
    for name, value in zip(names, coefficients, strict=True):
        along, i, j = name[0], int(name[3]), int(name[5])  # "u.x2y1"
        shift[:, "uv".index(along)] += value * x**i * y**j
    return shift


def ball_shifts(system: System, view: View) -> Array:
    """From the images of the balls' centres to the middles of their outlines, (N, 2) px: in the frame of the camera."""
    balls = effect_named(system, "ball_images")
    if balls is None:
        return np.zeros(2)
    upper, turn = rq(view.projection[:, :3])
    flip = np.diag(np.sign(np.diag(upper)))
    upper, turn = upper @ flip, flip @ turn
    camera = (np.linalg.solve(upper, view.projection @ homogeneous(system.fiducials_mm).T)).T
    stretched = camera[:, :2] * camera[:, 2:] / (camera[:, 2:] ** 2 - balls.radius_mm**2)
    plain = camera[:, :2] / camera[:, 2:]
    return balls.known * (stretched - plain) @ (upper / upper[2, 2])[:2, :2].T


def tilt(view: View, images: Array, turns: Array) -> Array:
    """Shift (n, 2) px of image points where the detector's plane is turned by angles (2,) about u and v: where rays
    meet it, to first order in the angles, by differences."""
    upper, _ = rq(view.projection[:, :3])
    camera = upper @ np.diag(np.sign(np.diag(upper)))
    camera = camera / camera[2, 2]
    rays = np.linalg.solve(camera, homogeneous(np.hstack([images, np.zeros((len(images), 1))]))[:, [0, 1, 3]].T).T

    def meet(about_u: float, about_v: float) -> Array:
        u, v = np.array([np.cos(about_v), 0, np.sin(about_v)]), np.array([0, np.cos(about_u), np.sin(about_u)])
        normal, foot = np.cross(u, v), np.array([0, 0, 1.0])
        hits = rays * ((normal @ foot) / (rays @ normal))[:, None]
        place = np.linalg.lstsq(np.column_stack([u, v]), (hits - foot).T, rcond=None)[0].T
        return place @ camera[:2, :2].T + camera[:2, 2]

    step = 1e-4
    by_u = (meet(step, 0.0) - meet(-step, 0.0)) / (2 * step)
    by_v = (meet(0.0, step) - meet(0.0, -step)) / (2 * step)
    return by_u * turns[0] + by_v * turns[1]


def drawn_of(effect: Any, inputs: dict[str, Array]) -> Array:
    """What an effect does in a trial: what is known of it, and what its sources are."""
    values = inputs.get(effect.name, np.zeros(effect.sources.count))
    return effect.known + effect.sources.direction @ values


def carry_on(system: System, inputs: dict[str, Array], point: Array) -> Array:
    """A point (4,) in flange after the screws of the arm, as exponentials of matrices."""
    arm: list[Any] = [effect for effect in system.effects if hasattr(effect, "twists")]
    total = sum(each.amounts @ drawn_of(each, inputs) for each in arm)
    for twist, amount in zip(arm[0].twists, total, strict=True) if arm else ():
        w, v = amount * twist[:3], amount * twist[3:]
        generator = np.array([[0, -w[2], w[1], v[0]], [w[2], 0, -w[0], v[1]], [-w[1], w[0], 0, v[2]], [0, 0, 0, 0]])
        point = expm(generator) @ point
    return point


def inputs_of(plan: ChainPlan, z: Array, place: int) -> dict[str, Array]:
    """What deviates (d,) of a trial are in native units, as ``run`` takes them, for the target at a place."""
    system, inputs = plan.system, {}
    scales = {effect.name: effect.sources for effect in (*system.links, *system.effects)}
    for block in plan.blocks:
        values = z[block.start : block.stop]
        if block.name in scales:
            inputs[block.name] = values * scales[block.name].half_width / scales[block.name].coverage_factor
        elif block.name == "fiducial_manufacturing":
            inputs[block.name] = values * system.manufacturing_half_width_mm.ravel()
        else:
            view = next(v for v in system.views if block.name.endswith(f":{v.name}"))
            if block.name.startswith("fiducial_noise"):
                inputs[block.name] = values * view.fiducial_noise_px
            else:
                inputs[block.name] = values[2 * place : 2 * place + 2] * view.target_noise_px
    return inputs


def run(system: System, target: Target, inputs: dict[str, Array]) -> dict[str, Array]:
    """One trial.  ``inputs``: contributor -> native values (missing: zero).  Returns the two error vectors."""
    form = system.rotation_form
    points = system.fiducials_mm
    true = points + inputs.get("fiducial_manufacturing", np.zeros(points.size)).reshape(points.shape)
    heat = effect_named(system, "temperature")
    if heat is not None:
        kelvin = heat.known[0] + inputs.get("temperature", np.zeros(1))[0]
        true = true + kelvin * heat.structure_per_k * (points - heat.seat_mm)
    clampings: list[Any] = [effect for effect in system.effects if effect.name.startswith("clamping:")]
    for clamped in clampings:
        *off, scale = drawn_of(clamped, inputs)
        held = [clamped.fiducials is None or label in clamped.fiducials for label in system.fiducial_labels]
        away = points[held] - (points[held].mean(axis=0) if clamped.pivot_mm is None else clamped.pivot_mm)
        true[held] += off[3:] + np.cross(off[:3], away) + scale * away
    first = drawn_of(system.structure_connector, inputs)
    told = points
    if system.reading is Reading.PHYSICAL:
        true = move(first, system.structure_connector.pivot_mm, form, true)
    else:
        told = move(first, system.structure_connector.pivot_mm, form, points)
    imaged, seen, wrong = [], [], []
    for view in system.views:
        shown = true
        if (motion := effect_named(system, f"motion:{view.name}")) is not None:
            shown = move(drawn_of(motion, inputs), motion.pivot_mm, form, true)
        noise = inputs.get(f"fiducial_noise:{view.name}", np.zeros(2 * len(points))).reshape(-1, 2)
        mixes = view.noise_factors if view.noise_factors is not None else [np.eye(2), np.eye(2)]
        images = project(view.projection, shown) + noise @ mixes[0].T + ball_shifts(system, view)
        noise = inputs.get(f"target_noise:{view.name}", np.zeros(2))
        aimed = project(view.projection, target.position_mm[None]) + mixes[1] @ noise
        if (wide := effect_named(system, f"image_field:{view.name}")) is not None:
            coefficients = wide.known + inputs.get(wide.name, np.zeros(wide.sources.count))
            images = images + field(wide, project(view.projection, points), coefficients)
            aimed = aimed + field(wide, project(view.projection, target.position_mm[None]), coefficients)
        if (turned := effect_named(system, f"detector_tilt:{view.name}")) is not None:
            turns = drawn_of(turned, inputs)
            images = images + tilt(view, project(view.projection, points), turns)
            aimed = aimed + tilt(view, project(view.projection, target.position_mm[None]), turns)
        imaged.append(images)
        seen.append(aimed[0])
        error = effect_named(system, f"assumed_intrinsics:{view.name}")
        wrong.append(np.zeros(3) if error is None else drawn_of(error, inputs))
    estimates = estimate_views(system, told, np.stack(imaged), np.stack(wrong))
    found = locate(system, estimates, np.stack(seen), told, weights_at_rest(system, target))
    moved = move(drawn_of(system.connector_flange, inputs), system.connector_flange.pivot_mm, form, found)
    if heat is not None:  # the connector has carried con away from the flange, and the robot does not know
        moved = moved - kelvin * heat.connector_per_k * (heat.seat_mm - heat.flange_seat_mm)
    to_tool = system.T_tcp_flange @ system.T_flange_con
    at_flange = carry_on(system, inputs, system.T_flange_con @ np.append(moved, 1))
    tool = (system.T_tcp_flange @ at_flange)[:3]
    tool = move(drawn_of(system.hand_eye, inputs), system.hand_eye.pivot_mm, form, tool)
    tool = tool + drawn_of(system.execution, inputs)
    return {
        "localisation": found - target.position_mm,
        "tcp": tool - (to_tool @ np.append(target.position_mm, 1))[:3],
    }

"""Numbers of radiostereometry: closed forms of three views at right angles, and double examinations by NumPy alone."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from plain_data import DEMO, EVERY, problems_of, replaced
from tailstack import load_design
from tailstack.design import compile_design
from tailstack.studies.radiostereometry import radiostereometry

Array = NDArray[np.float64]
CAGE = EVERY["radiostereometry"]


def far_views(noise_px: float) -> list[dict[str, Any]]:
    """Along y, x and z, from 9.5 m, where 0.1 mm on the detector are 0.1 / 1.25 mm at the markers."""
    aims = ([0, 1, 0], [0, 0, 1]), ([1, 0, 0], [0, 0, 1]), ([0, 0, 1], [0, 1, 0])
    return [
        {
            "name": f"view {k}",
            "source_detector_mm": 11_875,
            "source_isocentre_mm": 9_500,
            "pixel_mm": 0.1,
            "image_size_px": [8192, 8192],
            "beam_direction": beam,
            "up_direction": up,
            "fiducial_noise_px": 1e-5,
            "target_noise_px": noise_px,
        }
        for k, (beam, up) in enumerate(aims)
    ]


def test_three_views_at_right_angles_have_closed_forms() -> None:
    """closed form: each coordinate is measured twice with s = 0.08 mm, so that a marker has s^2 / 2 along each axis.
    Of n markers 3 n - 6 numbers are left by a rigid motion; two examinations differ by twice the variance; two rays
    miss each other by a normal number of variance 2 s^2, whose size has the mean 2 s / sqrt(pi).  From 9.5 m rays are
    parallel to 0.5 %."""
    s, spans = 0.08, np.array([30.0, 20.0, 10.0])
    places = np.vstack([np.diag(spans), -np.diag(spans)])
    data = {key: value for key, value in CAGE.items() if key not in ("requirements", "bodies")}
    data["views"] = far_views(1.0)
    data["fiducials"] = {"points": CAGE["fiducials"]["points"]}
    data["targets"] = [{"name": f"m{k}", "position_mm": at.tolist()} for k, at in enumerate(places)]
    data["bodies"] = [{"name": "stem", "targets": [f"m{k}" for k in range(6)]}]
    found = radiostereometry(load_design(data))
    (model,) = found.bodies
    assert (model.markers, model.against, model.simulated, found.pairs) == (6, None, None, None)
    assert model.condition_number_per_m == pytest.approx(1000 / sqrt(2 * 20**2 + 2 * 10**2), rel=1e-12)
    assert model.estimate.fitting_error_mm == pytest.approx(s * sqrt((3 * 6 - 6) / 6), rel=1e-2)
    assert model.estimate.translation_mm == pytest.approx([1.96 * s / sqrt(6)] * 3, rel=1e-2)
    arms = [2 * (spans[k - 2] ** 2 + spans[k - 1] ** 2) for k in range(3)]
    turns = [np.rad2deg(1.96 * s / sqrt(arm)) for arm in arms]
    assert model.estimate.rotation_deg == pytest.approx(turns, rel=1e-2)
    assert model.estimate.mtpm_mean_mm is None
    assert len(found.crossing_lines) == 6 * 3
    for line in found.crossing_lines:
        assert line.rms_mm == pytest.approx(sqrt(2) * s, rel=1e-2)
        assert line.mean_mm == pytest.approx(2 * s / sqrt(pi), rel=1e-2)


def examine(projections: list[Array], beads: Array, made: Array, markers: Array, rng: Any, count: int) -> Any:
    """Markers (count, T, 3) as they come out of two views, and the distance (count, T) of both rays to each: images
    with noise, matrices and points by singular values."""
    known = np.hstack([beads, np.ones((len(beads), 1))])
    matrices, images = [], []
    for projection in projections:

        def see(points: Array, projection: Array = projection) -> Any:
            seen = points @ projection[:, :3].T + projection[:, 3]
            exact = seen[..., :2] / seen[..., 2:]
            return np.broadcast_to(exact, (count, *exact.shape[-2:])) + 0.1 * rng.normal(
                size=(count, exact.shape[-2], 2)
            )

        centre, scale = np.array([2048.0, 2048.0]), 1000.0
        uv, aims = (see(made) - centre) / scale, (see(markers) - centre) / scale
        rows = np.zeros((count, len(beads), 2, 12))
        for k in range(2):
            rows[:, :, k, 4 * k : 4 * k + 4] = known
            rows[:, :, k, 8:] = -uv[:, :, k, None] * known
        matrices.append(np.linalg.svd(rows.reshape(count, -1, 12))[2][:, -1].reshape(count, 3, 4))
        images.append(aims)
    lines = [
        image[:, :, k, None] * matrix[:, None, 2] - matrix[:, None, k]
        for matrix, image in zip(matrices, images, strict=True)
        for k in range(2)
    ]
    points = np.linalg.svd(np.stack(lines, axis=2) / np.array([1, 1, 1, 100.0]))[2][:, :, -1]
    points = points[..., :3] / points[..., 3:] * 100.0
    sources = [-np.linalg.solve(matrix[:, :, :3], matrix[:, :, 3:])[:, None, :, 0] for matrix in matrices]
    rays = [
        np.linalg.solve(matrix[:, None, :, :3], np.concatenate([aims, np.ones_like(aims[..., :1])], -1)[..., None])[
            ..., 0
        ]
        for matrix, aims in zip(matrices, images, strict=True)
    ]
    across = np.cross(rays[0], rays[1])
    apart = np.abs(((sources[0] - sources[1]) * across).sum(-1)) / np.linalg.norm(across, axis=-1)
    return points, apart


def fit(before: Array, after: Array) -> tuple[Array, Array, Array]:
    """Turn (n, 3, 3) and both centroids (n, 1, 3) of points (n, K, 3), by Kabsch's decomposition."""
    centres = before.mean(axis=1, keepdims=True), after.mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(np.swapaxes(after - centres[1], 1, 2) @ (before - centres[0]))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right, *centres


def test_double_examinations_of_a_cage_come_out_as_numpy_draws_them() -> None:
    """independent: 3,000 pairs of examinations of 100 cages by NumPy, no code of the chain.  46 figures, each out by 5
    of its standard errors and 1 % of first order in less than 1 of 10,000 runs."""
    design, rng, cages, each = load_design(CAGE), np.random.default_rng(11), 100, 30
    found = radiostereometry(design, seed=2, pairs=4096)
    system = compile_design(design)
    projections, names = [view.projection for view in system.views], [target.name for target in system.targets]
    markers = np.array([target.position_mm for target in system.targets])
    exams: list[list[Any]] = [[], []]
    for _ in range(cages):
        made = system.fiducials_mm + 0.01 * rng.normal(size=system.fiducials_mm.shape)
        for exam in exams:
            exam.append(examine(projections, system.fiducials_mm, made, markers, rng, each))
    (first, apart), (second, _) = (tuple(map(np.concatenate, zip(*exam, strict=True))) for exam in exams)
    count = cages * each
    for line in found.crossing_lines:
        drawn = apart[:, names.index(line.target)]
        room = 5 * drawn.std() / sqrt(count) * 2 + 0.01 * line.mean_mm  # each cage is in thirty of them
        assert abs(drawn.mean() - line.mean_mm) < room
        assert abs(sqrt((drawn**2).mean()) - line.rms_mm) < room
    groups = {body.name: [names.index(name) for name in body.targets] for body in system.bodies}
    bone = fit(first[:, groups["bone"]], second[:, groups["bone"]])
    for model in found.bodies:
        before, after = first[:, groups[model.body]], second[:, groups[model.body]]
        turn, centre, moved = fit(before, after)
        left = (before - centre) @ np.swapaxes(turn, 1, 2) - (after - moved)
        if model.against == "bone":
            after = (after - bone[2]) @ bone[0] + bone[1]
            turn, centre, moved = fit(before, after)
        components = np.hstack([np.rad2deg(Rotation.from_matrix(turn).as_rotvec()), (moved - centre)[:, 0]])
        motion = np.linalg.norm(after - before, axis=2).max(axis=1)
        told = model.estimate
        expected = [*1.96 * np.sqrt((components**2).mean(axis=0)), sqrt((left**2).sum(axis=2).mean())]
        room = (5 / sqrt(2 * count) + 0.01) * np.array(expected)
        assert np.all(
            np.abs([*told.rotation_deg, *told.translation_mm, told.fitting_error_mm] - np.array(expected)) < room
        )
        expected += [motion.mean(), np.sort(motion)[int(0.95 * count)]]
        simulated, begin, end = (
            np.array([*one.rotation_deg, *one.translation_mm, one.fitting_error_mm, one.mtpm_mean_mm, one.mtpm_p95_mm])
            for one in (model.simulated, model.simulated_from, model.simulated_to)
        )
        assert np.all((begin < simulated) & (simulated < end) & (end < 1.1 * begin))
        both = 5 / 3.92 * (end - begin) * sqrt(1 + 4096 / count)  # of the program's own pairs and of these
        assert np.all(np.abs(simulated - expected) < both)


def test_what_an_examination_shares_with_the_first_is_not_in_its_precision() -> None:
    """The cage is the same at both: beads that are made ten times worse widen the lines, and no double examination."""
    rough = replaced(CAGE, ("fiducials", "manufacturing"), {"half_width_mm": 0.2, "distribution": "normal"})
    fine, coarse = (radiostereometry(load_design(data)) for data in (CAGE, rough))
    assert coarse.bodies == fine.bodies
    assert all(two.rms_mm > one.rms_mm for one, two in zip(fine.crossing_lines, coarse.crossing_lines, strict=True))
    assert fine.kept == ("fiducial manufacturing",)
    anew = radiostereometry(load_design(replaced(CAGE, ("fiducials", "manufacturing", "drawn"), "mounting")))
    assert anew.kept == ()
    assert all(
        two.estimate.translation_mm > one.estimate.translation_mm
        for one, two in zip(fine.bodies, anew.bodies, strict=True)
    )


def test_a_design_without_bodies_has_no_numbers_of_radiostereometry() -> None:
    (problem,) = problems_of(radiostereometry, load_design(DEMO))
    assert (problem.pointer, problem.code) == ("/bodies", "missing-field")
    assert problem.hint

"""A Monte Carlo of its own about OpenCV's pose: nothing of tailstack but the document and the answer of ``verify``.

Numbers are drawn by NumPy, structures moved by matrices written here, the pose is ``cv2.solvePnPRefineLM``, the target
met by a singular value decomposition and carried to the tool.  Five designs, each in the plain numbers below and as the
document that a user would write.
"""

from __future__ import annotations

import os
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.stats import binom

from tailstack import load_design, verify

TRIALS = 2000
DOUBT = 1e-3  # that a right answer is outside an interval of P95


class Seat(NamedTuple):
    """An interface: T_err1 or T_err2; degrees and mm, in the order rx ry rz tx ty tz."""

    pivot_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    bias: tuple[float, ...] = (0.0,) * 6
    half_width: tuple[float, ...] = (0.0,) * 6
    law: str = "uniform"


class Scene(NamedTuple):
    cameras: np.ndarray  # (V, 3, 3)
    rotations: np.ndarray  # (V, 3, 3)
    shifts_mm: np.ndarray  # (V, 3)
    points_mm: np.ndarray
    aim_mm: np.ndarray
    noise_px: tuple[float, ...]  # of the fiducials, by view
    aim_noise_px: tuple[float, ...]
    first: Seat = Seat()
    second: Seat = Seat()
    made_mm: float = 0.0  # half-width of manufacturing, uniform
    focal_rel: float = 0.0  # half-width of the assumed intrinsics, uniform
    centre_px: float = 0.0
    focal_bias_rel: float = 0.0
    tool_rotation_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    tool_shift_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    reading: str = "physical"
    triangulation: str = "normalised"


def turn(angles_rad: np.ndarray) -> np.ndarray:
    """Rx Ry Rz."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles_rad), np.sin(angles_rad)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def looking(azimuths_deg: tuple[float, ...], tilts_deg: tuple[float, ...], depths_mm: tuple[float, ...]) -> dict:
    """C-arms of 1020 mm with pixels of 0.194 mm, their sources at these directions and distances of the origin."""
    cameras, rotations = [], []
    for k, (azimuth, tilt) in enumerate(zip(np.radians(azimuths_deg), np.radians(tilts_deg), strict=True)):
        forward = np.array([np.cos(tilt) * np.sin(azimuth), np.cos(tilt) * np.cos(azimuth), np.sin(tilt)])
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotations.append(np.array([right, np.cross(forward, right), forward]))
        cameras.append([[5258.0, 0.0, 760.0 + 10 * k], [0.0, 5258.0, 770.0], [0.0, 0.0, 1.0]])
    shifts = np.array([[3.0 * k, -2.0, depth] for k, depth in enumerate(depths_mm)])
    return {"cameras": np.array(cameras), "rotations": np.array(rotations), "shifts_mm": shifts}


def cloud(seed: int, count: int, half_mm: float) -> np.ndarray:
    middle = np.array([0.0, 0.0, -40.0])
    return np.random.default_rng(seed).uniform(middle - half_mm, middle + half_mm, (count, 3)).round(3)


CORNERS = np.array([[x, y, z] for x in (-30, 30) for y in (-28, 30) for z in (-70, -15)], dtype=float)
SCENES = {
    "two-views-biased": Scene(
        **looking((0, 90), (0, 0), (700, 700)), points_mm=CORNERS, aim_mm=np.array([0.0, 0.0, 70.0]),
        noise_px=(0.5, 0.5), aim_noise_px=(0.5, 0.5),
        first=Seat((0, 0, -95), (1.5, -2.0, 0.5, 1.0, 0.0, -0.5), (0.1, 0.1, 0.1, 0.05, 0.05, 0.05), "normal"),
        second=Seat((0, 0, -145), (0, 0, 0, 0.2, 0, 0), (0.05, 0.05, 0.1, 0.05, 0.05, 0.02), "normal"),
        tool_rotation_deg=(10.0, -20.0, 30.0), tool_shift_mm=(5.0, 10.0, -70.0),
    ),
    "three-views-oblique-uniform": Scene(
        **looking((0, 50, 115), (20, -15, 5), (650, 720, 800)), points_mm=cloud(3, 9, 40.0),
        aim_mm=np.array([20.0, -10.0, 45.0]), noise_px=(0.4, 0.6, 0.5), aim_noise_px=(0.4, 0.3, 0.5),
        first=Seat((10, -20, -90), half_width=(0.3, 0.3, 0.4, 0.1, 0.1, 0.1)),
        second=Seat((0, 0, -145), half_width=(0.1, 0.1, 0.1, 0.1, 0.1, 0.1)), made_mm=0.05,
    ),
    "two-views-35-degrees-apart-eq18": Scene(
        **looking((10, 45), (5, -10), (680, 750)), points_mm=cloud(4, 12, 45.0), aim_mm=np.array([-15.0, 5.0, 30.0]),
        noise_px=(0.3, 0.3), aim_noise_px=(0.3, 0.3),
        first=Seat((0, 0, -95), (0.5, 1.0, -0.5, 0.3, 0.2, 0.1), (0.1,) * 6), reading="eq18",
        tool_rotation_deg=(0.0, 90.0, 0.0),
    ),
    "three-views-intrinsics-wrong": Scene(
        **looking((0, 60, 100), (0, 10, -10), (700, 700, 700)), points_mm=CORNERS, aim_mm=np.array([5.0, 5.0, 60.0]),
        noise_px=(0.3, 0.3, 0.3), aim_noise_px=(0.3, 0.3, 0.3), focal_rel=0.02, centre_px=15.0, focal_bias_rel=0.01,
    ),
    "three-views-weighted": Scene(
        **looking((0, 50, 100), (0, 10, -10), (600, 700, 850)), points_mm=cloud(6, 8, 25.0),
        aim_mm=np.array([0.0, 0.0, 60.0]), noise_px=(0.2, 1.0, 0.6), aim_noise_px=(0.2, 1.0, 0.3),
        triangulation="weighted",
    ),
}  # fmt: skip


def document_of(scene: Scene) -> dict[str, Any]:
    def seat(own: Seat) -> dict[str, Any]:
        names = ("rx", "ry", "rz", "tx", "ty", "tz")
        units = dict(zip(names, ["deg"] * 3 + ["mm"] * 3, strict=True))
        tolerances = {
            name: {f"half_width_{units[name]}": value, "distribution": own.law}
            for name, value in zip(names, own.half_width, strict=True)
            if value
        }
        bias = {f"{name}_{units[name]}": value for name, value in zip(names, own.bias, strict=True)}
        return {"pivot_mm": list(own.pivot_mm), "bias": bias, "tolerances": tolerances}

    views = []
    for k, camera in enumerate(scene.cameras):
        projection = camera @ np.column_stack([scene.rotations[k], scene.shifts_mm[k]])
        views.append(
            {
                "name": f"V{k}", "projection": projection.tolist(), "fiducial_noise_px": scene.noise_px[k],
                "target_noise_px": scene.aim_noise_px[k],
            }
        )  # fmt: skip
        if scene.focal_rel:
            views[-1]["intrinsics_error"] = {
                "focal": {
                    "bias_rel": scene.focal_bias_rel, "half_width_rel": scene.focal_rel, "distribution": "uniform"
                },
                "principal_point": {"half_width_px": scene.centre_px, "distribution": "uniform"},
            }  # fmt: skip
    document: dict[str, Any] = {
        "schema": "tailstack/design/1",
        "name": "scene",
        "views": views,
        "fiducials": {"points": [{"position_mm": p} for p in scene.points_mm.tolist()]},
        "targets": [{"name": "aim", "position_mm": scene.aim_mm.tolist()}],
        "interfaces": {"structure_connector": seat(scene.first), "connector_flange": seat(scene.second)},
        "transforms": {
            "T_tcp_flange": {
                "rotation": turn(np.radians(scene.tool_rotation_deg)).tolist(),
                "translation_mm": list(scene.tool_shift_mm),
            }
        },
        "model": {"estimator": "pose", "triangulation": scene.triangulation, "installation_reading": scene.reading},
    }
    if scene.made_mm:
        document["fiducials"]["manufacturing"] = {"half_width_mm": scene.made_mm, "distribution": "uniform"}
    return document


def image(camera: np.ndarray, rotation: np.ndarray, shift: np.ndarray, points: np.ndarray) -> np.ndarray:
    rays = (points @ rotation.T + shift) @ camera.T
    return rays[..., :2] / rays[..., 2:]


def find_pose(cv2: Any, points: np.ndarray, images: np.ndarray, camera: np.ndarray, start: tuple) -> np.ndarray:
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
    vector, shift = cv2.solvePnPRefineLM(
        points, images, camera, None, cv2.Rodrigues(start[0])[0], start[1].reshape(3, 1).copy(), stop
    )
    return camera @ np.column_stack([cv2.Rodrigues(vector)[0], shift])


def meet(matrices: np.ndarray, images: np.ndarray, told: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """The smallest singular vector of Eq 5, in the frame in which the fiducials have their mean at the origin and root
    mean square 1 along each axis; factors (V, 2, 2): what the rows of each view are multiplied by."""
    centre = told.mean(axis=0)
    size = np.sqrt(((told - centre) ** 2).sum() / len(told) / 3)
    back = np.eye(4)
    back[:3, :3] *= size
    back[:3, 3] = centre
    rows = []
    for matrix, seen, factor in zip(matrices, images, factors, strict=True):
        local = matrix @ back
        local /= np.linalg.norm(local[2, :3])
        rows.append(factor @ (np.outer(seen, local[2]) - local[:2]))
    vector = np.linalg.svd(np.concatenate(rows))[2][-1]
    return centre + size * vector[:3] / vector[3]


def draw_seat(rng: np.random.Generator, seat: Seat) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation, pivot and shift of an installation error; a normal law has its half-width at two deviations."""
    half = np.array(seat.half_width)
    drawn = rng.uniform(-1, 1, 6) * half if seat.law == "uniform" else rng.normal(size=6) * half / 2
    torsor = np.array(seat.bias) + drawn
    return turn(np.radians(torsor[:3])), np.array(seat.pivot_mm, dtype=float), torsor[3:]


def errors_of(cv2: Any, scene: Scene, trials: int, seed: int) -> np.ndarray:
    """(trials, 3) mm: error at the tool, in its frame."""
    rng = np.random.default_rng(seed)
    views, nominal = len(scene.cameras), list(zip(scene.rotations, scene.shifts_mm, strict=True))
    to_tool = turn(np.radians(scene.tool_rotation_deg))
    factors = np.broadcast_to(np.eye(2), (views, 2, 2))
    if scene.triangulation == "weighted":  # the scatter of the rows about nought, of noise alone, from 600 shots
        factors = np.array([np.linalg.cholesky(np.linalg.inv(s)).T for s in row_scatter(cv2, scene, 600, rng)])
    out = np.empty((trials, 3))
    for k in range(trials):
        made = scene.points_mm + rng.uniform(-1, 1, scene.points_mm.shape) * scene.made_mm
        rotation, pivot, shift = draw_seat(rng, scene.first)
        told, truly = scene.points_mm, (made - pivot) @ rotation.T + pivot + shift
        if scene.reading == "eq18":
            told, truly = (told - pivot) @ rotation.T + pivot + shift, made
        matrices, seen = [], []
        for v, (camera, pose) in enumerate(zip(scene.cameras, nominal, strict=True)):
            images = image(camera, *pose, truly) + scene.noise_px[v] * rng.normal(size=(len(truly), 2))
            seen.append(image(camera, *pose, scene.aim_mm) + scene.aim_noise_px[v] * rng.normal(size=2))
            assumed = camera.copy()
            assumed[[0, 1], [0, 1]] *= 1 + scene.focal_bias_rel + scene.focal_rel * rng.uniform(-1, 1)
            assumed[:2, 2] += scene.centre_px * rng.uniform(-1, 1, 2)
            matrices.append(find_pose(cv2, told, images, assumed, pose))
        found = meet(np.array(matrices), np.array(seen), told, factors)
        rotation, pivot, shift = draw_seat(rng, scene.second)
        out[k] = to_tool @ ((found - pivot) @ rotation.T + pivot + shift - scene.aim_mm)
    return out


def row_scatter(cv2: Any, scene: Scene, shots: int, rng: np.random.Generator) -> np.ndarray:
    """(V, 2, 2): mean squares of the rows at the target, with the structure in its place."""
    out = np.zeros((len(scene.cameras), 2, 2))
    for v, pose in enumerate(zip(scene.rotations, scene.shifts_mm, strict=True)):
        for _ in range(shots):
            images = image(scene.cameras[v], *pose, scene.points_mm)
            images += scene.noise_px[v] * rng.normal(size=images.shape)
            matrix = find_pose(cv2, scene.points_mm, images, scene.cameras[v], pose)
            seen = image(scene.cameras[v], *pose, scene.aim_mm) + scene.aim_noise_px[v] * rng.normal(size=2)
            ray = matrix @ np.append(scene.aim_mm, 1.0)
            row = (seen * ray[2] - ray[:2]) / np.linalg.norm(matrix[2, :3])
            out[v] += np.outer(row, row) / shots
    return out


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_verify_is_within_the_interval_of_an_independent_simulation_by_opencv(name, monkeypatch):
    """sampled: 2000 trials here, 131,072 there.  P95 within the distribution-free interval of 1 - 10^-3; each component
    of the mean and of the standard deviation within four of its own (error rate 6 * 10^-5 each)."""
    monkeypatch.setattr(os, "environ", os.environ.copy())  # OpenCV's import adds to it and to the path
    monkeypatch.setattr(sys, "path", list(sys.path))
    cv2 = pytest.importorskip("cv2")
    scene = SCENES[name]
    errors = errors_of(cv2, scene, TRIALS, seed=1)
    norms = np.sort(np.linalg.norm(errors, axis=1))
    low, high = (norms[int(binom.ppf(p, TRIALS, 0.95)) - 1 + k] for p, k in ((DOUBT / 2, 0), (1 - DOUBT / 2, 1)))
    answer = verify(load_design(document_of(scene)), trials=16_384 if scene.triangulation == "weighted" else 131_072)
    found = answer.targets[0]
    assert low < found.p95_mm < high
    spread, ours = errors.std(axis=0), np.array(found.std_mm)
    kurtosis = ((errors - errors.mean(axis=0)) ** 4).mean(axis=0) / spread**4
    assert (np.abs(errors.mean(axis=0) - found.bias_mm) < 4 * spread / np.sqrt(TRIALS)).all()
    assert (np.abs(ours / spread - 1) < 4 * np.sqrt((kurtosis - 1) / 4 / TRIALS) + 0.01).all()

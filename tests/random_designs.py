"""Random designs of every class, as documents: what first order is calibrated on and held to.

Views anywhere, on an arc, in near-copies or within a few degrees; fiducials in clouds, plates, rods, cubes, rings and
clusters; targets inside and far outside; manufacturing errors, biases and tolerances of all laws; both readings and
both forms of triangulation; unequal noise.  Noise is scaled so that the validity number lands where it is asked to.
"""

from __future__ import annotations

import copy
from itertools import count
from typing import Any

import numpy as np

from tailstack.design import check_design, load_design
from tailstack.errors import TailstackError
from tailstack.propagation.linear import covariance, linearise
from typical import declare_some

LAWS = ("normal", "uniform", "triangular")
FIDUCIALS = (6, 7, 8, 9, 10, 11, 12, 13, 14, 20, 40)
VIEWS = (2, 3, 4, 5, 6, 7, 8)
LOUDEST_PX = 5.0
# What is remarked where the geometry hardly determines the answer
DETERMINATION = ("flat-structure", "weak-resection", "small-parallax", "projected-overlap")
TURNS_DEG, SHIFTS_MM = ((0.002, 0.05), 1.0), ((0.01, 0.2), 10.0)  # of an arm: typical, and most
RADII, RAYS_DEG, SPAN_DEG = (4.0, 30.0), (2.0, 35.0), (2.0, 70.0)  # of far targets


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


def _rotation_towards(direction: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(3, 3) whose last row is the direction, turned about it at random."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(_unit(rng), z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def _directions(rng: np.random.Generator, views: int) -> list[np.ndarray]:
    kind = rng.choice(["anywhere", "anywhere", "arc", "near-copies", "narrow"])
    if kind == "anywhere":
        return [_unit(rng) for _ in range(views)]
    if kind == "near-copies":
        some = [_unit(rng) for _ in range(max(2, views // 2))]
        return [some[k % len(some)] + (k >= len(some)) * rng.normal(0, 0.1, 3) for k in range(views)]
    base = _unit(rng)
    side = np.cross(base, _unit(rng))
    side /= np.linalg.norm(side)
    up = np.cross(base, side)
    if kind == "arc":
        angles = np.linspace(0, np.radians(rng.uniform(30, 180)), views) + rng.normal(0, 0.03, views)
        return [np.cos(a) * base + np.sin(a) * side + rng.normal(0, 0.1) * up for a in angles]
    span = np.radians(_log_uniform(rng, 0.5, 30))
    return [base + span * (rng.uniform(-1, 1) * side + rng.uniform(-0.3, 0.3) * up) for _ in range(views)]


def _fiducials(rng: np.random.Generator, count: int, half: float) -> np.ndarray:
    kind = rng.choice(["cloud", "cloud", "plate", "rod", "corners", "rings", "cluster"])
    cloud = rng.uniform(-half, half, (count, 3))
    turn = _rotation_towards(_unit(rng), rng)
    if kind == "plate":
        return cloud * [1, 1, _log_uniform(rng, 0.05, 0.5)] @ turn
    if kind == "rod":
        return cloud * [1, 0.3, 0.3] @ turn
    if kind == "corners":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        eight = min(count, 8)
        cloud[:eight] = half * signs[rng.permutation(8)[:eight]]
        return cloud + rng.normal(0, 0.05 * half, (count, 3))
    if kind == "rings":
        angle = rng.uniform(0, 2 * np.pi) + 4 * np.pi * np.arange(count) / count + rng.normal(0, 0.2, count)
        height = rng.uniform(0.3, 1) * np.where(np.arange(count) % 2, 1, -1) + rng.normal(0, 0.05, count)
        return half * np.column_stack([np.cos(angle), np.sin(angle), height]) @ turn
    if kind == "cluster":
        away = max(2, count // 4)
        return np.concatenate([cloud[:away], rng.normal(0, 0.2 * half, (count - away, 3))])
    return cloud


def _interface(rng: np.random.Generator, quiet: bool) -> dict[str, Any]:
    out: dict[str, Any] = {"pivot_mm": rng.uniform(-100, 100, 3).round(3).tolist()}
    if rng.random() < 0.6:
        size = rng.choice([1.0, 3.0, 8.0])
        names = ("rx_deg", "ry_deg", "rz_deg", "tx_mm", "ty_mm", "tz_mm")
        out["bias"] = {name: float(rng.normal(0, size)) for name in names if rng.random() < 0.6}
    if not quiet and rng.random() < 0.7:
        size = _log_uniform(rng, 0.02, 1.0)
        out["tolerances"] = {
            name: {f"half_width_{'deg' if name[0] == 'r' else 'mm'}": size, "distribution": str(rng.choice(LAWS))}
            for name in ("rx", "ry", "rz", "tx", "ty", "tz")
            if rng.random() < 0.6
        }
    return out


def _narrow(rng: np.random.Generator, views: int) -> list[np.ndarray]:
    """Directions within 2 to 70 degrees, the first two as far apart as any."""
    base = _unit(rng)
    side = np.cross(base, _unit(rng))
    side /= np.linalg.norm(side)
    span = np.radians(_log_uniform(rng, *SPAN_DEG))
    angles = span * np.concatenate([[-0.5, 0.5], rng.uniform(-0.5, 0.5, views - 2)])
    up = rng.normal(0, 0.05 * span, views)[:, None] * np.cross(base, side)
    return list(np.cos(angles)[:, None] * base + np.sin(angles)[:, None] * side + up)


def radius_of(points: np.ndarray) -> float:
    """RMS distance of points (N, 3) from their centroid."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


def farness(document: dict[str, Any]) -> tuple[float, float]:
    """(distance of the target from the fiducials' centroid over their RMS radius, widest angle between its rays, deg);
    the angle is nan where a view does not look towards the target."""
    points = np.array([each["position_mm"] for each in document["fiducials"]["points"]])
    aim = np.array(document["targets"][0]["position_mm"])
    projections = np.array([view["projection"] for view in document["views"]])
    rays = aim + np.linalg.solve(projections[:, :, :3], projections[:, :, 3:])[:, :, 0]
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    ahead = (projections[:, 2, :3] * rays).sum(axis=1).min() > 0
    widest = float(np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1)).max()))
    return float(np.linalg.norm(aim - points.mean(axis=0))) / radius_of(points), widest if ahead else np.nan


def random_document(
    rng: np.random.Generator, views: int, fiducials: int, published: bool, far: bool = False
) -> dict[str, Any]:
    """A design document with one target, estimated by DLT; its noise is not scaled yet.

    far: the target lies 4 to 30 radii of the fiducials away, most often along the views, which are within 70 degrees.
    """
    half = _log_uniform(rng, 20 if far else 6, 60)
    points = _fiducials(rng, fiducials, half)
    directions = None
    if far:
        directions = _narrow(rng, views)
        away = _unit(rng) if rng.random() < 0.4 else directions[0] + rng.normal(0, 0.1, 3)
        aim = points.mean(axis=0) + rng.uniform(*RADII) * radius_of(points) * away / np.linalg.norm(away)
    else:
        near = rng.random() < 0.5
        reach = rng.uniform(0, half) if near else rng.uniform(1.5, 6) * half + rng.uniform(0, 60)
        aim = points.mean(axis=0) + reach * _unit(rng)
    shift = np.zeros(3)
    if rng.random() < 0.5:
        shift = rng.uniform(-60, 60, 3)
    elif rng.random() < 0.3:
        shift = -aim  # the target at the origin: where the published form pulls hardest
    noise, alike = _log_uniform(rng, 0.05, 2), rng.random() < 0.5
    described = []
    for k, direction in enumerate(directions or _directions(rng, views)):
        turn = _rotation_towards(np.asarray(direction), rng)
        focal, depth = rng.uniform(2500, 7000), rng.uniform(550, 1000)
        camera = np.diag([focal, focal * rng.uniform(0.99, 1.01), 1.0])
        camera[:2, 2] = 800 + rng.uniform(-200, 200, 2)
        isocentre = rng.uniform(-10, 10, 3) + shift
        projection = camera @ np.column_stack([turn, np.array([0, 0, depth]) - turn @ isocentre])
        own = noise if alike else noise * np.exp(rng.uniform(-1.1, 1.1))
        at_target = own if alike else own * np.exp(rng.uniform(-3, 0.7))
        described.append(
            {
                "name": f"V{k}", "fiducial_noise_px": float(own), "target_noise_px": float(at_target),
                "projection": projection.tolist(),
            }
        )  # fmt: skip
    quiet = rng.random() < 0.4  # no tolerances, which would drown what the images do
    document: dict[str, Any] = {
        "schema": "tailstack/design/1",
        "name": "random",
        "views": described,
        "fiducials": {"points": [{"position_mm": p} for p in (points + shift).round(4).tolist()]},
        "targets": [{"name": "t", "position_mm": (aim + shift).round(4).tolist()}],
        "interfaces": {
            name: _interface(rng, quiet) for name in ("structure_connector", "connector_flange") if rng.random() < 0.7
        },
        "model": {"triangulation": "published"} if published else {},
    }
    if rng.random() < (0.3 if quiet else 0.6):
        document["fiducials"]["manufacturing"] = {
            "half_width_mm": _log_uniform(rng, 0.005, 0.3), "distribution": str(rng.choice(LAWS)),
        }  # fmt: skip
    if rng.random() < 0.4:
        document["model"]["installation_reading"] = "eq18"
    return document


def under(document: dict[str, Any], estimator: str, triangulation: str, rng: np.random.Generator) -> dict[str, Any]:
    """The document under another estimator; intrinsics are known to between 0.1 and 5 %, or exact, or wrong by that.

    triangulation: its form, or "" to leave it as it is.
    """
    if triangulation:
        document["model"]["triangulation"] = triangulation
    if estimator == "dlt":
        return document
    document["model"]["estimator"] = estimator
    size = _log_uniform(rng, 0.001, 0.05)
    for view in document["views"]:
        if estimator == "pose_with_prior":
            view["intrinsics_prior"] = {"focal_rel_sd": size, "principal_point_px_sd": 1000 * size}
        elif estimator == "pose" and rng.random() < 0.3:
            view["intrinsics_error"] = {
                "focal": {"half_width_rel": size, "distribution": "uniform"},
                "principal_point": {"half_width_px": 1000 * size, "distribution": "normal"},
            }
    return document


def _toleranced(rng: np.random.Generator, rotation_deg: float, translation_mm: float) -> dict[str, Any]:
    law = str(rng.choice(LAWS))
    return {
        f"{kind}{axis}": {f"half_width_{unit}": size, "distribution": law}
        for kind, unit, size in (("r", "deg", rotation_deg), ("t", "mm", translation_mm))
        for axis in "xyz"
        if rng.random() < 0.6
    }


def with_effects(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The document with some of what can go wrong in an image: of every effect that there is what its fields say is
    typical (``typical.py``), and fiducials that a view does not see."""
    points, estimator = document["fiducials"]["points"], document["model"].get("estimator", "dlt")
    fewest = 4 if estimator.startswith("pose") else 6
    for k, point in enumerate(points):
        point["label"] = f"F{k}"
    declare_some(document, rng, 0.35)
    if rng.random() < 0.35 and len(points) > fewest:
        for view in document["views"]:
            count = int(rng.integers(max(fewest, len(points) - 3), len(points) + 1))
            view["sees"] = [points[n]["label"] for n in sorted(rng.permutation(len(points))[:count].tolist())]
    return document


def _far(rng: np.random.Generator, about: np.ndarray) -> list[float]:
    """A pivot up to 1.5 m from a point."""
    return [float(x) for x in (about + _log_uniform(rng, 10, 1500.0) * _unit(rng)).round(3)]


def _locators(rng: np.random.Generator, pivot: np.ndarray, span: float, half_width: float) -> list[dict[str, Any]]:
    """Three contacts on a face, two on the next, one on the last, a span apart."""
    law = str(rng.choice(LAWS))
    places = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (1, 0, 0), (0, 0, 0)]
    normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0)]
    return [
        {
            "name": f"L{k}", "position_mm": (pivot + span * np.array(place)).round(4).tolist(), "normal": list(normal),
            "half_width_mm": half_width, "distribution": law,
        }
        for k, (place, normal) in enumerate(zip(places, normals, strict=True))
    ]  # fmt: skip


def with_corners(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The document with some of what random designs seldom have: mounts that turn by much about near or far pivots, by
    tolerances, bounded ones, or locators close together; a hand-eye error; motion about a pivot up to 1.5 m away."""
    aim = np.array(document["targets"][0]["position_mm"])
    turned, seated, behind, moved = (rng.random(4) < (0.5, 0.3, 0.4, 0.35)).tolist()
    mounts = document["interfaces"]
    for name in ("structure_connector", "connector_flange"):
        if seated and rng.random() < 0.6:
            turn, span = np.radians(_log_uniform(rng, 0.02, 10)), _log_uniform(rng, 4, 100)
            pivot = aim + _log_uniform(rng, 10, 300) * _unit(rng)
            contacts = _locators(rng, pivot, span, float(turn * span))
            mounts[name] = {"pivot_mm": pivot.tolist(), "locators": contacts}
        elif turned and rng.random() < 0.7:
            tolerances = _toleranced(rng, _log_uniform(rng, 0.05, 10), _log_uniform(rng, 0.01, 1))
            if rng.random() < 0.15:
                for each in tolerances.values():
                    each["distribution"] = "bounded"
            mounts[name] = {"pivot_mm": _far(rng, aim), "tolerances": tolerances}
    if behind:
        tolerances = _toleranced(rng, _log_uniform(rng, 0.02, 3), _log_uniform(rng, 0.01, 1))
        document["execution"] = {"hand_eye": {"pivot_mm": _far(rng, aim), "tolerances": tolerances}}
    if moved:
        reach, size = _far(rng, aim), _log_uniform(rng, 0.005, 3)
        lever = float(np.linalg.norm(np.array(reach) - aim))
        for view in document["views"][1:]:
            tolerances = _toleranced(rng, float(np.degrees(size / lever)), size)
            if tolerances:
                view["motion"] = {"pivot_mm": reach, "tolerances": tolerances}
    return document


def with_arm(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The document with an arm of two to seven joints, near or far from the pose of the shots; what it is off by is 0.3
    to 40 times what is typical."""
    count, times = int(rng.integers(2, 8)), _log_uniform(rng, 0.3, 40)
    joints = [
        {
            "name": f"J{k}", "type": "prismatic" if rng.random() < 0.1 else "revolute",
            "xyz_mm": rng.uniform(-400, 400, 3).tolist(), "rpy_deg": rng.uniform(-120, 120, 3).tolist(),
            "axis": _unit(rng).tolist() if rng.random() < 0.3 else np.eye(3)[rng.integers(3)].tolist(),
        }
        for k in range(count)
    ]  # fmt: skip
    shots = rng.uniform(-120, 120, count)
    there = shots + rng.normal(0, 15, count) if rng.random() < 0.5 else rng.uniform(-120, 120, count)
    arm = {"joints": joints, "joints_imaging_deg": shots.tolist(), "joints_executing_deg": there.tolist()}
    angles, lengths = (np.minimum(times * _log_uniform(rng, *each), most) for each, most in (TURNS_DEG, SHIFTS_MM))
    stated = {
        "joint_sd_deg": float(angles),
        "parameter_sd": {"length_mm": float(lengths), "angle_deg": float(angles)},
        "repeatability_sd_deg": float(angles),
        "payload_kg": _log_uniform(rng, 0.5, 5),
    }
    arm |= {name: value for name, value in stated.items() if rng.random() < 0.6}
    if "payload_kg" in arm:
        arm["stiffness_nm_per_rad"] = [_log_uniform(rng, 1e4, 1e6) for _ in joints]
    document.setdefault("execution", {})["robot"] = arm
    return document


def with_bias(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The document with a known error of 0.3 to 5 times the random one, along a lever, along the random error's longest
    axis or anywhere, in one of the mounts."""
    system = check_design(load_design(document))[0]
    model = linearise(system, system.targets[0])
    mounts = document["interfaces"]
    name = str(rng.choice(["structure_connector", "connector_flange"]))
    mount = mounts.setdefault(name, {"pivot_mm": [0.0, 0.0, 0.0]})
    sizes, axes = np.linalg.eigh(covariance(model, "tcp"))
    along = [_unit(rng), axes[:, 2]]
    along += [model.reconstructed_mm - np.array(each["pivot_mm"]) for each in mounts.values()]
    chosen = int(rng.integers(len(along)))
    document["name"] = ("known error anywhere", "known error along the longest axis", "known error along a lever")[
        min(chosen, 2)
    ]
    direction = along[chosen] * rng.choice([-1.0, 1.0])
    shift = _log_uniform(rng, 0.3, 5) * np.sqrt(sizes[2]) * direction / max(np.linalg.norm(direction), 1e-9)
    bias = mount.setdefault("bias", {})
    for axis, size in zip(("tx_mm", "ty_mm", "tz_mm"), shift.tolist(), strict=True):
        bias[axis] = bias.get(axis, 0.0) + size
    return document


def scaled(document: dict[str, Any], factor: float) -> dict[str, Any]:
    """With image noise and manufacturing errors times the factor; without effects the validity number is proportional
    to them."""
    document = copy.deepcopy(document)
    for view in document["views"]:
        for name in ("fiducial_noise_px", "target_noise_px"):
            view[name] *= factor
    if "manufacturing" in document["fiducials"]:
        document["fiducials"]["manufacturing"]["half_width_mm"] *= factor
    return document


def random_design(
    rng: np.random.Generator,
    views: int,
    fiducials: int,
    published: bool,
    nu: tuple[float, float],
    clear: int = 0,
    estimator: str = "dlt",
    triangulation: str = "",
    effects: bool = False,
    corners: bool = False,
    far: bool = False,
    arm: bool = False,
) -> dict[str, Any]:
    """A document whose geometry is not refused; its validity number is drawn from a range, uniform in its logarithm,
    as it is without effects and corners, which add to it.

    clear: up to so many designs are drawn in search of one without a remark that it is hardly determined.  effects:
    with some of what can go wrong in an image.  corners: with some of what turns, and in two of three with a known
    error of the size of the random one.  arm: with a robot between the shots and the tool.
    """
    for drawn in count():
        document = under(random_document(rng, views, fiducials, published, far), estimator, triangulation, rng)
        if far and not RAYS_DEG[0] <= farness(document)[1] <= RAYS_DEG[1]:
            continue
        wanted = _log_uniform(rng, *nu)
        try:
            system, findings, _ = check_design(load_design(document))
            if drawn < clear and any(finding.rule in DETERMINATION for finding in findings):
                continue
            numbers = linearise(system, system.targets[0]).nonlinearity
            document = scaled(document, wanted / (numbers._replace(range=0.0) if far else numbers).nu)
            if effects:
                document = with_effects(document, rng)
            if corners:
                document = with_corners(document, rng)
            if arm:
                document = with_arm(document, rng)
            if corners and rng.random() < 0.67:
                document = with_bias(document, rng)
            _, findings, _ = check_design(load_design(document))
            if drawn < clear and any(finding.rule in DETERMINATION for finding in findings):
                continue
        except TailstackError:
            continue
        if max(view["fiducial_noise_px"] for view in document["views"]) <= LOUDEST_PX:
            return document
    raise AssertionError

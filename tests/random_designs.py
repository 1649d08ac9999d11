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
from tailstack.estimation.checks import DETERMINATION
from tailstack.propagation.linear import linearise

LAWS = ("normal", "uniform", "triangular")
FIDUCIALS = (6, 7, 8, 9, 10, 11, 12, 13, 14, 20, 40)
VIEWS = (2, 3, 4, 5, 6, 7, 8)
LOUDEST_PX = 5.0


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


def random_document(rng: np.random.Generator, views: int, fiducials: int, published: bool) -> dict[str, Any]:
    """A design document with one target, estimated by DLT; its noise is not scaled yet."""
    half = _log_uniform(rng, 6, 60)
    points = _fiducials(rng, fiducials, half)
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
    for k, direction in enumerate(_directions(rng, views)):
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


def _wrong_intrinsics(rng: np.random.Generator) -> dict[str, Any]:
    """Wrong by up to 3 % and 30 px, half of them known; a law of the rest."""
    size, known, law = _log_uniform(rng, 0.001, 0.03), float(rng.choice([0.0, 0.5])), str(rng.choice(LAWS))
    signs = rng.choice([-1.0, 1.0], 3) * known * size
    return {
        "focal": {"bias_rel": signs[0], "half_width_rel": (1 - known) * size, "distribution": law},
        "principal_point": {
            "bias_px": (1000 * signs[1:]).tolist(), "half_width_px": 1000 * (1 - known) * size, "distribution": law,
        },
    }  # fmt: skip


def with_effects(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The document with some of what can go wrong in an image: wrong intrinsics, image fields, motion, temperature,
    balls, fiducials that a view does not see.  A field stays away where the target's image is far outside."""
    points, estimator = document["fiducials"]["points"], document["model"].get("estimator", "dlt")
    wrong, fields, motion, warm, balls, hidden = (rng.random(6) < 0.35).tolist()
    field_px, law = _log_uniform(rng, 0.02, 1.0), str(rng.choice(LAWS))
    rotation_deg, translation_mm = _log_uniform(rng, 0.005, 0.3), _log_uniform(rng, 0.01, 0.3)
    fewest = 4 if estimator.startswith("pose") else 6
    for k, point in enumerate(points):
        point["label"] = f"F{k}"
    seats = np.array([point["position_mm"] for point in points] + [document["targets"][0]["position_mm"]])
    for k, view in enumerate(document["views"]):
        if wrong and estimator.startswith("pose"):
            view["intrinsics_error"] = _wrong_intrinsics(rng)
        images = np.column_stack([seats, np.ones(len(seats))]) @ np.array(view["projection"]).T
        away = np.linalg.norm(images[:, :2] / images[:, 2:] - 800, axis=1).max()
        if fields and away < 1400:
            view["image_size_px"] = [1600, 1600]
            sizes = (field_px * np.exp(rng.normal(0, 0.7, 4)) * (rng.random(4) < 0.7)).tolist()
            view["image_field"] = {"half_widths_px": sizes, "distribution": law}
        if motion and k and (tolerances := _toleranced(rng, rotation_deg, translation_mm)):
            view["motion"] = {"pivot_mm": seats[0].tolist(), "tolerances": tolerances}
        if hidden and len(points) > fewest:
            count = int(rng.integers(max(fewest, len(points) - 3), len(points) + 1))
            view["sees"] = [points[n]["label"] for n in sorted(rng.permutation(len(points))[:count].tolist())]
    if warm:
        document["temperature"] = {
            "difference_k": float(rng.uniform(-20, 20)), "half_width_k": float(rng.uniform(0, 10)),
            "distribution": str(rng.choice(LAWS)), "structure_expansion_um_per_m_k": float(rng.uniform(5, 100)),
            "seat_mm": rng.uniform(-100, 100, 3).tolist(),
        }  # fmt: skip
    if balls:
        document["fiducials"]["diameter_mm"] = float(rng.choice([1.5, 3, 6, 10]))
        document["fiducials"]["image_point"] = str(rng.choice(["outline", "shadow"]))
    return document


def scaled(document: dict[str, Any], factor: float) -> dict[str, Any]:
    """With image noise and manufacturing errors times the factor; the validity number is proportional to them."""
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
) -> dict[str, Any]:
    """A document whose geometry is not refused; its validity number is drawn from a range, uniform in its logarithm.

    clear: up to so many designs are drawn in search of one without a remark that it is hardly determined.  effects:
    with some of what can go wrong in an image.
    """
    for drawn in count():
        document = under(random_document(rng, views, fiducials, published), estimator, triangulation, rng)
        if effects:
            document = with_effects(document, rng)
        wanted = _log_uniform(rng, *nu)
        try:
            system, findings, _ = check_design(load_design(document))
            if drawn < clear and any(finding.rule in DETERMINATION for finding in findings):
                continue
            document = scaled(document, wanted / linearise(system, system.targets[0]).nu)
            check_design(load_design(document))
        except TailstackError:
            continue
        if max(view["fiducial_noise_px"] for view in document["views"]) <= LOUDEST_PX:
            return document
    raise AssertionError

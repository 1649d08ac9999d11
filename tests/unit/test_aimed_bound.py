"""A lower bound over every direction that views may take: held against directions and layouts, and what must break it.

Directions are written into documents with SciPy's rotations, and compiled; nothing here turns a view as the bound does.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf, radians
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optimise_documents import BOX, document, moving, optimised
from tailstack.design import load_design
from tailstack.errors import InfeasibleError
from tailstack.geometry.arrays import Array
from tailstack.geometry.camera import aim
from tailstack.geometry.rotation import left_jacobian, turn_by
from tailstack.optimisation import global_bound
from tailstack.optimisation.aimed_bound import AimBox, AimedViews, read_looks
from tailstack.optimisation.exact_law import evaluate_demand
from tailstack.optimisation.global_bound import (
    Information,
    NoBound,
    bound_quantile,
    cells_in,
    certify_layout,
    fit_below,
    most_known,
    still,
)
from tailstack.optimisation.problem import PlacementProblem, apply_choice, present_choice
from tailstack.optimisation.request import read_request
from tailstack.optimisation.terms import DemandTerms, every_terms
from tailstack.propagation.linear import UNJUDGED, chain_of, linearise_at
from tailstack.system import Law

BEAM, UP = np.array([0.42261826, 0.90630779, 0.0]), np.array([0.0, 0.0, 1.0])  # LAT, only 25 deg from AP
RIGHT = np.cross(BEAM, UP)
ISOCENTRE_MM, CONE_DEG, DISTANCES_MM = np.array([5.0, -10.0, 20.0]), 25.0, (650.0, 780.0)


def rotation(right_deg: float, up_deg: float) -> Rotation:
    """That of the arm, con."""
    return Rotation.from_rotvec(radians(right_deg) * np.cross(BEAM, RIGHT) + radians(up_deg) * np.cross(BEAM, UP))


def written(
    right_deg: float = 0.0, up_deg: float = 0.0, distance_mm: float = 700.0, free: dict[str, Any] | None = None,
    **changes: Any,
) -> dict[str, Any]:  # fmt: skip
    """Two views, the second so aimed about a point that is not the origin, and free as that says."""
    data = document(8, limit_mm=0.6, **moving(rotation_bounds=None)) | changes
    turn = rotation(right_deg, up_deg)
    data["views"][1].pop("orientation")
    data["views"][1] |= {
        "beam_direction": turn.apply(BEAM).tolist(), "up_direction": turn.apply(UP).tolist(),
        "source_isocentre_mm": distance_mm, "isocentre_mm": ISOCENTRE_MM.tolist(),
    }  # fmt: skip
    if free is not None:
        data["optimise"]["views"] = [{"view": "LAT"} | free]
    return data


TURNED: dict[str, Any] = {"cone_deg": CONE_DEG}
MOVED: dict[str, Any] = TURNED | {"source_isocentre_mm": list(DISTANCES_MM)}


def read(data: dict[str, Any]) -> tuple[PlacementProblem, DemandTerms]:
    problem = read_request(load_design(data)).problem
    return problem, every_terms(problem)[0]


def looks_of(free: dict[str, Any], most: int | None = None, **changes: Any) -> AimedViews:
    looks = read_looks(load_design(written(free=free, **changes)), 1)
    assert isinstance(looks, AimedViews)
    return replace(looks, most=most or looks.most)


def some_aim(rng: np.random.Generator, cone_deg: float = CONE_DEG) -> tuple[float, float, float]:
    """A turn within a cone, one in three on its rim, and a distance, one in three the smallest."""
    size, way = cone_deg * (1.0 if rng.random() < 1 / 3 else np.sqrt(rng.random())), rng.uniform(0, 2 * np.pi)
    distance = DISTANCES_MM[0] if rng.random() < 1 / 3 else rng.uniform(*DISTANCES_MM)
    return float(size * np.cos(way)), float(size * np.sin(way)), float(distance)


def some_layout(rng: np.random.Generator, count: int) -> Array:
    """In the box, half of them with fiducials on its faces and in its corners, where they tell most; no more than five
    in a plane."""
    low, high = np.array(BOX["min_mm"]), np.array(BOX["max_mm"])
    while True:
        drawn = rng.uniform(low, high, (count, 3))
        if rng.random() < 0.5:
            face = rng.integers(0, 3, drawn.shape)
            drawn = np.where(face == 0, low, np.where(face == 1, high, drawn))
        apart = np.linalg.norm(drawn[:, None] - drawn, axis=2)[np.triu_indices(count, 1)].min() >= 12.0
        planes = [np.isclose(drawn, side, atol=1e-9).sum(axis=0).max() for side in (low, high)]
        if apart and max(planes) <= 5:
            return drawn


def covariance_at(problem: PlacementProblem, layout: Array) -> Array:
    """(3, 3) con of noise, and of manufacturing where that is normal, by the score's linear model."""
    choice = replace(present_choice(problem), fiducials_mm=layout)
    model = linearise_at(chain_of(apply_choice(problem, choice)), problem.targets[0], UNJUDGED)
    normal = problem.system.manufacturing_law is Law.NORMAL
    wanted = ("noise", "manufacturing") if normal else ("noise",)
    blocks = [block for block in model.blocks if any(word in block.contributor for word in wanted)]
    return sum((block.covariance("localisation") for block in blocks), np.zeros((3, 3)))


@pytest.mark.parametrize(
    ("estimator", "free"),
    [
        ("dlt", MOVED),
        pytest.param("pose", TURNED, marks=pytest.mark.long),
        pytest.param("reprojection", TURNED, marks=pytest.mark.long),
    ],
)
def test_no_direction_and_no_layout_undercut_it(estimator: str, free: dict[str, Any]) -> None:
    """sampled, never wrong of a true bound: 40 directions, and distances, with 25 layouts each, of every estimator: the
    covariance by the score, its mean squares, and the exact quantile of some."""
    rng = np.random.default_rng(7)
    model: dict[str, Any] = {"model": {"estimator": estimator}}
    problem, term = read(written(**model))
    half_width = present_choice(problem).half_width
    images = looks_of(free, 12, **model).bound_images(problem, term, half_width)
    least, quantile_mm = fit_below(images.net, np.eye(3)), bound_quantile(images, problem, term, half_width).value_mm
    weights = [root @ root.T for root in rng.normal(size=(5, 3, 3))]
    squares = [images.least(weight) for weight in weights]
    assert quantile_mm > 0
    assert min(squares) > 0
    for _ in range(40):
        right, up, distance = some_aim(rng)
        aimed, _ = read(written(right, up, distance if "source_isocentre_mm" in free else 700.0, **model))
        for k in range(25):
            layout = some_layout(rng, 8)
            covariance = covariance_at(aimed, layout)
            assert np.linalg.eigvalsh(covariance - least)[0] >= -1e-12
            for weight, square in zip(weights, squares, strict=True):
                assert float((weight * covariance).sum()) >= square
            if k == 0:
                choice = replace(present_choice(aimed), fiducials_mm=layout)
                assert evaluate_demand(aimed, term, choice).exact_mm >= quantile_mm


@cache
def one_box() -> tuple[PlacementProblem, DemandTerms, AimBox, Information]:
    """Two turns by up to 3 deg and a distance by up to 20 mm about an aim far from that as written."""
    problem, term = read(written())
    box = AimBox(np.array([radians(9.0), radians(-14.0), 720.0]), np.array([radians(3.0), radians(3.0), 20.0]))
    return problem, term, box, looks_of(MOVED, 1).aim(problem, term.reconstructed_mm[0], box, every_law=False)


def pose_of(numbers: Array) -> Array:
    """(4, 4) of the camera, by the numbers of an aim."""
    turn = rotation(*np.degrees(numbers[:2]))
    beam = turn.apply(BEAM)
    return aim(ISOCENTRE_MM - numbers[2] * beam, beam, turn.apply(UP))


def told_by(information: Information, kind: int, points: Array, z: Array, carried: Array) -> Array:
    """(n,) squares of the whitened slopes of images of points (n, 3) along z (K, D), summed, by differences; the second
    view sees them, and displacements, where ``carried`` (4, 4) puts them."""
    total = np.zeros(len(points))
    for v, (change, _) in enumerate(information.changes(z)):
        seen, turn = points, np.eye(3)
        if v == 1:
            seen, turn = points @ carried[:3, :3].T + carried[:3, 3], carried[:3, :3]
        for k in range(len(z)):
            step, images = 1e-6 / max(np.abs(change[k]).max(), np.abs(z[k, :3]).max()), []
            for side in (step, -step):
                at = seen + side * (turn @ z[k, :3]) * kind
                rays = np.column_stack([at, np.ones(len(at))]) @ (information.projections[v] + side * change[k]).T
                images.append(rays[:, :2] / rays[:, 2:])
            total += (((images[0] - images[1]) / (2 * step) @ information.whiten[kind, v].T) ** 2).sum(axis=1)
    return total


def largest_found(information: Information, box: AimBox, z: Array, rng: np.random.Generator) -> float:
    """The most that one bead and the target tell along z at 300 places of each of 60 ways to aim."""
    (cells,) = cells_in(information)
    low, high = np.array(BOX["min_mm"]), np.array(BOX["max_mm"])
    here, found = pose_of(box.at), 0.0
    assert len(cells.centres)
    for _ in range(60):
        numbers = box.at + box.half * rng.choice([-1.0, 1.0, 0.3], 3)
        carried = np.linalg.inv(here) @ pose_of(numbers)
        points = rng.uniform(low, high, (300, 3))
        points[::2] = np.where(rng.random((150, 3)) < 0.5, low, high)
        bead = told_by(information, 0, points, z, carried).max()
        found = max(found, float(bead + told_by(information, 1, information.target_mm[None], z, carried)[0]))
    return found


def test_what_a_box_of_directions_can_tell_is_enclosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """independent: slopes of images by differences of projections, and poses of cameras aimed with SciPy.  Without F0,
    or as if the box were a point, it does not hold."""
    _, _, box, information = one_box()
    rng = np.random.default_rng(3)
    cells = tuple(each._replace(beads=each.beads._replace(number=1)) for each in cells_in(information))
    for _ in range(3):
        z = rng.normal(size=(2, information.unknowns))
        z[:, :3] *= 20.0  # the target's own images are about half of it
        found = largest_found(information, box, z, rng)
        bound = float(most_known(information, cells, z, together=True)[0])
        assert found <= bound * (1 + 1e-6) <= 1.5 * found
        as_a_point = replace(information, turns=still(2))
        assert most_known(as_a_point, cells, z, together=True)[0] < found
        with monkeypatch.context() as without:
            without.setattr(global_bound, "known_from_target", lambda _, z: np.zeros(8 * len(z)))
            assert most_known(information, cells, z, together=True)[0] < found


def test_a_box_is_about_the_view_that_a_document_with_its_middle_has() -> None:
    """independent: compiled from a document that SciPy has turned; six decimals of its directions."""
    _, term, box, information = one_box()
    degrees = np.degrees(box.at[:2])
    aimed, _ = read(written(float(degrees[0]), float(degrees[1]), float(box.at[2])))
    expected = global_bound.information_about(aimed, term.reconstructed_mm[0], with_made=False)
    assert np.abs(information.projections - expected.projections).max() < 1e-6 * np.abs(expected.projections).max()


@pytest.mark.long
def test_what_a_known_error_of_the_seat_does_to_a_turn_is_in_it() -> None:
    """sampled, never wrong of a true bound: in both readings of the seat's error, with one of 4 deg and 8 mm."""
    rng, seats = np.random.default_rng(2), written()["interfaces"]
    seats["structure_connector"]["bias"] = {"rx_deg": 4.0, "tx_mm": 8.0}
    for reading in ("physical", "eq18"):
        biased: dict[str, Any] = {"interfaces": seats, "model": {"installation_reading": reading}}
        problem, term = read(written(**biased))
        images = looks_of(TURNED, **biased).bound_images(problem, term, present_choice(problem).half_width)
        least = fit_below(images.net, np.eye(3))
        for _ in range(20):
            right, up, _ = some_aim(rng)
            aimed, _ = read(written(right, up, **biased))
            for _ in range(5):
                covariance = covariance_at(aimed, some_layout(rng, 8))
                assert np.linalg.eigvalsh(covariance - least)[0] >= -1e-12
                assert np.trace(covariance) >= images.least(np.eye(3))


def test_slopes_of_a_rotation_are_those_of_differences() -> None:
    """independent: SciPy's rotations; the tangent is off by at most half the square of the step."""
    rng = np.random.default_rng(0)
    for size in (0.0, 1e-3, 0.5, 1.5):
        for _ in range(20):
            vector, step = rng.normal(size=3), rng.normal(size=3) * 0.05
            vector *= size / np.linalg.norm(vector)
            exact = Rotation.from_rotvec(vector + step).as_matrix()
            assert np.allclose(turn_by(vector + step), exact, atol=1e-12)
            turn = left_jacobian(vector) @ step
            tangent = (np.eye(3) - np.cross(np.eye(3), turn).T) @ turn_by(vector)
            off = np.linalg.norm(exact - tangent, ord=2)
            assert off <= (step @ step) / 2 * (1 + 1e-9)


def test_of_too_much_freedom_it_says_that_it_is_of_the_views_as_aimed() -> None:
    """closed_form: two views with a cone and a distance each have six numbers."""
    data = written(free=MOVED)
    data["views"][0] |= {"isocentre_mm": [0.0, 0.0, 0.0]}
    data["optimise"]["views"].append({"view": "AP"} | MOVED)
    looks = read_looks(load_design(data), 1)
    problem, term = read(written())
    told = certify_layout(problem, [term], present_choice(problem), looks)
    plain = certify_layout(problem, [term], present_choice(problem))
    assert "no bound over what else they may look at" in told.statement
    assert told.lower_bound_mm == plain.lower_bound_mm


def test_boxes_that_are_too_wide_give_none() -> None:
    """closed_form: two views that may look anywhere, in one box."""
    looks = looks_of({"cone_deg": 90.0}, 1)
    problem, term = read(written())
    with pytest.raises(NoBound, match="too wide"):
        looks.bound_images(problem, term, present_choice(problem).half_width)


@pytest.mark.long
def test_an_optimum_is_held_against_every_direction() -> None:
    """oracle: the optimiser itself, its views turned by hand to four directions, as the adversary."""
    base = written(free=TURNED)
    base["optimise"] |= {"rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5}, "starts": 4}
    found = optimised(base)
    told, cheapest = found.certificate.global_bound, found.certificate.cheapest
    assert f"over all directions of LAT within cone_deg {CONE_DEG:g}" in told.statement
    assert "over all directions" in cheapest.statement
    assert told.lower_bound_mm <= told.quantile_mm <= 1.1 * told.lower_bound_mm
    assert cheapest.lower_bound <= found.cost_after <= 1.15 * cheapest.lower_bound
    for right, up in ((-15.0, 15.0), (0.0, 0.0), (17.0, -17.0), (25.0, 0.0)):
        aimed = written(right, up)
        aimed["optimise"] |= {"rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5}, "starts": 4}
        try:
            reached = optimised(aimed).cost_after
        except InfeasibleError:
            reached = inf  # that direction keeps the limit at no cost
        assert cheapest.lower_bound <= reached

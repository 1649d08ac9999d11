"""The reference scene of the layout study, and what is measured on it.

A reference structure in a box of 100 mm, the target 110 mm above the middle of the box, two shots of one C-arm at
90 degrees, 0.5 px, six rotational tolerances.  Everything that the study varies is a field of ``Scene``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from compared_layouts import careless_layouts, textbook_layout

from tailstack.design import load_design
from tailstack.errors import InfeasibleError, TailstackError
from tailstack.geometry.arrays import Array
from tailstack.optimisation.exact_law import ExactQuantile, exact_quantile, image_parts
from tailstack.optimisation.placement import settle
from tailstack.optimisation.present import broken_rules
from tailstack.optimisation.problem import PlacementProblem, apply_choice, present_choice
from tailstack.optimisation.request import read_request
from tailstack.optimisation.search import Search, farthest, objective_for_people, search
from tailstack.propagation.linear import LinearModel, linearise
from tailstack.propagation.validity import validity
from tailstack.results import LocalOptimum
from tailstack.system import System

SEED = 1
CARELESS = 30
TARGET_MM = (0.0, 0.0, 70.0)


@dataclass(frozen=True, slots=True)
class Scene:
    """What the study varies; the values here are the reference."""

    fiducials: int = 8
    box_mm: tuple[tuple[float, float, float], tuple[float, float, float]] = ((-50, -50, -90), (50, 50, 10))
    angle_deg: float = 90.0  # between the two beams
    noise_px: float = 0.5  # of fiducials
    target_noise_px: float | None = None  # None: as the fiducials'
    pivots_z_mm: tuple[float, float] = (-95.0, -145.0)
    half_width_deg: float = 0.05  # of each of the six rotations, where they are not free
    limit_mm: float = 0.5
    pivot_box_mm: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None  # of the first pivot
    estimator: str = "dlt"
    intrinsics_prior: tuple[float, float] | None = None  # focal length (relative), principal point, px: std of both
    seed: int = SEED


def cube(edge_mm: float, centre_z_mm: float = -40.0) -> Any:
    """Lowest and highest corner of a cube whose middle is on the z axis."""
    half = edge_mm / 2
    return (-half, -half, centre_z_mm - half), (half, half, centre_z_mm + half)


def document(scene: Scene, free: bool) -> dict[str, Any]:
    """The scene as a design; with ``free`` half-widths the least cost is wanted, without the smallest P95."""
    low, high = np.array(scene.box_mm)
    drawn = np.random.default_rng(7).uniform(low, high, (scene.fiducials, 3))
    angle = np.deg2rad(scene.angle_deg)
    target_noise = scene.noise_px if scene.target_noise_px is None else scene.target_noise_px
    views: list[dict[str, Any]] = [
        {
            "name": name, "source_detector_mm": 1020, "source_isocentre_mm": 700, "pixel_mm": 0.194,
            "image_size_px": [1536, 1536], "beam_direction": [-float(np.sin(a)), float(np.cos(a)), 0.0],
            "fiducial_noise_px": scene.noise_px, "target_noise_px": target_noise,
        }
        for name, a in (("first shot", 0.0), ("second shot", angle))
    ]  # fmt: skip
    if scene.intrinsics_prior is not None:
        focal, centre_px = scene.intrinsics_prior
        for view in views:
            view["intrinsics_prior"] = {"focal_rel_sd": focal, "principal_point_px_sd": centre_px}
    tolerance = {"half_width_deg": scene.half_width_deg, "distribution": "uniform"}
    interfaces = {
        name: {"pivot_mm": [0, 0, z], "tolerances": dict.fromkeys(("rx", "ry", "rz"), tolerance)}
        for name, z in zip(("structure_connector", "connector_flange"), scene.pivots_z_mm, strict=True)
    }
    wanted: dict[str, Any] = {
        "box": {"min_mm": list(low), "max_mm": list(high)}, "min_spacing_mm": 12, "min_projected_spacing_px": 25,
        "image_margin_px": 15, "target_clearance_px": 25,
    }  # fmt: skip
    if free:
        wanted["rotation_bounds"] = {"min_deg": 0.001, "max_deg": 3.0}
    if scene.pivot_box_mm is not None:
        lowest, highest = scene.pivot_box_mm
        wanted["pivots"] = [
            {"interface": "structure_connector", "box": {"min_mm": list(lowest), "max_mm": list(highest)}}
        ]
    return {
        "schema": "tailstack/design/1", "name": "layout study", "views": views,
        "fiducials": {"points": [
            {"label": f"F{k + 1}", "position_mm": [round(float(v), 3) for v in point]} for k, point in enumerate(drawn)
        ]},
        "interfaces": interfaces, "targets": [{"name": "target", "position_mm": list(TARGET_MM)}],
        "requirements": [{
            "name": "accuracy", "error": "tcp", "quantile": 0.95, "limit_mm": scene.limit_mm, "confidence": 0.95,
            "targets": ["target"], "risk": "pooled",
        }],
        "model": {"estimator": scene.estimator},
        "optimise": wanted,
    }  # fmt: skip


def problem_of(scene: Scene, free: bool) -> PlacementProblem:
    """The scene as the optimiser's problem."""
    return read_request(load_design(document(scene, free))).problem


@dataclass(frozen=True, slots=True, eq=False)
class Layouts:
    """P95 in mm, exact first-order law, of the optimal, the textbook and careless layouts at given half-widths."""

    best_mm: float
    layout_mm: Array  # (N, 3)
    optima: tuple[LocalOptimum, ...]
    textbook: str
    textbook_mm: float
    textbook_layout_mm: Array
    careless_mm: Array  # (CARELESS,) ascending
    careless_layouts_mm: list[Array]  # in that order
    careless_valid: int  # of those, first order may be trusted to 20 %
    no_fiducial_noise_mm: float  # with only the target's own image noise
    no_noise_mm: float  # with no image noise at all
    through_fiducials_mm: tuple[float, float, float]  # rms of that noise: optimal, textbook, median of the careless
    problem: PlacementProblem


def fixed_half_widths(scene: Scene, starts: int = 8) -> Layouts:
    """The smallest P95 over layouts at the scene's half-widths, and P95 of the layouts it is compared with."""
    problem = problem_of(scene, free=False)
    found = search(problem, starts=starts, seed=scene.seed, threads=1)
    best = settle(found, np.ones(1))
    steering = farthest(problem, found.terms)
    named = textbook_layout(problem)
    assert named is not None  # a box has one
    name, textbook = named
    careless = careless_layouts(problem, steering, CARELESS, scene.seed)
    careless.sort(key=lambda layout: p95_mm(problem, layout))
    trust = [validity(model_of(problem, layout).nonlinearity, system_at(problem, layout)).status for layout in careless]
    model = model_of(problem, best.choice.fiducials_mm)
    through = [through_fiducials_mm(problem, layout) for layout in (best.choice.fiducials_mm, textbook, *careless)]
    return Layouts(
        best_mm=best.worst_ratio * scene.limit_mm,
        layout_mm=best.choice.fiducials_mm,
        optima=found.optima,
        textbook=name,
        textbook_mm=p95_mm(problem, textbook),
        textbook_layout_mm=textbook,
        careless_mm=np.array([p95_mm(problem, layout) for layout in careless]),
        careless_layouts_mm=careless,
        careless_valid=sum(status != "not valid" for status in trust),
        no_fiducial_noise_mm=_without(model, problem, "fiducial_noise").value_mm,
        no_noise_mm=_without(model, problem, "fiducial_noise", "target_noise").value_mm,
        through_fiducials_mm=(through[0], through[1], float(np.median(through[2:]))),
        problem=problem,
    )


def system_at(problem: PlacementProblem, layout_mm: Array) -> System:
    """The problem's system with another layout (N, 3)."""
    return apply_choice(problem, replace(present_choice(problem), fiducials_mm=layout_mm))


def model_of(problem: PlacementProblem, layout_mm: Array) -> LinearModel:
    """The linear model of the score at a layout."""
    return linearise(system_at(problem, layout_mm), problem.targets[0])


def p95_mm(problem: PlacementProblem, layout_mm: Array) -> float:
    """Exact first-order P95 at a layout, half-widths as they are."""
    return exact_quantile(model_of(problem, layout_mm), problem.demands[0]).value_mm


def _without(model: LinearModel, problem: PlacementProblem, *contributors: str) -> ExactQuantile:
    kept = tuple(block for block in model.blocks if not block.contributor.startswith(contributors))
    return exact_quantile(replace(model, blocks=kept), problem.demands[0])


def through_fiducials_mm(problem: PlacementProblem, layout_mm: Array) -> float:
    """Root mean square length of the error that the fiducials' image noise makes, mm: what the layout decides."""
    model = model_of(problem, layout_mm)
    own = replace(model, blocks=tuple(b for b in model.blocks if b.contributor.startswith("fiducial_noise")))
    return float(np.sqrt(np.trace(image_parts(own, "tcp")[0])))


@dataclass(frozen=True, slots=True, eq=False)
class Costs:
    """Least cost by the closed form, half-widths optimised alike at every layout; None: the limit is out of reach."""

    best: float | None
    exact: float | None  # the optimum by the exact law
    textbook: float | None
    textbook_breaks_rule: bool
    careless_median: float | None  # of those that can meet the limit
    careless_worst: float | None
    careless_infeasible: int
    half_width_deg: Array  # (6,) of the exact optimum
    layout_mm: Array  # (N, 3)
    pivot_mm: Array  # (P, 3) where pivots are free


def least_cost(scene: Scene, starts: int = 8) -> Costs:
    """The least cost over layouts and half-widths at the scene's limit, against the textbook's and careless layouts."""
    problem = problem_of(scene, free=True)
    try:
        found = search(problem, starts=starts, seed=scene.seed, threads=1)
    except InfeasibleError:
        return Costs(None, None, None, False, None, None, CARELESS, np.full(6, np.nan), np.zeros((0, 3)), np.zeros(0))
    return costs_of(found, scene.seed)


def costs_of(found: Search, seed: int) -> Costs:
    """What a search came to, and the comparison."""
    best = objective_for_people(found.program, found.iterates[0].point.objective)
    problem = found.program.problem
    steering = farthest(problem, found.terms)
    named = textbook_layout(problem)
    assert named is not None  # a box has one
    careless = [closed_form_cost(problem, layout) for layout in careless_layouts(problem, steering, CARELESS, seed)]
    reached = [cost for cost in careless if cost is not None]
    exact = settle(found, np.ones(1))
    return Costs(
        best=best,
        exact=exact.cost,
        textbook=closed_form_cost(problem, named[1]),
        textbook_breaks_rule=any(broken_rules(problem, steering, named[1])),
        careless_median=float(np.median(reached)) if reached else None,
        careless_worst=max(reached, default=None),
        careless_infeasible=len(careless) - len(reached),
        half_width_deg=np.rad2deg(exact.choice.half_width),
        layout_mm=exact.choice.fiducials_mm,
        pivot_mm=exact.choice.pivots_mm,
    )


def closed_form_cost(problem: PlacementProblem, layout_mm: Array) -> float | None:
    """The least cost at a layout, by the closed form; None where the limit is out of reach."""
    try:
        return search(
            replace(problem, system=system_at(problem, layout_mm), places=()), starts=1, threads=1
        ).best_objective
    except TailstackError:
        return None


def closed_form_half_width_deg(scene: Scene) -> float:
    """The first half-width at least cost, by the closed form, fiducials where they stand."""
    found = search(replace(problem_of(scene, free=True), places=()), starts=1, seed=scene.seed, threads=1)
    return float(np.rad2deg(found.program.split(found.iterates[0].point.x).half_width[0]))

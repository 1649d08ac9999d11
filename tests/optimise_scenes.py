"""The placement problems of ``placement_best_known.json``, as the tests of the optimiser build them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes import cube_fiducials, mount, random_system, read_only, system_of, with_noise
from tailstack.design.compile import torsor_from_locators
from tailstack.geometry.arrays import Array
from tailstack.optimisation import FreeFiducial, FreeHalfWidth, PlacementProblem
from tailstack.optimisation.placement import PlacementSolution, settle
from tailstack.optimisation.prices import Price, reciprocal
from tailstack.optimisation.problem import Choice, PivotVariable, apply_choice
from tailstack.optimisation.regions import BoxRegion
from tailstack.optimisation.search import search
from tailstack.propagation.linear import linearise
from tailstack.scoring import score
from tailstack.system import DirectEffect, Law, Requirement, Sources
from tailstack.system import mount as mount_of

ORACLE = json.loads((Path(__file__).parent / "data" / "oracles" / "placement_best_known.json").read_text())
BOX_MM = np.array([[-50.0, -50.0, -90.0], [50.0, 50.0, 10.0]])
ROTATIONS = ("rx", "ry", "rz")
NORMAL_P95 = 1.959963984540054  # of |N(0, 1)|
# A 3-2-1 seat about (-7, -7, -87) mm: three contacts below, two in front, one at the side.
LOCATORS_MM = np.array(
    [[-40, -40, -95], [40, -40, -95], [0, 45, -95], [-40, -50, -80], [40, -50, -80], [-50, 0, -80]], dtype=float
)
NORMALS = np.array([[0, 0, 1]] * 3 + [[0, 1, 0]] * 2 + [[1, 0, 0]], dtype=float)


def solve_placement(problem: PlacementProblem, **options: Any) -> PlacementSolution:
    """Best of 8 local optima, its exact quantiles just below the limits; options: of ``search``."""
    found = search(problem, **options)
    return settle(found, np.ones(len(found.terms)))


def requirement(limit_mm: float, **changes: Any) -> Requirement:
    return replace(Requirement("accuracy", "tcp", 0.95, limit_mm, 0.95, ("target",)), **changes)


def free_rotations(components: tuple[str, ...] = ROTATIONS) -> tuple[FreeHalfWidth, ...]:
    return tuple(
        FreeHalfWidth(interface, component, np.deg2rad(1e-3), np.deg2rad(3.0), reciprocal())
        for interface in ("structure_connector", "connector_flange")
        for component in components
    )


def places_in_box(fiducials: Iterable[int], box_mm: Array = BOX_MM) -> tuple[FreeFiducial, ...]:
    """A place for each of these fiducials, all in one box."""
    box = BoxRegion(*np.asarray(box_mm, dtype=float))
    return tuple(FreeFiducial((i,), box) for i in fiducials)


def oracle_problem(
    fiducials: int = 8, limit_mm: float = 0.5, law: Law = Law.UNIFORM, **changes: Any
) -> PlacementProblem:
    """Box, spacing, projected spacing, margin and clearance of the oracle; the present layout is a random one."""
    half = [np.deg2rad(0.05)] * 3 + [0.0] * 3
    layout = np.random.default_rng(7).uniform(BOX_MM[0], BOX_MM[1], (fiducials, 3))
    system = system_of(
        layout,
        structure_connector=mount("structure_connector", (0.0, 0.0, -95.0), half_width=half, law=law),
        connector_flange=mount("connector_flange", (0.0, 0.0, -145.0), half_width=half, law=law),
    )
    problem = PlacementProblem(
        system=system,
        requirements=(requirement(limit_mm),),
        places=places_in_box(range(fiducials)),
        half_widths=free_rotations(),
        min_spacing_mm=12.0,
        min_projected_spacing_px=25.0,
        image_margin_px=15.0,
        target_clearance_px=25.0,
    )
    return replace(problem, **changes)


def fixed_layout(problem: PlacementProblem, fiducials_mm: Any) -> PlacementProblem:
    """The same with every fiducial fixed, at these positions."""
    system = replace(problem.system, fiducials_mm=np.array(fiducials_mm, dtype=float))
    return replace(problem, system=system, places=())


def silent_problem(
    limit_mm: float, components: tuple[str, ...], law: Law = Law.NORMAL, **changes: Any
) -> PlacementProblem:
    """No noise, a fixed cube: the error is what the free rotations make it, with levers of 165 and 215 mm."""
    half = [np.deg2rad(0.05) * (name in components) for name in ROTATIONS] + [0.0] * 3
    problem = fixed_layout(oracle_problem(8, limit_mm), cube_fiducials())
    system = replace(
        problem.system,
        views=with_noise(0.0),
        structure_connector=mount("structure_connector", (0.0, 0.0, -95.0), half_width=half, law=law),
        connector_flange=mount("connector_flange", (0.0, 0.0, -145.0), half_width=half, law=law),
    )
    return replace(problem, system=system, half_widths=free_rotations(components), **changes)


def first_interface_only(problem: PlacementProblem) -> PlacementProblem:
    """The second interface exact, and nothing of it free."""
    exact = replace(problem.system.connector_flange, sources=mount("connector_flange").sources)
    free = tuple(item for item in problem.half_widths if item.contributor == "structure_connector")
    return replace(problem, system=replace(problem.system, connector_flange=exact), half_widths=free)


def at_prices(problem: PlacementProblem, *prices: Price) -> PlacementProblem:
    """The same with one price for each free half-width."""
    free = tuple(replace(item, price=price) for item, price in zip(problem.half_widths, prices, strict=True))
    return replace(problem, half_widths=free)


def seat(name: str, pivot_mm: Any, half_width_mm: Any, law: Law | tuple[Law, ...] = Law.NORMAL) -> DirectEffect:
    """A mount on the six locators; half_width_mm (6,), those of no size left out."""
    laws = law if isinstance(law, tuple) else (law,) * 6
    kept = [j for j in range(6) if half_width_mm[j] != 0]
    sources = Sources(
        names=tuple(f"L{j + 1}" for j in kept),
        laws=tuple(laws[j] for j in kept),
        half_width=read_only([half_width_mm[j] for j in kept]),
        coverage_factor=read_only(np.ones(len(kept))),
        units=("mm",) * len(kept),
        direction=read_only(torsor_from_locators(LOCATORS_MM, NORMALS, np.asarray(pivot_mm))[:, kept]),
    )
    return mount_of(name, read_only(pivot_mm), read_only(np.zeros(6)), sources)


def pivot_in(contributor: str, low_mm: Any, high_mm: Any) -> PivotVariable:
    return PivotVariable(contributor, np.array(low_mm, dtype=float), np.array(high_mm, dtype=float))


def general_problem(seed: int, *, error: str = "tcp", **system_changes: Any) -> PlacementProblem:
    """Everything at once: two targets, biases, mixed laws, manufacturing, hand-eye, execution; three of seven
    fiducials free, locators of one interface and rotations of the other, and both pivots."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, fiducials=7, targets=2, **system_changes)
    laws = (Law.UNIFORM, Law.NORMAL, Law.TRIANGULAR, Law.UNIFORM, Law.NORMAL, Law.UNIFORM)
    first = replace(
        seat("structure_connector", rng.uniform(-80, 80, 3), [0.02] * 6, laws), known=system.structure_connector.known
    )
    free = (
        FreeHalfWidth("structure_connector", "L1", 1e-3, 0.3, reciprocal(0.02)),
        FreeHalfWidth("structure_connector", "L4", 1e-3, 0.3, reciprocal(0.03)),
        *(FreeHalfWidth("connector_flange", name, 1e-4, 0.05, reciprocal()) for name in ("rx", "rz")),
    )
    return PlacementProblem(
        system=replace(system, structure_connector=first),
        requirements=(requirement(5.0, error=error, targets=("t0", "t1")),),
        places=places_in_box((0, 2, 5), np.array([[-60.0] * 3, [50.0] * 3])),
        half_widths=free,
        pivots=(
            pivot_in("structure_connector", first.pivot_mm - 30, first.pivot_mm + 20),
            pivot_in("connector_flange", system.connector_flange.pivot_mm - 20, system.connector_flange.pivot_mm + 30),
        ),
        min_spacing_mm=5.0,
    )


def score_mm(problem: PlacementProblem, choice: Choice) -> list[float]:
    """What the score says of every demand at a choice, mm."""
    scored = score(replace(apply_choice(problem, choice), requirements=problem.requirements), losses=False)
    found = []
    for demand in problem.demands:
        (check,) = [c for c in scored.verdict.checks if (c.requirement, c.target) == demand.subject]
        found.append(float(check.value))
    return found


def image_covariance_by_score(problem: PlacementProblem, fiducials_mm: Array) -> Array:
    """(3, 3) of image noise and manufacturing at the first target, by the compiled model that the score uses."""
    model = linearise(replace(problem.system, fiducials_mm=np.asarray(fiducials_mm, dtype=float)), problem.targets[0])
    total = np.zeros((3, 3))
    for block in model.blocks:
        if "noise" in block.contributor or "manufacturing" in block.contributor:
            scaled = block.columns_mm(problem.requirements[0].error)
            total += scaled @ scaled.T
    return total


def oracle_p95_mm(noise: Array, levers_mm: Array, tau_rad: Array) -> float:
    """The oracle's own model of P95, written out: Pearson on three cumulants, Wilson-Hilferty, uniform sources.

    noise (3, 3), levers_mm (K, 3) mm per rad, tau_rad (K,) half-widths.
    """
    s = noise + np.einsum("k,ki,kj->ij", tau_rad**2 / 3, levers_mm, levers_mm)
    c1, c2, c3 = np.trace(s), np.trace(s @ s), np.trace(s @ s @ s)
    for g, tau in zip(levers_mm, tau_rad, strict=True):
        k4, k6, size = -2 * tau**4 / 15, 16 * tau**6 / 63, g @ g
        c2 += k4 * size**2 / 2
        c3 += (12 * k4 * size * (g @ s @ g) + k6 * size**3) / 8
    h = c2**3 / c3**2
    chi2 = h * (1 - 2 / (9 * h) + 1.6448536269514722 * np.sqrt(2 / (9 * h))) ** 3
    return float(np.sqrt(c1 + np.sqrt(c2 / h) * (chi2 - h)))


def oracle_levers_mm() -> Array:
    """(6, 3) rows ``axis x (target - pivot)``: magnitude is what counts, both mounts turn about their own pivot."""
    arms = [np.array([0.0, 0.0, 70.0 - z]) for z in (-95.0, -145.0)]
    return np.vstack([np.cross(np.eye(3), arm) for arm in arms])

"""The placement problems of ``placement_best_known.json``, as the tests of the optimiser build them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes import mount, system_of
from tailstack.optimisation import FreeHalfWidth, Place, PlacementProblem
from tailstack.optimisation.prices import reciprocal
from tailstack.optimisation.regions import Box
from tailstack.propagation.linear import linearise
from tailstack.system import Array, Law, Requirement

ORACLE = json.loads((Path(__file__).parent / "data" / "oracles" / "placement_best_known.json").read_text())
BOX_MM = np.array([[-50.0, -50.0, -90.0], [50.0, 50.0, 10.0]])
ROTATIONS = ("rx", "ry", "rz")


def requirement(limit_mm: float, **changes: Any) -> Requirement:
    return replace(Requirement("accuracy", "tcp", 0.95, limit_mm, 0.95, ("target",)), **changes)


def free_rotations(components: tuple[str, ...] = ROTATIONS, max_deg: float = 3.0) -> tuple[FreeHalfWidth, ...]:
    return tuple(
        FreeHalfWidth(interface, component, np.deg2rad(1e-3), np.deg2rad(max_deg), reciprocal())
        for interface in ("interface_1", "interface_2")
        for component in components
    )


def places_in_box(fiducials: Iterable[int], box_mm: Array = BOX_MM) -> tuple[Place, ...]:
    """A place for each of these fiducials, all in one box."""
    box = Box(*np.asarray(box_mm, dtype=float))
    return tuple(Place((i,), box) for i in fiducials)


def oracle_problem(
    fiducials: int = 8, limit_mm: float = 0.5, law: Law = Law.UNIFORM, **changes: Any
) -> PlacementProblem:
    """Box, spacing, projected spacing, margin and clearance of the oracle; the present layout is a random one."""
    half = [np.deg2rad(0.05)] * 3 + [0.0] * 3
    layout = np.random.default_rng(7).uniform(BOX_MM[0], BOX_MM[1], (fiducials, 3))
    system = system_of(
        layout,
        interface_1=mount("interface_1", (0.0, 0.0, -95.0), half_width=half, law=law),
        interface_2=mount("interface_2", (0.0, 0.0, -145.0), half_width=half, law=law),
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


def fixed_layout(problem: PlacementProblem, fiducials_mm: Any = None) -> PlacementProblem:
    """The same with every fiducial where it is (or at the given positions)."""
    system = problem.system
    if fiducials_mm is not None:
        system = replace(system, fiducials_mm=np.array(fiducials_mm, dtype=float))
    return replace(problem, system=system, places=())


def image_covariance_by_score(problem: PlacementProblem, fiducials_mm: Array) -> Array:
    """(3, 3) of image noise and manufacturing at the first target, by the compiled model that the score uses."""
    model = linearise(replace(problem.system, fiducials_mm=np.asarray(fiducials_mm, dtype=float)), problem.targets[0])
    total = np.zeros((3, 3))
    for block in model.blocks:
        if "noise" in block.contributor or "manufacturing" in block.contributor:
            scaled = model.gain(block, problem.requirements[0].error) * block.std
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


def oracle_levers_mm(target_mm: Any = (0.0, 0.0, 70.0)) -> Array:
    """(6, 3) rows ``axis x (target - pivot)``: magnitude is what counts, both mounts turn about their own pivot."""
    arms = [np.asarray(target_mm) - np.array([0.0, 0.0, z]) for z in (-95.0, -145.0)]
    return np.vstack([np.cross(np.eye(3), arm) for arm in arms])

"""What the optimiser may change and what it must keep, on plain arrays: no document, no solver."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..system import Array, Mount, Requirement, System, Target


@dataclass(frozen=True, slots=True)
class FreeHalfWidth:
    """One half-width of a mount that may be set; its cost is ``cost_weight / half_width``."""

    contributor: str  # "interface_1" or "interface_2"
    component: str  # name of the source: rx, ry, rz
    minimum: float  # native unit of the source (rad)
    maximum: float
    cost_weight: float
    pointer: str = "/optimise/tolerances"  # where the user gave the bounds


@dataclass(frozen=True, slots=True, eq=False)
class PlacementProblem:
    """Least cost of the free half-widths, over them and the free fiducials, with the quantile within its limit.

    ``system`` holds everything else, fixed.  With no free half-width the objective is the quantile itself.
    """

    system: System
    requirement: Requirement
    free_fiducials: tuple[int, ...]  # indices into system.fiducials_mm
    box_mm: Array  # (2, 3) lowest and highest corner, con; read only when fiducials are free
    half_widths: tuple[FreeHalfWidth, ...]
    min_spacing_mm: float = 0.0
    min_projected_spacing_px: float = 0.0  # between the images of two fiducials, in every view
    image_margin_px: float = 0.0  # from the image's border, in views whose size is stated
    target_clearance_px: float = 0.0  # between the image of a fiducial and that of a required target

    @property
    def targets(self) -> tuple[Target, ...]:
        """The targets the requirement names, in the order of the system."""
        return tuple(t for t in self.system.targets if t.name in self.requirement.targets)

    @property
    def lower(self) -> Array:
        """(K,) smallest half-widths, native unit."""
        return np.array([free.minimum for free in self.half_widths])

    @property
    def upper(self) -> Array:
        """(K,) largest half-widths, native unit."""
        return np.array([free.maximum for free in self.half_widths])

    @property
    def weights(self) -> Array:
        """(K,) cost weights."""
        return np.array([free.cost_weight for free in self.half_widths])

    def cost(self, half_width: Array) -> float:
        """Sum of ``cost_weight / half_width`` over the free half-widths (K,), native unit (1/rad)."""
        return float((self.weights / half_width).sum())


def mount_named(system: System, contributor: str) -> Mount:
    """The interface a contributor name stands for."""
    return {mount.name: mount for mount in (system.interface_1, system.interface_2)}[contributor]


def in_words(problem: PlacementProblem, index: int) -> str:
    """What the user calls a free half-width: the interface's label and the component."""
    free = problem.half_widths[index]
    mount = mount_named(problem.system, free.contributor)
    return f"{mount.label or mount.name} {free.component}"


def half_widths_of(problem: PlacementProblem) -> Array:
    """(K,) what the free half-widths are in the system as it stands, native unit."""
    values = []
    for free in problem.half_widths:
        sources = mount_named(problem.system, free.contributor).sources
        values.append(float(sources.half_width[sources.names.index(free.component)]))
    return np.array(values)


def apply_choice(problem: PlacementProblem, fiducials_mm: Array, half_width: Array) -> System:
    """The system with all fiducials (N, 3) mm and the free half-widths (K,) replaced."""
    mounts = {mount.name: mount for mount in (problem.system.interface_1, problem.system.interface_2)}
    for free, value in zip(problem.half_widths, half_width, strict=True):
        mount = mounts[free.contributor]
        widths = mount.sources.half_width.copy()
        widths[mount.sources.names.index(free.component)] = value
        widths.setflags(write=False)
        mounts[free.contributor] = replace(mount, sources=replace(mount.sources, half_width=widths))
    placed = np.array(fiducials_mm, dtype=float)
    placed.setflags(write=False)
    first, second = problem.system.interface_1.name, problem.system.interface_2.name
    return replace(problem.system, fiducials_mm=placed, interface_1=mounts[first], interface_2=mounts[second])

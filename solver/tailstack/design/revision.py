"""What an optimiser may change in a design, and the design with it changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, radians
from typing import Any

from ..system import Array
from .consistency import declared_rotations
from .loading import Design, design_to_data, load_design
from .reading import DEFAULT_LIMITS, Limits

CONTRIBUTOR = {"structure_connector": "interface_1", "connector_flange": "interface_2"}
FIELD = {contributor: field for field, contributor in CONTRIBUTOR.items()}


@dataclass(frozen=True, slots=True)
class FreeRotation:
    """One rotational half-width that may be set; its cost is ``cost_weight / half-width in rad``."""

    contributor: str  # "interface_1" or "interface_2"
    component: str  # "rx", "ry", "rz"
    min_rad: float
    max_rad: float
    cost_weight: float
    pointer: str  # where its bounds stand


def free_rotations(design: Design) -> tuple[FreeRotation, ...]:
    """The rotational half-widths a design sets free: those it lists, or all it declares within common bounds."""
    wanted = design.document.optimise
    if wanted is None:
        return ()
    bounds = wanted.rotation_bounds
    if bounds is not None:
        return tuple(
            FreeRotation(
                CONTRIBUTOR[interface],
                component,
                radians(bounds.min_deg),
                radians(bounds.max_deg),
                bounds.cost_weight,
                "/optimise/rotation_bounds",
            )
            for interface, component in declared_rotations(design.document)
        )
    return tuple(
        FreeRotation(
            CONTRIBUTOR[free.interface],
            free.component,
            radians(free.min_deg),
            radians(free.max_deg),
            free.cost_weight,
            f"/optimise/tolerances/{index}",
        )
        for index, free in enumerate(wanted.tolerances)
    )


def revise_design(
    design: Design,
    *,
    fiducials_mm: Array | None = None,
    half_width_rad: Mapping[tuple[str, str], float] | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Design:
    """The design with new fiducial positions (N, 3), con, and rotational half-widths, loaded and checked anew.

    ``half_width_rad`` maps (contributor, component), for example ("interface_1", "rz"), to rad.  Fiducials
    from a file become points of the document, so the result stands alone.
    """
    data: dict[str, Any] = design_to_data(design, inline=True)
    if fiducials_mm is not None:
        data["fiducials"]["points"] = [
            {"label": label, "position_mm": [float(value) for value in position]}
            for label, position in zip(design.fiducials.labels, fiducials_mm, strict=True)
        ]
    for (contributor, component), value in (half_width_rad or {}).items():
        tolerances = data["interfaces"][FIELD[contributor]]["tolerances"]
        tolerances[component]["half_width_deg"] = degrees(float(value))
    return load_design(data, limits=limits)

"""A design with some of its numbers changed: what an optimiser hands back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from typing import Any

import numpy as np

from ..system import Array
from .loading import Design, design_to_data, load_design
from .reading import DEFAULT_LIMITS, Limits

CONTRIBUTOR = {"structure_connector": "interface_1", "connector_flange": "interface_2"}
FIELD = {contributor: name for name, contributor in CONTRIBUTOR.items()}
ROTATIONS = ("rx", "ry", "rz")


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """What to change.  Contributors are "interface_1" and "interface_2"; half-widths in rad or mm."""

    labels: Sequence[str] | None = None  # of fiducials_mm; None: those of the design
    fiducials_mm: Array | None = None  # (N, 3) con; None: they stay
    half_width: Mapping[tuple[str, str], float] = field(default_factory=dict)  # (contributor, component or locator)
    pivot_mm: Mapping[str, Array] = field(default_factory=dict)  # (3,) con
    locator_scale: Mapping[str, float] = field(default_factory=dict)  # about the locators' centre


def revise_design(design: Design, change: Revision, limits: Limits = DEFAULT_LIMITS) -> Design:
    """The design with a change made, loaded and checked anew.

    Fiducials from a file become points of the document, so the result stands alone.  Raises DesignError.
    """
    data: dict[str, Any] = design_to_data(design, inline=True)
    if change.fiducials_mm is not None:
        labels = design.fiducials.labels if change.labels is None else change.labels
        data["fiducials"]["points"] = [
            {"label": label, "position_mm": [float(value) for value in position]}
            for label, position in zip(labels, change.fiducials_mm, strict=True)
        ]
        same = tuple(labels) == design.fiducials.labels
        if design.fiducials.origin is not None and not (
            same and np.array_equal(change.fiducials_mm, design.fiducials.positions_mm)
        ):
            data["fiducials"]["origin"]["changed"] = True
        _forget_missing_labels(data, set(labels))
    for (contributor, component), value in change.half_width.items():
        _set_half_width(data["interfaces"][FIELD[contributor]], component, float(value))
    for contributor, position in change.pivot_mm.items():
        data["interfaces"][FIELD[contributor]]["pivot_mm"] = [float(value) for value in position]
    for contributor, scale in change.locator_scale.items():
        locators = data["interfaces"][FIELD[contributor]]["locators"]
        positions = np.array([locator["position_mm"] for locator in locators], dtype=float)
        centre = positions.mean(axis=0)
        for locator, position in zip(locators, centre + scale * (positions - centre), strict=True):
            locator["position_mm"] = [float(value) for value in position]
    return load_design(data, limits=limits)


def _set_half_width(interface: dict[str, Any], component: str, value: float) -> None:
    if interface.get("locators"):
        for locator in interface["locators"]:
            if locator["name"] == component:
                locator["half_width_mm"] = value
        return
    unit, shown = ("deg", degrees(value)) if component in ROTATIONS else ("mm", value)
    interface["tolerances"][component][f"half_width_{unit}"] = shown


def _forget_missing_labels(data: dict[str, Any], labels: set[str]) -> None:
    """Fiducials that were left out are no longer named in the optimise section."""
    wanted = data.get("optimise")
    if not wanted:
        return
    wanted["fixed"] = [label for label in wanted.get("fixed") or [] if label in labels]

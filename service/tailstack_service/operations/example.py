"""The design in the examples of the OpenAPI document; it and its variants also warm the service up."""

from __future__ import annotations

from itertools import product
from typing import Any


def _view(name: str) -> dict[str, Any]:
    return {
        "name": name,
        "preset": "siemens-cios-fusion",
        "source_isocentre_mm": 700.0,
        "orientation": name,
        "fiducial_noise_px": 0.3,
        "target_noise_px": 0.3,
    }


def _rotation(half_width_deg: float) -> dict[str, Any]:
    return {"half_width_deg": half_width_deg, "distribution": "uniform"}


# Eight corners of a 90 mm box, each moved a little so that no two images fall together in either view.
_POINTS = [
    {"position_mm": [x + 0.06 * y + 0.05 * z, y - 0.08 * x + 0.04 * z, z]}
    for x, y, z in product((-38.0, 38.0), (-38.0, 38.0), (-80.0, 5.0))
]

EXAMPLE_DESIGN: dict[str, Any] = {
    "schema": "tailstack/design/1",
    "name": "eight beads, two seats",
    "views": [_view("AP"), _view("LAT")],
    "fiducials": {"points": _POINTS, "manufacturing": {"half_width_mm": 0.03, "distribution": "uniform"}},
    "interfaces": {
        "structure_connector": {
            "pivot_mm": [0.0, 0.0, -95.0],
            "tolerances": {"rx": _rotation(0.1), "ry": _rotation(0.1), "rz": _rotation(0.15)},
        },
        "connector_flange": {
            "pivot_mm": [0.0, 0.0, -145.0],
            "tolerances": {"rx": _rotation(0.1), "ry": _rotation(0.1), "rz": _rotation(0.1)},
        },
    },
    "targets": [{"name": "tip", "position_mm": [0.0, 0.0, 70.0]}],
    "requirements": [{"name": "tip-accuracy", "limit_mm": 1.5}],
    "optimise": {
        "box": {"min_mm": [-45.0, -45.0, -85.0], "max_mm": [45.0, 45.0, 15.0]},
        "rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5},
    },
}


def variants() -> tuple[dict[str, Any], ...]:
    """Designs that need, together with the example, every kernel a score can need."""
    mounts = EXAMPLE_DESIGN["interfaces"]
    seats = {name: {**mount, "tolerances": _as(mount["tolerances"], "bounded")} for name, mount in mounts.items()}
    connector = mounts["structure_connector"]
    plain: dict[str, Any] = {**EXAMPLE_DESIGN, "fiducials": {"points": _POINTS}}
    gaussian = {"structure_connector": {**connector, "tolerances": _as(connector["tolerances"], "normal")}}
    sharp = {"structure_connector": {**connector, "tolerances": {"rx": _rotation(0.1)}}}
    silent = [{**view, "fiducial_noise_px": 0.0, "target_noise_px": 0.0} for view in EXAMPLE_DESIGN["views"]]
    return (
        {**EXAMPLE_DESIGN, "interfaces": seats},
        {**plain, "interfaces": gaussian},
        {**plain, "interfaces": sharp, "views": silent},
    )


def _as(tolerances: dict[str, Any], law: str) -> dict[str, Any]:
    return {axis: {**tolerance, "distribution": law} for axis, tolerance in tolerances.items()}

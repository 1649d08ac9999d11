"""A small design for tests of the ``optimise`` section: six fiducials, two views, two seats, one target."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from tailstack.design import load_design
from tailstack.optimisation import optimise
from tailstack.results import Optimisation

BOX = {"min_mm": [-45.0, -45.0, -85.0], "max_mm": [45.0, 45.0, 15.0]}
POINTS_MM = (
    (-42.0, -40.0, -80.0),
    (42.0, -41.0, -76.0),
    (-40.0, 42.0, -78.0),
    (41.0, 40.0, 8.0),
    (-41.0, -39.0, 11.0),
    (39.0, -12.0, 4.0),
    (4.0, -8.0, -36.0),
    (-8.0, 16.0, -24.0),
)
PIVOT_MM = {"structure_connector": -95.0, "connector_flange": -145.0}  # z; x and y are 0
TIP_MM = 70.0  # z
COVERAGE = 2.0


def normal(unit: str, half_width: float) -> dict[str, Any]:
    return {f"half_width_{unit}": half_width, "distribution": "normal", "coverage_factor": COVERAGE}


def document(fiducials: int = 6, limit_mm: float = 1.0, **optimise_section: Any) -> dict[str, Any]:
    """rx, ry (and tx of the seat) of each interface vary by normal laws; ``optimise_section`` is its section."""
    view = {"preset": "siemens-cios-fusion", "source_isocentre_mm": 700.0, "isocentre_mm": [0.0, 0.0, 0.0],
            "fiducial_noise_px": 0.3, "target_noise_px": 0.3}  # fmt: skip
    return {
        "schema": "tailstack/design/1",
        "name": "six beads",
        "views": [view | {"name": name, "orientation": name} for name in ("AP", "LAT")],
        "fiducials": {
            "points": [{"label": f"F{k + 1}", "position_mm": list(POINTS_MM[k])} for k in range(fiducials)],
            "manufacturing": {"half_width_mm": 0.05, "distribution": "normal", "coverage_factor": COVERAGE},
        },
        "interfaces": {
            "structure_connector": {
                "label": "seat",
                "pivot_mm": [0.0, 0.0, PIVOT_MM["structure_connector"]],
                "tolerances": {"rx": normal("deg", 0.1), "ry": normal("deg", 0.1), "tx": normal("mm", 0.03)},
            },
            "connector_flange": {
                "label": "flange",
                "pivot_mm": [0.0, 0.0, PIVOT_MM["connector_flange"]],
                "tolerances": {"rx": normal("deg", 0.1), "ry": normal("deg", 0.1)},
            },
        },
        "targets": [{"name": "tip", "position_mm": [0.0, 0.0, TIP_MM]}],
        "requirements": [{"name": "accuracy", "error": "tcp", "limit_mm": limit_mm}],
        "optimise": {"starts": 2, **optimise_section},
    }  # fmt: skip


def moving(**changes: Any) -> dict[str, Any]:
    """The section with the box, its layout rules, and every rotation free."""
    section: dict[str, Any] = {
        "box": BOX, "min_spacing_mm": 12.0, "rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5},
    } | changes  # fmt: skip
    return {field: value for field, value in section.items() if value is not None}


@cache
def _optimised(text: str) -> Optimisation:
    return optimise(load_design(json.loads(text)))


def optimised(data: dict[str, Any]) -> Optimisation:
    """The optimisation of a document; asked for again, the same record."""
    return _optimised(json.dumps(data, sort_keys=True))


def free(interface: str, component: str, **fields: Any) -> dict[str, Any]:
    return {"interface": interface, "component": component, **fields}


def half_width(data: Any, interface: str, component: str) -> float:
    """deg or mm, as the document says."""
    mount = data["interfaces"][interface]
    if mount.get("locators"):
        return float(next(x["half_width_mm"] for x in mount["locators"] if x["name"] == component))
    return float(next(v for k, v in mount["tolerances"][component].items() if k.startswith("half_width_")))


def positions(data: Any) -> dict[str, list[float]]:
    return {point["label"]: point["position_mm"] for point in data["fiducials"]["points"]}

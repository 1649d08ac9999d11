"""The design in the examples of the OpenAPI document; it and its variants also warm the service up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

# Eight corners of a 90 mm box, each moved a little so that no two images fall together in either view
EXAMPLE_DESIGN: dict[str, Any] = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))


def variants() -> tuple[dict[str, Any], ...]:
    """Designs that need, together with the example, every kernel a score can need."""
    mounts = EXAMPLE_DESIGN["interfaces"]
    seats = {name: {**mount, "tolerances": _as(mount["tolerances"], "bounded")} for name, mount in mounts.items()}
    connector = mounts["structure_connector"]
    plain: dict[str, Any] = {**EXAMPLE_DESIGN, "fiducials": {"points": EXAMPLE_DESIGN["fiducials"]["points"]}}
    gaussian = {"structure_connector": {**connector, "tolerances": _as(connector["tolerances"], "normal")}}
    sharp = {"structure_connector": {**connector, "tolerances": {"rx": connector["tolerances"]["rx"]}}}
    silent = [{**view, "fiducial_noise_px": 0.0, "target_noise_px": 0.0} for view in EXAMPLE_DESIGN["views"]]
    (tip,) = EXAMPLE_DESIGN["targets"]
    entry = {"name": "entry", "position_mm": [0, 0, 40]}
    breach = {
        "name": "breach",
        "error": "corridor",
        "limit_mm": 3,
        "statistic": "probability",
        "limit_probability": 0.1,
    }
    screw = {"targets": [{**tip, "entry": "entry", "corridor_mm": 1}, entry], "requirements": [breach]}
    return (
        {**EXAMPLE_DESIGN, "interfaces": seats},
        {**plain, "interfaces": gaussian},
        {**plain, "interfaces": gaussian, **screw},
        {**plain, "interfaces": sharp, "views": silent},
    )


def _as(tolerances: dict[str, Any], law: str) -> dict[str, Any]:
    return {axis: {**tolerance, "distribution": law} for axis, tolerance in tolerances.items()}

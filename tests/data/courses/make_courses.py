"""Record what ``optimise`` reports: python tests/data/courses/make_courses.py NAME...

Seconds are those of the processor, for the starts divided by two: as on an idle machine with two cores, whatever else
runs on this one.
"""

from __future__ import annotations

import json
import random
import sys
import time
from pathlib import Path
from typing import Any

import yaml

from tailstack.design import load_design
from tailstack.optimisation import optimise
from tailstack_service.operations.optimisation import expect

KINDS = ("per_unit", "settles", "compares", "targets", "fiducials")
HERE = Path(__file__).parent
EXAMPLES = HERE.parents[2] / "examples"


def example(name: str, **section: Any) -> dict[str, Any]:
    """An example with fields of its optimise section changed."""
    design: dict[str, Any] = yaml.safe_load((EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8"))
    design["optimise"].update(section)
    return design


def per_unit() -> dict[str, Any]:
    design = example("demo")
    design["requirements"][0].update(risk="per_unit", min_yield=0.9, limit_mm=1.1)
    return design


def region() -> dict[str, Any]:
    """27 targets."""
    design = example("demo")
    box = {"centre_mm": [0, 0, 65], "size_mm": [20, 20, 20], "points_per_axis": 3}
    design["targets"] = [{"name": "tip", "region": {"box": box}}]
    design["requirements"][0]["limit_mm"] = 1.2
    return design


def many() -> dict[str, Any]:
    """28 fiducials."""
    design, draw = example("demo", min_spacing_mm=6, min_projected_spacing_px=10, starts=6), random.Random(1)
    design["fiducials"]["points"] += [
        {"label": f"G{n}", "position_mm": [draw.uniform(-40, 40), draw.uniform(-40, 40), draw.uniform(-80, 10)]}
        for n in range(16)
    ]
    return design


COURSES = {
    "demo8": lambda: example("demo"),
    "demo64": lambda: example("demo", starts=64),
    "demo160": lambda: example("demo", starts=160),
    "plate": lambda: example("flat_plate"),
    "locators": lambda: example("locators_321"),
    "tube": lambda: example("tube_carrier"),
    "counts": lambda: example("demo", count={"min": 8, "max": 14, "cost_per_fiducial": 15}),
    "front": lambda: example("demo", objective="pareto"),
    "per_unit": per_unit,
    "region": region,
    "many": many,
}


def record(name: str) -> None:
    """One course into its file."""
    design = load_design(COURSES[name]())
    events: list[list[Any]] = []
    now, last = 0.0, time.process_time()

    def advance(stage: str) -> float:
        nonlocal now, last
        used = time.process_time()
        now, last = now + (used - last) / (2 if stage == "start" else 1), used
        return round(now, 3)

    def note(stage: str, done: int, total: int, _least: float | None) -> None:
        events.append([advance(stage), stage, done, total])

    optimise(design, progress=note)
    assert design.document.optimise is not None
    expected = expect(design)
    kind = {field: getattr(expected, field) for field in KINDS}
    course = {"name": name, "goal": design.document.optimise.goal, **kind, "end": advance(""), "events": events}
    (HERE / f"{name}.json").write_text(json.dumps(course) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:] or COURSES:
        record(name)

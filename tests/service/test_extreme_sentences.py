"""What is said where scales are extreme: whole words, no nothing for what is something, nothing said twice."""

from __future__ import annotations

import ast
import json
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import tailstack
from optimise_documents import BOX, document, moving
from tailstack import load_design, score
from tailstack.errors import TailstackError
from tailstack.optimisation import optimise
from tailstack_service.cli.main import main

Data = dict[str, Any]
ROTATIONS = {"min_deg": 0.01, "max_deg": 0.5}


def still(limit_mm: float = 1.0) -> Data:
    """Nothing varies: what is simulated is the rounding of numbers."""
    data = document(8, limit_mm)
    del data["optimise"]
    for view in data["views"]:
        view |= {"fiducial_noise_px": 0.0, "target_noise_px": 0.0}
    data["fiducials"].pop("manufacturing")
    for seat in data["interfaces"].values():
        del seat["tolerances"]
    return data


def scaled(size: float, limit_mm: float) -> Data:
    """Every noise and tolerance a multiple of what is usual."""
    data = document(8, limit_mm)
    del data["optimise"]
    for view in data["views"]:
        view |= {"fiducial_noise_px": 0.3 * size, "target_noise_px": 0.3 * size}
    data["fiducials"]["manufacturing"]["half_width_mm"] *= size
    for seat in data["interfaces"].values():
        for tolerance in seat["tolerances"].values():
            for field in ("half_width_deg", "half_width_mm"):
                if field in tolerance:
                    tolerance[field] *= size
    return data


SCENES: dict[str, Data] = {
    "nothing varies": still(),
    "far below its limit": scaled(0.08, 20.0),
    "hardly anything": scaled(1e-5, 20.0),
    "a thousandth of a nanometre": scaled(1e-9, 1.0),
    "far above its limit": scaled(3.0, 0.01),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_length_that_is_something_is_never_told_as_nothing(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "design.json"
    path.write_text(json.dumps(SCENES[name]))
    main(["verify", str(path), "--trials", "4096"])
    text = " ".join(capsys.readouterr().out.split())
    told = text[: text.index("require- target")] + text[text.index("how sure:") :]  # sentences, without tables
    assert not re.findall(r"(?<![\d.])0(?:\.0+)? mm", told), told
    assert "0.0 % " not in told
    assert "100.0 % below" not in told
    if name in ("nothing varies", "a thousandth of a nanometre"):  # neither of the two P95 is a number to compare
        assert "this P95" not in told
        assert "first-order-gap" not in told
    findings = Counter(told.split(" warning: ")[1:])
    assert max(findings.values(), default=0) <= 1, findings
    assert told.count("[noise-too-small]") <= 1  # four noises that are alike are one finding


@pytest.mark.parametrize("bias_mm", [0.0, 0.3, 6.0, -6.0])
def test_a_known_bias_that_leads_is_named_before_any_tolerance(
    bias_mm: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = document(8, 0.1)
    del data["optimise"]
    data["interfaces"]["structure_connector"]["bias"] = {"tx_mm": bias_mm}
    path = tmp_path / "design.json"
    path.write_text(json.dumps(data))
    main(["score", str(path)])
    said = " ".join(capsys.readouterr().out.split())
    main(["gate", "--mode", "analytic", str(path)])
    judged = " ".join(capsys.readouterr().out.split())
    (target,) = score(load_design(data)).targets
    leads = math.hypot(*target.bias_mm) > math.hypot(*target.std_mm)
    assert leads == (abs(bias_mm) > 1)
    assert ["is a known bias of" in said, "share is a known bias of" in judged] == [leads, leads]
    if leads:
        assert "correct for it before any tolerance" in said
        assert "of the variance" not in judged


def class_names() -> list[str]:
    """Those of more than one word, as they stand in the sources, in small letters."""
    names = {
        node.name.strip("_")
        for path in Path(tailstack.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    return sorted(name.lower() for name in names if len(re.findall("[A-Z]", name)) > 1)


CYLINDER = {"base_mm": [0, 0, -80], "axis": [0, 0, 1], "height_mm": 80.0, "radius_mm": 40.0}
BALL = {"centre_mm": [0, 0, -40], "radius_mm": 20.0}
ZONES = [{"name": "table", "box": {"min_mm": [-99, -99, -99], "max_mm": [99, 99, 99]}, "clearance_mm": 2.0}]
REFUSED: dict[str, Data] = {
    "crowded box": document(8, 1.0, **moving(min_spacing_mm=120.0)),
    "crowded cylinder": document(8, 1.0, region={"cylinder": CYLINDER}, min_spacing_mm=99.0),
    "crowded ball": document(8, 1.0, region={"ball": BALL}, min_spacing_mm=30.0),
    "flat box": document(8, 1.0, box={"min_mm": [-40, -40, 0], "max_mm": [40, 40, 0]}),
    "flat but one": document(8, 1.0, box={"min_mm": [-40, -40, 0], "max_mm": [40, 40, 0]}, fixed=["F1"]),
    "behind": document(8, 1.0, box={"min_mm": [-40, -900, -40], "max_mm": [40, 40, 40]}),
    "outside": document(8, 1.0, box={"min_mm": [-40, -40, 400], "max_mm": [40, 40, 450]}),
    "kept out": document(8, 1.0, box=BOX, keep_out=ZONES),
    "dear": document(6, 1.0, objective="quantile", cost_limit=1.0, rotation_bounds=ROTATIONS),
    "tight": document(6, 0.001, rotation_bounds=ROTATIONS),
    "steep": document(
        6, 1.0, rotation_bounds=ROTATIONS | {"cost": {"curve": "exponential", "scale_deg": 0.0002}}
    ),
    "one factor for none": document(6, 1.0, objective="scaling", rotation_bounds=ROTATIONS, tolerances=[
        {"interface": "structure_connector", "component": "rx", "min_deg": 0.4, "max_deg": 0.5},
        {"interface": "structure_connector", "component": "ry", "min_deg": 0.01, "max_deg": 0.02}]),
}  # fmt: skip
NOTHING = re.compile(r"(?<![\d.])(?:but|at most|below|by|than) 0(?:\.0+)?(?![\d.])")


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_of_whole_words(name: str) -> None:
    """Every refusal that the optimiser makes without solving, and two that it makes by solving."""
    with pytest.raises(TailstackError) as error:
        optimise(load_design(REFUSED[name]), starts=1)
    for problem in error.value.problems:
        told = f"{problem.detail} {problem.hint}"
        words = re.findall(r"[a-z]+", told)
        assert not {*words} & {*class_names()}, told
        assert not NOTHING.search(told), told
        assert problem.hint

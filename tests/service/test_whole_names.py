"""What a user named is printed whole: long names that differ in one letter are told from one another everywhere.

Sentences hold at the ends of what numbers can be.
"""

from __future__ import annotations

import ast
import copy
import json
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from service_scenes import write_json

import tailstack
from optimise_documents import BOX, document, moving
from plain_data import DEMO, places_of, problems_of, value_at
from tailstack import load_design, score
from tailstack.design import Design
from tailstack.optimisation import optimise
from tailstack.sweeping import read_axes, sweep
from tailstack.verification import verify
from tailstack_service.cli.jobs import jobs_text
from tailstack_service.documents import to_json
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.validation import validate, validation_text
from tailstack_service.rendering.text import WIDTH
from tailstack_service.report.assembling import compute_report, options_of


def similar(what: str, letter: str, length: int = 80) -> str:
    """A name of so many letters, some words and then one long word, with its one letter of difference in the middle."""
    begin = f"{what} of the left arm, "
    rest = length - len(begin) - 1
    return begin + "x" * (rest // 2) + letter + "y" * (rest - rest // 2)


VIEWS, TARGETS, REQUIREMENTS = ([similar(what, letter) for letter in "ab"] for what in ("view", "target", "limit"))
LABELS = [similar("seat", letter, 200) for letter in "ab"]
NAME = similar("design", "a")


@pytest.fixture(scope="module")
def named() -> dict[str, Any]:
    """The demo, called so."""
    design = copy.deepcopy(DEMO)
    del design["optimise"]
    design["name"] = NAME
    for view, name in zip(design["views"], VIEWS, strict=True):
        view["name"] = name
    for interface, label in zip(design["interfaces"].values(), LABELS, strict=True):
        interface["label"] = label
    target, requirement = design["targets"][0], design["requirements"][0]
    design["targets"] = [{**target, "name": name} for name in TARGETS]
    design["targets"][1]["position_mm"] = [1.0, 0.0, 61.0]
    design["requirements"] = [
        {**requirement, "name": name, "targets": [target]} for name, target in zip(REQUIREMENTS, TARGETS, strict=True)
    ]
    return design


def squeezed(text: str) -> str:
    return re.sub(r"\s", "", text)


def columns_of(text: str) -> str:
    """Every column of every table of a text, read downwards, without blanks."""
    lines, found = text.split("\n"), []
    for place, line in enumerate(lines):
        if not re.fullmatch(r"\s*─+(  ─+)*", line):
            continue
        body = lines[place + 1 :]
        body = body[: next((k for k, each in enumerate(body) if not each.strip()), len(body))]
        for span in re.finditer(r"─+", line):
            found.append(squeezed("".join(each[span.start() : span.end()] for each in body)))
    return "\n".join(found)


def missing(names: list[str], text: str) -> list[str]:
    """Names that a text does not hold whole."""
    everything = squeezed(text) + "\n" + columns_of(text)
    return [name for name in names if squeezed(name) not in everything]


def text_of_sweep(design: Design) -> str:
    path = "/interfaces/structure_connector/tolerances/rz/half_width_deg"
    return OPERATIONS["sweep"].write(sweep(design, read_axes(design, [{"pointer": path, "values": [0.05, 0.1]}])))


@pytest.mark.parametrize(
    ("write", "names"),
    [
        (lambda design: OPERATIONS["score"].write(score(design)), [*VIEWS, *TARGETS, *REQUIREMENTS, *LABELS]),
        (lambda design: OPERATIONS["verification"].write(verify(design, trials=8192)), [*TARGETS, *REQUIREMENTS]),
        (text_of_sweep, TARGETS[:1]),  # a row has the worst
        (lambda design: validation_text("design.yaml", validate(design)), [*VIEWS, *TARGETS, *REQUIREMENTS]),
    ],
    ids=["score", "verify", "sweep", "validate"],
)
def test_names_are_whole_within_80_columns(
    named: dict[str, Any], write: Callable[[Design], str], names: list[str]
) -> None:
    text = write(load_design(named))
    assert missing([NAME, *names], text) == []
    assert max(map(len, text.split("\n"))) <= WIDTH


def test_jobs_show_ids_in_one_piece_and_names_whole() -> None:
    ids = ["job_3fa85f6457174562b3fc2c963f66afa6", "job_2c963f66afa63fa85f6457174562b3fc"]
    names = [similar("design", letter, 255) for letter in "ab"]
    jobs = [
        {
            "id": one, "kind": "verification", "state": "succeeded", "design_name": name,
            "created_at": "2026-11-22T10:00:00Z", "progress": {"fraction": 1.0},
        }
        for one, name in zip(ids, names, strict=True)
    ]  # fmt: skip
    text = jobs_text(jobs)
    assert missing(names, text) == []
    assert all(one in text.split() for one in ids)


def test_names_in_wide_letters_are_whole_too(named: dict[str, Any]) -> None:
    """A wide letter takes two columns; the page counts them."""
    names = ["固定具" * 26 + letter for letter in ("甲", "乙")]
    data = copy.deepcopy(named)
    for target, requirement, name in zip(data["targets"], data["requirements"], names, strict=True):
        target["name"], requirement["targets"] = name, [name]
    text = OPERATIONS["score"].write(score(load_design(data)))
    wide = [sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in line) for line in text.split("\n")]
    assert max(wide) <= WIDTH
    assert all(name[-1] in text for name in names)


# --- names of interfaces --------------------------------------------------------------------------


SEAT, FLANGE = "structure_connector", "connector_flange"
LABEL = {SEAT: "carrier on connector, two dowel pins", FLANGE: "connector on flange, spigot and four bolts"}


@pytest.fixture(scope="module")
def demo() -> dict[str, Any]:
    """A report of the demo, whose interfaces have labels, as plain data."""
    found: dict[str, Any] = json.loads(to_json(compute_report(load_design(DEMO), options_of({"parts": ["score"]}))))
    return found


def test_budget_and_allowances_name_interfaces_as_the_design_does(demo: dict[str, Any]) -> None:
    lines = demo["score"]["targets"][0]["contributors"]
    assert {line["name"]: line["label"] for line in lines if line["name"] in LABEL} == LABEL
    assert {
        entry["contributor"]: entry["label"] for entry in demo["allowances"] if entry["contributor"] in LABEL
    } == LABEL
    assert "fiducial noise, AP" in {line["label"] for line in lines if line["name"] == "fiducial_noise:AP"}
    texts = [found for place in places_of(demo) if isinstance(found := value_at(demo, place), str)]
    assert not [text for text in texts if re.search(r"\binterface_?[12]\b", text)]


def test_an_interface_without_a_label_is_called_by_its_name() -> None:
    data = copy.deepcopy(DEMO)
    for interface in data["interfaces"].values():
        del interface["label"]
    lines = score(load_design(data)).targets[0].contributors
    assert {line.label for line in lines if line.name == SEAT} == {SEAT}


# --- sentences ------------------------------------------------------------------------------------


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
def test_a_length_that_is_something_is_never_told_as_nothing(name: str, tmp_path: Path, call: Any) -> None:
    path = write_json(tmp_path / "design.json", SCENES[name])
    text = " ".join(call("verify", path, "--trials", "4096")[1].split())
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
def test_a_known_bias_that_leads_is_named_before_any_tolerance(bias_mm: float, tmp_path: Path, call: Any) -> None:
    data = document(8, 0.1)
    del data["optimise"]
    data["interfaces"]["structure_connector"]["bias"] = {"tx_mm": bias_mm}
    path = write_json(tmp_path / "design.json", data)
    said = " ".join(call("score", path)[1].split())
    judged = " ".join(call("gate", "--mode", "analytic", path)[1].split())
    (target,) = score(load_design(data)).targets
    leads = math.hypot(*target.bias_mm) > math.hypot(*target.std_mm)
    assert leads == (abs(bias_mm) > 1)
    assert ["is a known bias of" in said, "share is a known bias of" in judged] == [leads, leads]
    if leads:
        assert "correct for it before any tolerance" in said
        assert "of the variance" not in judged


@cache
def class_names() -> frozenset[str]:
    """Those of more than one word, as they stand in the sources, in small letters."""
    names = {
        node.name.strip("_")
        for path in Path(tailstack.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    return frozenset(name.lower() for name in names if len(re.findall("[A-Z]", name)) > 1)


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
    for problem in problems_of(optimise, load_design(REFUSED[name]), starts=1):
        told = f"{problem.detail} {problem.hint}"
        words = re.findall(r"[a-z]+", told)
        assert not class_names().intersection(words), told
        assert not NOTHING.search(told), told
        assert problem.hint

"""A physical effect is one file and one line: whoever adds them meets it wherever the product speaks of errors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import served
import yaml
from browsing import browser, used
from service_scenes import ROOT, copy_with_toy

from waiting import LIMIT_SECONDS

TOY = '''"""Bending of the structure under its own weight: beads sag with the square of their distance from the seat."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from ..arrays import frozen
from ..fields import BOUNDED_WORDS, COVERAGE_WORDS, AnyLaw, CoverageFactor, HalfWidth, Record, refuse_coverage
from ..system import Act, Drawn, Effect, Law, Place, Scene, Sources
from ..tolerances import coverage_of
from .kind import Doubt, EffectKind, Excess, PlausibilityTest


class Bending(Record):
    """How far a bead at 100 mm from the z axis may sag along z, drawn at every shot."""

    half_width_mm: HalfWidth = Field(description="Half-width of the sag, mm.", examples=[0.1])
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _coverage = model_validator(mode="after")(refuse_coverage)


class OfDesign(Record):
    bending: Bending | None = Field(default=None, description="Bending of the structure. Absent: it is rigid.")


@dataclass(frozen=True, slots=True, eq=False)
class BendingEffect(Effect):
    def act(self, scene: Scene) -> tuple[Act, ...]:
        away = (scene.fiducials_mm[:, :2] / 100) ** 2
        sag = np.zeros(scene.fiducials_mm.shape, scene.fiducials_mm.dtype)
        sag[:, 2] = sag[:, 2] - away[:, 0] - away[:, 1]
        return (Act(Place.BEADS, None, sag.reshape(-1, 1)),)

    @property
    def places(self) -> Any:
        return ((Place.BEADS, None),)


def _compile(document: Any, views: Any) -> Iterator[Effect]:
    if (own := document.bending) is not None:
        sources = Sources(("sag",), (Law(own.distribution),), frozen([own.half_width_mm]),
                          frozen([coverage_of(own.distribution, own.coverage_factor)]), ("mm",), frozen(np.eye(1)))
        yield BendingEffect("bending", "bending of the structure", "/bending", Drawn.SHOT, sources, frozen([0.0]))


def _doubt(subject: Any) -> Iterator[Doubt]:
    own = subject.document.bending
    if own is not None and own.half_width_mm > 5:
        yield Doubt("/bending/half_width_mm", "a structure that sags by more than 5 mm is none", own.half_width_mm, 5.0)


def _limits(system: Any) -> Iterator[Excess]:
    if any(effect.name == "bending" and effect.sources.half_width[0] > 5 for effect in system.effects):
        yield Excess("a sag of more than 5 mm")


KIND = EffectKind(
    sections={"design": OfDesign},
    compile=_compile,
    not_modelled=lambda system: "" if any(e.name == "bending" for e in system.effects) else "bending of the structure",
    doubts=(PlausibilityTest("bending-too-large", "A structure that sags like a rope", "5 mm: a judgement.", _doubt),),
    limits=_limits,
)
'''
__all__ = ["browser"]

SAG = {"half_width_mm": 0.6, "distribution": "uniform"}
TIP = "bending of the structure"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The solver's sources with one file more, and one line more in the table."""
    line = "    detector_tilt.KIND,\n"
    return copy_with_toy(
        ROOT / "solver" / "tailstack", tmp_path_factory.mktemp("solver"), "effects/bending.py", TOY,
        "effects/__init__.py", (line, f"{line}    bending.KIND,\n"), ("from . import", "from . import bending,"),
    )  # fmt: skip


@pytest.fixture(scope="module")
def variables(source: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    path = os.pathsep.join([str(source), str(ROOT / "service")])
    return served.environment(tmp_path_factory.mktemp("jobs"), PYTHONPATH=path)


def designed(folder: Path, **sag: Any) -> Path:
    """The demo with a structure that bends."""
    data = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text(encoding="utf-8"))
    file = folder / "bent.yaml"
    file.write_text(yaml.safe_dump({**data, "bending": {**SAG, **sag}}), encoding="utf-8")
    return file


def run(variables: dict[str, str], folder: Path, *arguments: str, codes: tuple[int, ...] = (0, 1)) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        env=variables,
        capture_output=True,
        text=True,
        timeout=3 * LIMIT_SECONDS,
        check=False,
        cwd=folder,
    )
    assert done.returncode in codes, done.stderr
    return done.stdout


def tailstack(variables: dict[str, str], folder: Path, *arguments: str, codes: tuple[int, ...] = (0, 1)) -> str:
    return run(variables, folder, "-m", "tailstack_service.cli.main", *arguments, codes=codes)


def test_it_is_declared_checked_and_doubted(variables: dict[str, str], tmp_path: Path) -> None:
    schema = json.loads(tailstack(variables, tmp_path, "schema", "design"))
    assert "bending" in schema["properties"]
    assert "No such field" not in tailstack(variables, tmp_path, "validate", str(designed(tmp_path)))
    doubtful = tailstack(variables, tmp_path, "validate", str(designed(tmp_path, half_width_mm=9.0)))
    assert "a structure that sags by more than 5 mm is none" in " ".join(doubtful.split())
    gate = ("gate", str(designed(tmp_path, half_width_mm=9.0)), "--mode", "analytic", "--format", "json")
    assert "bending-too-large" in tailstack(variables, tmp_path, *gate, codes=(0, 1, 4))
    refused = tailstack(variables, tmp_path, "validate", str(designed(tmp_path, coverage_factor=2)), codes=(2,))
    assert "not valid, 1 problem" in refused


def test_it_counts_in_the_estimate_and_the_simulation_alike(variables: dict[str, str], tmp_path: Path) -> None:
    """sampled: an interval of 99.9 % about P95 of the full chain, widened by the 1 % that the estimate promises."""
    file = designed(tmp_path)
    score = json.loads(tailstack(variables, tmp_path, "score", str(file), "--json"))
    plain = json.loads(tailstack(variables, tmp_path, "score", str(ROOT / "examples" / "demo.yaml"), "--json"))
    assert TIP not in score["provenance"]["not_included"]
    assert TIP in plain["provenance"]["not_included"]
    (target,), (without,) = score["targets"], plain["targets"]
    (line,) = [line for line in target["contributors"] if line["name"] == "bending"]
    assert (line["component"], line["unit"], line["half_width"], line["label"]) == ("sag", "mm", 0.6, TIP)
    assert line["p95_without_mm"] == pytest.approx(without["p95_mm"], rel=1e-3)
    assert target["p95_mm"] > 1.02 * without["p95_mm"]
    checked = ("verify", str(file), "--trials", "60000", "--seed", "1", "--json")
    simulated = json.loads(tailstack(variables, tmp_path, *checked, codes=(0, 1, 4)))["targets"][0]
    low, high = simulated["p95_interval_mm"]
    spread = (high - low) * (3.29 / 1.96 - 1) / 2 + 0.01 * target["p95_mm"]
    assert low - spread < target["p95_mm"] < high + spread
    large = json.loads(
        tailstack(variables, tmp_path, "score", str(designed(tmp_path, half_width_mm=9.0)), "--json", codes=(0, 1, 4))
    )
    assert "a sag of more than 5 mm" in large["validity"]["statement"]


def test_tables_sweeps_and_derivatives_know_its_numbers(variables: dict[str, str], tmp_path: Path) -> None:
    file = designed(tmp_path)
    found = json.loads(
        tailstack(variables, tmp_path, "sweep", str(file), "--set", "bending.half_width_mm=0.6,1.2", "--json")
    )
    swept = [point["targets"][0]["p95_mm"] for point in found["points"]]
    assert swept[1] > 1.05 * swept[0]
    told = run(
        variables,
        tmp_path,
        "-c",
        f"""
import json, sys
from tailstack import DesignFunction, load_design, score_batch
design = load_design(open({str(file)!r}, encoding="utf-8").read())
table = score_batch(design, {{"bending.half_width_mm": [0.6, 1.2]}}, columns=("p95_mm",))
(column,) = table.columns.values()
function = DesignFunction(design, ["bending.half_width_mm"])
step = 1e-3
values = [function.score([0.6 + k * step], losses=False).targets[0].p95_mm for k in (-1, 1)]
slope = float(function.p95_gradient([0.6])[1][0])
print(json.dumps([list(column), slope, (values[1] - values[0]) / (2 * step)]))
""",
    )
    batch, slope, difference = json.loads(told)
    assert batch == pytest.approx(swept, rel=1e-12)
    assert slope == pytest.approx(difference, rel=1e-4)


def test_what_judges_optimises_and_reports_names_it(variables: dict[str, str], tmp_path: Path) -> None:
    file = designed(tmp_path)
    gate = json.loads(tailstack(variables, tmp_path, "gate", str(file), "--mode", "analytic", "--format", "json"))
    assert gate["verdict"] == "fail"
    tailstack(variables, tmp_path, "report", str(file), "--parts", "score", "--format", "html", "-o", "out")
    (page,) = (tmp_path / "out").glob("*.html")
    assert TIP in page.read_text(encoding="utf-8")
    coupling = json.loads(
        tailstack(variables, tmp_path, "study", "coupling", str(file), "--trials", "8192", "--json", codes=(0, 1, 2, 4))
    )
    assert "bending" in coupling["noise"]
    optimised = json.loads(
        tailstack(variables, tmp_path, "optimise", str(file), "--starts", "1", "--json", codes=(0, 1, 4))
    )
    assert optimised["design"]["bending"] == SAG
    (tmp_path / "best.json").write_text(json.dumps(optimised["design"]), encoding="utf-8")
    best = json.loads(tailstack(variables, tmp_path, "score", "best.json", "--json", codes=(0, 1, 4)))["targets"][0]
    assert best["p95_mm"] <= 1.0005 * best["limit_mm"]
    bench = ROOT / "examples" / "measurements" / "bench_as_designed.csv"
    compared = tailstack(
        variables, tmp_path, "study", "compare", str(file), "--measurements", str(bench), "--details", codes=(0, 1, 4)
    )
    assert TIP in " ".join(compared.split())


def test_the_page_shows_it_and_changes_it(variables: dict[str, str], tmp_path: Path, browser: None) -> None:
    path = variables["PYTHONPATH"]
    with served.served(tmp_path, PYTHONPATH=path) as service:
        told = {"section": "bending", "field": "half_width_mm", "value": "1.2"}
        found = used(service.url, "section", designed(tmp_path).read_text(encoding="utf-8"), script="shown.mjs", **told)
    assert found["before"]["value"] == "0.6"
    assert found["sliders"] == 1
    for state in ("before", "after"):
        assert TIP in found[state]["budget"]
    assert found["after"]["p95"] > 1.05 * found["before"]["p95"]

"""A physical effect is one file and one line: whoever adds them meets it wherever the product speaks of errors."""

from __future__ import annotations

import filecmp
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import served
import yaml
from browsing import used
from copied_sources import copy_sources, meet_matrix, path_of, tailstack
from service_scenes import ROOT

from family import run_process, run_python
from plain_data import DEMO
from waiting import LIMIT_SECONDS

SAG = {"half_width_mm": 0.6, "distribution": "uniform"}
TIP = "bending of the structure"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the solver's sources with what ``./run new effect`` writes: one file, and one line in the table."""
    root = tmp_path_factory.mktemp("tailstack")
    copied = copy_sources(root)
    (root / "templates").mkdir()
    for name in ("run", "templates/effect.py"):
        shutil.copyfile(ROOT / name, root / name)
    made = write_effect(root, "bending")
    assert made.returncode == 0, made.stderr
    last = made.stdout.splitlines()[-1].split()[0]
    assert last == "docs/adding/effect.md"
    assert (ROOT / last).is_file()
    again = write_effect(root, "bending")
    assert (again.returncode, "is there already" in again.stderr) == (1, True)
    assert "run: new effect NAME" in write_effect(root, "Bending!").stderr
    return copied


def write_effect(root: Path, name: str) -> subprocess.CompletedProcess[str]:
    return run_python(str(root / "run"), "new", "effect", name)


def test_one_file_and_one_line_are_written_that_read_like_ours(source: Path) -> None:
    every = [path.relative_to(source).as_posix() for path in source.rglob("*.py")]
    _, changed, added = filecmp.cmpfiles(source, ROOT / "solver", every, shallow=False)
    assert (changed, added) == (["tailstack/effects/__init__.py"], ["tailstack/effects/bending.py"])
    table = (source / "tailstack" / "effects" / "__init__.py").read_text(encoding="utf-8")
    ours = (ROOT / "solver" / "tailstack" / "effects" / "__init__.py").read_text(encoding="utf-8")
    assert [line for line in table.splitlines() if line not in ours.splitlines()][1:] == ["    bending.KIND,"]
    for words in (("check",), ("format", "--check")):
        ruff = [sys.executable, "-m", "ruff", *words, "--config", str(ROOT / "pyproject.toml"), "--no-cache"]
        done = run_process(*ruff, *changed, *added, cwd=source)
        assert done.returncode == 0, done.stdout


def test_random_designs_scenes_and_tables_draw_it(variables: dict[str, str], tmp_path: Path) -> None:
    """What tests, the study of validity and fuzzing draw from, without a word of it there; sampled: in 35 of a hundred
    designs, so that none of thirty has it in 1 of 4e5."""
    program = """
import json, numpy as np
from random_designs import random_document, with_effects
from scenes import every_effect
from validity_trials import DECLARED
from properties.test_design_fuzz import PLACES
drawn = []
for seed in range(30):
    rng = np.random.default_rng([39, seed])
    drawn.append(with_effects(random_document(rng, 2, 8, False), rng).get("bending"))
names = [effect.name for effect in every_effect(np.random.default_rng(3)).effects]
places = [place for _, place in PLACES if "bending" in place]
print(json.dumps([[each for each in drawn if each], "bending" in names, "bending" in DECLARED, len(places)]))
"""
    path = os.pathsep.join([variables["PYTHONPATH"], str(ROOT / "tests")])
    told = {**variables, "PYTHONPATH": path}
    done = run_python("-c", program, env=told, timeout=3 * LIMIT_SECONDS, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    drawn, in_scene, in_study, places = json.loads(done.stdout)
    assert drawn
    assert all(0.05 <= each["half_width_mm"] <= 1 and each["distribution"] != "bounded" for each in drawn)
    assert in_scene
    assert in_study
    assert places >= 3


@pytest.fixture(scope="module")
def variables(source: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return served.environment(tmp_path_factory.mktemp("jobs"), PYTHONPATH=path_of(source))


def designed(folder: Path, **sag: Any) -> Path:
    """The demo with a structure that bends."""
    file = folder / "bent.yaml"
    file.write_text(yaml.safe_dump({**DEMO, "bending": {**SAG, **sag}}), encoding="utf-8")
    return file


def test_it_is_declared_checked_and_doubted(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    schema = json.loads(tailstack(copy, tmp_path, "schema", "design"))
    assert "bending" in schema["properties"]
    assert "No such field" not in tailstack(copy, tmp_path, "validate", str(designed(tmp_path)))
    doubtful = tailstack(copy, tmp_path, "validate", str(designed(tmp_path, half_width_mm=9.0)))
    assert "a structure that sags like a rope" in " ".join(doubtful.split())
    gate = ("gate", str(designed(tmp_path, half_width_mm=9.0)), "--mode", "analytic", "--format", "json")
    assert "a structure that sags like a rope" in tailstack(copy, tmp_path, *gate, codes=(0, 1, 4))
    refused = tailstack(copy, tmp_path, "validate", str(designed(tmp_path, coverage_factor=2)), codes=(2,))
    assert "not valid, 1 problem" in refused


def test_it_counts_and_what_is_large_is_doubted(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    file = designed(tmp_path)
    score = json.loads(tailstack(copy, tmp_path, "score", str(file), "--json"))
    plain = json.loads(tailstack(copy, tmp_path, "score", str(ROOT / "examples" / "demo.yaml"), "--json"))
    assert TIP not in score["provenance"]["not_included"]
    assert TIP in plain["provenance"]["not_included"]
    (target,), (without,) = score["targets"], plain["targets"]
    (line,) = [line for line in target["contributors"] if line["name"] == "bending"]
    assert (line["component"], line["unit"], line["half_width"], line["label"]) == ("sag", "mm", 0.6, TIP)
    assert line["p95_without_mm"] == pytest.approx(without["p95_mm"], rel=1e-3)
    found = tailstack(copy, tmp_path, "sweep", str(file), "--set", "bending.half_width_mm=0,0.6,9", "--json")
    nothing, same, large = (point["targets"][0]["p95_mm"] for point in json.loads(found)["points"])
    assert (nothing, same) == pytest.approx((without["p95_mm"], target["p95_mm"]), rel=1e-12)
    assert large > 2 * same > 2.04 * nothing
    file = designed(tmp_path, half_width_mm=9.0)
    doubted = json.loads(tailstack(copy, tmp_path, "score", str(file), "--json", codes=(0, 1, 4)))
    assert "a sag of more than 5 mm" in doubted["validity"]["statement"]


@pytest.mark.long
def test_whoever_has_to_know_of_an_effect_knows_of_it(variables: dict[str, str], tmp_path: Path) -> None:
    """As the matrix asks it of every effect that is shipped: brute force, differences, the chain, another model."""
    meet_matrix(variables, tmp_path, "test_effect_matrix", "bending")


@pytest.mark.long
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

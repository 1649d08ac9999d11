"""Charts: the same bytes wherever they are drawn, with looks that a page lets count, and names whole."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from service_scenes import EXAMPLES, ROOT
from test_report_figures import check_picture, distribution, texts

from family import run_python
from tailstack import load_design, score
from tailstack_service.report.charts import (
    draw_budgets,
    draw_distribution,
    draw_shares,
    draw_tolerances,
)
from tailstack_service.report.half_widths import tolerance_curves
from tailstack_service.report.records import ErrorDistribution

LONG = " ".join(f"adapter{k} of the carrier on its third spigot" for k in range(5))  # two hundred letters
SHOWN = ErrorDistribution("tip $a$", (0.0, 0.5, 1.0, 1.5), (0.5, 0.3, 0.2), (0.48, 0.31, 0.21), 5000)
DRAW = f"""
import sys
from tailstack_service.report.charts import draw_distribution
from tailstack_service.report.records import ErrorDistribution
sys.stdout.write(draw_distribution({SHOWN!r}, 0.87, (0.85, 0.89), 1.0, "d"))
"""


def run(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(str(ROOT / room) for room in ("solver", "service", "tests", "tests/service"))
    kept = {name: value for name, value in os.environ.items() if name not in ("MPLCONFIGDIR", "XDG_CACHE_HOME")}
    return run_python(
        "-c", code, env={**kept, "PYTHONPATH": path, "PYTHONUTF8": "1", **environment}, cwd=folder, check=True
    )


@pytest.mark.long
def test_neither_a_home_that_cannot_be_written_nor_settings_beside_the_design_change_a_chart(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("font.size: 31\nlines.linewidth: 9\naxes.facecolor: red\n")
    drawn = run(DRAW, tmp_path, HOME="/proc/nobody", XDG_CONFIG_HOME="/proc/nobody")
    assert drawn.stderr == ""
    assert drawn.stdout == draw_distribution(SHOWN, 0.87, (0.85, 0.89), 1.0, "d")
    assert [path.name for path in tmp_path.iterdir()] == ["matplotlibrc"]


@pytest.mark.long
def test_a_command_that_draws_nothing_does_not_import_matplotlib(tmp_path: Path) -> None:
    code = f"""
import sys
from tailstack_service.cli.main import main
assert main(["score", {str(EXAMPLES / "demo.yaml")!r}]) == 1
import tailstack_service.report.chapters.gate, tailstack_service.report.chapters.report
assert not {{"matplotlib", "weasyprint"}} & set(sys.modules)
"""
    run(code, tmp_path)


def test_settings_of_matplotlib_are_as_they_were() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw_distribution(distribution("tip", 0.5), 0.87, None, None, "d")
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("target", ["tip", "Spitze der Nadel, 针尖", "a $x_1$ \\frac b"])
def test_looks_stand_in_attributes(target: str) -> None:
    """The content security policy lets neither style attributes nor references to other files count."""
    svg = draw_distribution(distribution(target, 0.5), 0.87, (0.85, 0.89), 1.0, "d")
    check_picture(svg)
    assert target.replace("\\", "\\") in svg
    assert not re.search(r"style=|<style|<use|href|<image|<!DOCTYPE|metadata", svg)


def words_of(svg: str) -> str:
    return " ".join(words for words, *_ in texts(check_picture(svg)))


def test_a_long_name_is_whole_and_hides_nothing() -> None:
    design = load_design(EXAMPLES / "demo.yaml")
    target = score(design).targets[0]
    renamed = tuple(replace(entry, label=LONG) if entry.name == "hand_eye" else entry for entry in target.contributors)
    assert f"{LONG} tx" in words_of(draw_shares(renamed, "tip"))
    assert f"{LONG} tx" in words_of(draw_budgets(target, replace(target, contributors=renamed)))
    curves = tolerance_curves(design, "tip")
    long = replace(curves, curves=tuple(replace(curve, label=LONG) for curve in curves.curves))
    assert words_of(draw_tolerances(long)).count(LONG) == len(curves.curves)

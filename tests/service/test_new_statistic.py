"""A statistic is one row: whoever adds it meets it in document, score, simulation, optimiser, gate and report."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from copied_sources import commands_on, copy_sources, edit, path_of, refusal, tailstack
from gate_scenes import judge_files, of_rule, plain_record, waivers, write_document

from plain_data import EVERY

ROW = """    Statistic(
        name="twice_mean", meaning="twice the mean", headline="twice the mean{of}",
        sentence="twice the mean of {error} is",
        reads=(), of_law=lambda law: 2 * law.mean_norm_mm, convex=True,
        mixture=lambda quantile: tuple((level, 2 * weight) for level, weight in from_quantile(0.0)),
        of_trials=lambda trials, quantile, limit: (
            2 * trials.mean()[0], tuple(2 * end for end in trials.mean()[1])
        ),
    ),
"""


def asked(*requirements: dict[str, object]) -> dict[str, object]:
    stated = [{"name": f"r{k}", "limit_mm": 0.2} | each for k, each in enumerate(requirements)]
    return EVERY["mean_and_tail"] | {"requirements": stated}


@pytest.mark.long
def test_a_row_is_met_everywhere(tmp_path: Path) -> None:
    source = copy_sources(tmp_path)
    edit(source / "tailstack" / "statistic.py", ("STATISTICS = (\n", f"STATISTICS = (\n{ROW}"))
    file = write_document(tmp_path / "design.yaml", asked({"statistic": "mean"}, {"statistic": "twice_mean"}))
    with commands_on(os.environ | {"PYTHONPATH": path_of(source)}) as copy:
        first = json.loads(tailstack(copy, tmp_path, "score", str(file), "--json"))["verdict"]["checks"]
        drawn = json.loads(tailstack(copy, tmp_path, "verify", str(file), "--trials", "9000", "--json"))["verdict"]
        for mean, twice in (first, drawn["checks"]):
            assert twice["value"] == pytest.approx(2 * mean["value"], rel=1e-12)
            assert twice["interval"] == pytest.approx([2 * end for end in mean["interval"]], rel=1e-12)
            assert (twice["headline"], twice["status"]) == ("twice the mean", "fail")
        tailstack(copy, tmp_path, "gate", str(file), "--mode", "analytic", "--format=json=gate.json")
        judged = json.loads((tmp_path / "gate.json").read_text(encoding="utf-8"))["findings"]
        assert sum(finding["rule"] == "statistic" for finding in judged) == 2
        tailstack(copy, tmp_path, "report", str(file), "-o", "report.html")
        assert "twice the mean" in (tmp_path / "report.html").read_text(encoding="utf-8")
        free = {"rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5}}
        write_document(file, asked({"statistic": "twice_mean", "limit_mm": 0.9}) | {"optimise": free})
        answer = json.loads(tailstack(copy, tmp_path, "optimise", str(file), "--json"))
        (check,) = answer["certificate"]["verification"]["verdict"]["checks"]
        assert 0.99 * 0.9 < check["value"] < 0.9
        assert answer["certificate"]["relaxation"]["gap_percent"] < 0.01
        write_document(file, asked({"statistic": "twice_mean", "quantile": 0.9}))
        assert "does not read quantile" in refusal(copy, tmp_path, "score", str(file))


def test_the_gate_judges_statistics_by_their_own_values_and_no_waiver_of_p95_covers_them() -> None:
    stated = asked({"statistic": "mean"}, {"statistic": "probability", "limit_probability": 0.01}, {"limit_mm": 2.5})
    record = judge_files({"a.yaml": stated}, waivers=waivers(30, designs=["a.yaml"], max_value=9.0))
    mean, share = of_rule(record, "statistic")
    assert record.verdict == "fail"
    assert (mean.limit, mean.pointer, mean.suppressed_by) == (0.2, "/requirements/0/limit_mm", None)
    assert (share.limit, share.pointer, share.suppressed_by) == (0.01, "/requirements/1/limit_probability", None)
    assert share.value is not None
    assert 0.01 < share.value <= 1
    numbers = {number.requirement: number for number in record.designs[0].numbers}
    assert (numbers["r1"].unit, numbers["r1"].beyond, numbers["r1"].rule) == ("of 1", 0.2, "statistic")
    assert (numbers["r2"].status, numbers["r2"].rule) == ("pass", "p95")


def test_a_statistic_that_asks_for_less_than_the_baseline_is_found() -> None:
    loose: dict[str, object] = {"limit_mm": 2.5}
    largest = loose | {"statistic": "max_of_n"}
    before = judge_files({"a.yaml": asked({"statistic": "cvar"} | loose, {"n": 20} | largest)})
    now = asked({"statistic": "mean"} | loose, {"n": 5} | largest)
    record = judge_files({"a.yaml": now}, baseline=plain_record(before))
    found = " ".join(finding.message for finding in of_rule(record, "limit-relaxed"))
    assert "limits the mean, and limited the cvar" in found
    assert "quantile lowered" in found

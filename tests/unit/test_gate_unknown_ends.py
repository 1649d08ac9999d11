"""A score beyond its range of validity leaves as JSON: its interval has no upper end, not an infinite one."""

from __future__ import annotations

import json
from pathlib import Path

from tailstack import load_design, score
from tailstack.design import design_to_data
from tailstack_service.documents import to_json
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.schemas import read_record

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "small_cluster_far_target.yaml"


def test_an_unknown_upper_end_is_null_and_never_passes() -> None:
    data = design_to_data(load_design(EXAMPLE))
    data["requirements"] = [
        {"name": "lenient", "limit_mm": 5000.0},
        {"name": "units", "limit_mm": 5000.0, "risk": "per_unit", "min_yield": 0.9},
    ]
    for view in data["views"]:
        view["fiducial_noise_px"] = view["target_noise_px"] = 1.2
    result = score(load_design(data))
    assert result.validity.status == "not valid"
    document = json.loads(to_json(result))
    assert [check["interval_mm"][1] for check in document["verdict"]["checks"]] == [None, None]
    assert [check["status"] for check in document["verdict"]["checks"]] == ["inconclusive", "inconclusive"]
    assert read_record("score", to_json(result)) == result
    text = " ".join(OPERATIONS["score"].write(result).split())
    assert "no upper end is known" in text
    assert "at least 0.000" not in text  # says nothing
    assert "so whether it keeps the limit of 5000 mm is open" in text
    for finding in result.verdict.findings:  # nothing is close to a limit of 5 m
        assert "too close" not in finding.message

"""Every design that ships, computed once: score, check and report hold together, and the report is verified."""

from __future__ import annotations

import numpy as np
import pytest
from service_scenes import EXAMPLES

from tailstack import load_design
from tailstack.design import design_to_data
from tailstack_service.audit import audit
from tailstack_service.documents import to_json
from tailstack_service.report.assembling import ReportContents, compute_report

DESIGNS = {
    path.stem if path.parent == EXAMPLES else f"{path.parent.name}-{path.stem}": path
    for path in sorted(EXAMPLES.rglob("*.yaml"))
    if "schema: tailstack/design/1" in path.read_text(encoding="utf-8")
}


# One of each kind: seats, regions, robots, files of others, limits on units; all of them are scored and verified as
# text by test_plain_words.py
FIRST = (
    "clip_on", "demo", "hand_eye_report", "locators_321", "pedicle_screw", "gallery-robot_arm", "gallery-seat_from_cad",
)  # fmt: skip


@pytest.mark.long(but=FIRST)
@pytest.mark.parametrize("name", DESIGNS)
def test_its_report_holds_together_and_is_verified(name: str) -> None:
    report = compute_report(load_design(DESIGNS[name]), ReportContents(trials=4_000, seed=1))
    for target in report.score.targets:
        assert np.isfinite(target.p95_mm)
        assert target.p95_mm > 0
        assert target.law_error_mm < 1e-3 * target.p95_mm
    for estimate in report.verification.targets:
        low, high = estimate.p95_interval_mm
        assert 0 < low <= estimate.p95_mm <= high <= estimate.worst_mm
        assert estimate.cvar95_mm > estimate.p95_mm
    assert report.score.provenance.design_sha256 == report.verification.provenance.design_sha256
    assert report.allowances
    for entry in report.allowances:  # every tolerance has room to its limit, or a reason why it has none
        assert (entry.slack is None) == (entry.status not in ("spare", "too wide"))
        if entry.slack is not None:
            assert (entry.slack > 0) == (entry.status == "spare")
    assert design_to_data(load_design(report.design)) == report.design
    found = audit(to_json(report), "x", fast=True)
    assert found.verdict == "verified", [
        detail for asked in found.questions for detail in (asked.words, *asked.details)
    ]

"""A gate as GitLab's code quality report: a subset of the Code Climate format, findings at lines of a merge request.

GitLab reads ``description``, ``check_name``, ``fingerprint``, ``severity``, ``location.path`` and
``location.lines.begin``, keeps one finding of a fingerprint, and knows no accepted findings: those of waivers are left
out.
"""

from __future__ import annotations

from typing import Any

from tailstack.json_text import write_json

from .places import counts, fingerprints
from .records import GateFinding, GateRecord

UNJUDGED = ("invalid-design", "invalid-input", "not-evaluated")


def gitlab_text(record: GateRecord) -> str:
    """A list of findings, [] where there are none."""
    reported = [
        _entry(record, finding, print_)
        for finding, print_ in zip(record.findings, fingerprints(record.findings), strict=True)
        if finding.suppressed_by is None
    ]
    return write_json(reported, indent=2) + "\n"


def _entry(record: GateRecord, finding: GateFinding, print_: str) -> dict[str, Any]:
    return {
        "description": finding.message,
        "check_name": f"tailstack/{finding.rule}",
        "fingerprint": print_,
        "severity": _severity(record, finding),
        "location": {"path": finding.file, "lines": {"begin": finding.line or 1}},
    }


def _severity(record: GateRecord, finding: GateFinding) -> str:
    """blocker: nothing was judged.  critical, major: fails the gate, as error, as warning.  minor, info: does not."""
    if finding.rule in UNJUDGED:
        return "blocker"
    if counts(record, finding):
        return "critical" if finding.severity == "error" else "major"
    return "info" if finding.severity == "note" else "minor"

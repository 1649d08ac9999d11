"""A gate as SARIF 2.1.0 (OASIS): for code scanning and every viewer that reads it."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any
from urllib.parse import quote

from tailstack.json_text import write_json

from .places import fingerprints
from .records import GateFinding, GateRecord
from .rules import RULES, Rule

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def sarif_text(record: GateRecord) -> str:
    """One run; what a waiver accepts stays in it, suppressed.  Columns count characters."""
    order = {name: index for index, name in enumerate(RULES)}
    run = {
        "tool": {
            "driver": {
                "name": "tailstack",
                "version": record.provenance.tailstack_version,
                "rules": [_rule(rule) for rule in RULES.values()],
            }
        },
        "columnKind": "unicodeCodePoints",
        "invocations": [
            {
                # what could not be judged is not a run that found nothing
                "executionSuccessful": record.verdict != "not evaluated",
                "exitCode": record.exit_code,
            }
        ],
        "results": [
            _result(finding, order[finding.rule], print_)
            for finding, print_ in zip(record.findings, fingerprints(record.findings), strict=True)
        ],
        "properties": {
            "verdict": record.verdict,
            "mode": record.mode,
            "seed": record.seed,
            "policySha256": record.provenance.policy_sha256,
            "notJudged": [
                {"file": design.file, "requirement": entry.requirement, "target": entry.target, "reason": entry.reason}
                for design in record.designs
                for entry in design.not_judged
            ],
            "notIncluded": list(record.provenance.not_included),
        },
    }
    return write_json({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2) + "\n"


def _rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "name": "".join(part.capitalize() for part in rule.id.split("-")),
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.page.split("\n\n")[0].replace("\n", " ")},
        "help": {"text": rule.page, "markdown": rule.page},
        "defaultConfiguration": {"level": rule.severity},
        "properties": {"tags": ["tolerance"]},
    }


def _result(finding: GateFinding, index: int, print_: str) -> dict[str, Any]:
    # A viewer of code needs a line: what is about a whole document stands at its first.
    region = {"startLine": finding.line or 1} | ({"startColumn": finding.column} if finding.column else {})
    place: dict[str, Any] = {"artifactLocation": {"uri": file_uri(finding.file)}, "region": region}
    location: dict[str, Any] = {"physicalLocation": place}
    if finding.pointer:
        location["logicalLocations"] = [{"fullyQualifiedName": finding.pointer, "kind": "member"}]
    result: dict[str, Any] = {
        "ruleId": finding.rule,
        "ruleIndex": index,
        "level": finding.severity,
        "message": {"text": finding.message},
        "locations": [location],
        # GitHub tells alerts of two runs apart by the second of these, and would compute it from the line if absent.
        "partialFingerprints": {"tailstackFinding/v1": print_, "primaryLocationLineHash": f"{print_[:16]}:1"},
        "properties": {"value": finding.value, "limit": finding.limit},
    }
    if finding.suppressed_by is not None:
        result["suppressions"] = [{"kind": "external", "status": "accepted", "justification": finding.suppressed_by}]
    return result


def file_uri(file: str) -> str:
    """A file's name as a URI reference: relative ones stay so, for a viewer knows the root of the repository."""
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix(), safe="/")

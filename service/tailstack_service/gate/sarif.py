"""A gate as SARIF 2.1.0 (OASIS): for code scanning and every viewer that reads it."""

from __future__ import annotations

import hashlib
import json
from pathlib import PurePath
from typing import Any
from urllib.parse import quote

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
        "results": [_result(finding, order[finding.rule]) for finding in record.findings],
        "properties": {
            "verdict": record.verdict,
            "mode": record.mode,
            "seed": record.seed,
            "policySha256": record.provenance.policy_sha256,
            "notIncluded": list(record.provenance.not_included),
        },
    }
    return json.dumps({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2, ensure_ascii=False) + "\n"


def _rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.page.split("\n\n")[0].replace("\n", " ")},
        "help": {"text": rule.page},
        "defaultConfiguration": {"level": rule.severity},
    }


def _result(finding: GateFinding, index: int) -> dict[str, Any]:
    location: dict[str, Any] = {"physicalLocation": {"artifactLocation": {"uri": file_uri(finding.file)}}}
    if finding.line is not None:
        region = {"startLine": finding.line}
        location["physicalLocation"]["region"] = region | ({"startColumn": finding.column} if finding.column else {})
    if finding.pointer:
        location["logicalLocations"] = [{"fullyQualifiedName": finding.pointer, "kind": "member"}]
    result: dict[str, Any] = {
        "ruleId": finding.rule,
        "ruleIndex": index,
        "level": finding.severity,
        "message": {"text": finding.message},
        "locations": [location],
        "partialFingerprints": {"tailstackFinding/v1": fingerprint(finding)},
        "properties": {"value": finding.value, "limit": finding.limit},
    }
    if finding.suppressed_by is not None:
        result["suppressions"] = [{"kind": "external", "status": "accepted", "justification": finding.suppressed_by}]
    return result


def fingerprint(finding: GateFinding) -> str:
    """The same for the same rule at the same place of the same document, whatever line or value it has today."""
    named = finding.message.split(": ", 1)[0]  # requirement and target, where the rule has them
    parts = (finding.rule, finding.file, finding.pointer, named if ", target " in named else "")
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def file_uri(file: str) -> str:
    """A file's name as a URI reference: relative ones stay so, for a viewer knows the root of the repository."""
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix(), safe="/")

"""A gate's record in the formats that pipelines read, and the table of all formats.

sarif: SARIF 2.1.0 (OASIS), for code scanning and every viewer that reads it.
junit: JUnit XML (the form that Jenkins publishes as junit-10.xsd): a suite a design, a case a number or rule.  failure:
a finding counts.  error: nothing was judged.  skipped: a waiver accepts it, or nothing was held against it.  What was
said and does not count is in system-out of its case.  No times are given: they are not reproducible.
github: workflow commands of GitHub Actions.  GitHub shows ten errors, ten warnings and ten notices of a step and says
nothing of the others, and it refuses a summary of more than 1 MiB altogether.
gitlab: the code quality report, a subset of the Code Climate format.  GitLab reads ``description``, ``check_name``,
``fingerprint``, ``severity``, ``location.path`` and ``location.lines.begin``, keeps one finding of a fingerprint, and
knows no accepted findings: those of waivers are left out.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import PurePath, PurePosixPath
from posixpath import normpath
from typing import Any
from urllib.parse import quote
from xml.sax.saxutils import escape, quoteattr

from tailstack.json_text import write_json

from ..documents import to_json
from .records import GatedDesign, GateFinding, GateRecord, counts
from .rules import RULES, Rule
from .text import count_not_judged, gate_text, markdown_text, name_place


def name_from_root(record: GateRecord, prefix: str) -> GateRecord:
    """The record with files named from the root of the repository.

    prefix: the way from that root to the directory that the names are relative to, with slashes; "" is the root.
    """
    if not prefix:
        return record
    return replace(
        record,
        findings=tuple(replace(finding, file=_join_name(prefix, finding.file)) for finding in record.findings),
        designs=tuple(replace(design, file=_join_name(prefix, design.file)) for design in record.designs),
    )


def _join_name(prefix: str, file: str) -> str:
    if PurePosixPath(file).is_absolute() or file.startswith("<"):
        return file
    return normpath(f"{prefix}/{file}")


def fingerprint_findings(findings: Iterable[GateFinding]) -> list[str]:
    """One for each finding: the same for the same rule at the same place of the same document, whatever line or value
    it has today.  Several findings of a rule at one place are told apart by their order."""
    seen: Counter[tuple[str, ...]] = Counter()
    prints = []
    for finding in findings:
        named = finding.message.split(": ", 1)[0]  # requirement and target, where the rule has them
        parts = (finding.rule, finding.file, finding.pointer, named if ", target " in named else "")
        again = (str(seen[parts]),) if seen[parts] else ()
        seen[parts] += 1
        prints.append(hashlib.sha256("\0".join((*parts, *again)).encode()).hexdigest())
    return prints


def cut_text(text: str, most_bytes: int) -> str:
    """Text of at most so many bytes of UTF-8, cut at the end of a line, the rest told."""
    content = text.encode()
    if len(content) <= most_bytes:
        return text
    closing = "\n(cut here: the rest is in the record)\n"
    kept = content[: max(most_bytes - len(closing), 0)].decode(errors="ignore")
    whole = kept[: kept.rfind("\n") + 1] + closing
    return whole if len(whole.encode()) <= most_bytes else ""


SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def sarif_text(record: GateRecord) -> str:
    """One run; what a waiver accepts stays in it, suppressed.  Columns count characters."""
    order = {name: index for index, name in enumerate(RULES)}
    run = {
        "tool": {
            "driver": {
                "name": "tailstack",
                "version": record.provenance.tailstack_version,
                "rules": [_sarif_rule(rule) for rule in RULES.values()],
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
            _sarif_result(finding, order[finding.rule], print_)
            for finding, print_ in zip(record.findings, fingerprint_findings(record.findings), strict=True)
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


def _sarif_rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "name": "".join(part.capitalize() for part in rule.id.split("-")),
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.page.split("\n\n")[0].replace("\n", " ")},
        "help": {"text": rule.page, "markdown": rule.page},
        "defaultConfiguration": {"level": rule.severity},
        "properties": {"tags": ["tolerance"]},
    }


def _sarif_result(finding: GateFinding, index: int, print_: str) -> dict[str, Any]:
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


UNJUDGED = ("invalid-design", "invalid-input", "not-evaluated")


def gitlab_text(record: GateRecord) -> str:
    """A list of findings, [] where there are none."""
    reported = [
        _gitlab_issue(record, finding, print_)
        for finding, print_ in zip(record.findings, fingerprint_findings(record.findings), strict=True)
        if finding.suppressed_by is None
    ]
    return write_json(reported, indent=2) + "\n"


def _gitlab_issue(record: GateRecord, finding: GateFinding, print_: str) -> dict[str, Any]:
    return {
        "description": finding.message,
        "check_name": f"tailstack/{finding.rule}",
        "fingerprint": print_,
        "severity": _gitlab_severity(record, finding),
        "location": {"path": finding.file, "lines": {"begin": finding.line or 1}},
    }


def _gitlab_severity(record: GateRecord, finding: GateFinding) -> str:
    """blocker: nothing was judged.  critical, major: fails the gate, as error, as warning.  minor, info: does not."""
    if finding.rule in UNJUDGED:
        return "blocker"
    if counts(finding, record.fail_level):
        return "critical" if finding.severity == "error" else "major"
    return "info" if finding.severity == "note" else "minor"


NOT_EVALUATED, NOT_JUDGED = "not-evaluated", "not-judged"
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 cannot hold


@dataclass(frozen=True, slots=True)
class _JunitCase:
    name: str
    findings: tuple[GateFinding, ...]


def junit_text(record: GateRecord) -> str:
    """Suites in the order of the designs, then of other files that findings are about: policy, waivers, baseline."""
    suites = []
    files = [design.file for design in record.designs]
    for design in record.designs:
        suites.append((design.file, _junit_cases(design, [f for f in record.findings if f.file == design.file])))
    for other in dict.fromkeys(finding.file for finding in record.findings if finding.file not in files):
        suites.append((other, _group_by_rule([finding for finding in record.findings if finding.file == other])))
    written = [_junit_suite(record, name, cases) for name, cases in suites]
    total = [sum(numbers[k] for numbers, _ in written) for k in range(4)]
    head = f'<testsuites name="tailstack gate" tests="{total[0]}" failures="{total[1]}" errors="{total[2]}">'
    body = [line for _, lines in written for line in lines]
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', head, *body, "</testsuites>"]) + "\n"


def _junit_cases(design: GatedDesign, findings: list[GateFinding]) -> list[_JunitCase]:
    cases = []
    left = list(findings)
    for number in design.numbers:
        opening = f"{number.requirement}, target {number.target}: "
        about = [f for f in left if f.rule in (number.rule, "inconclusive") and f.message.startswith(opening)]
        left = [finding for finding in left if finding not in about]
        cases.append(_JunitCase(f"{number.rule}: {number.requirement}, target {number.target}", tuple(about)))
    for requirement in dict.fromkeys(entry.requirement for entry in design.not_judged):
        about = [f for f in left if f.rule == NOT_JUDGED and f.message.startswith(f"{requirement} (")]
        left = [finding for finding in left if finding not in about]
        cases += [_JunitCase(f"{NOT_JUDGED}: {requirement}", tuple(about))] if about else []
    cases += _group_by_rule(left)
    # what is wrong may stand in another file, that of the fiducials: the design is no empty suite all the same
    return cases or [_JunitCase(NOT_EVALUATED if design.verdict == "not evaluated" else "gate", ())]


def _group_by_rule(findings: list[GateFinding]) -> list[_JunitCase]:
    rules = dict.fromkeys(finding.rule for finding in findings)
    return [_JunitCase(rule, tuple(finding for finding in findings if finding.rule == rule)) for rule in rules]


def _junit_suite(record: GateRecord, name: str, cases: list[_JunitCase]) -> tuple[tuple[int, int, int, int], list[str]]:
    lines: list[str] = []
    failures = errors = skipped = 0
    for case in cases:
        kind, findings = _decide_outcome(record, case)
        failures += kind == "failure"
        errors += kind == "error"
        skipped += kind == "skipped"
        lines += _junit_lines(name, case, kind, findings)
    counted = (len(cases), failures, errors, skipped)
    head = f'  <testsuite name={_xml_attribute(name)} tests="{len(cases)}" failures="{failures}" '
    return counted, [f'{head}errors="{errors}" skipped="{skipped}">', *lines, "  </testsuite>"]


def _decide_outcome(record: GateRecord, case: _JunitCase) -> tuple[str, list[GateFinding]]:
    """What a case comes to, and the findings that say so."""
    unjudged = [finding for finding in case.findings if finding.rule in UNJUDGED]
    counted = [finding for finding in case.findings if counts(finding, record.fail_level)]
    accepted = [finding for finding in case.findings if finding.suppressed_by is not None]
    if not case.findings and case.name == NOT_EVALUATED:
        return "error", []
    open_ones = [finding for finding in case.findings if finding.rule == NOT_JUDGED]
    kinds = (("error", unjudged), ("failure", counted), ("skipped", accepted), ("skipped", open_ones))
    for kind, found in kinds:
        if found:
            return kind, found
    return "passed", []


def _junit_lines(suite: str, case: _JunitCase, kind: str, findings: list[GateFinding]) -> list[str]:
    lines = [f"    <testcase classname={_xml_attribute(suite)} name={_xml_attribute(case.name)}>"]
    if kind == "skipped":
        reasons = "; ".join(
            dict.fromkeys(
                finding.message if finding.suppressed_by is None else f"accepted by {finding.suppressed_by}"
                for finding in findings
            )
        )
        lines.append(f"      <skipped type={_xml_attribute(case.findings[0].rule)} message={_xml_attribute(reasons)}/>")
    elif kind != "passed":
        more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
        rule, message = (
            (findings[0].rule, findings[0].message + more) if findings else (case.name, "see the other files")
        )
        opening = f"      <{kind} type={_xml_attribute(rule)} message={_xml_attribute(message)}>"
        text = "\n".join(_junit_line(finding) for finding in findings)
        lines.append(f"{opening}{_xml_text(text)}</{kind}>")
    rest = [finding for finding in case.findings if finding not in findings or kind == "skipped"]
    if rest:
        text = "\n".join(_junit_line(finding) for finding in rest)
        lines.append(f"      <system-out>{_xml_text(text)}</system-out>")
    return [*lines, "    </testcase>"] if len(lines) > 1 else [lines[0].removesuffix(">") + "/>"]


def _junit_line(finding: GateFinding) -> str:
    return f"{name_place(finding)}: {finding.severity}: {finding.message}"


def _xml_text(text: str) -> str:
    return escape(_NOT_XML.sub("\ufffd", text))


def _xml_attribute(text: str) -> str:
    return quoteattr(_NOT_XML.sub("\ufffd", " ".join(text.split())))


MOST_ANNOTATIONS = 10  # annotations of a kind in a step
SUMMARY_BYTES = 2**20
COMMANDS = {"error": "error", "warning": "warning", "note": "notice"}


def github_text(record: GateRecord) -> str:
    """One command a finding that no waiver accepts, errors first; the last place of a full kind tells how many more."""
    lines = []
    for severity, command in COMMANDS.items():
        found = [f for f in record.findings if f.severity == severity and f.suppressed_by is None]
        shown = found if len(found) <= MOST_ANNOTATIONS else found[: MOST_ANNOTATIONS - 1]
        lines += [_github_command(command, finding) for finding in shown]
        if len(found) > len(shown):
            rest = f"{len(found) - len(shown)} more: GitHub shows {MOST_ANNOTATIONS} of a kind; "
            rest += "all are in the summary and the record"
            lines.append(f"::{command} title={_escape_property('tailstack gate')}::{_escape_data(rest)}")
    accepted = sum(finding.suppressed_by is not None for finding in record.findings)
    waived = f", {accepted} accepted by waivers" if accepted else ""
    lines.append(f"tailstack gate: {record.verdict} (exit code {record.exit_code}{waived}{count_not_judged(record)})")
    return "\n".join(lines) + "\n"


def step_summary(record: GateRecord, taken_bytes: int = 0) -> str:
    """The gate as Markdown for ``$GITHUB_STEP_SUMMARY``, within what is left of its size."""
    return cut_text(markdown_text(record), SUMMARY_BYTES - taken_bytes)


def _github_command(command: str, finding: GateFinding) -> str:
    properties = [f"file={_escape_property(finding.file)}"]
    if finding.line is not None:
        properties.append(f"line={finding.line}")
        properties += [f"col={finding.column}"] if finding.column else []
    properties.append(f"title={_escape_property(f'tailstack {finding.rule}')}")
    where = f" ({finding.pointer})" if finding.pointer and finding.line is None else ""
    return f"::{command} {','.join(properties)}::{_escape_data(finding.message + where)}"


def _escape_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _escape_property(text: str) -> str:
    return _escape_data(text).replace(":", "%3A").replace(",", "%2C")


@dataclass(frozen=True, slots=True)
class Format:
    """One format of ``--format``."""

    name: str
    write: Callable[[GateRecord], bytes]
    in_repository: bool = False  # files are named from the root of the repository, see ``places``


def _json(record: GateRecord) -> bytes:
    return to_json(record) + b"\n"


def _text(record: GateRecord) -> bytes:
    return gate_text(record).encode()


def _markdown(record: GateRecord) -> bytes:
    return markdown_text(record).encode()


def _sarif(record: GateRecord) -> bytes:
    return sarif_text(record).encode()


def _junit(record: GateRecord) -> bytes:
    return junit_text(record).encode()


def _github(record: GateRecord) -> bytes:
    return github_text(record).encode()


def _gitlab(record: GateRecord) -> bytes:
    return gitlab_text(record).encode()


FORMATS: dict[str, Format] = {
    entry.name: entry
    for entry in (
        Format("text", _text),
        Format("json", _json),
        Format("markdown", _markdown),
        Format("sarif", _sarif, in_repository=True),
        Format("junit", _junit),
        Format("github", _github, in_repository=True),
        Format("gitlab", _gitlab, in_repository=True),
    )
}

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
from dataclasses import replace
from pathlib import PurePath
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

from tailstack.results.json_text import write_json

from ..documents import plain, to_json
from ..rendering.page import Page, current, write_on
from .records import GatedDesign, GateFinding, GateRecord, counts, name_place, split_findings
from .rules import RULES, Rule
from .text import describe_outcome, render_markdown, render_text


def name_from_root(record: GateRecord, name_file: Callable[[str], str]) -> GateRecord:
    """The record with files named from the root of the repository, by what knows where that is."""
    return replace(
        record,
        findings=tuple(replace(finding, file=name_file(finding.file)) for finding in record.findings),
        designs=tuple(replace(design, file=name_file(design.file)) for design in record.designs),
    )


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
    text = content[: max(most_bytes - len(closing), 0)].decode(errors="ignore")
    text = text[: text.rfind("\n") + 1] + closing
    return text if len(text.encode()) <= most_bytes else ""


# --- sarif --------------------------------------------------------------------------------------------

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def render_sarif(record: GateRecord) -> str:
    """One run; what a waiver accepts stays in it, suppressed.  Columns count characters."""
    order = {name: index for index, name in enumerate(RULES)}
    run = {
        "tool": {
            "driver": {
                "name": "tailstack",
                "version": record.provenance.tailstack_version,
                "rules": [_write_sarif_rule(rule) for rule in RULES.values()],
            }
        },
        "columnKind": "unicodeCodePoints",
        # what could not be judged is not a run that found nothing
        "invocations": [{"executionSuccessful": record.verdict != "not evaluated", "exitCode": record.exit_code}],
        "results": [
            _write_sarif_result(finding, order[finding.rule], fingerprint)
            for finding, fingerprint in zip(record.findings, fingerprint_findings(record.findings), strict=True)
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


def _write_sarif_rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "name": "".join(part.capitalize() for part in rule.id.split("-")),
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.page.split("\n\n")[0].replace("\n", " ")},
        "help": {"text": rule.page, "markdown": rule.page},
        "defaultConfiguration": {"level": rule.severity},
        "properties": {"tags": ["tolerance"]},
    }


def _write_sarif_result(finding: GateFinding, index: int, fingerprint: str) -> dict[str, Any]:
    # A viewer of code needs a line: what is about a whole document stands at its first.
    region = {"startLine": finding.line or 1} | ({"startColumn": finding.column} if finding.column else {})
    place: dict[str, Any] = {"artifactLocation": {"uri": write_uri(finding.file)}, "region": region}
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
        "partialFingerprints": {"tailstackFinding/v1": fingerprint, "primaryLocationLineHash": f"{fingerprint[:16]}:1"},
        "properties": {"value": finding.value, "limit": finding.limit},
    }
    if finding.suppressed_by is not None:
        result["suppressions"] = [{"kind": "external", "status": "accepted", "justification": finding.suppressed_by}]
    return result


def write_uri(file: str) -> str:
    """A file's name as a URI reference: relative ones stay so, for a viewer knows the root of the repository."""
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix(), safe="/")


# --- gitlab -------------------------------------------------------------------------------------------

UNJUDGED = ("invalid-design", "invalid-input", "not-evaluated")


def render_gitlab(record: GateRecord) -> str:
    """A list of findings, [] where there are none."""
    reported = [
        _write_gitlab_issue(record, finding, fingerprint)
        for finding, fingerprint in zip(record.findings, fingerprint_findings(record.findings), strict=True)
        if finding.suppressed_by is None
    ]
    return write_json(reported, indent=2) + "\n"


def _write_gitlab_issue(record: GateRecord, finding: GateFinding, fingerprint: str) -> dict[str, Any]:
    return {
        "description": finding.message,
        "check_name": f"tailstack/{finding.rule}",
        "fingerprint": fingerprint,
        "severity": _weigh_gitlab(record, finding),
        "location": {"path": finding.file, "lines": {"begin": finding.line or 1}},
    }


def _weigh_gitlab(record: GateRecord, finding: GateFinding) -> str:
    """blocker: nothing was judged.  critical, major: fails the gate, as error, as warning.  minor, info: does not."""
    if finding.rule in UNJUDGED:
        return "blocker"
    if counts(finding, record.fail_level):
        return "critical" if finding.severity == "error" else "major"
    return "info" if finding.severity == "note" else "minor"


# --- junit --------------------------------------------------------------------------------------------

NOT_EVALUATED, NOT_JUDGED = "not-evaluated", "not-judged"
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 cannot hold
_Case = tuple[str, list[GateFinding]]  # its name and what is said of it


def render_junit(record: GateRecord) -> str:
    """Suites in the order of the designs, then of other files that findings are about: policy, waivers, baseline."""
    about: dict[str, list[GateFinding]] = {design.file: [] for design in record.designs}
    for finding in record.findings:
        about.setdefault(finding.file, []).append(finding)
    suites = [(design.file, _list_cases(design, about.pop(design.file, []))) for design in record.designs]
    suites += [(file, _group_by_rule(findings)) for file, findings in about.items()]
    root = ElementTree.Element("testsuites", name="tailstack gate")
    for file, cases in suites:
        suite = ElementTree.SubElement(root, "testsuite", name=_as_xml(file))
        for name, findings in cases:
            case = ElementTree.SubElement(suite, "testcase", classname=_as_xml(file), name=_as_xml(name))
            _tell_outcome(case, record, name, findings)
        _count_outcomes(suite, "tests", "failures", "errors", "skipped")
    _count_outcomes(root, "tests", "failures", "errors")
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _count_outcomes(element: ElementTree.Element, *attributes: str) -> None:
    tags = {"tests": "testcase", "failures": "failure", "errors": "error", "skipped": "skipped"}
    element.attrib |= {name: str(sum(1 for _ in element.iter(tags[name]))) for name in attributes}


def _list_cases(design: GatedDesign, findings: list[GateFinding]) -> list[_Case]:
    cases: list[_Case] = []
    for number in design.numbers:
        name = f"{number.requirement}, target {number.target}"
        about = [
            finding
            for finding in findings
            if finding.rule in (number.rule, "inconclusive")
            and finding.message.startswith(f"{name}: ")
            and (finding.value, finding.limit)
            == (number.judged_value, number.judged_limit)  # two limits may be called the same
        ]
        findings = [finding for finding in findings if finding not in about]
        cases.append((f"{number.rule}: {name}", about))
    for requirement in dict.fromkeys(entry.requirement for entry in design.not_judged):
        about = [f for f in findings if f.rule == NOT_JUDGED and f.message.startswith(f"{requirement} (")]
        findings = [finding for finding in findings if finding not in about]
        cases += [(f"{NOT_JUDGED}: {requirement}", about)] if about else []
    cases += _group_by_rule(findings)
    # what is wrong may stand in another file, that of the fiducials: the design is no empty suite all the same
    return cases or [(NOT_EVALUATED if design.verdict == "not evaluated" else "gate", [])]


def _group_by_rule(findings: list[GateFinding]) -> list[_Case]:
    groups: dict[str, list[GateFinding]] = {}
    for finding in findings:
        groups.setdefault(finding.rule, []).append(finding)
    return list(groups.items())


def _decide_outcome(record: GateRecord, name: str, findings: list[GateFinding]) -> tuple[str, list[GateFinding]]:
    """What a case comes to, and the findings that say so."""
    if not findings and name == NOT_EVALUATED:
        return "error", []
    outcomes = (
        ("error", [finding for finding in findings if finding.rule in UNJUDGED]),
        ("failure", [finding for finding in findings if counts(finding, record.fail_level)]),
        ("skipped", [finding for finding in findings if finding.suppressed_by is not None]),
        ("skipped", [finding for finding in findings if finding.rule == NOT_JUDGED]),
    )
    return next(((kind, decisive) for kind, decisive in outcomes if decisive), ("passed", []))


def _tell_outcome(case: ElementTree.Element, record: GateRecord, name: str, findings: list[GateFinding]) -> None:
    """Elements below a case."""
    kind, decisive = _decide_outcome(record, name, findings)
    rest = [finding for finding in findings if finding not in decisive]
    if kind == "skipped":
        reasons = [f.message if f.suppressed_by is None else f"accepted by {f.suppressed_by}" for f in decisive]
        message = _as_xml("; ".join(dict.fromkeys(reasons)))
        ElementTree.SubElement(case, kind, type=findings[0].rule, message=message)
        rest = findings
    elif kind != "passed":
        rule, message = (decisive[0].rule, decisive[0].message) if decisive else (name, "see the other files")
        message += f" (and {len(decisive) - 1} more)" if len(decisive) > 1 else ""
        told = ElementTree.SubElement(case, kind, type=rule, message=_as_xml(message))
        told.text = _write_findings(decisive)
    if rest:
        ElementTree.SubElement(case, "system-out").text = _write_findings(rest)


def _write_findings(findings: list[GateFinding]) -> str:
    lines = [f"{name_place(finding)}: {finding.severity}: {finding.message}" for finding in findings]
    return _NOT_XML.sub("\ufffd", "\n".join(lines))


def _as_xml(text: str) -> str:
    """One line that XML can hold."""
    return _NOT_XML.sub("\ufffd", " ".join(text.split()))


# --- github -------------------------------------------------------------------------------------------

MOST_ANNOTATIONS = 10  # annotations of a kind in a step
SUMMARY_BYTES = 2**20


def render_github(record: GateRecord) -> str:
    """One command a finding that no waiver accepts, errors first; the last place of a full kind tells how many more."""
    lines = []
    counted, _ = split_findings(record)
    for severity, command in (("error", "error"), ("warning", "warning"), ("note", "notice")):
        own = [finding for finding in counted if finding.severity == severity]
        shown = own if len(own) <= MOST_ANNOTATIONS else own[: MOST_ANNOTATIONS - 1]
        lines += [_write_command(command, finding) for finding in shown]
        if more := len(own) - len(shown):
            rest = f"{more} more: GitHub shows {MOST_ANNOTATIONS} of a kind; all are in the summary and the record"
            lines.append(f"::{command} title={_escape_property('tailstack gate')}::{_escape_data(rest)}")
    return "\n".join([*lines, f"tailstack gate: {describe_outcome(record)}"]) + "\n"


def render_step_summary(record: GateRecord, taken_bytes: int = 0) -> str:
    """The gate as Markdown for ``$GITHUB_STEP_SUMMARY``, within what is left of its size."""
    return cut_text(render_markdown(record), SUMMARY_BYTES - taken_bytes)


def _write_command(command: str, finding: GateFinding) -> str:
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


# --- all ----------------------------------------------------------------------------------------------


def _render_json(record: GateRecord) -> str:
    return to_json(record).decode() + "\n"


def _render_baseline(record: GateRecord) -> str:
    """The same record with a line for each field, so that a reviewer sees what changed in the one that is kept."""
    return write_json(plain(record), indent=2) + "\n"


FORMATS: dict[str, Callable[[GateRecord], str]] = {
    "text": render_text,
    "json": _render_json,
    "baseline": _render_baseline,
    "markdown": render_markdown,
    "sarif": render_sarif,
    "junit": render_junit,
    "github": render_github,
    "gitlab": render_gitlab,
}
NAMED_FROM_ROOT = ("sarif", "github", "gitlab")  # read by what knows files from the root of the repository only


def render(record: GateRecord, name: str, name_file: Callable[[str], str] | None = None) -> bytes:
    """A record in a format, the same bytes whatever the terminal is like.

    name_file: how a file is called from the root of the repository, for what knows it from there only.
    """
    if name_file is not None and name in NAMED_FROM_ROOT:
        record = name_from_root(record, name_file)
    with write_on(Page(details=current().details)):
        return FORMATS[name](record).encode()
